"""The noise spectrum of a lap: a white part and a slow part with their most likely sizes.

The error of a robot and the noise share every integer order of a lap, so only repeated laps contain information about
slow noise. The differences between the laps of a run are compared with the spectra of white noise and of slow noise (an
Ornstein-Uhlenbeck process with some correlation time, or 1/f). Whittle's likelihood (1953) is computed over a grid of
sizes, with the sizes of real cells as the prior. For a single lap, robust differences at several scales limit the noise
from above, and the prior determines the rest.

Changes between laps are of two kinds. A drift continues all the time and causes a ramp along each lap; a slip of a
clamp happens once. The difference of two laps is constant around the circle for a drift, and has a step for a slip.
Both are removed as far as the laps show the changes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from analysis.robot.kinematics.arm import Array, Integers, Mask
from analysis.runs.noise.cell_noise import DRIFT_MM_PER_S, LEVELS_APART, SLOW_MM, WHITE_MM, NoiseSource
from analysis.runs.noise.readings import beyond_neighbours, robust_sd

NODES = 720
"""Number of angles of a reduced lap, half a degree apart. Chosen: finer than the stated resolution of 80 undulations
per revolution."""
ORDERS = np.arange(NODES // 2 + 1)
"""The orders of a lap, from 0 to NODES // 2."""
DRAWS = 400
"""Monte Carlo draws (JCGM 101): 400 determine a standard deviation to 4 %."""
_TIMES_S = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4, 12.8)
"""Candidate correlation times of slow noise: real cells have 0.1 to 5 s."""
_PINK_S = np.geomspace(0.005, 100.0, 40)
"""Correlation times of processes that in equal parts have a spectrum of 1/f."""
_WHITES_MM = np.geomspace(2e-5, 0.012, 30)
"""Candidate sizes of white noise: ten times below to four times above the range of real cells."""
_SLOWS_MM = np.concatenate([[1e-6], np.geomspace(3e-5, 0.05, 40)])
"""Candidate sizes of slow noise: none, and from well below to 2.5 times above the range of real cells."""
_TOP = 240
"""Highest order in the comparison; the reduction to nodes changes higher orders."""
_SINGLE = 16
"""Highest order compared individually; higher orders are combined in bands that widen by a fifth.

Chosen: slow noise decreases steeply at low orders.
"""
_SCALES = (1, 2, 4, 8, 16, 32)
"""Distances in nodes for the differences of a single lap. Chosen: an octave apart, from half a degree to 16°."""
_CURVED = (0.15, 0.25, 0.4, 0.6, 0.8, 0.9)
"""Prior probability, for each of _SCALES, that the curve itself contributes to the difference. Curves of robots have
some 0.7 µm at orders 16 to 32, and transits of reversals cover up to some degrees.
"""
_LARGER = 3.0
"""Scale, in the logarithm of the variance, of the factor by which a curve increases a difference. Chosen: a curve
may greatly exceed the noise."""


@dataclass(frozen=True)
class LapNoise:
    """m random draws of the noise of a curve, from its posterior.

    white (m,): standard deviation of a reading, slow (m,): of the slow part, both in the unit of the curve. shape (m,):
    index of the correlation time of the slow part. source: origin of the values.
    """

    white: Array
    slow: Array
    shape: Integers
    source: NoiseSource

    def power(self, laps: int, rows: float, lap_s: float) -> Array:
        """Noise power (m, NODES // 2 + 1) by Fourier order that remains after averaging the laps.

        rows: number of rows in each lap.
        """
        slow = _shapes(lap_s, laps)[1][self.shape]
        power: Array = self.white[:, None] ** 2 * _white(rows) / laps + self.slow[:, None] ** 2 * slow
        return power

    def elsewhere(self, rng: np.random.Generator) -> LapNoise:
        """Noise expected in a different run of the same cell, which may have a different level."""
        level = LEVELS_APART ** rng.uniform(-1.0, 1.0, len(self.white))
        return LapNoise(self.white * level, self.slow * level, self.shape, "borrowed")


