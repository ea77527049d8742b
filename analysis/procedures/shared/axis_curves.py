"""Angle error of a joint over its angle, by direction of motion, from tracker poses.

If a single joint turns, the target on the tool moves on a circle about that axis, and its lag or lead along the circle
is the angle error (circle-point analysis; Mooring, Roth and Driels, Fundamentals of Manipulator Calibration, 1991, ch.
3). Driven in both directions, backlash and curve form one quantity: the bidirectional angular positioning deviation
(Ibaraki, Int. J. Automation Technology 16, 2022), in the terms of ISO 230-2. Because the circle is fitted, a constant
error and most of a wave of one cycle per turn are invisible; compliance of the joint under its load is visible. No arm
model is needed, only the angles and directions of the joint.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.procedures.shared.lap_curve import SEED
from analysis.procedures.shared.quantity import Quantity, figures_of
from analysis.robot.kinematics.arm import Array, Integers
from analysis.runs.noise.spectrum import DRAWS

_FEWEST_ANGLES, _LEAST_RAD = 5, np.radians(10)
"""Minimum number of joint angles, and minimum range, for a circle: it has seven parameters, and each angle three
coordinates."""


@dataclass(frozen=True)
class AxisCurve:
    """Angle error of a joint that turned alone, at k angles.

    axis: number of the joint, from 1. radius_mm: radius of the circle of the target. angle_deg: reported angles.
    up_deg, down_deg (k,): true minus reported angle, relative to the fitted circle, after turning up and down; nan if
    not measured. u_deg (k,): standard uncertainty of a value due to the noise of the poses.
    """

    axis: int
    radius_mm: float
    angle_deg: Array
    up_deg: Array
    down_deg: Array
    u_deg: Array


def axis_curves(
    q: Array, sides: Integers, xyz_mm: Array, axes: int
) -> tuple[tuple[AxisCurve, ...], dict[str, Quantity]]:
    """Curve of each joint that turned alone, up and down, and its figures axis3_reversal_deg and
    axis3_bidirectional_deg.

    q (n, k) rad: joints, those of the arm first. sides (n, k): directions of approach, -1, 0 or 1. xyz_mm (n, 3):
    positions. The noise is the scatter across the circle, unaffected by the angle error; it includes compliance of
    other joints.
    """
    curves, figures, rng = list[AxisCurve](), dict[str, Quantity](), np.random.default_rng(SEED)
    for joint in range(axes):
        rows = _rows_of_joint(q, sides, joint)
        # Index of each distinct angle, in increasing order.
        order, number, way = np.argsort(q[rows, joint]), np.zeros(len(rows), dtype=np.int64), sides[rows, joint]
        number[order[1:]] = np.cumsum(np.diff(q[rows, joint][order]) > _SAME_RAD)
        count = int(number.max(initial=-1)) + 1
        if count < _FEWEST_ANGLES or np.ptp(q[rows, joint]) < _LEAST_RAD:
            continue
        radius_mm, off_mm, across_mm = _about_circle(q[rows, joint], xyz_mm[rows])
        freedom = 2 * len(rows) - _ACROSS
        sd = float(np.sqrt((across_mm**2).sum() / freedom)) * np.sqrt(freedom / rng.chisquare(freedom, (DRAWS, 1)))
        drawn = off_mm + sd * rng.standard_normal((DRAWS, len(rows)))
        up, down = (
            _mean_errors(np.vstack([off_mm, drawn]) / radius_mm, number, way == side, count) for side in (1, -1)
        )
        if not np.isfinite(up[0] + down[0]).any():
            continue
        u_deg = np.degrees(np.nanmax([up[1:].std(axis=0), down[1:].std(axis=0)], axis=0))
        at_deg = np.degrees([q[rows, joint][number == k].mean() for k in range(count)])
        curves.append(AxisCurve(joint + 1, radius_mm, at_deg, np.degrees(up[0]), np.degrees(down[0]), u_deg))
        # ISO 230-2:2014: mean reversal error, positive if the joint lags, as with backlash; and the range of the errors
        # of both directions, the bidirectional systematic deviation E.
        wide, ways = f"axis{joint + 1}_bidirectional_deg", np.concatenate([up, down], axis=-1)
        both = {
            f"axis{joint + 1}_reversal_deg": np.degrees(np.nanmean(down - up, axis=-1)),
            wide: np.degrees(np.nanmax(ways, axis=-1) - np.nanmin(ways, axis=-1)),
        }
        values, draws = ({name: figure[part] for name, figure in both.items()} for part in (0, slice(1, None)))
        too_wide = {wide: max(float(draws[wide].mean() - values[wide]), 0.0)}
        figures |= figures_of(values, draws, len(rows), too_wide, excess_u=0.5)
    return tuple(curves), figures


_ACROSS = 5
"""Parameters fitted across the circle: its plane (3), and radius and centre in it (2 of 3)."""
_SAME_RAD = float(np.radians(0.1))
"""Joint motion below which an angle counts as repeated, and a joint as standing."""


def _rows_of_joint(q: Array, sides: Integers, joint: int) -> Integers:
    rows = np.flatnonzero((sides[:, joint] != 0) & (np.delete(sides, joint, axis=1) == 0).all(axis=1))
    if not len(rows):
        return rows
    others = np.delete(q[rows], joint, axis=1)
    alike = (np.abs(others - stood).max(axis=1) < _SAME_RAD for stood in others)  # one row at a time, to save memory
    return np.asarray(rows[max(alike, key=np.count_nonzero)])


def _about_circle(angle: Array, xyz_mm: Array) -> tuple[float, Array, Array]:
    """Radius in mm of the circle through positions at angles (n,) rad, and the deviations along it (n,) and across it
    (n, 2) mm.

    The circle is the least-squares similarity from the unit circle (Umeyama, IEEE PAMI 13, 1991).
    """
    on_unit = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    unit, seen = on_unit - on_unit.mean(axis=0), xyz_mm - xyz_mm.mean(axis=0)
    u, s, vt = np.linalg.svd(unit.T @ seen)
    turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    radius_mm = float(s[:2].sum() / (unit**2).sum())
    off = seen @ turn.T - radius_mm * unit
    outwards, along = (off[:, :2] * on_unit[:, :2]).sum(axis=1), off[:, 1] * on_unit[:, 0] - off[:, 0] * on_unit[:, 1]
    return radius_mm, along, np.stack([outwards, off[:, 2]], axis=1)


def _mean_errors(off: Array, number: Integers, kept: Array, count: int) -> Array:
    share = (number[:, None] == np.arange(count)) & np.asarray(kept, dtype=bool)[:, None]
    rows = share.sum(axis=0)
    weight = np.divide(share, rows, out=np.full(share.shape, np.nan), where=rows > 0)
    return np.asarray(off @ weight)
