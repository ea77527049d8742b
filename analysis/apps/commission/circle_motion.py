"""Which part of a path is a circle, which rows lie on it, and how they deviate where noise is slow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.robot.geometry.circle import (
    CircleFrame,
    circle_frame,
    circles_through,
    deviations,
    largest_deviations,
    moved,
    nearest_circle,
)
from analysis.robot.kinematics.arm import Arm, Array, Integers, Mask, forward
from analysis.runs.loading import RobotMotion
from analysis.runs.stands import Stand, stands_of
from rigs.errors import FileError

# ----------------------------------------------------------------------------------------------------------------------
# Which part of a path is the circle: found among approaches, ways home and stops, without knowing the circle.
#
# The path is taken at even steps of distance, so that a stop weighs nothing. Circles through three of its points,
# near and far apart, are held against all of it; the one along which the path turns furthest without leaving it wins.
# A straight line stays within the tolerance of a circle for 23° at the most. An arm that swings one joint seldom
# turns as far as a programmed circle; where it does, that is a second circle, and a person decides.

_POINTS = 600
"""Points along the path, so that a tenth of it still has sixty."""
_TRIPLES = 1500
"""Some hundred have all three points on the circle, also where it is only a tenth of the path."""
_BEST = 20
"""Triples of points that are refined: those that turn furthest, most of which are the same circle."""
_REFINED = 3
"""Times that a circle is fitted to what lies on it; it ends earlier where nothing changes."""
_RADIUS_MM = (1.0, 2000.0)
"""Radii that a rig file may have (`rigs.schema.declared_tests.Circle`)."""
_OF_RADIUS = 0.01
"""Share of the radius that a point may be off at the most, so that a small circle does not take in a corner."""
_FEWEST_OF_A_STRETCH = 10
"""Points of a stretch; fewer are the corner where two lines meet."""
_HOLES = 2
"""Points in a row that may be off: a row or two of the feedback wrong."""


@dataclass(frozen=True)
class Tolerance:
    """How far, in mm, a path may be off its circle, at most `scale` hundredths of the radius, and the arc in rad along
    which it must follow it to be one."""

    mm: float
    scale: float
    least_rad: float

    def at(self, radius_mm: float) -> float:
        """The tolerance in mm on a circle of this radius."""
        return min(self.mm, self.scale * _OF_RADIUS * radius_mm)


DRIVEN = Tolerance(0.5, 1.0, float(np.radians(30.0)))
"""A robot's own circle: the constants of a healthy arm bend it by some tenths of a mm."""
BENT = Tolerance(2.0, 3.0, float(np.radians(90.0)))
"""The circle of a robot whose controller has other constants than the rig file, as with zeros off by half a degree."""
LED = Tolerance(5.0, 5.0, float(np.radians(120.0)))
"""A circle along which a person led the robot; a line is as near to it for up to 52°."""


@dataclass(frozen=True)
class FoundCircle:
    """A circle in a path, and along how much of it, in rad, the path went."""

    circle: CircleFrame
    turned_rad: float


def even_path(places: Array, run: Integers) -> tuple[Array, Integers]:
    """At most some hundred points (k, 3) mm at even distances along places (n, 3) mm, and the run (k,) of each."""
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    steps[np.diff(run) != 0] = 0.0
    along = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.linspace(0.0, along[-1], _POINTS)
    points = np.stack([np.interp(at, along, column) for column in places.T], axis=1)
    return points, run[np.searchsorted(along, at).clip(max=len(run) - 1)]


def find_circle(points: Array, run: Integers, tolerance: Tolerance) -> FoundCircle | None:
    """The circle along which a path of even steps (k, 3) mm in runs (k,) by number turns furthest; None without one."""
    rng = np.random.default_rng(0)
    half = np.exp(rng.uniform(np.log(3), np.log((len(points) - 1) / 2), _TRIPLES)).astype(int)
    middle = (half + rng.uniform(size=_TRIPLES) * (len(points) - 2 * half)).astype(int)
    rows = np.stack([middle - half, middle, middle + half], axis=1)
    centre, normal, radius = circles_through(points[rows])
    sound = (radius > _RADIUS_MM[0]) & (radius < _RADIUS_MM[1])
    centre, normal, radius, rows = centre[sound], normal[sound], radius[sound], rows[sound]
    limit = np.array([tolerance.at(mm) for mm in radius.tolist()])
    turned = (largest_deviations(points, centre, normal, radius) < limit[:, None]).sum(axis=1) / radius
    best: FoundCircle | None = None
    for k in np.argsort(-turned)[:_BEST]:
        circle, turned_rad = circle_frame(centre[k], normal[k], points[rows[k, 0]] - centre[k], radius[k]), 0.0
        for _ in range(_REFINED):
            on, turned_rad = followed(circle, points, run, tolerance)
            nearest = nearest_circle(points[on]) if on.sum() > 3 else None
            if nearest is None or not _RADIUS_MM[0] < nearest.radius < _RADIUS_MM[1]:
                break
            circle = nearest
        else:
            if best is None or turned_rad > best.turned_rad:
                best = FoundCircle(circle, turned_rad)
    return best