def noise_of(
    laps: Array, rows: float, times_s: tuple[float, float], per_mm: float, rng: np.random.Generator
) -> LapNoise:
    """Noise of a curve measured in laps (L, NODES), in order of time.

    rows: number of rows in each lap. times_s: duration of a lap, and time between the starts of two laps. per_mm: unit
    of the curve per mm of the noise of a gauge.
    """
    lap_s, apart_s = times_s
    if len(laps) > 1:
        evidence = _of_differences(laps / per_mm, rows, lap_s, DRIFT_MM_PER_S * apart_s)
    else:
        evidence = _of_scales(laps[0] / per_mm, rows, lap_s)
    probability = np.exp(evidence + _prior() - (evidence + _prior()).max())
    cumulated = np.cumsum(probability.ravel())
    place = np.searchsorted(cumulated, rng.uniform(0, cumulated[-1], DRAWS)).clip(max=probability.size - 1)
    white, slow, shape = np.unravel_index(place, probability.shape)
    source: NoiseSource = "measured" if len(laps) > 1 else "assumed"
    return LapNoise(_WHITES_MM[white] * per_mm, _SLOWS_MM[slow] * per_mm, shape, source)


def _of_differences(laps: Array, rows: float, lap_s: float, drift_mm: float) -> Array:
    """Log likelihood (whites, slows, shapes) of the differences between laps (L, NODES) mm.

    drift_mm: largest drift between successive laps, which does not count as noise of their levels.
    """
    freedom = len(laps) - 1
    drifted = drift_mm**2 / 3 * len(laps) * (len(laps) + 1) / 12
    spectra = np.fft.rfft(laps - laps.mean(axis=0), axis=1) / NODES
    seen = _banded((np.abs(spectra) ** 2).sum(axis=0) / freedom)
    white, slow = _banded(_white(rows)), _banded(_shapes(lap_s, len(laps))[0])
    # The number of orders (bands,) in each band. Order 0 is a single real number and counts half.
    weights = np.diff(_edges()).astype(float)
    weights[0] = 0.5
    weight = freedom * weights
    evidence = np.empty((len(_WHITES_MM), len(_SLOWS_MM), len(slow)))
    for shape, slow_power in enumerate(slow):
        power = _WHITES_MM[:, None, None] ** 2 * white + _SLOWS_MM[None, :, None] ** 2 * slow_power
        power[:, :, 0] += drifted
        evidence[:, :, shape] = -(np.log(power) + seen / power) @ weight
    return evidence


def _of_scales(lap: Array, rows: float, lap_s: float) -> Array:
    """Log likelihood (whites, slows, shapes) of the third differences of a lap (NODES,) mm at several
    scales.

    Each difference is a mixture of pure noise, and of noise with curve, which is larger by some factor.
    """
    slow = _shapes(lap_s, 1)[0]
    evidence = np.zeros((len(_WHITES_MM), len(_SLOWS_MM), len(slow)))
    for scale, curved in zip(_SCALES, _CURVED, strict=True):
        passed = _third_difference_passes(scale)
        variance = _WHITES_MM[:, None, None] ** 2 * (_white(rows) @ passed)
        variance = variance + _SLOWS_MM[None, :, None] ** 2 * (slow @ passed)
        # The third differences (NODES,) of means of `scale` nodes, spaced by the same number of nodes, around a closed
        # lap.
        summed = np.cumsum(np.concatenate([[0.0], lap, lap[:scale]]))
        means = (summed[scale:] - summed[:-scale])[:NODES] / scale
        third: Array = means - 3 * np.roll(means, -scale) + 3 * np.roll(means, -2 * scale) - np.roll(means, -3 * scale)
        seen = robust_sd(np.abs(third)) ** 2
        # The median of NODES / scale overlapping differences determines a variance with a quarter of that number of
        # degrees of freedom.
        spread = np.sqrt(8.0 * scale / NODES)
        off = np.log(max(seen, 1e-18) / variance)
        close = np.exp(-0.5 * (off / spread) ** 2)
        with_curve = np.where(off > 0, np.exp(-np.maximum(off, 0.0) / _LARGER), close) / _LARGER
        evidence += np.log((1 - curved) * close / (spread * np.sqrt(2 * np.pi)) + curved * with_curve + 1e-300)
    return evidence


