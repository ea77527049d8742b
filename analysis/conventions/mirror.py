"""Places in a left-handed frame: a tracker's export with one axis turned round, which no rigid frame makes right."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from analysis.conventions.finding import Finding, Misfit
from analysis.conventions.joints import CLEARLY, FEWEST, RIGHT_MM, left_mm
from analysis.kinematics.arm import arm_of, without_setup
from analysis.traces.tables import PoseTable
from rigs.rig import Rig

_JUDGED, _STEPS = 80, 100
_MIRROR = np.array([1.0, -1.0, 1.0])
"""Any axis will do: the frame is fitted."""


def mirror_findings(table: PoseTable, rig: Rig, convention: str) -> Iterator[Finding]:
    """Whether poses fit the arm only with one of x, y, z counting the other way."""
    measured = np.flatnonzero((table.xyz_mm != 0).any(axis=1))
    if len(measured) < FEWEST:
        return
    chosen = measured[np.unique(np.linspace(0, len(measured) - 1, _JUDGED).astype(int))]
    bare, q, xyz_mm = without_setup(arm_of(rig.robot)), table.q[chosen], table.xyz_mm[chosen]
    as_labelled = left_mm(PoseTable(q, xyz_mm, None), bare, q, _STEPS, with_turns=False)
    if as_labelled < RIGHT_MM:
        return
    mirrored = left_mm(PoseTable(q, xyz_mm * _MIRROR, None), bare, q, _STEPS, with_turns=False)
    if mirrored > RIGHT_MM or as_labelled < CLEARLY * mirrored:
        return
    what = (
        f"only with y_mm counting the other way do these poses fit: {mirrored:.2g} mm instead of {as_labelled:.0f} mm; "
        "the instrument's frame is left-handed"
    )
    remedy = "change the sign of one of x_mm, y_mm, z_mm, or import the file as it was written, by a map with mirror: y"
    misfit = Misfit(as_labelled, mirrored, len(chosen) * float(np.log(as_labelled / max(mirrored, 1e-9))))
    yield Finding(convention, "impossible", ("x_mm", "y_mm", "z_mm"), "y mirrored", what, remedy, misfit)
