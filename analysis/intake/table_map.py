"""The map of a table in the format of an instrument: meaning and unit of columns, and form of orientations.

A map is a YAML file that the operator reads, edits and passes to an import. A run stores the map it was imported with.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, StringConstraints, ValidationError, model_validator

from rigs.errors import FileError
from rigs.files import read_bytes
from rigs.problems import RigFileError, problems_of
from rigs.schema.part import Part
from rigs.schema.vocabulary import TestName
from rigs.yaml_text import flow, read_yaml

_MOST_BYTES = 100_000
MAPPED: TestName = "pose"
"""The test whose tables may have the format of an instrument and are read with a proposed map."""
OPEN = "?"
"""Placeholder in a proposed map for a decision by the operator."""
Name = Annotated[str, StringConstraints(min_length=1, max_length=200)]
Names = Annotated[tuple[Name, ...], Field(min_length=1, max_length=16)]
Separator = Literal["comma", "semicolon", "tab", "bar", "blanks"]
SEPARATORS: dict[Separator, str] = {"comma": ",", "semicolon": ";", "tab": "\t", "bar": "|", "blanks": " "}
AngleUnit = Literal["deg", "rad"]
TO_MM: dict[str, float] = {"mm": 1.0, "m": 1000.0, "cm": 10.0, "um": 1e-3, "in": 25.4}
ANGLE_UNITS = ("deg", "rad")
TO_DEG: dict[str, float] = {
    "deg": 1.0, "rad": 57.29577951308232, "gon": 0.9, "turn": 360.0, "1/1024 turn": 360 / 1024,
    "1/4096 turn": 360 / 4096, "1/16384 turn": 360 / 16384, "1/65536 turn": 360 / 65536, "300/1024 deg": 300 / 1024,
}  # fmt: skip
"""Units of joints, usual ones first. Counts are those of magnetic encoders of 10 to 16 bits, and of servos of the
Dynamixel X and Feetech STS (4096 a turn) and Dynamixel AX series (1024 over 300°).
"""
TO_UNIT: dict[str, dict[str, float]] = {
    "deg": TO_DEG,
    "mm": TO_MM,
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0},
}
"""Conversion factors to the unit suffixes of the columns of docs/tables.md."""
TurnForm = Annotated[str, StringConstraints(pattern=r"^(quaternion|rotation vector|matrix|(moving|fixed) [xyz]{3})$")]
TURN_COLUMNS = {"quaternion": 4, "rotation vector": 3, "matrix": 9}


class FileLayout(Part):
    """Layout of a text file. Lines count from 1; 0 means none."""

    encoding: Literal["utf-8", "utf-16", "cp1252"] = "utf-8"
    separator: Separator = "comma"
    decimal: Literal["point", "comma"] = "point"
    comment: Annotated[str, StringConstraints(max_length=3)] = ""
    header_line: int = Field(default=1, ge=0)
    units_line: int = Field(default=0, ge=0)
    first_line: int = Field(default=2, ge=1)
    sheet: Annotated[str, StringConstraints(max_length=200)] = ""
    """Sheet of a workbook."""
    topic: Annotated[str, StringConstraints(max_length=500)] = ""
    """Topic of the poses in a bag."""


Unit = str | tuple[str, ...]
"""Unit of all columns, or the unit of each."""


class ColumnsWithUnit(Part):
    known_units: ClassVar[Mapping[str, float]]
    columns: Names
    unit: Unit

    @property
    def units(self) -> tuple[str, ...]:
        return (self.unit,) * len(self.columns) if isinstance(self.unit, str) else self.unit

    @property
    def factors(self) -> list[float]:
        return [self.known_units[unit] for unit in self.units]

    @model_validator(mode="after")
    def _check_units(self) -> Self:
        unknown = [unit for unit in self.units if unit not in self.known_units]
        if unknown or len(self.units) != len(self.columns):
            fact = f"unit {unknown[0]!r} is unknown" if unknown else f"has {len(self.units)} units"
            known = ", ".join(self.known_units)
            raise ValueError(f"{fact}; give one of {known}, or a list of {len(self.columns)}, one for each column")
        return self


class Angles(ColumnsWithUnit):
    """Columns of angles in the order of the axes."""

    known_units = TO_DEG
    reversed: Annotated[tuple[Annotated[int, Field(ge=1, le=16)], ...], Field(max_length=16)] = ()
    """Axes, from 1, with a sense opposite to the rig file."""
    zeros_deg: Annotated[tuple[float, ...], Field(max_length=16)] = ()
    """Angles to add to the axes after that, if the columns count from other zeros than the rig file; empty for none."""

    def has_small_zeros(self, most_deg: float) -> bool:
        """True if only zeros up to this size differ from the rig file."""
        return bool(self.zeros_deg) and not self.reversed and max(map(abs, self.zeros_deg)) <= most_deg

    @model_validator(mode="after")
    def _check_zeros(self) -> Self:
        if self.zeros_deg and len(self.zeros_deg) != len(self.columns):
            raise ValueError(
                f"zeros_deg has {len(self.zeros_deg)} values; give {len(self.columns)}, one for each column"
            )
        return self


class Lengths(ColumnsWithUnit):
    known_units = TO_MM
    columns: Annotated[tuple[Name, ...], Field(min_length=3, max_length=3)]
    mirror: Literal["x", "y", "z"] | None = None
    """Reversed axis of an instrument with a left-handed frame."""


class Residual(Lengths):
    """Measured residual at a target; `place` then contains the target."""

    meaning: Literal["target - measured", "measured - target"]


class TurnColumns(Part):
    columns: Names
    """A quaternion x, y, z, w; a matrix by rows; or angles in the order of their axes."""
    form: TurnForm
    unit: AngleUnit | None = None

    @model_validator(mode="after")
    def _check_form(self) -> TurnColumns:
        if re.search("xx|yy|zz", self.form):
            raise ValueError(f"{self.form} turns about the same axis twice in a row; write xyz, zyx, zyz …")
        count = TURN_COLUMNS.get(self.form, 3)
        if len(self.columns) != count:
            raise ValueError(f"a turn as {self.form} has {count} columns, not {len(self.columns)}")
        angles = self.form not in ("quaternion", "matrix")
        if angles and self.unit is None:
            raise ValueError(f"a turn as {self.form} needs a unit; add deg or rad")
        if not angles and self.unit is not None:
            raise ValueError(f"a turn as {self.form} has no unit; remove the unit")
        return self


class MappedColumn(Part):
    """A column of the file that supplies a column of docs/tables.md, and its unit if different."""

    column: Name
    unit: Literal["deg", "rad", "mm", "m", "cm", "um", "in", "s", "ms", "us", "ns", "min"] | None = None


class TableMap(Part):
    """Meaning of the columns of a measurement."""

    files: Annotated[tuple[FileLayout, ...], Field(min_length=1, max_length=8)]
    join: Annotated[str, StringConstraints(max_length=200)] = ""
    """How to join several files: `rows` or a common column."""
    joints: Angles | None = None
    commanded: Angles | None = None
    place: Lengths | None = None
    residual: Residual | None = None
    turn: TurnColumns | None = None
    controller: Lengths | None = None
    """Pose of the tool that the controller computed, next to a measured place."""
    controller_turn: TurnColumns | None = None
    sees: Literal["the tool", "from the tool"] = "the tool"
    """`from the tool` for an instrument on the tool, such as a camera."""
    stops: Literal["of the cube"] | None = None
    """The rows are stops of the ISO 9283 cube, identified by position."""
    columns: dict[Name, MappedColumn] = Field(default_factory=dict, max_length=100)
    """Columns of other tests, by the names of docs/tables.md."""
    constants: dict[Name, Name] = Field(default_factory=dict, max_length=10)
    """Texts common to all rows, such as the socket."""
    only_commanded: bool = False
    """Measured joint angles are unknown."""
    assumed: tuple[Name, ...] = ()
    """Unconfirmed assumptions."""

    def used(self) -> list[str]:
        poses = (self.place, self.residual, self.turn, self.controller, self.controller_turn)
        parts = (self.joints, self.commanded, *poses)
        return [*(name for part in parts if part for name in part.columns), *(c.column for c in self.columns.values())]


def load_map(path: Path) -> TableMap:
    try:
        text = read_bytes(path, _MOST_BYTES).decode("utf-8")
    except OSError as error:
        raise FileError.of_os(path, error, "check the path of the map", code="file.unreadable") from None
    except UnicodeDecodeError:
        raise FileError(str(path), "is not UTF-8", "save the map as UTF-8", code="file.invalid") from None
    return parse_map(text, str(path))


def parse_map(text: str, where: str) -> TableMap:
    root, data = read_yaml(text, where)
    for number, line in enumerate(text.splitlines(), start=1):
        key, _, value = line.partition(":")
        if not line.lstrip().startswith("#") and value.strip() in (f'"{OPEN}"', f"'{OPEN}'", OPEN):
            problem = f"line {number}, {key.strip()}: this question is not answered"
            remedy = "write one of the answers listed above that line in place of the ?"
            raise FileError(where, problem, remedy, code="table.unclear")
    try:
        return TableMap.model_validate(data)
    except ValidationError as error:
        raise RigFileError(where, problems_of(error, data, root, TableMap)) from None


def map_text(table_map: TableMap, open_keys: dict[str, list[str]] | None = None) -> str:
    """A map as YAML. open_keys: options as text of keys for the operator to fill in, such as `residual.meaning`."""
    lines, questions = list[str](), open_keys or {}
    for key, value in _without_defaults(table_map).items():
        if key in questions:
            lines += [*_choices(key, questions[key]), f'{key}: "{OPEN}"']
        elif not isinstance(value, dict):
            lines.append(f"{key}: {flow(value)}")
        else:
            lines.append(f"{key}:")
            for name, entry in value.items():
                place = f"{key}.{name}"
                lines += [f"  {line}" for line in _choices(place, questions[place])] if place in questions else []
                lines.append(f"  {flow(name)}: {flow(OPEN if place in questions else entry)}")
    return "\n".join(lines) + "\n"


def line_of_map(table_map: TableMap) -> str:
    return flow(_without_defaults(table_map))


def _without_defaults(table_map: TableMap) -> dict[str, Any]:
    data = table_map.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
    files = [layout.model_dump(mode="json", exclude_defaults=True) for layout in table_map.files]
    return data | {"files": [file or {"separator": "comma"} for file in files]}


def value_text(value: Part | None) -> str:
    return "null" if value is None else flow(value.model_dump(mode="json", exclude_none=True))


def _choices(place: str, words: list[str]) -> list[str]:
    return [f"# {OPEN} {place}: {words[0]}", *(f"#   {line}" for line in words[1:])]
