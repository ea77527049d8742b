"""The rows of one or several motions that lie on a circle, and how they deviate from it, in blocks.

Rows that stand, approach or go home are not on it; single rows far from their neighbours are left out and counted. The
deviations of neighbouring rows are averaged, not their places: the mean of places on an arc lies inside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.fitting.circle_search import Tolerance, followed
from analysis.fitting.slow_noise import Regression, regress
from analysis.geometry.circle import CircleFrame
from analysis.geometry.circle_through import deviations, moved, nearest_circle
from analysis.kinematics.arm import Arm, Array, Integers, Mask, forward
from analysis.traces.robot_motion import RobotMotion
from analysis.traces.stands import Stand, stands_of
from rigs.errors import FileError

_BIN_S = 0.05
"""So much of a motion is one place when the circle is searched: a few degrees of a circle that is driven fast."""
_FEWEST = 8
"""Bins on the circle, from which the scatter of the rest can be distinguished from the circle."""
_OUTLYING = 6.0 * 1.4826
"""Median deviations beyond which a row does not belong to the circle: as in `analysis.traces.stands`."""
_SMALLEST_MM = 0.02
"""Deviations up to this are a robot's on a circle, however even most of it is."""
_MOST_OUTLYING = 0.1
"""Share of rows that may be left out as wild; where more deviate, the arm bends its circle and all rows count."""
_ALONG = 0.9
"""Cosine between the way the tool goes and the circle; it approaches at a larger angle."""
_MOST_ROWS = 40_000
"""Rows that are taken of a motion, evenly: a lap of 18 s at 500 Hz has 9000."""
_BLOCKS = 80
"""Means of rows that the regression takes; its time grows with their third power."""
_TRIMS = 3
"""Times that bins off the circle are left out and the circle is fitted again; the second changes hardly any."""
_ROUNDS = 4
"""Gauss-Newton steps from a circle that was found to a part in a hundred: each squares what is left of it."""
_APART_S = 1e7
"""Between two runs: noise that both share is not seen."""


