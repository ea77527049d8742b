"""One axis at a time: the error of a joint's angle over its angle, by the way it turned, from poses of a tracker.

Where one joint turns and all others stand, the target on the tool goes round that axis, and how far it lags or leads
along its circle is the error of the angle (circle-point analysis; Mooring, Roth and Driels, Fundamentals of Manipulator
Calibration, 1991, ch. 3). Driven both ways, play and curve are one quantity: the bidirectional angular positioning
deviation (Ibaraki, Int. J. Automation Technology 16, 2022), with the words of ISO 230-2. The circle is fitted, so that
a constant error and most of one wave a turn, which are a circle turned and put elsewhere, do not show; what the joint
yields under the weight that it carries does. No arm is needed, only which joint turned, and from where.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.procedures.shared.lap_curve import SEED
from analysis.procedures.shared.quantity import Quantity, figures_of
from analysis.robot.kinematics.arm import Array, Integers
from analysis.runs.noise.spectrum import DRAWS

_FEWEST_ANGLES, _LEAST_RAD = 5, np.radians(10)
"""Angles of a joint, and the range that they span, from which there is a circle: its seven numbers are of three
coordinates each."""


@dataclass(frozen=True)
class AxisCurve:
    """What a joint does as it turns alone, by angle (k,): axis from 1; radius_mm of the target's circle; angle_deg as
    reported; up_deg, down_deg (k,): real less reported angle, about the fitted circle, where it came turning up and
    down, nan where it did not come so; u_deg (k,): standard uncertainty of one of them by the noise of the poses."""

    axis: int
    radius_mm: float
    angle_deg: Array
    up_deg: Array
    down_deg: Array
    u_deg: Array


def axis_curves(
    q: Array, sides: Integers, xyz_mm: Array, axes: int
) -> tuple[tuple[AxisCurve, ...], dict[str, Quantity]]:
    """Return the curve of each joint that turned alone, up and down, and its figures axis3_reversal_deg and
    axis3_bidirectional_deg: of poses at joints q (n, k) rad, of which those of the arm are first, that came by ways
    `sides` (n, k), -1, 0 or 1, with places xyz_mm (n, 3).

    The noise is what places show across their circle, which no error of the angle moves; what other joints yield is in
    it.
    """
    curves, figures, rng = list[AxisCurve](), dict[str, Quantity](), np.random.default_rng(SEED)
    for joint in range(axes):
        rows = _alone(q, sides, joint)
        # The number of each angle, in increasing order; those that are alike have one.
        order, number, way = np.argsort(q[rows, joint]), np.zeros(len(rows), dtype=np.int64), sides[rows, joint]
        number[order[1:]] = np.cumsum(np.diff(q[rows, joint][order]) > _SAME_RAD)
        count = int(number.max(initial=-1)) + 1
        if count < _FEWEST_ANGLES or np.ptp(q[rows, joint]) < _LEAST_RAD:
            continue
        radius_mm, off_mm, across_mm = _about_circle(q[rows, joint], xyz_mm[rows])
        freedom = 2 * len(rows) - _ACROSS
        sd = float(np.sqrt((across_mm**2).sum() / freedom)) * np.sqrt(freedom / rng.chisquare(freedom, (DRAWS, 1)))
        drawn = off_mm + sd * rng.standard_normal((DRAWS, len(rows)))
        up, down = (_means(np.vstack([off_mm, drawn]) / radius_mm, number, way == side, count) for side in (1, -1))
        if not np.isfinite(up[0] + down[0]).any():
            continue
        u_deg = np.degrees(np.nanmax([up[1:].std(axis=0), down[1:].std(axis=0)], axis=0))
        at_deg = np.degrees([q[rows, joint][number == k].mean() for k in range(count)])
        curves.append(AxisCurve(joint + 1, radius_mm, at_deg, np.degrees(up[0]), np.degrees(down[0]), u_deg))
        # As ISO 230-2:2014 has them: the mean reversal error, here positive where the joint lags behind, as with play;
        # and the largest less the smallest error of both ways, the bidirectional systematic deviation E.
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
"""Numbers that are fitted to places across their circle: its plane (3), and in it radius and centre (2 of 3)."""
_SAME_RAD = float(np.radians(0.1))
"""Angles that differ by less are one, and a joint that does has stood, as poses that are visited again."""


def _alone(q: Array, sides: Integers, joint: int) -> Integers:
    """Return the rows to which a joint alone moved, with the others where they stood in most such rows."""
    rows = np.flatnonzero((sides[:, joint] != 0) & (np.delete(sides, joint, axis=1) == 0).all(axis=1))
    if not len(rows):
        return rows
    others = np.delete(q[rows], joint, axis=1)
    alike = (np.abs(others - stood).max(axis=1) < _SAME_RAD for stood in others)  # of many rows, one at a time
    return np.asarray(rows[max(alike, key=np.count_nonzero)])


def _about_circle(angle: Array, xyz_mm: Array) -> tuple[float, Array, Array]:
    """Return the radius in mm of the circle on which places xyz_mm (n, 3) go round with angles (n,) rad; how far each
    is along it from where its angle has it, (n,) mm; and how far out of it (n, 2) mm, outwards and along the axis.

    The circle is the similarity from the unit circle with least squares (Umeyama, IEEE PAMI 13, 1991).
    """
    on_unit = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    unit, seen = on_unit - on_unit.mean(axis=0), xyz_mm - xyz_mm.mean(axis=0)
    u, s, vt = np.linalg.svd(unit.T @ seen)
    turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    radius_mm = float(s[:2].sum() / (unit**2).sum())
    off = seen @ turn.T - radius_mm * unit
    outwards, along = (off[:, :2] * on_unit[:, :2]).sum(axis=1), off[:, 1] * on_unit[:, 0] - off[:, 0] * on_unit[:, 1]
    return radius_mm, along, np.stack([outwards, off[:, 2]], axis=1)


def _means(off: Array, number: Integers, kept: Array, count: int) -> Array:
    """Return the means (m, count) of errors (m, n) over the rows kept (n,) of each angle; nan of an angle without
    any."""
    share = (number[:, None] == np.arange(count)) & np.asarray(kept, dtype=bool)[:, None]
    rows = share.sum(axis=0)
    weight = np.divide(share, rows, out=np.full(share.shape, np.nan), where=rows > 0)
    return np.asarray(off @ weight)