@lru_cache(maxsize=16)
def _third_difference_passes(scale: int) -> Array:
    """Share (NODES // 2 + 1,) of the mean square passed by a third difference, for both halves of a spectrum."""
    half = np.pi * ORDERS / NODES
    mean = np.ones(len(ORDERS))
    mean[1:] = np.sin(scale * half[1:]) / (scale * np.sin(half[1:]))
    passed: Array = (2 * np.sin(scale * half)) ** 6 * mean**2
    passed[1:-1] *= 2
    return passed


@lru_cache(maxsize=4)
def _prior() -> Array:
    """Log prior (whites, slows, 1): log-uniform over the range of real cells, falling outside."""
    white = -2.0 * (_positive_log(0.5 * WHITE_MM.low / _WHITES_MM) + _positive_log(_WHITES_MM / (2 * WHITE_MM.high)))
    slow = -1.0 * _positive_log(0.6 * SLOW_MM.low / _SLOWS_MM) - 2.0 * _positive_log(_SLOWS_MM / (1.5 * SLOW_MM.high))
    prior: Array = (white[:, None] + slow[None, :])[:, :, None]
    return prior


def _positive_log(ratio: Array) -> Array:
    return np.maximum(0.0, np.log(ratio))


def _white(rows: float) -> Array:
    turn = 2 * np.pi * ORDERS / NODES
    return 3 / (2 + np.cos(turn)) / node_response() ** 2 / rows


@lru_cache(maxsize=1)
def node_response() -> Array:
    """Response (NODES // 2 + 1,) of the least-squares broken line through NODES to each order of a smooth
    curve.

    A broken line overshoots a curve at the nodes (Unser, Splines: a perfect fit, 1999), by 2 % at order 60.
    """
    turn = 2 * np.pi * ORDERS / NODES
    response: Array = np.sinc(ORDERS / NODES) ** 2 * 3 / (2 + np.cos(turn))
    return response


@lru_cache(maxsize=8)
def _shapes(lap_s: float, laps: int) -> tuple[Array, Array]:
    """Mean squares (shapes, orders) of the coefficients of a lap, and of the mean of laps, for slow noise.

    Each shape is a kind of slow noise of unit variance. The coefficients of a lap are relative to the mean of the laps,
    or absolute for a single lap.
    """
    turn_s = np.asarray(2 * np.pi * ORDERS / lap_s, dtype=np.float64)
    of_lap = np.array([_coefficients(tau, lap_s, turn_s) for tau in (*_TIMES_S, *_PINK_S)])
    of_mean = np.array([_coefficients(tau, laps * lap_s, turn_s) for tau in (*_TIMES_S, *_PINK_S)])
    about = laps * (of_lap - of_mean) / (laps - 1) if laps > 1 else of_lap
    return _with_pink(about), _with_pink(of_mean)


def _with_pink(power: Array) -> Array:
    count = len(_TIMES_S)
    return np.concatenate([power[:count], power[count:].mean(axis=0, keepdims=True)])


def _coefficients(tau_s: float, window_s: float, turn_s: Array) -> Array:
    """Mean squares (k,) of Fourier coefficients of an Ornstein-Uhlenbeck process of unit variance.

    turn_s (k,): angular frequencies, for which the window contains full turns. Each result is the double integral of
    the covariance over the window.
    """
    rate = 1 / tau_s + 1j * turn_s
    inside = window_s / rate - (1 - np.exp(-window_s / tau_s)) / rate**2
    power: Array = np.maximum(2 / window_s**2 * inside.real, 1e-15)
    return power


