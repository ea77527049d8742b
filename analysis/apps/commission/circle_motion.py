"""Fit of a circle to the rows of one or several motions, with deviations averaged in blocks.

Rows of stops, approaches and returns are excluded. Single rows distant from their neighbours are dropped and counted.
Averages are taken over the deviations of neighbouring rows, not over places: the mean of places on an arc lies inside
the arc.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.apps.commission.circle_search import DRIVEN, Tolerance, follow_circle
from analysis.apps.commission.slow_noise import regress
from analysis.robot.geometry.circle import (
    CircleFrame,
    deviations,
    moved,
    nearest_circle,
)
from analysis.robot.kinematics.arm import Arm, Array, Integers, Mask, forward
from analysis.runs.loading import RobotMotion
from analysis.runs.stands import Stand, stands_of
from rigs.errors import FileError

_BIN_S = 0.05
"""Bin length in the search for a circle: a few degrees of a fast circle."""
_FEWEST = 8
"""Minimum number of bins for separating scatter from the circle."""
_OUTLYING = 6.0 * 1.4826
"""Limit in median deviations beyond which a row is off the circle, as in `analysis.runs.stands`."""
_SMALLEST_MM = 0.02
"""Smallest limit for outliers: on a good circle single rows of a robot deviate this much."""
_MOST_OUTLYING = 0.1
"""If more rows deviate, the arm bends the circle and all rows are used."""
_ALONG = 0.9
"""Minimum cosine between the motion of the tool and the circle. An approach has a larger angle."""
_MOST_ROWS = 40_000
"""Maximum number of rows used, spread evenly. A lap of 18 s at 500 Hz has 9000."""
_BLOCKS = 80
"""Maximum number of block means: the run time grows with the third power."""
_TRIMS = 3
"""Rounds of dropping outlying bins and refitting the circle. The second changes very little."""
_ROUNDS = 4
"""Gauss-Newton steps: the start is accurate to 1 %, and each step squares the relative error."""
_ROUND_MM = 0.3
"""Largest deviation from a circle caused by a healthy arm."""
NEAR = 4.0
"""Tolerances from a circle within which a path still belongs to it."""
_APART_S = 1e7
"""Time between two runs that makes them uncorrelated."""


@dataclass(frozen=True)
class Binned:
    t_s: Array
    """Median timestamps (n,)."""
    q: Array
    """Median angles (n, 6) in rad."""
    T: Array
    """Tool poses (n, 4, 4)."""
    run: Integers
    """Number (n,) of the motion."""
    stands: tuple[Stand, ...]
    """Stops, by bin indices."""
    rows: tuple[int, ...]
    """Rows in a bin, of each motion."""

    @property
    def places(self) -> Array:
        """Places (n, 3) of the tool in mm."""
        return self.T[:, :3, 3]

    @property
    def stand_rows(self) -> Integers:
        """Index (m,) of the middle bin of each stop."""
        return np.array([(stand.begin + stand.end) // 2 for stand in self.stands], dtype=np.int64)

    @property
    def moving(self) -> Mask:
        """Mask (n,) of the bins in which the robot moved."""
        moves = np.ones(len(self.t_s), dtype=bool)
        for stand in self.stands:
            moves[stand.begin : stand.end] = False
        return moves


def bin_motions(motions: Sequence[RobotMotion], arm: Arm) -> Binned:
    parts, counts, stands, first = [], list[int](), list[Stand](), 0
    for number, motion in enumerate(motions):
        count = max(1, int(np.ceil(_BIN_S / max(float(np.median(np.diff(motion.t_s))), 1e-6) - 0.1)))
        whole = len(motion.t_s) // count * count
        if whole < 2 * count:
            problem = f"has {len(motion.t_s)} rows of motion, too few for a circle"
            raise FileError(motion.where, problem, "record the full circle at a lower speed", code="readings.too_few")
        t_s = np.median(motion.t_s[:whole].reshape(-1, count), axis=1)
        q = np.median(motion.q[:whole].reshape(-1, count, 6), axis=1)
        here = stands_of(t_s, q, np.empty((len(t_s), 0)))
        stands += [replace(stand, begin=first + stand.begin, end=first + stand.end) for stand in here]
        parts.append((t_s, q, np.full(len(t_s), number)))
        counts.append(count)
        first += len(t_s)
    t_s, q, run = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Binned(t_s, q, forward(arm, q), run, tuple(stands), tuple(counts))


def on_circle(bins: Binned, circle: CircleFrame, tolerance: Tolerance, where: str) -> tuple[Mask, CircleFrame]:
    """Bins (n,) in which the tool moved along the circle, and the circle nearest to them."""
    on, _ = follow_circle(circle, bins.places, bins.run, tolerance)
    way = np.gradient(bins.places, axis=0)
    radial = np.cross(circle.n, bins.places - circle.centre)
    along = np.abs(np.einsum("ni,ni->n", way, radial))
    lengths = np.linalg.norm(way, axis=1) * np.linalg.norm(radial, axis=1)
    on &= bins.moving & (along > _ALONG * lengths)
    for _ in range(_TRIMS):
        if on.sum() < _FEWEST:
            problem = f"the robot was on the circle for {_BIN_S * on.sum():.2g} s only, too short for a fit"
            remedy = "drive the circle more slowly, or record the feedback at a higher rate"
            raise FileError(where, problem, remedy, code="readings.too_few")
        circle = nearest_circle(bins.places[on]) or circle
        largest = deviations(circle, bins.places).largest
        on &= largest < _outlier_from_mm(largest[on])
    return on, circle


@dataclass(frozen=True)
class CircleFit:
    circle: CircleFrame
    radial: Array
    """Covariance (3, 3) in mm² of the coefficients of the radial deviations."""
    axial: Array
    """The same of the axial deviations."""
    T: Array
    """Tool poses (n, 4, 4) of the stretch, in order of time."""
    q: Array
    """Joint angles (n, 6) of the stretch in rad."""
    used: str
    """Description of the data."""
    doubts: tuple[str, ...] = ()
    motion: int = 0
    """Number of the motion of the stretch."""


def fit_rows(motions: Sequence[RobotMotion], arm: Arm, bins: Binned, on: Mask, circle: CircleFrame) -> CircleFit:
    """Fit a circle to all rows of the selected bins (n,), allowing for slow noise."""
    # Rows of bins off the circle with neighbours on it are tested individually: an outlier or a reversing joint spoils
    # the median of a small bin.
    before, after = np.zeros_like(on), np.zeros_like(on)
    for off in (1, 2):
        before[off:] |= on[:-off] & (bins.run[:-off] == bins.run[off:])
        after[:-off] |= on[off:] & (bins.run[off:] == bins.run[:-off])
    t_s, places, stretch = _rows_of_bins(motions, arm, bins, on | (before & after))
    largest = deviations(circle, places).largest
    sound = largest < _outlier_from_mm(largest)
    if sound.mean() < 1 - _MOST_OUTLYING:
        sound[:] = True
    t_s, places, stretch = t_s[sound], places[sound], stretch[sound]
    # First row of each block: stretches (m,) cut into pieces of similar length.
    size = max(1, -(-len(stretch) // _BLOCKS))
    begins = np.flatnonzero(np.diff(stretch, prepend=stretch[0] - 1))
    ends = np.append(begins[1:], len(stretch))
    pieces = [np.arange(begin, end, size) for begin, end in zip(begins.tolist(), ends.tolist(), strict=True)]
    starts = np.concatenate(pieces)
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
    (radial, radial_cov), (axial, axial_cov) = regress(mean(away.design), readings, mean(t_s), count)
    circle = moved(circle, radial, axial)
    longest, outliers = _longest_stretch(bins, on, circle), int((~sound).sum())
    doubts = [f"{outliers} rows are outliers of the circle and are not used"] if outliers else []
    off_mm = float(np.quantile(deviations(circle, bins.places[on]).largest, 0.95))
    if off_mm > _ROUND_MM:
        hand = f"the path is off the circle by {off_mm:.1f} mm: the robot was guided by hand, the feedback jumped, or"
        doubts.append(f"{hand} the link constants of the controller differ from the rig file")
    return CircleFit(
        circle, radial_cov, axial_cov, bins.T[longest], bins.q[longest], f"{len(t_s)} rows", tuple(doubts),
        int(bins.run[longest][0]),
    )  # fmt: skip


def _longest_stretch(bins: Binned, on: Mask, circle: CircleFrame) -> Integers:
    """Bins that follow a circle over the largest angle, with pauses at turning points."""
    rows = np.flatnonzero(on)
    is_off = deviations(circle, bins.places).largest > DRIVEN.at(circle.radius) * NEAR
    number = np.cumsum(is_off | (np.diff(bins.run, prepend=0) != 0))[rows]
    pieces = [rows[number == piece] for piece in np.unique(number)]
    return max(pieces, key=lambda piece: float(np.ptp(circle.angle(bins.places[piece]))))


def _outlier_from_mm(largest: Array) -> float:
    """Deviation from which a place is an outlier among places with these deviations (n,)."""
    return max(_OUTLYING * float(np.median(largest)), _SMALLEST_MM)


def _rows_of_bins(motions: Sequence[RobotMotion], arm: Arm, bins: Binned, on: Mask) -> tuple[Array, Array, Integers]:
    """Timestamps (m,), places (m, 3) in mm and stretch numbers (m,) of the rows in the selected bins."""
    stretches = np.cumsum(np.diff(on, prepend=False) | (np.diff(bins.run, prepend=0) != 0))
    times, angles, numbers = [], [], []
    for number, (motion, count) in enumerate(zip(motions, bins.rows, strict=True)):
        bins_of_run = np.flatnonzero(on & (bins.run == number))
        rows = ((bins_of_run - np.searchsorted(bins.run, number))[:, None] * count + np.arange(count)).ravel()
        times.append(motion.t_s[rows] + _APART_S * number)
        angles.append(motion.q[rows])
        numbers.append(np.repeat(stretches[bins_of_run], count))
    thin = slice(None, None, max(1, sum(map(len, times)) // _MOST_ROWS))
    t_s, q, stretch = (np.concatenate(parts)[thin] for parts in (times, angles, numbers))
    return t_s, forward(arm, q)[:, :3, 3], stretch
