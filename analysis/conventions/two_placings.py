"""Poses of one run that were measured with the target, or the instrument, in two places.

Beside an arm with all constants fitted, what remains is noise and the little that constants do not explain. Where the
rows from some row on, or every other row, are given a placing of their own and far less remains, something was moved.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from analysis.geometry.pose_setup import DETERMINED, FittedArm, fit_arm
from analysis.kinematics.arm import Arm, Array, Mask, forward
from analysis.traces.tables import PoseTable

_FEWEST_ROWS, _SPLITS = 4, 24
"""Rows of a part, of which the nine unknowns of a placing leave three readings, and how many are tried as its first."""
SPARE, FITTED = 30, 300
"""Readings beyond the unknowns without which a fit of all constants shows nothing, and poses that are enough for it."""
_SHARE, _SHARE_OF_FEW = 0.6, 0.3
"""Share of what remains that a second placing has to leave at most, and of fewer rows or readings to spare than these
two. Of a UR10 and a UR5, measured over hours, the best of all splits leaves 0.86 and more of 30 to 1495 poses in their
order; of 272 sets of 20 to 40 poses, every split tried, 0.51 and more."""
_MANY_ROWS, _MANY_SPARE = 8, 120
_LEAST_MM = 0.05
"""Below what the noise of a tracker is, nothing was moved."""


def two_placings(table: PoseTable, bare: Arm) -> str:
    """Return which rows were measured with target or instrument elsewhere than the others, in words; empty where none
    were, or the poses are too few to show it."""
    count = len(table.q)
    chosen = np.unique(np.linspace(0, count - 1, min(FITTED, count)).astype(int))
    if count < 2 * _FEWEST_ROWS:
        return ""
    q, xyz_mm, rows = table.q[chosen], table.xyz_mm[chosen], table.rows[chosen]
    fitted = fit_arm(bare, q, xyz_mm)
    if fitted.spare < SPARE or fitted.rms_mm < _LEAST_MM:
        return ""
    T = forward(fitted.arm, q)
    best, words, many = np.inf, "", _MANY_ROWS if fitted.spare >= _MANY_SPARE else count
    for part, called in _parts(rows, lambda part: _left_mm(fitted, T, part)):
        after, few = _left_mm(fitted, T, part), min(part.sum(), (~part).sum())
        if after < min(best, (_SHARE if few >= many else _SHARE_OF_FEW) * fitted.rms_mm):
            best, words = after, called
    if not words:
        return ""
    return (
        f"{words} were measured with the target or the instrument elsewhere than the others: with a placing of their "
        f"own {best:.2g} mm are left of {fitted.rms_mm:.2g} mm"
    )


def _parts(rows: Array, left_mm: Callable[[Mask], float]) -> Iterator[tuple[Mask, str]]:
    """Rows that may have a placing of their own, with how they are called: those from the row on at which least
    remains, of a few tried and then of those beside it, and every other row where there are enough."""
    place, last = np.arange(len(rows)), len(rows) - _FEWEST_ROWS
    tried = np.unique(np.linspace(_FEWEST_ROWS, last, _SPLITS).astype(int)).tolist()
    near, step = min(tried, key=lambda first: left_mm(place >= first)), last // _SPLITS
    first = min(range(max(_FEWEST_ROWS, near - step), min(last, near + step) + 1), key=lambda k: left_mm(place >= k))
    yield place >= first, f"rows from about {rows[first]} on"
    second = rows % 2 == 0
    if min(second.sum(), (~second).sum()) >= _FEWEST_ROWS:
        yield second, "every other row"


def _left_mm(fitted: FittedArm, T: Array, part: Mask) -> float:
    """What is left, rms mm corrected for the unknowns, where a part of the tool poses T (n, 4, 4) is shifted, turned
    and has its target elsewhere, the constants fitted beside it."""
    p = (T[:, :3, 3] - T[:, :3, 3].mean(axis=0)) / 1000.0
    (x, y, z), zero = p.T, np.zeros(len(p))
    turned = np.stack([zero, z, -y, -z, zero, x, y, -x, zero], axis=1).reshape(-1, 3, 3)
    shifted = np.tile(np.eye(3), (len(p), 1, 1))
    placing = (np.concatenate([shifted, turned, T[:, :3, :3]], axis=2) * part[:, None, None]).reshape(-1, 9)
    design = np.concatenate([fitted.design, placing], axis=1)
    left = fitted.left_mm - design @ np.linalg.lstsq(design, fitted.left_mm, rcond=DETERMINED)[0]
    return replace(fitted, left_mm=left, spare=fitted.spare - 9).rms_mm
