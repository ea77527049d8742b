"""Circles in a path: their detection, the rows on them, and a fit that allows for slow noise."""

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
# Search for the circular part of a path among approaches, returns and stops.
#
# The path is resampled at equal distances, so stops have no weight. Among circles through triples of points, the one
# that the path follows over the largest angle wins. A straight line stays within the tolerance for at most 23°.

_POINTS = 600
"""Points along the path: a tenth of it still has sixty."""
_TRIPLES = 1500
"""Random triples; a few hundred lie on a circle that is a tenth of the path."""
_BEST = 20
"""Triples that are refined."""
_REFINED = 3
"""Fits to the points on a circle."""
_RADIUS_MM = (1.0, 2000.0)
"""Radii allowed in a rig file (`rigs.schema.declared_tests.Circle`)."""
_OF_RADIUS = 0.01
"""Largest deviation relative to the radius: a small circle must not absorb a corner."""
_FEWEST_OF_A_STRETCH = 10
"""Fewer points are the corner between two lines."""
_HOLES = 2
"""Consecutive outliers tolerated within a stretch: a few feedback rows may be wrong."""


@dataclass(frozen=True)
class Tolerance:
    """Distance of a path from a circle that it follows, limited to `scale` hundredths of the radius."""

    mm: float
    scale: float
    least_rad: float

    def at(self, radius_mm: float) -> float:
        return min(self.mm, self.scale * _OF_RADIUS * radius_mm)


DRIVEN = Tolerance(0.5, 1.0, float(np.radians(30.0)))
"""Circle driven by the robot. The constants of a healthy arm bend it by some tenths of a mm."""
BENT = Tolerance(2.0, 3.0, float(np.radians(90.0)))
"""Circle of a controller with other constants than the rig file, such as zeros wrong by 0.5°."""
GUIDED = Tolerance(5.0, 5.0, float(np.radians(120.0)))
"""Circle along which the robot was guided by hand. A line stays within this for up to 52°."""


@dataclass(frozen=True)
class FoundCircle:
    circle: CircleFrame
    turned_rad: float


def even_path(places: Array, run: Integers) -> tuple[Array, Integers]:
    """Resample places (n, 3) to points (k, 3) at equal distances, each with its run number (k,)."""
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    steps[np.diff(run) != 0] = 0.0
    along = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.linspace(0.0, along[-1], _POINTS)
    points = np.stack([np.interp(at, along, column) for column in places.T], axis=1)
    return points, run[np.searchsorted(along, at).clip(max=len(run) - 1)]


def find_circle(points: Array, run: Integers, tolerance: Tolerance) -> FoundCircle | None:
    """Circle that equidistant points (k, 3) in mm follow over the largest angle; None if there is no circle."""
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
            on, turned_rad = follow_circle(circle, points, run, tolerance)
            nearest = nearest_circle(points[on]) if on.sum() > 3 else None
            if nearest is None or not _RADIUS_MM[0] < nearest.radius < _RADIUS_MM[1]:
                break
            circle = nearest
        else:
            if best is None or turned_rad > best.turned_rad:
                best = FoundCircle(circle, turned_rad)
    return best


def follow_circle(circle: CircleFrame, points: Array, run: Integers, tolerance: Tolerance) -> tuple[Mask, float]:
    """Mask (k,) of the points in stretches that follow a circle, and the sum of their angles in rad."""
    away = deviations(circle, points)
    rows = np.flatnonzero(away.largest < tolerance.at(circle.radius))
    kept, turned = np.zeros(len(points), dtype=bool), 0.0
    breaks = np.flatnonzero((np.diff(rows) > 1 + _HOLES) | (np.diff(run[rows]) != 0)) + 1
    for stretch in np.split(rows, breaks) if len(rows) else ():
        turned_here = float(np.ptp(np.unwrap(away.phi[stretch])))
        if turned_here >= tolerance.least_rad and len(stretch) >= _FEWEST_OF_A_STRETCH:
            kept[stretch] = True
            turned += turned_here
    return kept, turned


# ----------------------------------------------------------------------------------------------------------------------
# Regression with slow noise: the uncertainty of each coefficient if the errors of neighbouring readings correlate.
#
# The covariance of two readings is s² (white + r k(|t - t'| / tau)). The kernel k decays exponentially (rough) or is a
# Matérn kernel of order 3/2 (smooth). Each combination of r and tau on a grid is weighted by the restricted likelihood,
# with the coefficients and s integrated out; the result is the mean over all, each with a Student t distribution. Noise
# that a record cannot reveal could have any size, so its standard deviation has a half-Cauchy prior as wide as the
# residual (Gelman, Bayesian Analysis 1, 2006), and smooth noise correlates over at most a quarter of the record.

