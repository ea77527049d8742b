"""Places that the controller computed, in a table that also has measured ones.

The names of the columns decide if they state an instrument or a command. Otherwise the places decide: no instrument
measures as closely as the controller computes, and the controller computes in the base of its arm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.intake.column_groups import ColumnGroup, Groups, PlaceColumns
from analysis.intake.mapped import poses_of
from analysis.intake.table_reading import Judge, Question, TableReading, in_each_unit, short
from analysis.procedures.checks.meanings import CLEARLY, fit_nearest
from analysis.procedures.checks.place import PlaceSource, source_of
from analysis.robot.geometry.pose_setup import position_error
from analysis.robot.kinematics.arm import forward

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
        """True if the name is that of a place commanded or reported by the robot."""
        return self.pose.place.of_controller or self.pose.place.role == "commanded"

    def is_nominal(self, most_mm: float) -> bool:
        """True if it follows the constants of an arm that other places of the same arm miss by `most_mm`."""
        left_mm = self.source.left_mm
        return bool(self.source.proof) or (left_mm < COMPUTED_MM and CLEARLY * left_mm < most_mm)

    def is_computed(self, measured: Sequence[FittingPlace]) -> bool:
        """True if the controller computed this place, next to measured ones."""
        most_mm = max(place.source.left_mm for place in measured)
        fitted_mm = max(place.source.fitted.rms_mm for place in measured)
        by_name = self.is_robots and self.source.fitted.rms_mm < fitted_mm
        return self.is_nominal(most_mm) or self.source.in_base or by_name


@dataclass(frozen=True)
class PlaceRoles:
    """Places that an instrument may have measured, and the one that the controller computed, None if there is none."""

    seen: tuple[PlaceColumns, ...]
    controller: FittingPlace | None = None


def place_roles(
    judge: Judge, joints: Sequence[ColumnGroup], groups: Groups, seen: Sequence[PlaceColumns]
) -> PlaceRoles:
    """Separate the places of a table. seen: those that may be measured by their names.

    A contradiction between the name of an instrument and the places becomes a question of the judge.
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
            _ask_source(judge, measured[0], named[0])
    if len(measured) > 1:
        closest = min(measured, key=lambda place: place.source.fitted.rms_mm)
        measured = [place for place in measured if place is not closest or not place.source.in_base]
    if not measured:
        return PlaceRoles(tuple(seen))
    computed = [place for place in fitting if place not in measured and place.is_computed(measured)]
    computed.sort(key=lambda place: (not place.pose.place.of_controller, place.pose.place.role == "commanded"))
    kept = {place.pose.place.columns for place in measured}
    return PlaceRoles(tuple(pose for pose in groups.seen if pose.place.columns in kept), next(iter(computed), None))


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


def _ask_source(judge: Judge, measured: FittingPlace, computed: FittingPlace) -> None:
    names = [short(place.pose.place.columns) for place in (measured, computed)]
    judge.questions.append(
        Question(
            "place",
            f"{names[1]} is named as measured, but follows a data sheet too closely; which places were measured?",
            tuple(
                TableReading(place.reading.value.place, place.reading.left, "mm", name, place.reading.share)
                for place, name in zip((measured, computed), names, strict=True)
            ),
        )
    )