@dataclass(frozen=True)
class Binned:
    """Motions in bins, in order: t_s (n,) s; q (n, 6) rad, medians; T (n, 4, 4) of the tool; run (n,), the number of
    the motion; stands, by bins; rows: how many rows of each motion make a bin."""

    t_s: Array
    q: Array
    T: Array
    run: Integers
    stands: tuple[Stand, ...]
    rows: tuple[int, ...]

    @property
    def places(self) -> Array:
        """Places (n, 3) mm of the tool."""
        return self.T[:, :3, 3]

    @property
    def path(self) -> Mask:
        """Which bins (n,) are the path: all while the robot moved, and one of each stand."""
        rows = self.moving
        rows[self.stand_rows] = True
        return rows

    @property
    def stand_rows(self) -> Integers:
        """Index (m,) of the bin in the middle of each stand."""
        return np.array([(one.begin + one.end) // 2 for one in self.stands], dtype=np.int64)

    @property
    def moving(self) -> Mask:
        """Whether (n,) the robot moved."""
        moves = np.ones(len(self.t_s), dtype=bool)
        for one in self.stands:
            moves[one.begin : one.end] = False
        return moves


def binned(motions: Sequence[RobotMotion], arm: Arm) -> Binned:
    """Motions in bins of a twentieth of a second, or of one row where rows are further apart.

    Raises FileError for a motion of fewer than two bins."""
    times: list[Array] = []
    angles, runs, counts = [], [], []
    stands: list[Stand] = []
    for number, motion in enumerate(motions):
        count = max(1, int(np.ceil(_BIN_S / max(float(np.median(np.diff(motion.t_s))), 1e-6) - 0.1)))
        whole = len(motion.t_s) // count * count
        if whole < 2 * count:
            what = f"has {len(motion.t_s)} rows of motion, too few to find a circle in them"
            raise FileError(motion.where, what, "record all of the circle, and drive it slower")
        t_s = np.median(motion.t_s[:whole].reshape(-1, count), axis=1)
        q = np.median(motion.q[:whole].reshape(-1, count, 6), axis=1)
        first = sum(len(one) for one in times)
        stands += [
            replace(one, begin=first + one.begin, end=first + one.end)
            for one in stands_of(t_s, q, np.empty((len(t_s), 0)))
        ]
        times.append(t_s)
        angles.append(q)
        runs.append(np.full(len(t_s), number))
        counts.append(count)
    q = np.concatenate(angles)
    return Binned(np.concatenate(times), q, forward(arm, q), np.concatenate(runs), tuple(stands), tuple(counts))


def on_circle(bins: Binned, circle: CircleFrame, tolerance: Tolerance, where: str) -> tuple[Mask, CircleFrame]:
    """A mask (n,) of the bins that lie on a circle while the tool goes along it, and the nearest circle of these.
    Raises FileError for too few."""
    on, _ = followed(circle, bins.places, bins.run, tolerance)
    way = np.gradient(bins.places, axis=0)
    radial = np.cross(circle.n, bins.places - circle.centre)
    along = np.abs(np.einsum("ni,ni->n", way, radial))
    lengths = np.linalg.norm(way, axis=1) * np.linalg.norm(radial, axis=1)
    on &= bins.moving & (along > _ALONG * lengths)
    for _ in range(_TRIMS):
        if on.sum() < _FEWEST:
            what = f"the robot was on the circle for {_BIN_S * on.sum():.2g} s only, too briefly to fit it"
            raise FileError(where, what, "drive the circle slower, or record the feedback at a higher rate")
        circle = nearest_circle(bins.places[on]) or circle
        largest = deviations(circle, bins.places).largest
        on &= largest < _wild_from(largest[on])
    return on, circle


@dataclass(frozen=True)
class Fit:
    """The circle with what its regressions of radial and axial deviations say; rows used, and rows left out as wild."""

    circle: CircleFrame
    radial: Regression
    axial: Regression
    rows: int
    wild: int


def fit_rows(motions: Sequence[RobotMotion], arm: Arm, bins: Binned, on: Mask, circle: CircleFrame) -> Fit:
    """The circle by all rows of the bins that are on it, a mask (n,), with slow noise allowed for."""
    t_s, places, stretch = _rows(motions, arm, bins, on | _holes(bins, on))
    largest = deviations(circle, places).largest
    sound = largest < _wild_from(largest)
    if sound.mean() < 1 - _MOST_OUTLYING:
        sound[:] = True
    t_s, places, stretch = t_s[sound], places[sound], stretch[sound]
    starts = _block_starts(stretch)
    count = np.diff(np.append(starts, len(t_s))).astype(float)

    def mean(values: Array) -> Array:
        return np.asarray(np.add.reduceat(values, starts) / count.reshape(-1, *[1] * (values.ndim - 1)))

    root = np.sqrt(count)[:, None]
    for _ in range(_ROUNDS):
        away = deviations(circle, places)
        design, readings = mean(away.design), mean(np.stack([away.radial, away.axial], axis=1))
        radial, axial = np.linalg.lstsq(design * root, readings * root, rcond=None)[0].T
        circle = moved(circle, radial, axial)
    away = deviations(circle, places)
    readings = mean(np.stack([away.radial, away.axial], axis=1))
    along, across = regress(mean(away.design), readings, mean(t_s), count)
    wild = int((~sound).sum())
    return Fit(moved(circle, along.value, across.value), along, across, len(t_s), wild)


def _wild_from(largest: Array) -> float:
    """The deviation in mm from which a place is not of a circle whose places deviate by (n,) mm."""
    return max(_OUTLYING * float(np.median(largest)), _SMALLEST_MM)


def _holes(bins: Binned, on: Mask) -> Mask:
    """Which bins (n,) are off a circle that the robot was on just before and just after: their rows are judged singly,
    since a wild row spoils the median of three, and so does a joint that turns back."""
    before, after = np.zeros_like(on), np.zeros_like(on)
    for away in (1, 2):
        before[away:] |= on[:-away] & (bins.run[:-away] == bins.run[away:])
        after[:-away] |= on[away:] & (bins.run[away:] == bins.run[:-away])
    holes: Mask = before & after & ~on
    return holes


def _rows(motions: Sequence[RobotMotion], arm: Arm, bins: Binned, on: Mask) -> tuple[Array, Array, Integers]:
    """Times (m,) s, places (m, 3) mm and numbers (m,) of the stretch of the rows in the bins that are on the circle."""
    stretches = np.cumsum(np.diff(on, prepend=False) | (np.diff(bins.run, prepend=0) != 0))
    times, angles, numbers = [], [], []
    for number, (motion, count) in enumerate(zip(motions, bins.rows, strict=True)):
        own = np.flatnonzero(on & (bins.run == number))
        rows = ((own - np.searchsorted(bins.run, number))[:, None] * count + np.arange(count)).ravel()
        times.append(motion.t_s[rows] + _APART_S * number)
        angles.append(motion.q[rows])
        numbers.append(np.repeat(stretches[own], count))
    thin = slice(None, None, max(1, sum(map(len, times)) // _MOST_ROWS))
    t_s, q, stretch = (np.concatenate(parts)[thin] for parts in (times, angles, numbers))
    return t_s, forward(arm, q)[:, :3, 3], stretch


def _block_starts(stretch: Integers) -> Integers:
    """The first row of each block: stretches (m,) by number cut into pieces of nearly one length."""
    size = max(1, -(-len(stretch) // _BLOCKS))
    begins = np.flatnonzero(np.diff(stretch, prepend=stretch[0] - 1))
    ends = np.append(begins[1:], len(stretch))
    pieces = [np.arange(begin, end, size) for begin, end in zip(begins.tolist(), ends.tolist(), strict=True)]
    return np.concatenate(pieces)