_TIMES = 7
"""Correlation times tried, from a step to the longest."""
_LONGEST = (1.0, 0.25)
"""Longest correlation times of rough and smooth noise, relative to the record. Slower noise looks like motion."""
_SHARES = np.concatenate([[0.0], np.geomspace(1e-2, 1e6, 9)])
"""Ratios of slow to white variance. White noise almost vanishes in the mean of some hundred readings."""
_NONE = float(np.pi / np.log(_SHARES[2] / _SHARES[1]))
"""Prior weight of no slow noise: the total weight of all other cases."""
_NOTHING = 1e-24
"""Squared deviation used for noise-free readings."""
_DRAWS = 4000
"""Draws of the coefficients: a 95 % quantile is then accurate to 2 %."""


def regress(design: Array, readings: Array, t_s: Array, count: Array) -> list[tuple[Array, Array]]:
    """Fit each column of readings (m, k) by the design (m, p): coefficients (p,) with covariance (p, p).

    t_s (m,): timestamps. count (m,): number of equal readings averaged in each row. m must be at least p + 4.
    """
    m, p = design.shape
    step = float(np.median(np.diff(t_s)))
    span = max(step * m, 2 * step)
    root = np.sqrt(count / count.mean())
    residual = readings - design @ np.linalg.lstsq(design, readings, rcond=None)[0]
    usual = np.maximum((residual**2).sum(axis=0) / (m - p), _NOTHING)
    cases = []
    for longest, smooth in zip(_LONGEST, (0.0, 1.0), strict=True):
        for tau in np.geomspace(step, longest * span, _TIMES):
            away = np.abs(t_s[:, None] - t_s) / tau
            # Whiten with the white part: a single decomposition then serves every share.
            level, V = np.linalg.eigh((1 + smooth * away) * np.exp(-away) * np.outer(root, root))
            X, Y = (V.T @ (values * root[:, None]) for values in (design, readings))
            for share in _SHARES.tolist():
                variance = 1 + share * np.maximum(level, 0.0)
                scaled = X / variance[:, None]
                information = scaled.T @ X
                inverse = np.linalg.inv(information)
                values = inverse @ (scaled.T @ Y)
                squares = np.maximum(((Y - X @ values) ** 2 / variance[:, None]).sum(axis=0), _NOTHING)
                log = np.log(variance).sum() + np.linalg.slogdet(information)[1] + (m - p) * np.log(squares)
                slow = share * squares / (m - p) / usual
                # Half-Cauchy prior of the logarithm. Zero slow noise is as likely as any slow noise.
                prior = np.sqrt(slow) / (1 + slow) if share else np.full(len(usual), _NONE)
                cases.append((np.log(prior) - log / 2, values.T, squares, inverse))
    logs, values, squares, inverses = (np.stack(part) for part in zip(*cases, strict=True))
    return [_posterior(logs[:, k], values[:, k], squares[:, k], inverses, m - p) for k in range(len(usual))]


def _posterior(logs: Array, values: Array, squares: Array, inverses: Array, free: int) -> tuple[Array, Array]:
    """Mean (p,) and covariance (p, p) over all cases, scaled so that ±1.96 u of each coefficient covers 95 %.

    logs (c,): log weights. squares (c,): whitened sums of squared residuals. inverses (c, p, p): covariances over s².
    """
    weight = np.exp(logs - logs.max())
    weight /= weight.sum()
    value: Array = weight @ values
    rng = np.random.default_rng(0)
    draws = []
    for number, count in enumerate(rng.multinomial(_DRAWS, weight).tolist()):
        size = np.sqrt(squares[number] / rng.chisquare(free, count))[:, None]
        noise = rng.normal(size=(count, len(value))) @ np.linalg.cholesky(inverses[number]).T
        draws.append(values[number] - value + size * noise)
    off = np.concatenate(draws)
    covariance = off.T @ off / _DRAWS
    wide = np.quantile(np.abs(off), 0.95, axis=0) / 1.96 / np.sqrt(np.diag(covariance))
    return value, covariance * np.outer(wide, wide)


# ----------------------------------------------------------------------------------------------------------------------
# Rows of one or several motions on a circle, and the deviations from it in blocks.
#
# Rows of stops, approaches and returns are excluded. Single rows distant from their neighbours are dropped and counted.
# Averages are taken over the deviations of neighbouring rows, not over places: the mean of places on an arc lies inside
# the arc.

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