@lru_cache(maxsize=1)
def _edges() -> Integers:
    edges = list(range(_SINGLE + 1))
    while edges[-1] < _TOP:
        edges.append(min(_TOP, max(edges[-1] + 2, round(1.2 * edges[-1]))))
    return np.array(edges)


def _banded(power: Array) -> Array:
    edges = _edges()
    means: Array = np.add.reduceat(power[..., : edges[-1]], edges[:-1], axis=-1) / np.diff(edges)
    return means


_WIDE = (24, 8)
"""Nodes on either side of a step over which it is detected: 12°, and 4° near the ends of a lap. In 200 simulated
pairs of laps with the noise of real cells there was no false slip at this, half or twice the width. Of 200 slips
of 8 standard deviations of the slow noise 26 were found, 52 at half the width and 28 at twice."""
_CLEAR = 8.0
"""Size of a step, in robust standard deviations of all such differences, from which it is a slip. 700 positions are
tested, and the differences have heavy tails. In the same laps limits of 6 and 10 give no false slip either, and
find 104 and 5 slips."""
_SLIPPED = 4.0
"""Difference of the levels of two laps, in standard deviations, from which it is a slip. Chosen: noise exceeds 4
sigma only in 1 of 16 000 cases."""
_RINGS = 6
"""Number of nodes on either side of a burst of outliers that are replaced too.

The fitted polyline changes beyond them by less than a thousandth.
"""
_LEVEL = 120
"""Nodes on either side of a step for averaging the level: 60°. Chosen: several correlation lengths of slow noise."""
_NEAR = 41
"""Number of nodes around a node for the detection of a burst of outliers: 20°. Chosen: longer than a burst."""


def without_slips(laps: Array) -> tuple[Array, list[float]]:
    """Laps (L, NODES) of a gauge corrected for the steps of its clamp, and these steps."""
    slips: list[float] = []
    while len(slips) < len(laps) and (clearest := _clearest(laps)):
        lap, node, step = clearest
        between = laps[lap + 1] - laps[lap]
        before = float(np.median(between[max(0, node - _LEVEL) : node]))
        after = float(np.median(between[node : node + _LEVEL]))
        laps = laps.copy()
        if abs(before) < abs(after):  # The laps agreed until here, so the later lap slipped.
            lap, by = lap + 1, step
        else:
            by = -step
        laps[lap, node:] -= by
        laps[lap + 1 :] -= by
        slips.append(by)
    return laps, slips


def _clearest(laps: Array) -> tuple[int, int, float] | None:
    clearest: tuple[int, int, float] | None = None
    most = _CLEAR
    for lap, between in enumerate(np.diff(laps, axis=0)):
        for width in _WIDE:
            level = np.median(np.lib.stride_tricks.sliding_window_view(between, width), axis=1)
            steps = level[width:] - level[:-width]
            away = np.abs(steps - np.median(steps))
            # Most differences of coarse readings are zero, but not the ninetieth percentile.
            spread = max(robust_sd(away), float(np.quantile(away, 0.9)) / 1.645, 1e-12)
            if width < _WIDE[0]:
                steps[_WIDE[0] - width : width - _WIDE[0]] = 0.0
            place = int(np.argmax(np.abs(steps)))
            clear = abs(float(steps[place])) / spread
            node, step = place + width, float(steps[place])
            if not clear > most:
                continue
            before, after = between[max(0, node - _LEVEL) : node], between[node : node + _LEVEL]
            if 0.5 < (float(np.median(after)) - float(np.median(before))) / step < 2.0:  # The level remains changed.
                most, clearest = clear, (lap, node, step)
    return clearest


