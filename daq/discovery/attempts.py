"""Attempts for a port, derived from the schemas, and the results of a search.

An interface with an unconfirmed request (`Origin.standing`) is tried only if the user names it, because the request
could have a different meaning for other instruments.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel, TypeAdapter

from daq import gauges
from daq.discovery.trial import USUAL_LINES
from daq.protocol.conversation import ConversationStep, Fault, FaultKind, Host, Item
from daq.protocol.streamed import Streamed
from rigs.interfaces import models, name_of
from rigs.load import load
from rigs.schema.feedback import Feedback
from rigs.schema.gauges import Gauge
from rigs.schema.links import Line, tcp_address
from rigs.schema.modbus import ModbusMap
from rigs.schema.probe import Probe

Sends = Literal["nothing", "requests", "all"]
"""No data, read requests only, or all data as in rigd."""

_MOST_CHANNELS = 8
STAND_IN: dict[str, Any] = {"range_mm": 100.0}
"""Substitutes for keys known only to the owner: readings are then percentages of the range."""
_MODBUS_EXAMPLE = "ur10e-cell"
"""Shipped rig with the only known Modbus register map, that of OM20 and OM30 by Baumer."""
_GAUGE: TypeAdapter[Any] = TypeAdapter(Gauge)


@dataclass(frozen=True)
class Attempt:
    """Gauges on a port (one, or one per channel), line settings, and the data that may be sent."""

    gauges: tuple[Gauge, ...]
    line: Line
    sends: Sends

    @property
    def interface(self) -> str:
        return self.gauges[0].interface

    @property
    def request(self) -> bytes:
        """Request for the first reading; empty if the instrument sends unprompted."""
        host = gauges.host(self.gauges)
        return host.tick(host.connected(0).wake_ns or 0).send


def attempts(port: str, modbus_units: Sequence[int] = (1,)) -> list[Attempt]:
    """Attempts for an unknown port: listening, the line settings of the makers, then common settings."""
    candidates = list(_candidates(port, modbus_units))
    listened = [Attempt(gauges, gauges[0].line, "nothing") for gauges in candidates if _streams(gauges)]
    asked = [gauges for gauges in candidates if not _streams(gauges)]
    declared = [Attempt(gauges, gauges[0].line, "requests") for gauges in asked if _has_line(gauges)]
    if tcp_address(port):
        return declared
    by_line = sorted(declared, key=lambda attempt: [gauges.line for gauges in declared].index(attempt.line))
    # For all possible interfaces, the most common line settings come first: the first match ends the search of a port.
    usual = [
        Attempt(gauges, line, "requests")
        for line in USUAL_LINES
        for gauges in asked
        if not (_has_line(gauges) and gauges[0].line == line)
        and (line.bits == 8 or gauges[0].interface != "modbus_map")  # Modbus RTU needs all eight bits
    ]
    return [*listened, *by_line, *usual]


def named_attempts(fields: dict[str, Any]) -> list[Attempt]:
    """Attempts for an instrument that the user named by keys of the rig file; they send what rigd sends."""
    placed = {"offset_mm": 0.0, **fields}
    lines = USUAL_LINES if "line" not in fields else ()
    model = next((candidate for candidate in models(Gauge) if name_of(candidate) == fields.get("interface")), None)
    default = model.model_fields["line"].default if model else None
    first = fields.get("line", str(default) if isinstance(default, Line) else str(USUAL_LINES[0]))
    gauge = _GAUGE.validate_python({**placed, "line": first})
    others = [] if tcp_address(gauge.port) else [line for line in lines if line != gauge.line]
    return [Attempt((gauge,), line, "all") for line in [gauge.line, *others]]


def missing_keys(interface: str) -> list[str]:
    """Keys of an interface known only to the owner."""
    (model,) = (candidate for candidate in models(Gauge) if name_of(candidate) == interface)
    discovered = {"interface", "port", "offset_mm", "line"}
    return [key for key, field in model.model_fields.items() if field.is_required() and key not in discovered]


def _candidates(port: str, modbus_units: Sequence[int]) -> Iterator[tuple[Gauge, ...]]:
    for model in models(Gauge):
        assert issubclass(model, Probe)  # noqa: S101 - every gauge is one
        if model.origin.standing != "confirmed":
            continue
        if model is ModbusMap:
            example = load(_MODBUS_EXAMPLE)[0].gauges.g1
            for unit in modbus_units:
                yield (example.model_copy(update={"port": port, "offset_mm": 0.0, "unit": unit}),)
            continue
        needed = missing_keys(name_of(model))
        if tcp_address(port) or any(key not in STAND_IN for key in needed):
            continue
        fields = {"port": port, "offset_mm": 0.0, **{key: STAND_IN[key] for key in needed}}
        channels: Sequence[int] = (1,)
        if model.shares:
            most = next(bound.le for bound in model.model_fields["channel"].metadata if hasattr(bound, "le"))
            channels = range(1, min(most, _MOST_CHANNELS) + 1)
        for choice in _choices(model):
            default = model.model_fields["line"].default
            line = default if isinstance(default, Line) else USUAL_LINES[0]
            made = {**fields, **choice, "interface": name_of(model), "line": line}
            yield tuple(_GAUGE.validate_python({**made, "channel": channel}) for channel in channels)


def _streams(members: tuple[Gauge, ...]) -> bool:
    return isinstance(gauges.host(members[:1]), Streamed)


def _has_line(members: tuple[Gauge, ...]) -> bool:
    return members[0].interface == "modbus_map" or isinstance(type(members[0]).model_fields["line"].default, Line)


def _choices(model: type[BaseModel]) -> list[dict[str, str]]:
    """Settings to try for an instrument: all combinations of its enumerated keys, with the maker's usual cable.

    Other cables poll with a modem line, which may affect other devices.
    """
    placing = {"interface", "units", "cable"}
    settings = [key for key in model.model_fields if key in model.__annotations__ and key not in placing]
    several = [key for key in settings if get_origin(model.model_fields[key].annotation) is Literal]
    values = [get_args(model.model_fields[key].annotation) for key in several]
    return [dict(zip(several, chosen, strict=True)) for chosen in product(*values)]


_MOST_FAULTS = 3
"""Faults before the first reading that end an attempt. One is normal when joining a stream."""


class Probing:
    """Host side of a conversation on trial, which ends when it can no longer succeed.

    Messages sent before any data arrives configure the instrument (`OUT0`, `OUTPUT RS422`); they are suppressed if only
    requests are permitted.
    """

    def __init__(self, host: Host, sends: Sends, silences: int = 1) -> None:
        """silences: number of time-outs that end it."""
        self._host = host
        self._silences = silences
        self._sends = sends
        self._opening = b""
        self._faults = 0
        self._has_read = False

    def connected(self, now_ns: int) -> ConversationStep:
        step = self._host.connected(now_ns)
        self._opening = step.send
        return self._limited(step)

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        return self._limited(self._host.received(data, now_ns))

    def tick(self, now_ns: int) -> ConversationStep:
        return self._limited(self._host.tick(now_ns))

    def handle_link_loss(self, now_ns: int) -> tuple[Item, ...]:
        return self._host.handle_link_loss(now_ns)

    def _limited(self, step: ConversationStep) -> ConversationStep:
        for item in step.items:
            if not isinstance(item, Fault):
                self._has_read = True
            elif item.kind is not FaultKind.DEVICE_ERROR:
                self._faults += 1
                self._silences -= item.kind is FaultKind.SILENT
        hopeless = not self._has_read and (self._faults >= _MOST_FAULTS or self._silences <= 0)
        silent = self._sends == "nothing" or (self._sends != "all" and step.send == self._opening)
        return replace(step, send=b"" if silent else step.send, hang_up=step.hang_up or hopeless)


@dataclass(frozen=True)
class FoundGauge:
    """A responding gauge. also: other matching interfaces."""

    gauge: Gauge
    reading_mm: float
    rate_hz: float
    sends: Sends
    also: tuple[str, ...] = ()

    @property
    def place(self) -> str:
        return f"{self.gauge.port}#{self.gauge.channel}" if self.gauge.shares else self.gauge.port

    @property
    def lacks(self) -> tuple[str, ...]:
        """Keys still required from the owner. Until they are known, readings are percentages of the range."""
        if self.sends == "all":  # named by the user with all keys
            return ()
        return tuple(key for key in missing_keys(self.gauge.interface) if key in STAND_IN)

    def to_dict(self) -> dict[str, Any]:
        plain = self.gauge.model_dump(mode="json", exclude_defaults=True, exclude={"offset_mm", *self.lacks})
        fields = {"interface": self.gauge.interface, "line": str(self.gauge.line), **plain}
        unit = "reading_percent" if self.lacks else "reading_mm"
        return {
            "place": self.place, "gauge": fields, unit: self.reading_mm, "rate_hz": round(self.rate_hz, 1),
            "lacks": list(self.lacks), "also": list(self.also),
        }  # fmt: skip


@dataclass(frozen=True)
class PortReport:
    port: str
    description: str = ""
    gauges: tuple[FoundGauge, ...] = ()
    problem: str = ""
    remedy: str = ""

    def to_dict(self) -> dict[str, Any]:
        return {**asdict(self), "gauges": [gauge.to_dict() for gauge in self.gauges]}


@dataclass(frozen=True)
class RobotReport:
    address: str
    feedback: Feedback | None = None
    joints_deg: tuple[float, ...] = ()
    rate_hz: float = 0.0
    units_sure: bool = True
    """False if the numbers could be degrees or radians."""
    reported: str = ""
    """Last warning of the controller."""
    problem: str = ""
    remedy: str = ""

    def to_dict(self) -> dict[str, Any]:
        feedback = self.feedback.model_dump(mode="json", exclude_defaults=True) if self.feedback else None
        return {**vars(self), "feedback": feedback}
