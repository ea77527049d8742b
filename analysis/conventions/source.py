"""Whether an instrument measured the places of poses, or the controller computed them: from its joints by its own
constants. Such places say nothing of where the arm was.

Two things prove it, whatever a column or a topic is called. No reflector sits in the middle of the flange's face while
the instrument's frame is the arm's base. And no instrument and no robot repeat to the last digit: places that the arm's
constants, all free, explain closer than that were computed from the joints.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from analysis.conventions.finding import Finding, Misfit
from analysis.conventions.joints import FEWEST, RIGHT_MM
from analysis.geometry.fitted_arm import fit_arm
from analysis.geometry.pose_setup import fit_setup, position_error
from analysis.kinematics.arm import Array, arm_of, forward, without_setup
from analysis.traces.tables import PoseTable, Table
from rigs.rig import Rig

SOURCE = "source"
OF_CONTROLLER = "rig arms NAME --poses TABLE -o arm.yaml reads its calibration out of them"
"""What such places are good for."""
_NO_INSTRUMENT_MM = 0.005
"""The best trackers state 0.010 mm and more (Leica AT960: 15 µm + 6 µm/m), and arms repeat to 0.01 mm."""
_BASE_MM, _BASE_RAD, _FLANGE_MM = 3.0, float(np.radians(0.3)), 2.0
"""How well frame and target are known by an arm's nominal constants: the calibrations of sound arms move them by so
much. The smallest reflectors are balls of 12.7 mm on a nest."""
_SPARE = 30
"""Readings beyond the unknowns, of which a fit to a few µm is no chance."""
_POSES = 150


def source_findings(table: Table, rig: Rig) -> Iterator[Finding]:
    """Whether the places of poses were computed, not measured."""
    if not isinstance(table, PoseTable) or table.rail:
        return
    measured = np.flatnonzero((table.xyz_mm != 0).any(axis=1))
    if len(measured) < FEWEST:
        return
    chosen = measured[np.unique(np.linspace(0, len(measured) - 1, min(_POSES, len(measured))).astype(int))]
    bare, q, xyz_mm = without_setup(arm_of(rig.robot)), table.q[chosen], table.xyz_mm[chosen]
    T = forward(bare, q)
    setup = fit_setup(T, xyz_mm)
    left_mm = float(np.sqrt((position_error(T, xyz_mm, setup) ** 2).sum(axis=1).mean()))
    if left_mm > RIGHT_MM:
        return
    target_mm = float(np.linalg.norm(setup.T_flange_tool[:3, 3]))
    fitted = fit_arm(bare, q, xyz_mm)
    computed = fitted.spare >= _SPARE and fitted.rms_mm < _NO_INSTRUMENT_MM
    in_flange = _is_base(setup.T_world_base) and target_mm < _FLANGE_MM
    if not computed and not in_flange:
        return
    proof = (
        f"the arm's constants explain them to {1e3 * fitted.rms_mm:.2g} µm, closer than any instrument measures"
        if computed
        else f"they are given in the arm's base, of a point {target_mm:.1f} mm from the middle of the flange"
    )
    what = f"no instrument measured these places: {proof}, so that the controller computed them from its joints"
    remedy = f"give those of an instrument; {OF_CONTROLLER}"
    misfit = Misfit(left_mm, fitted.rms_mm, float(fitted.left_mm.size * np.log(left_mm / max(fitted.rms_mm, 1e-9))))
    columns = ("x_mm", "y_mm", "z_mm")
    yield Finding(SOURCE, "impossible", columns, "the controller's own places", what, remedy, misfit)


def _is_base(T: Array) -> bool:
    """Whether a frame (4, 4) is the arm's base, or that turned half round about z, as base_link of ROS drivers is."""
    turned = [T[:3, :3] @ np.diag([sign, sign, 1.0]) for sign in (1.0, -1.0)]
    angle = min(float(np.arccos(np.clip((np.trace(R) - 1) / 2, -1.0, 1.0))) for R in turned)
    return angle < _BASE_RAD and float(np.linalg.norm(T[:3, 3])) < _BASE_MM