def bursts(laps: Array) -> Mask:
    """Mask (L, NODES) of nodes at which a lap differs both from its neighbours and from the other laps: outliers in
    succession, too many for a running median.
    """
    odd = np.zeros(laps.shape, dtype=bool)
    for lap in range(len(laps) if len(laps) > 1 else 0):
        others = np.delete(laps, lap, axis=0).mean(axis=0)
        apart = laps[lap] - others
        leaves = np.abs(apart - _local_median(apart))
        # If the curve jumps, laps also differ because their rows are at slightly different angles.
        bad = beyond_neighbours(leaves) & (leaves > changes(others))
        bad &= np.abs(laps[lap] - _local_median(laps[lap])) > np.abs(others - _local_median(others))
        if bad.any():
            wide = np.any([np.roll(bad, by) for by in range(-_RINGS, _RINGS + 1)], axis=0)
            odd[lap] = wide if wide.sum() < NODES // 4 else False
    return odd


def following(laps: Array, odd: Mask) -> Array:
    """Laps (L, NODES) with masked values replaced by the other laps, at the distance of the surrounding nodes."""
    mended = laps.copy()
    for lap in np.flatnonzero(odd.any(axis=1)):
        others = np.delete(laps, lap, axis=0).mean(axis=0)
        good = np.flatnonzero(~odd[lap])
        apart = np.interp(np.flatnonzero(odd[lap]), good, (laps[lap] - others)[good], period=NODES)
        mended[lap, odd[lap]] = others[odd[lap]] + apart
    return mended


def without_level_steps(laps: Array, level_sd: float, apart_s: float, per_mm: float) -> tuple[Array, list[float]]:
    """Laps (L, NODES) shifted to the level of the first lap, and the steps removed: those that exceed noise and drift,
    as after a slip on the way back.
    """
    steps = np.diff(laps.mean(axis=1))
    # Two gauges may drift in opposite directions, each by the largest drift of real cells.
    limit = np.sqrt(2) * DRIFT_MM_PER_S * per_mm * apart_s + _SLIPPED * np.sqrt(2) * level_sd
    slips = np.where(np.abs(steps) > limit, steps, 0.0)
    level: Array = laps - np.concatenate([[0.0], np.cumsum(slips)])[:, None]
    return level, slips[slips != 0].tolist()


def changes(lap: Array) -> Array:
    spectrum = np.fft.rfft(lap)
    spectrum[:3] = 0.0
    rough = np.fft.irfft(spectrum, NODES)
    changes: Array = np.max([np.abs(np.roll(rough, reach) - rough) for reach in (-2, -1, 1, 2)], axis=0)
    return changes


def _local_median(values: Array) -> Array:
    half = _NEAR // 2
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(values, half, mode="wrap"), _NEAR)
    median: Array = np.median(windows, axis=1)
    return median


def without_drift(
    laps: Array, level_variance: float, times_s: tuple[float, float], per_mm: float
) -> tuple[Array, float, float]:
    """Laps (L, NODES) with the ramp of their means removed, the drift in a lap, and the variance of the drift.

    times_s: duration of a lap, and time between the starts of two laps. The ramp is shrunk towards the largest drift of
    real cells. With noisy levels or a single lap it cannot be detected, and all of it is uncertainty.
    """
    lap_s, apart_s = times_s
    plausible = (DRIFT_MM_PER_S * lap_s * per_mm) ** 2 / 3
    if len(laps) == 1:
        return laps, 0.0, plausible
    number = np.arange(len(laps)) - (len(laps) - 1) / 2
    leverage = float(number @ number) * (apart_s / lap_s) ** 2
    seen = float(number @ laps.mean(axis=1)) * (apart_s / lap_s) / leverage
    noise = level_variance / leverage
    drift = seen * plausible / (plausible + noise)
    since = np.arange(NODES) / NODES - 0.5 + number[:, None] * (apart_s / lap_s)
    return laps - drift * since, drift, plausible * noise / (plausible + noise)


def power_of_ramp(variance: float) -> Array:
    power = np.zeros(len(ORDERS))
    power[1:] = variance / (2 * np.pi * ORDERS[1:]) ** 2
    return power