def followed(circle: CircleFrame, points: Array, run: Integers, tolerance: Tolerance) -> tuple[Mask, float]:
    """Which points (k, 3) mm of runs (k,) by number belong to stretches that follow a circle, and how far these turn in
    rad."""
    away = deviations(circle, points)
    on = away.largest < tolerance.at(circle.radius)
    rows = np.flatnonzero(on)
    kept, turned = np.zeros(len(points), dtype=bool), 0.0
    if not len(rows):
        return kept, turned
    breaks = np.flatnonzero((np.diff(rows) > 1 + _HOLES) | (np.diff(run[rows]) != 0)) + 1
    for stretch in np.split(rows, breaks):
        turned_here = float(np.ptp(np.unwrap(away.phi[stretch])))
        if turned_here >= tolerance.least_rad and len(stretch) >= _FEWEST_OF_A_STRETCH:
            kept[stretch] = True
            turned += turned_here
    return kept, turned


# ----------------------------------------------------------------------------------------------------------------------
# A regression whose noise may be slow: how much each coefficient is worth where neighbouring readings err alike.
#
# The noise is taken as white and slow together: the covariance of two readings is s² (white + r k(|t - t'| / tau)), k
# falling exponentially (rough) or as Matérn's of order 3/2 (smooth). How much is slow (r), over which time (tau) and
# how large all of it is (s) is not known. Each combination on a grid is weighed by its restricted likelihood, in
# which the coefficients and s are integrated out, and the answer is the mean over all of them, each with Student's t.
# So a short record, which cannot distinguish slow noise from the motion itself, has a large uncertainty.
#
# Noise that a record cannot show at all could be of any size: its standard deviation has a half-Cauchy prior as wide
# as what the regression leaves (Gelman, Bayesian Analysis 1, 2006), and smooth noise is at the slowest a quarter of
# the record long.

_TIMES = 7
"""Correlation times from a step to the longest: neighbours differ by less than a factor of three at 100 steps."""
_LONGEST = (1.0, 0.25)
"""Longest times of rough and of smooth noise in lengths of the record. What is slower is a part of the motion to it."""
_SHARES = np.concatenate([[0.0], np.geomspace(1e-2, 1e6, 9)])
"""Slow variance over white variance; the mean of some hundred readings shows white noise hardly at all."""
_NONE = float(np.pi / np.log(_SHARES[2] / _SHARES[1]))
"""Weight of no slow noise: that of all shares together, which is the half-Cauchy's sum over the grid."""
_NOTHING = 1e-24
"""Square of a deviation, of readings without noise."""
_DRAWS = 4000
"""Draws of the coefficients; a quantile of 95 % is then good to 2 %."""


@dataclass(frozen=True)
class Regression:
    """value (p,) of the coefficients, in the readings' unit; covariance (p, p), in its square."""

    value: Array
    covariance: Array


@dataclass(frozen=True)
class _Case:
    """One combination of the grid: log of its weight; value (p,) of the coefficients; over s² their covariance (p, p);
    squares: the sum of squares of what is left, whitened."""

    log: float
    value: Array
    inverse: Array
    squares: float


def regress(design: Array, readings: Array, t_s: Array, count: Array) -> list[Regression]:
    """The coefficients of each column of readings (m, k), in any unit, by a design (m, p), as shares.

    t_s (m,): times; count (m,): how many equal readings each is the mean of. m must be 4 above p or more."""
    m, p = design.shape
    step = float(np.median(np.diff(t_s)))
    span = max(step * m, 2 * step)
    root = np.sqrt(count / count.mean())
    rest_of_fit = readings - design @ np.linalg.lstsq(design, readings, rcond=None)[0]
    usual = np.maximum((rest_of_fit**2).sum(axis=0) / (m - p), _NOTHING)
    cases: list[list[_Case]] = [[] for _ in readings.T]
    for longest, smooth in zip(_LONGEST, (0.0, 1.0), strict=True):
        for tau in np.geomspace(step, longest * span, _TIMES):
            away = np.abs(t_s[:, None] - t_s) / tau
            # Whitened by the white part, so that one decomposition serves every share.
            level, V = np.linalg.eigh((1 + smooth * away) * np.exp(-away) * np.outer(root, root))
            X, Y = (V.T @ (values * root[:, None]) for values in (design, readings))
            for share in _SHARES.tolist():
                variance = 1 + share * np.maximum(level, 0.0)
                for column_cases, y, residual in zip(cases, Y.T, usual.tolist(), strict=True):
                    column_cases.append(_case(X, y, variance, share, residual))
    return [_posterior(column_cases, m - p) for column_cases in cases]


