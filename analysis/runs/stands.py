"""Detect standstills of the robot, assign them to targets, and average their readings without outliers.

A radial or repeatability program stops at each target. At standstill of all joints the gauge is averaged; the closest
target of the rig file is assigned; the side of approach is the tool's radial position since the last stop there.
Standstills outside the program's order are not visits: before its start, after its end, or additional waits. They are
counted but not used.

In a table several readings of one standstill count as one, because only a visit after a move shows repeatability:
otherwise only the instrument's scatter is seen. Treated as visits, three of them gave an RP of 0.008 mm, and tripled
the data in calibration fits and held-out sets.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.robot.geometry.driven_programs import TargetProgram
from analysis.robot.kinematics.arm import Array, Integers, Mask, arm_of, forward
from analysis.robot.model.motion import standing
from analysis.runs.tables import Table
from rigs.errors import FileError
from rigs.rig import Rig

STANDS_RAD = float(np.radians(0.01))
"""Joint motion within the window that counts as standstill; encoder noise is a tenth of it."""
FLICKER_DEG = 0.03
"""Noise of a resting joint in a live view; the slowest circle moves a joint by more in half a second."""
STOOD_RAD = float(np.radians(0.2))
"""Joint motion in a whole run that counts as standstill."""
_WINDOW_S = 0.3
_SETTLED = 0.5
"""Share of a standstill, at its end, that is averaged: arm vibration has decayed by then."""
_OUTLYING = 6.0
"""Outlier limit in scaled median deviations: twice Hampel's usual three."""
_MOST_OUTLYING = 0.1
"""Largest share of outliers in a standstill; more means that arm or gauge really moved."""


@dataclass(frozen=True)
class Stand:
    """Rows [begin, end) at standstill; mean angles (6,) rad and mean readings (k,) mm of the settled part, without
    its `outliers`."""

    begin: int
    end: int
    t_s: float
    q: Array
    g_mm: Array
    outliers: int

    @property
    def settled(self) -> slice:
        """Averaged rows."""
        return _settled(self.begin, self.end)


def stands_of(t_s: Array, q: Array, g_mm: Array) -> list[Stand]:
    """Return the standstills of a motion: times t_s (n,) s, reported angles q (n, 6) rad, readings g_mm (n, k) of k
    gauges."""
    stands = []
    for begin, end in standing(t_s, q, STANDS_RAD, _WINDOW_S):
        settled = _settled(begin, end)
        mean_mm, outliers = _averaged(g_mm[settled])
        stands.append(Stand(begin, end, float(t_s[settled].mean()), _averaged(q[settled])[0], mean_mm, outliers))
    return stands


def _settled(begin: int, end: int) -> slice:
    return slice(begin + int((end - begin) * (1 - _SETTLED)), end)


def _averaged(values: Array) -> tuple[Array, int]:
    """Return the mean (k,) of the readings or angles (n, k) without outliers, and their number."""
    away = np.abs(values - np.median(values, axis=0))
    limit = _OUTLYING * 1.4826 * np.median(away, axis=0)
    # If most readings of a coarse gauge are equal, the median deviation is zero: there are no outliers then.
    sound = (away <= limit) | (limit == 0)
    sound |= sound.mean(axis=0) < 1 - _MOST_OUTLYING
    mean: Array = np.where(sound, values, 0.0).sum(axis=0) / sound.sum(axis=0)
    return mean, int((~sound).sum())


_NEAR_MM = 20.0
_TURNED_RAD = np.radians(8.0)
"""Rotation from every target beyond which a standstill is not at a target."""
_FOLLOWED = 0.5
"""Minimum share of standstills at targets that follow the program's order."""


@dataclass(frozen=True)
class Visits:
    """Standstills in the order of a program.

    which (n,): indices of the standstills at targets. Program row of each, means t_s (n,) s, q (n, 6) rad and g_mm
    (n,), notes.
    """

    number: list[int]
    rows: Integers
    t_s: Array
    q: Array
    g_mm: Array
    doubts: list[str]


