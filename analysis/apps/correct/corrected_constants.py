"""Corrected joint zeros and link constants of an arm: the sums of all effects on each constant."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from analysis.correction.support import Support
from analysis.robot.kinematics.arm import controller_robot
from rigs.rig import Rig
from rigs.schema.effect import Use

CONSTANTS = ("a_mm", "alpha_deg", "beta_deg", "d_mm", "offset_deg")
"""Columns of a table of constants, named as in the rig file."""


@dataclass(frozen=True)
class Correction:
    """A number to change, in mm or degrees."""

    axis: int
    key: str
    """As in the rig file."""
    nominal: float
    """Value in the controller."""
    delta: float
    u: float
    """Standard uncertainty of the change."""

    @property
    def corrected(self) -> float:
        return self.nominal + self.delta


def joint_zeros(rig: Rig, supported: Sequence[Support]) -> list[Correction]:
    """Changes of the controller's joint angles in an unchanged posture, for mastering."""
    return _summed(supported, "joint zero", {axis: {"q_deg": 0.0} for axis in range(1, len(rig.robot.axes) + 1)})


def link_constants(rig: Rig, supported: Sequence[Support]) -> list[Correction]:
    """Changes of the arm's constants relative to those in the controller.

    If it has other constants than the rig file, changes within their uncertainty are omitted.
    """
    axes = {k: axis.model_dump() for k, axis in enumerate(rig.robot.axes, start=1)}
    found = _summed(supported, "link constant", axes)
    if not (own := rig.robot.controller_axes):
        return found
    nows = [float(getattr(own[each.axis - 1], each.key)) for each in found]
    changes = [replace(each, nominal=now, delta=each.corrected - now) for each, now in zip(found, nows, strict=True)]
    return [change for change in changes if abs(change.delta) > change.u]


def corrected_table(rig: Rig, corrections: Sequence[Correction]) -> list[dict[str, float | int | str]]:
    """Corrected constants, a row per axis."""
    changed = {(correction.axis, correction.key): correction.corrected for correction in corrections}
    rows: list[dict[str, float | int | str]] = []
    for k, axis in enumerate(controller_robot(rig.robot).axes, start=1):
        constants = {key: round(changed.get((k, key), getattr(axis, key)), 9) for key in CONSTANTS}
        rows.append({"axis": k, "name": axis.name, **constants})
    return rows


def _summed(supported: Sequence[Support], use: Use, nominal: dict[int, dict[str, float]]) -> list[Correction]:
    places: dict[tuple[int, str], list[Support]] = {}
    for support in supported:
        if support.use == use and (place := support.effect.compensation().constant):
            places.setdefault(place, []).append(support)
    made = []
    for (axis, key), of_place in sorted(places.items(), key=lambda item: item[0]):
        delta, u = math.fsum(support.value for support in of_place), math.hypot(*(support.u for support in of_place))
        made.append(Correction(axis, key, float(nominal[axis][key]), delta, u))
    return made
