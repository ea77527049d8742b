"""Interpretations of the columns of joints and places, each compared with the arm.

Alternatives are the hypotheses of `analysis.procedures.checks.columns` and a left-handed frame. Those that a map can
express (column order, reversed axis, mirror) become questions; zeros and couplings belong to the rig file.

Names decide whether an instrument or a command gave a place. Otherwise the places decide: no instrument measures as
closely as the controller computes, and the controller computes in the base of its arm.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np

from analysis.intake.column_groups import ColumnGroup, Groups, PlaceColumns
from analysis.intake.mapped import poses_of
from analysis.intake.raw_table import RawTable
from analysis.intake.table_map import ANGLE_UNITS, TO_DEG, TO_MM, Angles, FileLayout, Lengths, Residual, TableMap, Unit
from analysis.intake.table_problems import TableFileError
from analysis.procedures.checks.columns import (
    AS_WELL,
    CLEARLY,
    FEWEST,
    RIGHT_MM,
    fit_nearest,
    left_mm,
    meanings,
    right_mm,
    searched_meanings,
)
from analysis.procedures.checks.places import PlaceSource, source_of
from analysis.procedures.shared.test_kind import Meaning
from analysis.robot.geometry.pose_setup import position_error
from analysis.robot.kinematics.arm import Arm, Array, Mask, forward

_SCREEN_STEPS = 12
_FARTHEST_MM = 1e6
LENGTHS = ("mm", "m", "in", "cm")
"""Units of places that state none."""


@dataclass(frozen=True)
class TableReading:
    value: Any
    left: float
    """Residual, rms of the best four fifths, in mm or degrees."""
    unit: str
    words: str
    share: float = 0.0
    """Residual of places relative to their spread, to compare units."""
    mistakes: int = 0
    """Number of independent mistakes that it assumes."""
    remedy: str = ""
    """Action if a map cannot express it."""

    def line(self, next_best: TableReading | None = None) -> str:
        text = f"{self.words}{self._leaves()}"
        return f"{text}. The second-best interpretation: {next_best.words}{next_best._leaves()}" if next_best else text

    def _leaves(self) -> str:
        if np.isnan(self.left):
            return ""
        of = f"; the positions spread over {_plain(self.left / self.share)} {self.unit}" if self.share else ""
        return f" (they fit the arm to {_plain(self.left)} {self.unit}{of})"

    @property
    def fits(self) -> bool:
        return self.left <= (right_mm(self.left / self.share) if self.share else RIGHT_MM)


@dataclass(frozen=True)
class Question:
    """A key of the map that the data leave open."""

    key: str
    asks: str
    readings: tuple[TableReading, ...]
    """Candidates, likeliest first."""
    maps: tuple[TableMap, ...] = ()
    """Maps among which this question and others decide; only their combinations of values are possible."""


@dataclass
class Judge:
    """Compares interpretations of some rows with the bare arm, and collects findings and questions."""

    raw: RawTable
    bare: Arm
    layouts: tuple[FileLayout, ...]
    join: str
    checked: list[str] = field(default_factory=list)
    questions: list[Question] = field(default_factory=list)
    assumed: list[str] = field(default_factory=list)
    zeros: str = ""
    """Zeros of the arm within the range of a diagnosis that explain why no reading fits."""

    def map_of(self, joints: Angles, place: Lengths, residual: Residual | None = None, **keys: Any) -> TableMap:
        return TableMap(files=self.layouts, join=self.join, joints=joints, place=place, residual=residual, **keys)

    def reading(self, table_map: TableMap, words: str, steps: int = _SCREEN_STEPS) -> TableReading:
        q, xyz_mm = _measured_rows(self.raw, table_map)
        if len(q) < FEWEST or np.abs(xyz_mm).max() > _FARTHEST_MM:
            return TableReading(table_map, np.inf, "mm", words, np.inf)
        apart = spread_of(xyz_mm)
        rms_mm = left_mm(self.bare, q, xyz_mm, steps)
        return TableReading(table_map, rms_mm, "mm", words, rms_mm / apart if apart else np.inf)


def _measured_rows(raw: RawTable, table_map: TableMap) -> tuple[Array, Array]:
    """Joints (n, k) rad and places (n, 3) mm of the rows with a place; none if the map does not suit the table."""
    try:
        poses = poses_of(raw, table_map)
    except TableFileError:
        return np.empty((0, 0)), np.empty((0, 3))
    measured = (poses.xyz_mm != 0).any(axis=1)
    return poses.q[measured], poses.xyz_mm[measured]


def spread_of(places: Array) -> float:
    return float(np.sqrt(((places - places.mean(axis=0)) ** 2).sum(axis=1).mean()))


_FIRST_STEPS, _ALL_STEPS, _BEST = 8, 60, 6
"""Number of optimiser steps for screening and for the best candidates, and number of these candidates."""
_LEAST_TRAVEL, _MOST_TRAVEL = np.radians(20.0), np.radians(1080.0)
"""Travel of the joint that moves most. Chosen: with less, hardly any reading is refuted; no arm winds up farther."""
_ZERO_DIGITS = 2
_ALIKE = 4.0
"""Largest ratio between the spread of the places and of the flange; a larger ratio means a wrong unit."""
_FIRST, _PARTS = 0.4, 4
"""Share of first rows that may belong to a separate placement, and maximum number of values of a column that names
placements.
"""
_MIRROR = "y"
"""Mirrored axis; any axis works because the frame is fitted."""


def plausibility_key(way: TableReading, closest: float) -> tuple[float, float]:
    """Sort key: mistakes first if the fit is as good as that with the smallest share (`closest`), then the fit."""
    return (way.mistakes if way.share <= AS_WELL * closest else np.inf, way.share)


def alternative_readings(raw: RawTable, bare: Arm, base: TableMap) -> list[TableReading]:
    """Alternative interpretations of the joints and places of a map, best first.

    Empty if the units do not suit the arm or hardly any row has a place.
    """
    q, xyz_mm = _measured_rows(raw, base)
    if len(q) < FEWEST:
        return []
    apart, reach = spread_of(xyz_mm), spread_of(forward(bare, q)[:, :3, 3])
    if not 1 / _ALIKE < apart / max(reach, 1e-9) < _ALIKE:
        return []

    def judged(way: tuple[TableMap, Meaning | None, str, str], steps: int) -> TableReading:
        table_map, meaning, words, remedy = way
        seen = xyz_mm if meaning else xyz_mm @ np.diag([-1.0 if letter == _MIRROR else 1.0 for letter in "xyz"])
        rms_mm = left_mm(bare, meaning.of(q) if meaning else q, seen, steps)
        mistakes = meaning.mistakes if meaning else 1
        return TableReading(table_map, rms_mm, "mm", words, rms_mm / apart, mistakes, remedy)

    ways = list(_alternatives(base, bare.axes))
    order = np.argsort([judged(way, _FIRST_STEPS).left for way in ways])[:_BEST]
    best = [judged(ways[k], _ALL_STEPS) for k in order.tolist()]
    closest = min(way.share for way in best)
    return sorted(best, key=lambda way: plausibility_key(way, closest))


def searched_readings(raw: RawTable, bare: Arm, base: TableMap) -> list[TableReading]:
    """Readings of the joints with other signs and zeros of several axes, simplest first; empty if none fits."""
    q, xyz_mm = _measured_rows(raw, base)
    if base.joints is None or not _is_plausible(bare, q, xyz_mm):
        return []
    found = []
    for meaning, mm in searched_meanings(bare, q, xyz_mm):
        backwards = tuple((np.flatnonzero(np.diag(meaning.matrix) < 0) + 1).tolist())
        zeros_deg = tuple(np.degrees(meaning.offset).round(_ZERO_DIGITS).tolist()) if meaning.offset.any() else ()
        joints = base.joints.model_copy(update={"reversed": backwards, "zeros_deg": zeros_deg})
        table_map, share = base.model_copy(update={"joints": joints}), mm / spread_of(xyz_mm)
        found.append(TableReading(table_map, mm, "mm", meaning.words, share, meaning.mistakes, meaning.remedy))
    return found


def _is_plausible(bare: Arm, q: Array, xyz_mm: Array) -> bool:
    """True if joints and places have the extent of such an arm, as they have in the right units."""
    if len(q) < FEWEST:
        return False
    travel = np.ptp(q, axis=0).max()
    if not _LEAST_TRAVEL < travel < _MOST_TRAVEL:
        return False
    apart, reach = spread_of(xyz_mm), spread_of(forward(bare, q)[:, :3, 3])
    return bool(1 / _ALIKE < apart / max(reach, 1e-9) < _ALIKE)


def fits_in_parts(raw: RawTable, bare: Arm, base: TableMap) -> str:
    """Rows in words that fit the arm by themselves: the target or the instrument was moved; "" if there are none."""
    poses = poses_of(raw, base)
    measured, number = (poses.xyz_mm != 0).any(axis=1), np.arange(len(raw.lines))
    parts = {"the first rows": [number < max(_FIRST * len(number), FEWEST)]}
    parts["every other row"] = [number % 2 == 0, number % 2 == 1]
    for name in raw.names:
        values = raw.cells[name].to_pylist()
        if name not in raw.numeric and 1 < len(set(values)) <= _PARTS:
            parts |= {f"the rows of {name} {value}": [np.array([cell == value for cell in values])] for value in values}

    def misfit_mm(rows: Mask) -> float:
        q, xyz_mm = poses.q[rows & measured], poses.xyz_mm[rows & measured]
        rms_mm = left_mm(bare, q, xyz_mm, _ALL_STEPS) if len(q) >= FEWEST else np.inf
        return rms_mm if rms_mm < right_mm(spread_of(xyz_mm)) else np.inf

    left = {words: max(map(misfit_mm, every)) for words, every in parts.items()}
    return next((f"{words}, which leave {mm:.2g} mm" for words, mm in left.items() if np.isfinite(mm)), "")


def _alternatives(base: TableMap, axes: int) -> Iterator[tuple[TableMap, Meaning | None, str, str]]:
    """Alternatives: map, meaning (None for a mirror), words, and the remedy if a map cannot express it."""
    if base.joints is None or base.place is None:
        return
    mirrored = base.place.model_copy(update={"mirror": _MIRROR})
    yield base.model_copy(update={"place": mirrored}), None, f"{_MIRROR} mirrored: the frame is left-handed", ""
    columns = np.array(base.joints.columns, dtype=object)
    for meaning in meanings(axes):
        is_order = not meaning.offset.any() and bool((np.abs(meaning.matrix).sum(axis=1) == 1).all())
        if not is_order:
            yield base, meaning, meaning.words, meaning.remedy
            continue
        backwards = tuple((np.flatnonzero(meaning.matrix.sum(axis=1) < 0) + 1).tolist())
        order = tuple(columns[np.abs(meaning.matrix).argmax(axis=1)].tolist())
        joints = base.joints.model_copy(update={"columns": order, "reversed": backwards})
        yield base.model_copy(update={"joints": joints}), meaning, meaning.words, ""


def _plain(number: float) -> str:
    return f"{number:.0f}" if number >= 100 else f"{number:.3g}"


def in_each_unit(
    joints: Sequence[ColumnGroup],
    seen: Sequence[PlaceColumns],
    units: Sequence[str] = LENGTHS,
    *,
    angle_units: Sequence[str] = ANGLE_UNITS,
    stated: bool = True,
) -> Iterator[tuple[PlaceColumns, Angles, Lengths, str]]:
    """All joints and places in all possible units, with words. stated: trust the units of the file."""
    for group, pose in product(joints, seen):
        if set(group.columns) & set(pose.place.columns):
            continue
        angles = possible_units(group.unit if stated else "", TO_DEG, angle_units)
        for angle, length in product(angles, possible_units(pose.place.unit if stated else "", TO_MM, units)):
            joint_words = f"joints {column_span(group.columns)} in {unit_words(angle)}"
            words = f"{joint_words}, place {column_span(pose.place.columns)} in {unit_words(length)}"
            place = Lengths(columns=pose.place.columns, unit=length)
            yield pose, Angles(columns=group.columns, unit=angle), place, words


def likely_angles(raw: RawTable, group: ColumnGroup) -> Angles:
    """Joint columns in the stated or likely unit: joints within 2π degrees would hardly have moved."""
    is_small = np.nanmax(np.abs(raw.numbers(group.columns))) <= 2 * np.pi
    (unit, *_) = possible_units(group.unit, TO_DEG, ("rad" if is_small else "deg",))
    return Angles(columns=group.columns, unit=unit)


def possible_units(stated: Unit, known: Container[str], otherwise: Iterable[Unit]) -> list[Unit]:
    each = (stated,) if isinstance(stated, str) else stated
    return [stated] if all(unit in known for unit in each) else list(otherwise)


def unit_words(unit: Unit) -> str:
    return ", ".join("inches" if name == "in" else name for name in ((unit,) if isinstance(unit, str) else unit))


def column_span(columns: Sequence[str]) -> str:
    return columns[0] if len(columns) == 1 else f"{columns[0]} … {columns[-1]}"


_STEPS = 100
_NEAR = 6.0
"""Largest distance from the arm, in medians, of the rows that are compared. Chosen: far beyond normal scatter."""
COMPUTED_MM = 0.1
"""Largest residual of places computed with the constants of a data sheet. Few real arms are as close to nominal."""


@dataclass(frozen=True)
class FittingPlace:
    """Columns of a place that fit the arm, with the evidence on their source."""

    pose: PlaceColumns
    reading: TableReading
    source: PlaceSource

    @property
    def is_robots(self) -> bool:
        return self.pose.place.of_controller or self.pose.place.role == "commanded"

    def is_nominal(self, most_mm: float) -> bool:
        """True if it follows the constants of an arm that other places of the same arm miss by `most_mm`."""
        left_mm = self.source.left_mm
        return bool(self.source.proof) or (left_mm < COMPUTED_MM and CLEARLY * left_mm < most_mm)

    def is_computed(self, measured: Sequence[FittingPlace]) -> bool:
        most_mm = max(place.source.left_mm for place in measured)
        fitted_mm = max(place.source.fitted.rms_mm for place in measured)
        by_name = self.is_robots and self.source.fitted.rms_mm < fitted_mm
        return self.is_nominal(most_mm) or self.source.in_base or by_name


def separate_places(
    judge: Judge, joints: Sequence[ColumnGroup], groups: Groups, seen: Sequence[PlaceColumns]
) -> tuple[Sequence[PlaceColumns], FittingPlace | None]:
    """Places that an instrument may have measured, and the one that the controller computed, if any.

    seen: places that may be measured by their names. A contradiction between the name of an instrument and the places
    becomes a question of the judge.
    """
    fitting = _fitting_places(judge, joints, groups.seen) if len({p.place.columns for p in groups.seen}) > 1 else []
    by_name = {pose.place.columns for pose in seen}
    if not any(pose.place.of_instrument for pose in seen):  # "actual" is also a word of controllers
        by_name |= {place.pose.place.columns for place in fitting if not place.is_robots}
    named = [place for place in fitting if place.pose.place.columns in by_name]
    most_mm = max((place.source.left_mm for place in fitting), default=0.0)
    real = [place for place in fitting if not place.is_nominal(most_mm)]
    measured = [place for place in real if place in named]
    if named and not measured:  # all of them were computed
        measured = [place for place in real if not place.is_robots]
        if measured:
            _ask_who_measured(judge, measured[0], named[0])
    if len(measured) > 1:
        closest = min(measured, key=lambda place: place.source.fitted.rms_mm)
        measured = [place for place in measured if place is not closest or not place.source.in_base]
    if not measured:
        return seen, None
    computed = [place for place in fitting if place not in measured and place.is_computed(measured)]
    computed.sort(key=lambda place: (not place.pose.place.of_controller, place.pose.place.role == "commanded"))
    kept = {place.pose.place.columns for place in measured}
    return [pose for pose in groups.seen if pose.place.columns in kept], next(iter(computed), None)


def _fitting_places(judge: Judge, joints: Sequence[ColumnGroup], seen: Sequence[PlaceColumns]) -> list[FittingPlace]:
    fitting = []
    for pose in {pose.place.columns: pose for pose in reversed(seen)}.values():
        readings = [
            judge.reading(judge.map_of(angles, lengths), words)
            for _, angles, lengths, words in in_each_unit(joints, [pose])
        ]
        best = min(readings, key=lambda reading: reading.share, default=None)
        if best is None or not best.fits:
            continue
        poses = poses_of(judge.raw, best.value)
        setup = fit_nearest(judge.bare, poses.q, poses.xyz_mm, _STEPS)[1]
        away_mm = np.linalg.norm(position_error(forward(judge.bare, poses.q), poses.xyz_mm, setup), axis=1)
        near = away_mm <= _NEAR * np.median(away_mm)
        if source := source_of(judge.bare, poses.q[near], poses.xyz_mm[near]):
            fitting.append(FittingPlace(pose, best, source))
    return fitting


def _ask_who_measured(judge: Judge, measured: FittingPlace, computed: FittingPlace) -> None:
    names = [column_span(place.pose.place.columns) for place in (measured, computed)]
    asks = f"{names[1]} is named as measured, but follows a data sheet too closely; which places were measured?"
    readings = (
        TableReading(place.reading.value.place, place.reading.left, "mm", name, place.reading.share)
        for place, name in zip((measured, computed), names, strict=True)
    )
    judge.questions.append(Question("place", asks, tuple(readings)))
