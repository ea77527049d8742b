"""Where a rail stood, read in another unit: held against a tracker's places, whatever the frames."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from analysis.conventions.finding import Finding
from analysis.conventions.joints import CLEARLY, FEWEST, RIGHT_MM, left_mm
from analysis.kinematics.arm import Array, arm_of, rail_mm, without_setup
from analysis.traces.tables import PoseTable
from rigs.rig import Rig

_MM = {"m": 1000.0, "inches": 25.4, "cm": 10.0}
"""Millimetres of each unit in which a controller may write where a rail stands."""
_POSES, _STEPS = 200, 30
"""Poses that show a unit, and steps of a fit to them."""


def rail_findings(table: PoseTable, rig: Rig) -> Iterator[Finding]:
    """What speaks against e1_mm of poses of an arm on a rail: another unit fits, or the rail ends before."""
    arm = without_setup(arm_of(rig.robot))
    if rig.robot.rail is None or table.q.shape[1] == arm.axes:
        return
    if len(table.q) >= FEWEST:
        kept = np.unique(np.linspace(0, len(table.q) - 1, _POSES).astype(int))
        chosen = PoseTable(table.q[kept], table.xyz_mm[kept], None, rail=True)

        def misfit_mm(factor: float) -> float:
            q: Array = chosen.q * np.append(np.ones(arm.axes), factor)
            return left_mm(chosen, arm, q, _STEPS, with_turns=False)

        as_read = misfit_mm(1.0)
        for unit, factor in _MM.items() if as_read > CLEARLY * RIGHT_MM else ():
            if (meant := misfit_mm(factor)) < RIGHT_MM:
                what = f"e1_mm is in {unit}: only then do these poses fit, {meant:.2g} mm instead of {as_read:.0f} mm"
                yield Finding("units", "impossible", ("e1_mm",), unit, what, "convert it to mm")
                return
    stands, (low, high) = rail_mm(arm, table.q), rig.robot.rail.limits_mm
    if stands.min() < low or stands.max() > high:
        reach = f"{stands.min():.6g} to {stands.max():.6g} mm"
        what = f"e1_mm goes from {reach}, and robot.rail.limits_mm from {low:g} to {high:g} mm"
        yield Finding("units", "likely", ("e1_mm",), "another unit", what, "check its unit, or correct limits_mm")
