"""Properties of the readings of a gauge: rounding step, noise before rounding, and outliers; and the rounding error
that repeated visits do not average out.

A fit to all readings follows an outlier: a single lost point of a tracker among 130 poses increased an rms of 0.14 mm
to 165 mm. The fit is therefore repeated a few times with the near readings. Distant readings are outliers, unless they
are very many, many in a row, or share a range of a joint: the cause is then an error of the model or a movement.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.robot.kinematics.arm import Array, Integers, Mask

_SAMPLE = 20_000
"""Number of readings that is enough to estimate steps and spreads: a standard deviation to 0.5 %. Chosen."""
_SPREADS, _TAIL = 6.0, 2.5
"""Limits of a wild reading: it differs from the running median by 6 robust standard deviations and by 2.5 times the
limit of 98 % of all readings. With only the first limit, steps and slow noise at a high rate would classify 44 %
of sound readings as wild."""
_JUMPS = 2.0
"""Factor by which a wild reading must exceed the change of the curve within some rows. In six simulated laps with
backlash and 49 wild readings among 28 848, factors of 1 to 4 find 49 to 47 of the wild readings, and at most a
single false one."""
_SORTING = ((0, 5), (0, 3), (1, 6), (2, 4), (0, 1), (3, 5), (2, 6), (2, 3), (3, 6), (4, 5), (1, 4), (1, 3), (3, 4))
"""Pairs to compare and exchange, after which the fourth of seven values is the median (Devillard, Fast median
search, 1998)."""
_SEEN = 0.35
"""Share of a step below which noise cannot be detected.

