"""Joint zeros and link constants as they are, by the supported effects.

Several effects on one constant (a second diagnosis adds to the first) are summed, their uncertainties in quadrature.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from analysis.correction.support import Support
from rigs.effects import JointOffset, LinkGeometry
from rigs.rig import Rig

_COLUMNS = {"a": "a_mm", "alpha": "alpha_deg", "beta": "beta_deg", "d": "d_mm"}
CONSTANTS = (*_COLUMNS.values(), "offset_deg")
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
    parts = [
        (one.effect.axis, "q_deg", one) for one in found if one.use != "none" and isinstance(one.effect, JointOffset)
    ]
    return _summed(parts, {axis: {"q_deg": 0.0} for axis in range(1, 7)})


def link_constants(rig: Rig, found: Sequence[Support]) -> list[Correction]:
    """Constants of the arm that are not as the rig file says."""
    parts = [
        (one.effect.axis, _COLUMNS[one.effect.field], one)
        for one in found
        if one.use != "none" and isinstance(one.effect, LinkGeometry)
    ]
    return _summed(parts, {k: axis.model_dump() for k, axis in enumerate(rig.robot.axes, start=1)})


def corrected_table(rig: Rig, corrections: Sequence[Correction]) -> list[dict[str, float | int | str]]:
    """The table of constants, a row for each axis, with the corrections in it; joint zeros are not."""
    changed = {(one.axis, one.key): one.corrected for one in corrections}
    rows: list[dict[str, float | int | str]] = []
    for k, axis in enumerate(rig.robot.axes, start=1):
        constants = {key: round(changed.get((k, key), getattr(axis, key)), 9) for key in CONSTANTS}
        rows.append({"axis": k, "name": axis.name, **constants})
    return rows


def _summed(parts: Sequence[tuple[int, str, Support]], nominal: dict[int, dict[str, float]]) -> list[Correction]:
    places = sorted({(axis, key) for axis, key, _ in parts})
    made = []
    for axis, key in places:
        own = [one for k, other, one in parts if (k, other) == (axis, key)]
        delta, u = math.fsum(one.value for one in own), math.hypot(*(one.u for one in own))
        made.append(Correction(axis, key, float(nominal[axis][key]), delta, u))
    return made
