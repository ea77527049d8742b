"""All interfaces for a rig file, from the unions of the schemas."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

from pydantic import BaseModel

from rigs.schema.feedback import Feedback
from rigs.schema.gauges import Gauge
from rigs.schema.links import Line
from rigs.schema.part import Origin
from rigs.schema.probe import Probe

NO_DEFAULT = "line to be given"


@dataclass(frozen=True)
class Interface:
    """An interface. line: settings of the serial line, `NO_DEFAULT`, or empty. keys: specific keys.

    modem: modem lines required by the cables. timing, timing_source: default latching time of a gauge, and its source.
    """

    name: str
    kind: Literal["gauge", "robot"]
    line: str
    origin: Origin
    keys: tuple[str, ...]
    timing: str = ""
    timing_source: str = ""
    modem: str = ""


def list_interfaces() -> list[Interface]:
    return [_interface(model, "gauge") for model in models(Gauge)] + [
        _interface(model, "robot") for model in models(Feedback)
    ]


def models(union: Any) -> tuple[type[BaseModel], ...]:
    members: tuple[type[BaseModel], ...] = get_args(get_args(union)[0])
    return members


def name_of(model: type[BaseModel]) -> str:
    (name,) = get_args(model.model_fields["interface"].annotation)
    return str(name)


def _interface(model: type[BaseModel], kind: Literal["gauge", "robot"]) -> Interface:
    fields = model.model_fields
    origin: Origin = model.origin  # type: ignore[attr-defined]
    settings = ""
    if (line := fields.get("line")) is not None:
        settings = str(line.default) if isinstance(line.default, Line) else NO_DEFAULT
    keys_of_its_own = {*model.__annotations__, *(fields.keys() - Probe.model_fields.keys())} - {"interface", "timing"}
    keys = tuple(key for key in fields if key in keys_of_its_own)
    interface = Interface(name_of(model), kind, settings, origin, keys)
    if not issubclass(model, Probe):
        return interface
    modem = "; ".join(f"{cable} {lines}" for cable, lines in model.cables.items())
    return replace(interface, timing=str(fields["timing"].default), timing_source=model.timing_source, modem=modem)