If the curve changes by about a step between readings, noise-free readings appear to have noise of this size.
"""
_HARMONICS = 5
"""Number of harmonics of a sawtooth: five contain nine tenths of the energy."""
_BLOCK = 1 << 13
"""Number of rows processed at a time, to fit into the cache of the processor."""


def rms(values: NDArray[Any]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def extent_of(places: Array) -> float:
    """Root mean square distance of places (n, 3) from their centre."""
    return float(np.sqrt(3)) * rms(places - places.mean(axis=0))


def robust_sd(distances: Array) -> float:
    """Standard deviation that outliers hardly affect: the scaled median of absolute deviations (n,)."""
    return 1.4826 * float(np.median(distances))


def evenly(count: int, most: int) -> Integers:
    return np.unique(np.linspace(0, count - 1, min(most, count)).astype(np.int64))


def running_median(values: Array) -> Array:
    """Median (n,) of each value and three neighbours on either side; the ends are repeated."""
    padded = np.pad(values, 3, mode="edge")
    medians = np.empty(len(values))
    for begin in range(0, len(values), _BLOCK):
        end = min(begin + _BLOCK, len(values))
        seven = [padded[begin + k : end + k] for k in range(7)]
        for low, high in _SORTING:
            seven[low], seven[high] = np.minimum(seven[low], seven[high]), np.maximum(seven[low], seven[high])
        medians[begin:end] = seven[3]
    return medians


def is_outlier(values: Array) -> Mask:
    """Find readings (n,) in order of time that differ from their neighbours more than any jump of the curve."""
    if len(values) < 7:
        return np.zeros(len(values), dtype=bool)
    median = running_median(values)
    away = np.abs(values - median)
    # The change (n,) of a curve within four rows before or after each row; the ends are repeated.
    padded = np.pad(median, 4, mode="edge")
    before = np.abs(median - padded[: -2 * 4])
    change: Array = np.maximum(before, np.abs(padded[2 * 4 :] - median))
    return beyond_neighbours(away) & (away > _JUMPS * change)


def beyond_neighbours(away: Array) -> Mask:
    seen = away[:: max(1, len(away) // _SAMPLE)]
    limit = max(_SPREADS * robust_sd(seen), _TAIL * float(np.quantile(seen, 0.98)))
    return away > limit if limit > 0 else np.zeros(len(away), dtype=bool)


def step_of(values: Array) -> float:
    """Rounding step of readings (n,) in their unit, or 0.

    All distances between neighbouring distinct values are multiples of it. If few values repeat, they are multiples of
    the last digit only.
    """
    seen = values[:_SAMPLE]
    distinct = np.unique(seen)
    if len(distinct) < 2 or len(distinct) > 0.9 * len(seen):
        return 0.0
    gaps = np.diff(distinct)
    gaps = gaps[gaps > 1e-6 * gaps.max()]
    step = float(gaps.min())
    multiples = gaps / step
    return step if float(np.abs(multiples - np.round(multiples)).max()) < 0.05 else 0.0


def noise_beneath(values: Array, step: float) -> float:
    """Standard deviation of the white noise of readings (n,) before rounding to `step`.

    Median of third differences, to which neither a smooth curve (Gasser, Sroka and Jennen-Steinmetz 1986) nor jumps
    contribute, minus the variance of rounding, step²/12. Differences of rounded readings are multiples of the step, so
    the median is that of grouped data. Noise below a third of a step is returned as zero.
    """
    third = np.abs(np.diff(values[:_SAMPLE], 3))
    if len(third) == 0:
        return 0.0
    median = float(np.median(third))
    if step:  # Assume an even distribution of the differences in a group.
        groups, middle = np.rint(third / step), (len(third) - 1) // 2
        group = np.partition(groups, middle)[middle]
        share = (len(third) / 2 - np.sum(groups < group)) / np.sum(groups == group)
        low, high = max(group - 0.5, 0.0), group + 0.5
        median = float((low + share * (high - low)) * step)
    noise = float(np.sqrt(max((median / 0.6745) ** 2 / 20.0 - step**2 / 12, 0.0)))
    return noise if noise > _SEEN * step else 0.0


def rounding_error(curve: Array, step: float, noise: float, phase: Array) -> tuple[Array, Array]:
    """Mean rounding errors (m, n) in mm of a closed curve (n,) of noisy readings, and the variance (n,)
    about them.

    phase (m,): positions of the steps. The variance is that of a single reading. The sawtooth of rounding is expanded
    in a Fourier series (Widrow and Kollár, Quantization Noise, 2008). Noise smooths it, and so does the slope of the
    curve between two points, because each reading falls on a different part of the sawtooth.
    """
    k = np.arange(1, _HARMONICS + 1)[:, None]
    slope = (np.roll(curve, -1) - np.roll(curve, 1)) / 2
    whole = (-1.0) ** k * step / (np.pi * k) * np.exp(-2 * (np.pi * k * noise / step) ** 2)
    mean = whole * np.sinc(k * slope / step)
    at, by = 2 * np.pi * k * curve / step, 2 * np.pi * k * phase / step
    errors: Array = np.cos(by).T @ (mean * np.sin(at)) + np.sin(by).T @ (mean * np.cos(at))
    return errors, (whole**2 - mean**2).sum(axis=0) / 2


_COARSEST_MM = 0.03
"""The coarsest resolution of gauges in use: a little more than 0.001 inch."""
_USUAL_MM = np.array([0.010, 0.005, 0.001, 0.0005, 0.0001])
"""Resolutions of data sheets."""
_FEWEST_GAPS = 6
"""Minimum number of distances between distinct readings: in a tenth of all cases six distances are within 0.05 of
multiples of a step by chance."""
_NOT_WHOLE = 0.05
"""Tolerance for multiples of a step. Chosen: above the rounding of written numbers."""
_STEPS_APART = np.arange(1, 11)
"""Possible numbers of steps between the two closest of a few readings. With any limit from 5 to 30 the same 299 of
300 steps of simulated tables are found, and no step in 300 unrounded tables."""
_SHARED_HARMONICS = np.arange(1, 21)[:, None, None]
"""Harmonics of the sawtooth of rounding: the omitted harmonics have less than 3 % of the variance."""


def step_of_stops(readings_mm: Array) -> float:
    """Rounding step in mm of readings (n,) mm at stops, or 0.

    Few stops repeat a value, and the closest two may be several steps apart: the step is the largest divisor of all
    distances. If this is coarser than any gauge, it is the largest usual resolution that divides it.
    """
    step = step_of(readings_mm)
    gaps = np.diff(np.unique(readings_mm))
    gaps = gaps[gaps > 1e-6 * gaps.max(initial=0.0)]
    if not step and len(gaps) >= _FEWEST_GAPS:
        steps = gaps.min() / _STEPS_APART
        multiples = gaps / steps[:, None]
        whole = np.abs(multiples - np.round(multiples)).max(axis=1) < _NOT_WHOLE
        step = float(steps[np.argmax(whole)]) if whole.any() else 0.0
    if step <= _COARSEST_MM:
        return step
    multiples = step / _USUAL_MM
    fits = np.abs(multiples - np.round(multiples)) < _NOT_WHOLE
    return float(_USUAL_MM[np.argmax(fits)]) if fits.any() else 0.0


def shared_rounding(step_mm: float, noise_sq: Array) -> Array:
    """Variance (m, t) mm² of the rounding error shared by all readings at a position.

    noise_sq (m, t): variance in mm² of the readings before rounding. For zero noise the result is the variance of a
    single reading, step²/12; noise of half a step removes it (Widrow and Kollár, Quantization Noise, 2008).
    """
    if step_mm == 0:
        return np.zeros_like(noise_sq)
    damped = np.exp(-((2 * np.pi * _SHARED_HARMONICS / step_mm) ** 2) * noise_sq) / _SHARED_HARMONICS**2
    values: Array = step_mm**2 / (2 * np.pi**2) * damped.sum(axis=0)
    return values


SPREADS, NEAR = 10.0, 2.5
"""Limits in robust standard deviations: above the first a reading is an outlier; up to the second it is used in the
fit.