def _case(X: Array, y: Array, variance: Array, share: float, usual: float) -> _Case:
    """One case by its restricted likelihood and the prior of its slow part; usual: mean square of what is left."""
    scaled = X / variance[:, None]
    information = scaled.T @ X
    inverse: Array = np.asarray(np.linalg.inv(information), dtype=np.float64)
    value = inverse @ (scaled.T @ y)
    free = len(y) - X.shape[1]
    squares = max(float(((y - X @ value) ** 2 / variance).sum()), _NOTHING)
    log = -0.5 * float(np.log(variance).sum() + np.linalg.slogdet(information)[1] + free * np.log(squares))
    slow = share * squares / free / usual
    # Half-Cauchy over the logarithm; no slow noise at all is as likely as some.
    return _Case(
        log + (float(np.log(np.sqrt(slow) / (1 + slow))) if share else float(np.log(_NONE))), value, inverse, squares
    )


def _posterior(cases: list[_Case], free: int) -> Regression:
    """The mean over all cases, and its covariance, scaled so that 1.96 u of each coefficient hold 95 % of the draws."""
    logs = np.array([case.log for case in cases])
    weight = np.exp(logs - logs.max())
    weight /= weight.sum()
    value: Array = weight @ np.array([case.value for case in cases])
    rng = np.random.default_rng(0)
    draws = []
    for case, count in zip(cases, rng.multinomial(_DRAWS, weight).tolist(), strict=True):
        size = np.sqrt(case.squares / rng.chisquare(free, count))[:, None]
        draws.append(
            case.value - value + size * (rng.normal(size=(count, len(value))) @ np.linalg.cholesky(case.inverse).T)
        )
    off = np.concatenate(draws)
    covariance = off.T @ off / _DRAWS
    wide = np.quantile(np.abs(off), 0.95, axis=0) / 1.96 / np.sqrt(np.diag(covariance))
    return Regression(value, covariance * np.outer(wide, wide))


# ----------------------------------------------------------------------------------------------------------------------
# The rows of one or several motions that lie on a circle, and how they deviate from it, in blocks.
#
# Rows that stand, approach or go home are not on it; single rows far from their neighbours are left out and counted.
# The deviations of neighbouring rows are averaged, not their places: the mean of places on an arc lies inside it.

_BIN_S = 0.05
"""So much of a motion is one place when the circle is searched: a few degrees of a circle that is driven fast."""
_FEWEST = 8
"""Bins on the circle, from which the scatter of the rest can be distinguished from the circle."""
_OUTLYING = 6.0 * 1.4826
"""Median deviations beyond which a row does not belong to the circle: as in `analysis.runs.stands`."""
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
        return np.array([(stand.begin + stand.end) // 2 for stand in self.stands], dtype=np.int64)

    @property
    def moving(self) -> Mask:
        """Whether (n,) the robot moved."""
        moves = np.ones(len(self.t_s), dtype=bool)
        for stand in self.stands:
            moves[stand.begin : stand.end] = False
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
            problem = f"has {len(motion.t_s)} rows of motion, too few for a circle"
            raise FileError(motion.where, problem, "record the full circle at a lower speed")
        t_s = np.median(motion.t_s[:whole].reshape(-1, count), axis=1)
        q = np.median(motion.q[:whole].reshape(-1, count, 6), axis=1)
        first = sum(len(earlier) for earlier in times)
        stands += [
            replace(stand, begin=first + stand.begin, end=first + stand.end)
            for stand in stands_of(t_s, q, np.empty((len(t_s), 0)))
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
            problem = f"the robot was on the circle for {_BIN_S * on.sum():.2g} s only, too short for a fit"
            raise FileError(where, problem, "drive the circle slower, or record the feedback at a higher rate")
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
    # Which bins (n,) are off a circle that the robot was on just before and just after: their rows are judged singly,
    # since a wild row spoils the median of three, and so does a joint that turns back
    before, after = np.zeros_like(on), np.zeros_like(on)
    for off in (1, 2):
        before[off:] |= on[:-off] & (bins.run[:-off] == bins.run[off:])
        after[:-off] |= on[off:] & (bins.run[off:] == bins.run[:-off])
    holes: Mask = before & after & ~on
    t_s, places, stretch = _rows(motions, arm, bins, on | holes)
    largest = deviations(circle, places).largest
    sound = largest < _wild_from(largest)
    if sound.mean() < 1 - _MOST_OUTLYING:
        sound[:] = True
    t_s, places, stretch = t_s[sound], places[sound], stretch[sound]
    # The first row of each block: stretches (m,) by number cut into pieces of nearly one length
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
    along, across = regress(mean(away.design), readings, mean(t_s), count)
    wild = int((~sound).sum())
    return Fit(moved(circle, along.value, across.value), along, across, len(t_s), wild)


def _wild_from(largest: Array) -> float:
    """The deviation in mm from which a place is not of a circle whose places deviate by (n,) mm."""
    return max(_OUTLYING * float(np.median(largest)), _SMALLEST_MM)


def _rows(motions: Sequence[RobotMotion], arm: Arm, bins: Binned, on: Mask) -> tuple[Array, Array, Integers]:
    """Times (m,) s, places (m, 3) mm and numbers (m,) of the stretch of the rows in the bins that are on the circle."""
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
