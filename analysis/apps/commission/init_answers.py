"""What is answered already: by the command line, and before, so that a second run goes on.

The answers are kept beside the rig file until that is written. They are data that a person could have changed: read
bounded and checked by the schema, as a rig file is.
"""

from __future__ import annotations

import os
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
    """The answers; None where a question is open."""

    robot_address: str | None = Field(default=None, max_length=300)
    feedback: Feedback | None = None
    gauges: tuple[Gauge, ...] | None = Field(default=None, min_length=1, max_length=2)
    """Gauge 1 and, where there is one, gauge 2; their places on the baseline follow from `baseline_mm`."""
    baseline_mm: Annotated[float, Field(gt=0, le=10_000)] | None = None
    arm: str | None = Field(default=None, max_length=4096)
    build: Build | None = None
    """How the arm is built; None as long as the arm library or the arm's own file says it."""
    tool: Pose | None = None
    tolerance_mm: Annotated[float, Field(ge=0, le=1000)] | None = None
    """Error that the work allows at the ball; 0 where there are to be no limits."""
    circle: Circle | None = None
    circle_later: bool = False

    @property
    def count(self) -> int:
        """How many questions are answered."""
        return len(self.model_fields_set)


def kept_in(rig_file: Path) -> Path:
    """Return where the answers for a rig file are kept."""
    return rig_file.with_name(rig_file.name + _ENDING)


def load_answers(rig_file: Path) -> Answers:
    """Return the answers kept so far; none where nothing is kept. Raises FileError."""
    path = kept_in(rig_file)
    try:
        owner = path.lstat().st_uid
        if owner != os.geteuid():
            raise FileError(str(path), f"belongs to a different user (number {owner})", _BEGIN_AGAIN)
        return Answers.model_validate_json(read_bytes(path, _MAX_BYTES))
    except FileNotFoundError:
        return Answers()
    except OSError as error:
        raise FileError(str(path), error.strerror or str(error), _BEGIN_AGAIN) from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        raise FileError(str(path), f"is damaged: {where} {first['msg']}".strip(), _BEGIN_AGAIN) from None


def keep_answers(rig_file: Path, answers: Answers) -> None:
    """Keep the answers, whole or not at all, readable by their owner alone. Raises CellError."""
    path = kept_in(rig_file)
    try:
        durable.replace(path, answers.model_dump_json(exclude_unset=True, indent=1).encode(), 0o600)
    except OSError as error:
        raise CellError(
            str(path), f"cannot be written: {error.strerror or error}", "choose a different directory"
        ) from None


def forget_answers(rig_file: Path) -> None:
    """Remove the kept answers."""
    kept_in(rig_file).unlink(missing_ok=True)


_SECTIONS = ("g1", "g2", "feedback")


@dataclass(frozen=True)
class Options:
    """The options of `rig init`; None and empty for what is to be asked. keys: by section, `g1` to `feedback`."""

    path: Path
    name: str
    measured_by: MeasuredBy
    robot: str | None
    ports: tuple[str, ...]
    places: tuple[str, ...]
    """Where g1 and g2 are, as far as they are given."""
    keys: dict[str, dict[str, Any]]
    baseline_mm: float | None
    arm: str | None
    build: Build | None
    tool: str | None
    tolerance_mm: float | None
    circle_here: bool | None
    radius_mm: float | None
    listen_s: float
    modbus_units: tuple[int, ...]


def keys_of(texts: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return the keys of a rig file, given as `g1.range_mm=10`, by section. Raises UseError."""
    keys: dict[str, dict[str, Any]] = {section: {} for section in _SECTIONS}
    for text in texts:
        place, equals, value = text.partition("=")
        section, _, key = place.partition(".")
        if not equals or section not in keys or not key:
            raise UseError(f"--key {text}", "is not SECTION.KEY=VALUE", "write it as --key g1.range_mm=10")
        keys[section][key] = written(value, f"--key {text}")
    return keys


def places_of(g1: str | None, g2: str | None, keys: Mapping[str, Mapping[str, Any]]) -> tuple[str, ...]:
    """Return where g1 and g2 are, as far as they are given. Raises UseError for g2 alone, and for the interface of a
    gauge whose place is not given."""
    if g2 is not None and g1 is None:
        raise UseError("--g2", "needs --g1", "give both, or neither")
    for gauge, place in (("g1", g1), ("g2", g2)):
        if "interface" in keys[gauge] and place is None:
            raise UseError(f"--key {gauge}.interface", f"needs --{gauge}", f"give --{gauge} PORT as well")
    return tuple(place for place in (g1, g2) if place is not None)


def checked(schema: Any, fields: Any, section: str) -> Any:
    """Return a part of a rig file made from its keys, or of its value. Raises FileError with the first mistake."""
    try:
        return TypeAdapter(schema).validate_python(fields)
    except ValidationError as error:
        raise key_error(error, section) from None


def with_keys(schema: Any, part: Part, keys: Mapping[str, Any], section: str) -> Any:
    """Return a part of a rig file with these keys changed. Raises FileError."""
    return checked(schema, {**part.model_dump(mode="json", exclude_unset=True), **keys}, section) if keys else part


def has_keys(schema: Any, part: Part, keys: Mapping[str, Any]) -> bool:
    """Return whether a part of a rig file has these values already. Raises FileError."""
    return bool(with_keys(schema, part, keys, "--key") == part)


def key_error(error: ValidationError, section: str) -> FileError:
    """Return the first mistake in the keys of a section, and the option that corrects it."""
    first = error.errors(include_url=False)[0]
    key = next((str(step) for step in reversed(first["loc"]) if isinstance(step, str)), "interface")
    problem = first["msg"].removeprefix("Value error, ")
    if section.startswith("--"):
        return FileError(section, problem, "see rig init --help")
    return FileError(f"{section}.{key}", problem, f"give --key {section}.{key}=…; rig interfaces lists the keys")


def written(text: str, where: str) -> Any:
    """Return what was typed for a key, as YAML reads it. Raises RigFileError."""
    return read_yaml(text, where)[1]