Chosen: as for the sphere of a radial test, and usual. The 2127 poses of the measured UR10 are within 2 standard
deviations of the nominal arm.
"""
FITTED_SPREADS = 5.0
"""Robust standard deviations from which a pose is an outlier for an arm with fitted constants, both at import and
among held-out poses. Measured: of 1600 poses of a UR10 and a UR5, in sets of 30 to 400, the farthest was at 4.2.
On the UR5, with a residual of 0.1 mm, a reading wrong by 0.8 mm is detected in 14 of 14 sets (6 of 14 with a
limit of 6), and also at 1 mm."""
STEPS = 4
"""Number of fits, each to the readings near the previous fit (Rousseeuw's concentration steps): a fit to all
readings did not reveal a single outlier in nine."""
_FEW = 30
"""Number of readings up to which each reading is first omitted in turn, at the cost of a fit per reading."""
FEW, MOST = 0.1, 0.3
"""Shares of readings: up to the first, outliers are an accident; up to the second, if they are also scattered over the
table. Chosen: of more than a third, the fits above do not always find the sound readings.
"""
_SCATTERED = 0.5
"""Smallest number of blocks of successive outliers, as a share of the number at random: a target or instrument that has
moved makes one or two blocks."""
_RANGE = 3
"""Number of outliers in a separate range of a joint that is not an accident: for three in 130 placed at random, the
chance is 0.002 for six joints."""


def spreads_of(distances: Array, least: float) -> Array:
    """Distances (n,) as multiples of their robust standard deviation, which is at least `least`."""
    sd = max(robust_sd(distances), least)
    return distances / sd


def far_from_fit(distances_of: Callable[[Mask], Array], count: int, least: float) -> tuple[Array, Array]:
    """Distances (n,), in mm or rad, of `count` readings from a model fitted to the near ones; also in robust standard
    deviations.

    distances_of: fits the model to some of the readings, and returns the distances of all.
    """
    near = np.ones(count, dtype=bool)
    # For a small number of readings, first omit the reading whose omission gives the smallest rms, unless all fit with
    # a scale of `least`. For nine readings and nine unknowns, the steps do not always find the outlier.
    if count <= _FEW and not float(np.sqrt(np.mean(distances_of(near) ** 2))) < SPREADS * least / np.sqrt(count):
        but_one = ~np.eye(count, dtype=bool)
        rms = [float(np.sqrt(np.mean(distances_of(those)[those] ** 2))) for those in but_one]
        near = but_one[int(np.argmin(rms))]
    distances = spreads = np.zeros(count)
    for _ in range(STEPS):
        distances = distances_of(near)
        spreads = spreads_of(distances, least)
        near = spreads <= NEAR
    return distances, spreads


def by_accident(far: Mask, q: Array, most: float = MOST) -> bool:
    """True if distant readings (n,), in the order of the table, are few or scattered, and have no range of a joint of
    their own.

    most: largest share.
    """
    count, share = int(far.sum()), float(far.mean())
    if count > max(1.0, most * len(far)):
        return False
    blocks = int(np.count_nonzero(np.diff(far.astype(int), prepend=0) == 1))
    if share > FEW and blocks < _SCATTERED * count * (1 - share):
        return False
    low, high = q[far].min(axis=0, initial=np.inf), q[far].max(axis=0, initial=-np.inf)
    others = ((q[~far] >= low) & (q[~far] <= high)).any(axis=0)
    return count < _RANGE or bool(others.all())
