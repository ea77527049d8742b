"""Corrected joint zeros and link constants, from the effects that can be corrected.

Several effects on one constant (a second diagnosis adds to the first) are summed, and their uncertainties are added in
quadrature.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from analysis.correction.support import Support
from rigs.rig import Rig
from rigs.schema.effect import Use

CONSTANTS = ("a_mm", "alpha_deg", "beta_deg", "d_mm", "offset_deg")
"""Columns of a table of constants, named as in the rig file."""


@dataclass(frozen=True)
class Correction:
    """One number to change: the axis from 1, the key as in the rig file, in mm or degrees, and the change `delta` with
    its standard uncertainty `u`."""

    axis: int
    key: str
    nominal: float
    delta: float
    u: float

    @property
    def corrected(self) -> float:
        """The corrected value."""
        return self.nominal + self.delta


def joint_zeros(rig: Rig, found: Sequence[Support]) -> list[Correction]:
    """Return the changes of the controller's angle of each joint at an unchanged posture, which is its mastering."""
    return _summed(found, "joint zero", {axis: {"q_deg": 0.0} for axis in range(1, len(rig.robot.axes) + 1)})


def link_constants(rig: Rig, found: Sequence[Support]) -> list[Correction]:
    """Return the changes of the arm's constants from those in the rig file."""
    return _summed(found, "link constant", {k: axis.model_dump() for k, axis in enumerate(rig.robot.axes, start=1)})


def corrected_table(rig: Rig, corrections: Sequence[Correction]) -> list[dict[str, float | int | str]]:
    """Return the table of constants, a row for each axis, with the corrections included; joint zeros are not."""
    changed = {(one.axis, one.key): one.corrected for one in corrections}
    rows: list[dict[str, float | int | str]] = []
    for k, axis in enumerate(rig.robot.axes, start=1):
        constants = {key: round(changed.get((k, key), getattr(axis, key)), 9) for key in CONSTANTS}
        rows.append({"axis": k, "name": axis.name, **constants})
    return rows


def _summed(found: Sequence[Support], use: Use, nominal: dict[int, dict[str, float]]) -> list[Correction]:
    """Return the corrections of one use, by axis and key."""
    places: dict[tuple[int, str], list[Support]] = {}
    for one in found:
        if one.use == use and (place := one.effect.compensation().constant):
            places.setdefault(place, []).append(one)
    made = []
    for (axis, key), own in sorted(places.items(), key=lambda one: one[0]):
        delta, u = math.fsum(one.value for one in own), math.hypot(*(one.u for one in own))
        made.append(Correction(axis, key, float(nominal[axis][key]), delta, u))
    return made