def visits_of(
    at: Sequence[tuple[Stand, int]],
    places: Sequence[Hashable],
    order: Sequence[Hashable],
    once: int,
    program: TargetProgram,
    where: str,
) -> Visits:
    """Return the visits among standstills at targets, each with its program row.

    places: target of each. order: targets of the program in sequence. once: length of one pass. Raises FileError if no
    standstill is at a target.
    """
    pairs = _longest_common(places, order)
    if len(pairs) > 1 and pairs[-1][1] > 0 and pairs[-1][1] % once == 0:
        pairs.pop()  # a pass ending at its first place is not counted: the robot returned
    fits, doubts = [k for k, _ in pairs], list[str]()
    if len(fits) < _FOLLOWED * len(places):
        fits = list(range(len(places)))
        doubts.append("targets were visited in a different order than in the rig file: all stands are used")
    elif others := len(places) - len(fits):
        outside = "outside the order of the program (before it, after it, or once too often) are not used"
        doubts.append(f"{others} stands {outside}")
    stands = [at[k][0] for k in fits]
    if not stands:
        remedy = "correct tests.hemisphere, or record its program"
        raise FileError(where, "the robot did not rest at any target", remedy)
    rows = np.array([at[k][1] for k in fits], dtype=np.int64)
    missing = sorted(set(program.target.tolist()) - set(program.target[rows].tolist()))
    if missing:
        ending = " …" if len(missing) > 8 else ""
        doubts.append(f"the run lacks a stop at target {', '.join(map(str, missing[:8]))}{ending}")
    if outliers := sum(stand.outliers for stand in stands):
        doubts.append(f"{outliers} readings are outliers of their stop and are not used")
    t_s, q, g_mm = zip(*((stand.t_s, stand.q, stand.g_mm[0]) for stand in stands), strict=True)
    return Visits(fits, rows, np.array(t_s), np.array(q), np.array(g_mm), doubts)


def _longest_common(places: Sequence[Hashable], order: Sequence[Hashable]) -> list[tuple[int, int]]:
    """Return indices of the longest common subsequence in both sequences; the latest of several."""
    codes = {place: code for code, place in enumerate(dict.fromkeys([*places, *order]))}
    targets = np.array([codes[place] for place in order], dtype=np.int64)
    length = np.zeros((len(places) + 1, len(order) + 1), dtype=np.int32)
    for k, place in enumerate(places):
        longer = np.where(targets == codes[place], length[k, :-1] + 1, 0)
        length[k + 1, 1:] = np.maximum.accumulate(np.maximum(length[k, 1:], longer))
    pairs, k, j = [], len(places), len(order)
    while length[k, j]:
        if length[k, j - 1] == length[k, j]:
            j -= 1
        elif places[k - 1] == order[j - 1]:
            k, j = k - 1, j - 1
            pairs.append((k, j))
        else:
            k -= 1
    return pairs[::-1]


def at_targets(
    stands: Sequence[Stand], program: TargetProgram, rig: Rig, turned: float = _TURNED_RAD
) -> list[tuple[Stand, int]]:
    """Return the standstills close to a program row, rotated by less than the limit, each with the closest row."""
    if not stands:
        return []
    arm = arm_of(rig.robot)
    targets, reached = forward(arm, program.q), forward(arm, np.array([stand.q for stand in stands]))
    away = np.linalg.norm(reached[:, None, :3, 3] - targets[None, :, :3, 3], axis=2)
    cosine = (np.einsum("aij,bij->ab", reached[:, :3, :3], targets[:, :3, :3]) - 1) / 2
    angle = np.arccos(np.clip(cosine, -1, 1))
    badness = away / _NEAR_MM + angle / _TURNED_RAD
    best = badness.argmin(axis=1)
    near = (away[np.arange(len(best)), best] < _NEAR_MM) & (angle[np.arange(len(best)), best] < turned)
    return [(stand, int(row)) for stand, row, good in zip(stands, best, near, strict=True) if good]


STANDS_MM = 1.0
"""Largest difference between positions or readings of one standstill; larger ones measure different things and are
not averaged."""


def one_row_a_stand(table: Table) -> Table:
    """Return a table with adjacent rows of one standstill averaged; circles are unchanged."""
    first = _begins(table)
    if first is None or first.all():
        return table
    stand = np.cumsum(first) - 1
    count = np.bincount(stand)

    def mean(values: Array) -> Array:
        """Return the means (s, …) over each standstill, in the unit of the values."""
        columns = values.reshape(len(values), -1).T
        means = np.stack([np.bincount(stand, column) / count for column in columns], axis=1)
        return means.reshape(len(count), *values.shape[1:])

    return table.kind.averaged(table, first, mean)


def rows_a_stand(table: Table) -> Integers:
    """Return the number of rows of each standstill, (s,); empty for circles."""
    first = _begins(table)
    return np.empty(0, dtype=np.int64) if first is None else np.bincount(np.cumsum(first) - 1)


def _begins(table: Table) -> Mask | None:
    """Return a mask (n,) of the rows starting a standstill; None if rows are never repeated readings."""
    differs = table.kind.differs(table) if len(table.q) else None
    if differs is None:
        return None
    moved = (np.abs(np.diff(table.q, axis=0)) > STANDS_RAD).any(axis=1) | differs
    if table.kind.of_places and not _neighbours_are_stands(table.q, moved):
        return np.ones(len(table.q), dtype=bool)
    return np.concatenate([[True], moved])


def _neighbours_are_stands(q: Array, moved: Mask) -> bool:
    """Return whether most rows that repeat a posture of joints q (n, axes) rad stand next to each other. Only then does
    the order of rows without times state that they are readings of one stand, and not visits in any order."""
    postures = len(np.unique(np.round(q / STANDS_RAD), axis=0))
    return 2 * int(np.count_nonzero(~moved)) > len(q) - postures
