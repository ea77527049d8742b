"""Where the robot stood still, and at which target: the readings of each stand without wild ones.

A radial or repeatability program stops at each target. While all joints stand, the gauge is averaged; the target is the
nearest of the rig file's; the side of approach is where the tool was, along the radius, since it last stood there.
Stands that do not belong to the program's order are not visits: where the robot stood before it began or after its end,
or waited at a target for something else. They are counted, not used.

In a table several readings of one stand count as one, since only a visit after a move shows repeatability: they scatter
by the instrument alone. Taken for visits, three of them gave an RP of 0.008 mm, and made the fits of a calibration, and
what is held out of them, three times the same.
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
"""Joints that move by less within the window stand; an encoder's noise is a tenth of it."""
FLICKER_DEG = 0.03
"""A joint seen live that is at rest flickers by less; the slowest circle moves some joint by more in half a second."""
STOOD_RAD = float(np.radians(0.2))
"""Joints that move by less in a whole run stood still."""
_WINDOW_S = 0.3
_SETTLED = 0.5
"""Share of a stand, at its end, that is averaged: the arm has stopped swinging by then."""
_OUTLYING = 6.0
"""Scaled median deviations beyond which a sample of a stand is an outlier: Hampel's usual three, twice as wary."""
_MOST_OUTLYING = 0.1
"""More of a stand than this share is not an outlier: the arm or the gauge really moved."""


@dataclass(frozen=True)
class Stand:
    """Rows [begin, end) in which all joints stood; mean angles (6,) rad and mean readings (k,) mm of the settled part,
    without its `outliers`."""

    begin: int
    end: int
    t_s: float
    q: Array
    g_mm: Array
    outliers: int

    @property
    def settled(self) -> slice:
        """The rows that are averaged."""
        return _settled(self.begin, self.end)


def stands_of(t_s: Array, q: Array, g_mm: Array) -> list[Stand]:
    """The stands of a motion: times t_s (n,) s, reported angles q (n, 6) rad, readings g_mm (n, k) of k gauges."""
    stands = []
    for begin, end in standing(t_s, q, STANDS_RAD, _WINDOW_S):
        settled = _settled(begin, end)
        mean_mm, outliers = _averaged(g_mm[settled])
        stands.append(Stand(begin, end, float(t_s[settled].mean()), _averaged(q[settled])[0], mean_mm, outliers))
    return stands


def _settled(begin: int, end: int) -> slice:
    return slice(begin + int((end - begin) * (1 - _SETTLED)), end)


def _averaged(values: Array) -> tuple[Array, int]:
    """Mean (k,) of the readings, or angles, (n, k) of a stand without single wild ones, and how many those were."""
    away = np.abs(values - np.median(values, axis=0))
    limit = _OUTLYING * 1.4826 * np.median(away, axis=0)
    # Readings of a coarse gauge that mostly agree have no median deviation: nothing is called wild there.
    sound = (away <= limit) | (limit == 0)
    sound |= sound.mean(axis=0) < 1 - _MOST_OUTLYING
    mean: Array = np.where(sound, values, 0.0).sum(axis=0) / sound.sum(axis=0)
    return mean, int((~sound).sum())


_NEAR_MM = 20.0
_TURNED_RAD = np.radians(8.0)
"""A stand further from every target than this is not at a target."""
_FOLLOWED = 0.5
"""A run follows the program's order where at least this share of its stands at targets fits it."""


@dataclass(frozen=True)
class Visits:
    """The stands that follow the order of a program: which (n,) of those at targets, the program's row of each, means
    t_s (n,) s, q (n, 6) rad and g_mm (n,), and what a person should know."""

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
    """Return the visits among stands at targets, each with its row of the program; places: what each is of, order:
    those of the program in turn, once: of one pass of it. Raises FileError where no stand is at a target."""
    pairs = _longest_common(places, order)
    if len(pairs) > 1 and pairs[-1][1] > 0 and pairs[-1][1] % once == 0:
        pairs.pop()  # a pass that ends with its first place is not counted: the robot went back
    fits, doubts = [k for k, _ in pairs], list[str]()
    if len(fits) < _FOLLOWED * len(places):
        fits = list(range(len(places)))
        doubts.append("targets were visited in another order than in the rig file: all stands are used")
    elif others := len(places) - len(fits):
        outside = "outside the order of the program (before it, after it, or once too often) are not used"
        doubts.append(f"{others} stands {outside}")
    stands = [at[k][0] for k in fits]
    if not stands:
        remedy = "correct tests.hemisphere, or record its program"
        raise FileError(where, "the robot did not stand at any target", remedy)
    rows = np.array([at[k][1] for k in fits], dtype=np.int64)
    missing = sorted(set(program.target.tolist()) - set(program.target[rows].tolist()))
    if missing:
        ending = " …" if len(missing) > 8 else ""
        doubts.append(f"the run has no stand at target {', '.join(map(str, missing[:8]))}{ending}")
    if outliers := sum(stand.outliers for stand in stands):
        doubts.append(f"{outliers} readings lie far from the others of their stand and are not used")
    t_s, q, g_mm = zip(*((stand.t_s, stand.q, stand.g_mm[0]) for stand in stands), strict=True)
    return Visits(fits, rows, np.array(t_s), np.array(q), np.array(g_mm), doubts)


def _longest_common(places: Sequence[Hashable], order: Sequence[Hashable]) -> list[tuple[int, int]]:
    """Numbers in both of the longest common subsequence; of equal ones, the one whose places come last."""
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
    """Return the stands that are near a row of the program, turned by less, each with the nearest row."""
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
"""Places or readings of one stand that differ by more are no readings of one thing; they are left as they are."""


def one_row_a_stand(table: Table) -> Table:
    """A table with neighbouring rows of one stand averaged; circles, driven, as they are."""
    first = _begins(table)
    if first is None or first.all():
        return table
    stand = np.cumsum(first) - 1
    count = np.bincount(stand)

    def mean(values: Array) -> Array:
        """Means (s, …) in the values' unit over each stand."""
        columns = values.reshape(len(values), -1).T
        means = np.stack([np.bincount(stand, column) / count for column in columns], axis=1)
        return means.reshape(len(count), *values.shape[1:])

    return table.kind.averaged(table, first, mean)


def rows_a_stand(table: Table) -> Integers:
    """How many rows each stand of a table has, (s,); none of a circle, which is driven."""
    first = _begins(table)
    return np.empty(0, dtype=np.int64) if first is None else np.bincount(np.cumsum(first) - 1)


def _begins(table: Table) -> Mask | None:
    """Which rows (n,) begin a stand; None where no row is a second reading of one."""
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
