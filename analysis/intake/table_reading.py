"""Interpretations of the columns of joints and places, each compared with the arm."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np

from analysis.intake.cells import TableFileError
from analysis.intake.column_groups import ColumnGroup, PlaceColumns
from analysis.intake.mapped import poses_of, spread_of
from analysis.intake.raw_table import RawTable
from analysis.intake.table_map import TO_DEG, TO_MM, Angles, FileLayout, Lengths, Residual, TableMap, Unit
from analysis.procedures.checks.meanings import FEWEST, RIGHT_MM, RIGHT_SHARE, left_mm
from analysis.robot.kinematics.arm import Arm

_SCREEN_STEPS = 12
_FARTHEST_MM = 1e6
LENGTHS = ("mm", "m", "in", "cm")
"""Units of places that state none."""


@dataclass(frozen=True)
class TableReading:
    """An interpretation of a part of the table, with the residual.

    left: rms of the best four fifths, in mm or degrees. share: for places also relative to their spread, to compare
    units.
    """

    value: Any
    left: float
    unit: str
    words: str
    share: float = 0.0

    def line(self, next_best: TableReading | None = None) -> str:
        """Interpretation and the residual as text, with the next best for comparison."""
        text = f"{self.words}{self._leaves()}"
        return f"{text}. The second-best interpretation: {next_best.words}{next_best._leaves()}" if next_best else text

    def _leaves(self) -> str:
        if np.isnan(self.left):
            return ""
        of = f"; the positions spread over {_plain(self.left / self.share)} {self.unit}" if self.share else ""
        return f" (they fit the arm to {_plain(self.left)} {self.unit}{of})"

    @property
    def fits(self) -> bool:
        return self.left <= RIGHT_MM and self.share <= RIGHT_SHARE


@dataclass(frozen=True)
class Question:
    """A key of the map that the data leave open, with candidate values, likeliest first.

    maps: maps among which this question and others decide; only their combinations of values are possible.
    """

    key: str
    asks: str
    readings: tuple[TableReading, ...]
    maps: tuple[TableMap, ...] = ()


@dataclass
class Judge:
    """The rows and the bare arm used to compare interpretations."""

    raw: RawTable
    bare: Arm
    layouts: tuple[FileLayout, ...]
    join: str
    checked: list[str] = field(default_factory=list)
    questions: list[Question] = field(default_factory=list)
    assumed: list[str] = field(default_factory=list)

    def map_of(self, joints: Angles, place: Lengths, residual: Residual | None = None, **keys: Any) -> TableMap:
        return TableMap(files=self.layouts, join=self.join, joints=joints, place=place, residual=residual, **keys)

    def reading(self, table_map: TableMap, words: str, steps: int = _SCREEN_STEPS) -> TableReading:
        """An interpretation of joints and place with the residual against the arm."""
        nothing = TableReading(table_map, np.inf, "mm", words, np.inf)
        try:
            poses = poses_of(self.raw, table_map)
        except TableFileError:
            return nothing
        sound = (poses.xyz_mm != 0).any(axis=1)
        q, xyz_mm = poses.q[sound], poses.xyz_mm[sound]
        if len(q) < FEWEST or np.abs(xyz_mm).max() > _FARTHEST_MM:
            return nothing
        apart = spread_of(xyz_mm)
        rms_mm = left_mm(self.bare, q, xyz_mm, steps)
        return TableReading(table_map, rms_mm, "mm", words, rms_mm / apart if apart else np.inf)


def _plain(number: float) -> str:
    return f"{number:.0f}" if number >= 100 else f"{number:.3g}"


def in_each_unit(
    joints: Sequence[ColumnGroup], seen: Sequence[PlaceColumns], units: Sequence[str] = LENGTHS, *, stated: bool = True
) -> Iterator[tuple[PlaceColumns, Angles, Lengths, str]]:
    """Yield all joints and places in all possible units, described as text. stated: trust the units of the file."""
    for group, pose in product(joints, seen):
        if set(group.columns) & set(pose.place.columns):
            continue
        angles = possible_units(group.unit if stated else "", TO_DEG, TO_DEG)
        for angle, length in product(angles, possible_units(pose.place.unit if stated else "", TO_MM, units)):
            joint_words = f"joints {short(group.columns)} in {unit_words(angle)}"
            words = f"{joint_words}, place {short(pose.place.columns)} in {unit_words(length)}"
            place = Lengths(columns=pose.place.columns, unit=length)
            yield pose, Angles(columns=group.columns, unit=angle), place, words


def likely_angles(raw: RawTable, group: ColumnGroup) -> Angles:
    """Joint columns in the stated unit, or in the likely one: in degrees, joints within a full turn of radians would
    hardly have moved.
    """
    is_small = np.nanmax(np.abs(raw.numbers(group.columns))) <= 2 * np.pi
    (unit, *_) = possible_units(group.unit, TO_DEG, ("rad" if is_small else "deg",))
    return Angles(columns=group.columns, unit=unit)


def possible_units(stated: Unit, known: Container[str], otherwise: Iterable[Unit]) -> list[Unit]:
    """The unit stated in the file if known, otherwise all candidates."""
    each = (stated,) if isinstance(stated, str) else stated
    return [stated] if all(unit in known for unit in each) else list(otherwise)


def unit_words(unit: Unit) -> str:
    return ", ".join("inches" if name == "in" else name for name in ((unit,) if isinstance(unit, str) else unit))


def short(columns: Sequence[str]) -> str:
    return columns[0] if len(columns) == 1 else f"{columns[0]} … {columns[-1]}"
