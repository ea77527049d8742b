"""Standstills of the robot in a recording or a table.

A radial or repeatability program stops at each target. The readings of a standstill are averaged and assigned to the
closest target of the rig file. The side of approach is the tool's radial position since the previous stop. Standstills
outside the program's order are not visits: before the start, after the end, or additional waits. They are counted, but
not used.

Several readings of one standstill in a table count as one. Only a visit after a move shows repeatability; repeated
readings show the scatter of the instrument. In one case three readings of each standstill, treated as visits, gave an
RP of 0.008 mm, and tripled the data in calibration fits and held-out sets.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.robot.geometry.driven_programs import TargetProgram
from analysis.robot.kinematics.arm import Array, Integers, Mask, arm_of, forward
from analysis.robot.predict import standing
from analysis.runs.tables import Table, format_of
from rigs.errors import FileError
from rigs.rig import Rig

STANDSTILL_RAD = float(np.radians(0.01))
"""Largest joint motion within the window of a standstill, ten times the encoder noise."""
FLICKER_DEG = 0.03
"""Noise of a resting joint in a live view. The slowest circle moves a joint further within half a second."""
STILL_RUN_RAD = float(np.radians(0.2))
"""Largest joint motion in a run during which the robot stands still."""
_WINDOW_S = 0.3
_SETTLED = 0.5
"""Fraction of a standstill that is averaged: its last part, when the vibration of the arm has decayed."""
_OUTLYING = 6.0
"""Threshold of an outlier in scaled median deviations: twice the three of Hampel."""
_MOST_OUTLYING = 0.1
"""Largest share of outliers in a standstill. If there are more, the arm or gauge really moved."""


@dataclass(frozen=True)
class Stand:
    """Rows [begin, end) of a standstill, and means of its settled part: time s, angles (6,) rad, readings (k,) mm."""

    begin: int
    end: int
    t_s: float
    q: Array
    g_mm: Array
    outliers: int

    @property
    def settled(self) -> slice:
        return _settled(self.begin, self.end)


def stands_of(t_s: Array, q: Array, g_mm: Array) -> list[Stand]:
    stands = []
    for begin, end in standing(t_s, q, STANDSTILL_RAD, _WINDOW_S):
        settled = _settled(begin, end)
        mean_mm, outliers = _averaged(g_mm[settled])
        stands.append(Stand(begin, end, float(t_s[settled].mean()), _averaged(q[settled])[0], mean_mm, outliers))
    return stands


def _settled(begin: int, end: int) -> slice:
    return slice(begin + int((end - begin) * (1 - _SETTLED)), end)


def _averaged(values: Array) -> tuple[Array, int]:
    away = np.abs(values - np.median(values, axis=0))
    limit = _OUTLYING * 1.4826 * np.median(away, axis=0)
    # The median deviation is zero if most readings of a coarse gauge are equal. Outliers cannot be detected then.
    sound = (away <= limit) | (limit == 0)
    sound |= sound.mean(axis=0) < 1 - _MOST_OUTLYING
    mean: Array = np.where(sound, values, 0.0).sum(axis=0) / sound.sum(axis=0)
    return mean, int((~sound).sum())


_NEAR_MM = 20.0
_TURNED_RAD = np.radians(8.0)
"""Largest rotation of a standstill relative to a target."""
_FOLLOWED = 0.5
"""Smallest share of standstills at targets that follow the program's order."""


@dataclass(frozen=True)
class Visits:
    """Standstills in the order of a program.

    number: index of each visit among the standstills at targets. rows (n,): program row. t_s, q, g_mm: means.
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
    """Select the visits among the standstills at targets, and assign the program rows.

    places: target of each standstill. order: targets of the program. once: length of one pass. Raises FileError without
    a standstill at a target.
    """
    pairs = _longest_common(places, order)
    if len(pairs) > 1 and pairs[-1][1] > 0 and pairs[-1][1] % once == 0:
        pairs.pop()  # A pass that ends at its first target is not a new pass: the robot returned.
    fits, doubts = [k for k, _ in pairs], list[str]()
    if len(fits) < _FOLLOWED * len(places):
        fits = list(range(len(places)))
        doubts.append("targets were visited in a different order than in the rig file: all standstills are used")
    elif others := len(places) - len(fits):
        outside = "outside the order of the program (before, after, or repeated) are not used"
        doubts.append(f"{others} stops {outside}")
    stands = [at[k][0] for k in fits]
    if not stands:
        remedy = "correct tests.hemisphere, or record the program of that test"
        raise FileError(where, "the robot did not rest at any target", remedy, code="table.invalid")
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
    """Index pairs of the latest longest common subsequence."""
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
    """Assign each standstill to the closest program row, without those distant from all rows or rotated."""
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


FEWEST_POSTURES = 4
"""Smallest number of postures that determine base and tool: nine unknowns, and three coordinates of each posture."""


def require_postures(q: Array, where: str) -> None:
    """Raise FileError if joints q (n, axes) rad have too few postures to fit base and tool."""
    seen = list[Array]()
    for row in q:
        if not any(np.abs(row - other).max() < STILL_RUN_RAD for other in seen):
            seen.append(row)
        if len(seen) == FEWEST_POSTURES:
            return
    postures = "a single posture" if len(seen) == 1 else f"only {len(seen)} postures"
    problem = f"has rows of {postures}, which show the scatter of the instrument, but not the errors of the arm"
    raise FileError(
        where,
        problem,
        "measure other postures also, in the whole working space (rig plan --poses)",
        code="readings.too_few",
    )


STANDSTILL_MM = 1.0
"""Largest difference between positions or readings of one standstill. If the difference is larger, they are
measurements of different things and are not averaged.
"""


def average_standstills(table: Table) -> Table:
    first = format_of(table.test).stands(table)
    if first is None or first.all():
        return table
    stand = np.cumsum(first) - 1
    count = np.bincount(stand)

    def mean(values: Array) -> Array:
        columns = values.reshape(len(values), -1).T
        means = np.stack([np.bincount(stand, column) / count for column in columns], axis=1)
        return means.reshape(len(count), *values.shape[1:])

    return format_of(table.test).averaged(table, first, mean)


def rows_per_standstill(table: Table) -> Integers:
    first = format_of(table.test).stands(table)
    return np.empty(0, dtype=np.int64) if first is None else np.bincount(np.cumsum(first) - 1)


def standstill_starts(q: Array, differs: Mask) -> Mask:
    """Mask (n,) of the rows that start a standstill: joints moved, or the row differs otherwise (n - 1,)."""
    if not len(q):
        return np.ones(0, dtype=bool)
    return np.concatenate([[True], (np.abs(np.diff(q, axis=0)) > STANDSTILL_RAD).any(axis=1) | differs])


def standstill_starts_of_visits(q: Array, differs: Mask) -> Mask:
    """Mask like `standstill_starts`; rows without times that seem to be visits in any order are all starts."""
    starts = standstill_starts(q, differs)
    if not len(q):
        return starts
    # Most rows with equal postures are adjacent if they are repeated readings of one standstill.
    postures = len(np.unique(np.round(q / STANDSTILL_RAD), axis=0))
    are_adjacent = 2 * int(np.count_nonzero(~starts[1:])) > len(q) - postures
    return starts if are_adjacent else np.ones(len(q), dtype=bool)
