"""Answers from the command line and, stored next to the rig file, of an interrupted `rig init`, which can resume."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, TypeAdapter, ValidationError

from daq.store import durable
from rigs.errors import CellError, FileError, UseError
from rigs.files import read_bytes
from rigs.schema.declared_tests import Circle
from rigs.schema.feedback import Feedback
from rigs.schema.gauges import Gauge
from rigs.schema.part import Part
from rigs.schema.robot import Pose
from rigs.schema.vocabulary import Build, MeasuredBy
from rigs.yaml_text import read_yaml

_ENDING = ".init"
_MAX_BYTES = 100_000
_BEGIN_AGAIN = "remove the file, and restart"


class Answers(Part):
    """Answers of the user. Questions whose field is not set are open."""

    robot_address: str | None = Field(default=None, max_length=300)
    feedback: Feedback | None = None
    gauges: tuple[Gauge, ...] | None = Field(default=None, min_length=1, max_length=2)
    """Gauge 1 and, if present, gauge 2. The offsets on the baseline follow from `baseline_mm`."""
    baseline_mm: Annotated[float, Field(gt=0, le=10_000)] | None = None
    arm: str | None = Field(default=None, max_length=4096)
    build: Build | None = None
    """Build of the arm; None if the arm library or the file of the arm states it."""
    tool: Pose | None = None
    tolerance_mm: Annotated[float, Field(ge=0, le=1000)] | None = None
    """Error allowed by the application at the ball; 0 for no limits."""
    circle: Circle | None = None
    """Circle that starts at the position of the robot; None for a circle that is fitted later."""


def kept_in(rig_file: Path) -> Path:
    return rig_file.with_name(rig_file.name + _ENDING)


def load_answers(rig_file: Path) -> Answers:
    path = kept_in(rig_file)
    try:
        return Answers.model_validate_json(read_bytes(path, _MAX_BYTES))
    except FileNotFoundError:
        return Answers()
    except OSError as error:
        raise FileError.of_os(path, error, _BEGIN_AGAIN, code="file.unreadable") from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        problem = f"is damaged: {where} {first['msg']}".strip()
        raise FileError(str(path), problem, _BEGIN_AGAIN, code="file.invalid") from None


def keep_answers(rig_file: Path, answers: Answers) -> None:
    """Store the answers atomically, readable only by the owner."""
    path = kept_in(rig_file)
    try:
        durable.replace(path, answers.model_dump_json(exclude_unset=True, indent=1).encode(), 0o600)
    except OSError as error:
        problem = f"cannot be written: {error.strerror or error}"
        raise CellError(str(path), problem, "choose a different directory", code="output.not_writable") from None


def forget_answers(rig_file: Path) -> None:
    kept_in(rig_file).unlink(missing_ok=True)


_SECTIONS = ("g1", "g2", "feedback")
Changes = dict[str, Any]
"""Changed fields of the answers."""


@dataclass(frozen=True)
class Options:
    """Options of `rig init`; None or empty for open questions."""

    path: Path
    name: str
    measured_by: MeasuredBy
    robot: str | None
    ports: tuple[str, ...]
    places: tuple[str, ...]
    """Ports of g1 and g2, if given."""
    keys: dict[str, dict[str, Any]]
    """Values of --key for the sections g1, g2 and feedback."""
    given: Changes
    """Answers that an option gives as they are; the tool as text."""
    circle_here: bool | None
    radius_mm: float | None
    listen_s: float
    modbus_units: tuple[int, ...]


def keys_of(texts: Sequence[str]) -> dict[str, dict[str, Any]]:
    keys: dict[str, dict[str, Any]] = {section: {} for section in _SECTIONS}
    for text in texts:
        place, equals, value = text.partition("=")
        section, _, key = place.partition(".")
        if not equals or section not in keys or not key:
            remedy = "write KEY=VALUE, such as --key g1.range_mm=10"
            raise UseError(f"--key {text}", "is not SECTION.KEY=VALUE", remedy)
        keys[section][key] = read_yaml(value, f"--key {text}")[1]
    return keys


def places_of(g1: str | None, g2: str | None, keys: Mapping[str, Mapping[str, Any]]) -> tuple[str, ...]:
    if g2 is not None and g1 is None:
        raise UseError("--g2", "needs --g1", "give both, or neither")
    for gauge, place in (("g1", g1), ("g2", g2)):
        if "interface" in keys[gauge] and place is None:
            option, remedy = f"--key {gauge}.interface", f"add --{gauge} PORT"
            raise UseError(option, f"needs --{gauge}", remedy)
    return tuple(place for place in (g1, g2) if place is not None)


def read_number(text: str, low: float, high: float, what: str, remedy: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high:  # also rejects NaN
        raise FileError(repr(text), f"is not {what}", remedy, code="usage")
    return value


def checked(schema: Any, fields: Any, section: str) -> Any:
    try:
        return TypeAdapter(schema).validate_python(fields)
    except ValidationError as error:
        raise key_error(error, section) from None


def with_keys(schema: Any, part: Part, keys: Mapping[str, Any], section: str) -> Any:
    return checked(schema, {**part.model_dump(mode="json", exclude_unset=True), **keys}, section) if keys else part


def has_keys(schema: Any, part: Part, keys: Mapping[str, Any]) -> bool:
    return bool(with_keys(schema, part, keys, "--key") == part)


def key_error(error: ValidationError, section: str) -> FileError:
    """First error in the keys of a section, with the option that corrects it."""
    first = error.errors(include_url=False)[0]
    key = next((str(step) for step in reversed(first["loc"]) if isinstance(step, str)), "interface")
    problem = first["msg"].removeprefix("Value error, ")
    if section.startswith("--"):
        return FileError(section, problem, "see rig init --help", code="rig_file.invalid")
    remedy = f"give --key {section}.{key}=…; rig interfaces lists the keys"
    return FileError(f"{section}.{key}", problem, remedy, code="usage")
