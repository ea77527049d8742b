"""Joint zeros and link constants as they are, by the supported effects.

Several effects on one constant (a second diagnosis adds to the first) are summed, their uncertainties in quadrature.
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
    """One number to change. axis from 1; key: as in the rig file, mm or deg; delta with its standard uncertainty u."""

    axis: int
    key: str
    nominal: float
    delta: float
    u: float

    @property
    def corrected(self) -> float:
        """What it is instead of the nominal."""
        return self.nominal + self.delta


def joint_zeros(rig: Rig, found: Sequence[Support]) -> list[Correction]:
    """By how much the controller's angle of each joint must read more where the arm stands: its mastering."""
    return _summed(found, "joint zero", {axis: {"q_deg": 0.0} for axis in range(1, 7)})


def link_constants(rig: Rig, found: Sequence[Support]) -> list[Correction]:
    """Constants of the arm that are not as the rig file says."""
    return _summed(found, "link constant", {k: axis.model_dump() for k, axis in enumerate(rig.robot.axes, start=1)})


def corrected_table(rig: Rig, corrections: Sequence[Correction]) -> list[dict[str, float | int | str]]:
    """The table of constants, a row for each axis, with the corrections in it; joint zeros are not."""
    changed = {(one.axis, one.key): one.corrected for one in corrections}
    rows: list[dict[str, float | int | str]] = []
    for k, axis in enumerate(rig.robot.axes, start=1):
        constants = {key: round(changed.get((k, key), getattr(axis, key)), 9) for key in CONSTANTS}
        rows.append({"axis": k, "name": axis.name, **constants})
    return rows


def _summed(found: Sequence[Support], use: Use, nominal: dict[int, dict[str, float]]) -> list[Correction]:
    """The corrections of one use, by axis and key."""
    places: dict[tuple[int, str], list[Support]] = {}
    for one in found:
        if one.use == use and (place := one.effect.compensation().constant):
            places.setdefault(place, []).append(one)
    made = []
    for (axis, key), own in sorted(places.items(), key=lambda one: one[0]):
        delta, u = math.fsum(one.value for one in own), math.hypot(*(one.u for one in own))
        made.append(Correction(axis, key, float(nominal[axis][key]), delta, u))
    return made
