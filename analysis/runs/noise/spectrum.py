"""The noise spectrum of a lap: a white part and a slow part with their most likely sizes.

The error of a robot and the noise share every integer order of a lap, so only repeated laps contain information about
slow noise. The differences between the laps of a run are compared with the spectra of white noise and of slow noise (an
Ornstein-Uhlenbeck process with some correlation time, or 1/f). Whittle's likelihood (1953) is computed over a grid of
sizes, with the sizes of real cells as the prior. For a single lap, robust differences at several scales limit the noise
from above, and the prior determines the rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from analysis.robot.kinematics.arm import Array
from analysis.runs.noise.cell_noise import DRIFT_MM_PER_S, LEVELS_APART, SLOW_MM, WHITE_MM, NoiseSource

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

Integers = NDArray[np.int64]


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
        """Mean square (m, NODES // 2 + 1) of each complex Fourier coefficient of the mean of laps.

        rows: number of rows in each lap.
        """
        slow = _shapes(lap_s, laps)[1][self.shape]
        power: Array = self.white[:, None] ** 2 * _white(rows) / laps + self.slow[:, None] ** 2 * slow
        return power

    def elsewhere(self, rng: np.random.Generator) -> LapNoise:
        """Noise (m,) expected in a different run of the same cell, which may have a different level."""
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
        seen = (1.4826 * float(np.median(np.abs(third)))) ** 2
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
    """Share (NODES // 2 + 1,) of the mean square passed by a third difference at each order, for both
    halves of a spectrum."""
    half = np.pi * ORDERS / NODES
    mean = np.ones(len(ORDERS))
    mean[1:] = np.sin(scale * half[1:]) / (scale * np.sin(half[1:]))
    passed: Array = (2 * np.sin(scale * half)) ** 6 * mean**2
    passed[1:-1] *= 2
    return passed


@lru_cache(maxsize=4)
def _prior() -> Array:
    """Log prior (whites, slows, 1): uniform on a logarithmic scale over the range of real cells, falling
    outside."""
    white = -2.0 * (_positive_log(0.5 * WHITE_MM.low / _WHITES_MM) + _positive_log(_WHITES_MM / (2 * WHITE_MM.high)))
    slow = -1.0 * _positive_log(0.6 * SLOW_MM.low / _SLOWS_MM) - 2.0 * _positive_log(_SLOWS_MM / (1.5 * SLOW_MM.high))
    prior: Array = (white[:, None] + slow[None, :])[:, :, None]
    return prior


def _positive_log(ratio: Array) -> Array:
    return np.maximum(0.0, np.log(ratio))


def _white(rows: float) -> Array:
    """Mean square (NODES // 2 + 1,) of the coefficients of unit white noise in a number of rows, reduced
    to nodes."""
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
    """Means (..., bands) of power (..., orders) over bands of orders."""
    edges = _edges()
    means: Array = np.add.reduceat(power[..., : edges[-1]], edges[:-1], axis=-1) / np.diff(edges)
    return means
