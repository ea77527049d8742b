"""The spectrum of a lap's noise: a white part and a slow one, as likely as the laps make them.

A robot's error and the noise meet at every whole order of a lap, so one lap says nothing about its own slow noise: only
laps that were driven again do. What differs between laps of one run is compared with the spectra of white noise and of
slow noise (an Ornstein-Uhlenbeck process of some correlation time, or 1/f), over a grid of their sizes, by Whittle's
likelihood (1953); the sizes of real cells are the prior. Of one lap, robust differences at several scales bound the
noise from above, and the prior does the rest."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from analysis.kinematics.arm import Array
from analysis.noise.cell import DRIFT_MM_PER_S, LEVELS_APART, SLOW_MM, WHITE_MM, NoiseSource

NODES = 720
"""Circle angles that a lap is reduced to, half a degree apart."""
ORDERS = np.arange(NODES // 2 + 1)
DRAWS = 400
"""Monte Carlo draws (JCGM 101): their spread is known to 4 %."""
_TIMES_S = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4, 12.8)
"""Correlation times of slow noise: real cells have 0.1 to 5 s."""
_PINK_S = np.geomspace(0.005, 100.0, 40)
"""Equal parts of processes of these correlation times have a spectrum of 1/f."""
_WHITES_MM = np.geomspace(2e-5, 0.012, 30)
_SLOWS_MM = np.concatenate([[1e-6], np.geomspace(3e-5, 0.05, 40)])
_TOP = 240
"""Orders up to here are compared; above, the reduction to nodes begins to show."""
_SINGLE = 16
"""Orders up to here are compared one by one, those above in bands that widen by a fifth."""
_SCALES = (1, 2, 4, 8, 16, 32)
_CURVED = (0.15, 0.25, 0.4, 0.6, 0.8, 0.9)
"""At differences of so many nodes the curve itself is likely to show with this probability: robots' curves hold some
0.7 µm at orders 16 to 32, and reversals have transits of up to some degrees."""
_LARGER = 3.0
"""By what factor, on a logarithmic scale, a curve then makes a difference's variance too large."""

Integers = NDArray[np.int64]


@dataclass(frozen=True)
class LapNoise:
    """Likely sizes of the noise in a curve, DRAWS of them: white (m,), of one reading, and slow (m,), standard
    deviations in the curve's unit; shape (m,): which correlation time the slow part has; source: where they come
    from."""

    white: Array
    slow: Array
    shape: Integers
    source: NoiseSource

    def power(self, laps: int, rows: float, lap_s: float) -> Array:
        """Mean square (m, NODES // 2 + 1) of each complex Fourier coefficient of the mean of some laps of so many
        rows."""
        slow = _shapes(lap_s, laps)[1][self.shape]
        power: Array = self.white[:, None] ** 2 * _white(rows) / laps + self.slow[:, None] ** 2 * slow
        return power

    def elsewhere(self, rng: np.random.Generator) -> LapNoise:
        """The noise of another run of the same cell: of some other level."""
        level = LEVELS_APART ** rng.uniform(-1.0, 1.0, len(self.white))
        return LapNoise(self.white * level, self.slow * level, self.shape, "borrowed")


def noise_of(
    laps: Array, rows: float, times_s: tuple[float, float], per_mm: float, rng: np.random.Generator
) -> LapNoise:
    """The noise of a curve driven in laps (L, NODES), in order of time, of so many rows each.

    times_s: of a lap, and from one to the next; per_mm: the curve's unit by mm of a gauge's noise.
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
    """Log likelihood (whites, slows, shapes) of what laps (L, NODES) mm differ by; drift_mm: at the most from one lap
    to the next, which is no noise of their levels."""
    freedom = len(laps) - 1
    drifted = drift_mm**2 / 3 * len(laps) * (len(laps) + 1) / 12
    spectra = np.fft.rfft(laps - laps.mean(axis=0), axis=1) / NODES
    seen = _banded((np.abs(spectra) ** 2).sum(axis=0) / freedom)
    white, slow = _banded(_white(rows)), _banded(_shapes(lap_s, len(laps))[0])
    weight = freedom * _weights()
    evidence = np.empty((len(_WHITES_MM), len(_SLOWS_MM), len(slow)))
    for shape, one in enumerate(slow):
        power = _WHITES_MM[:, None, None] ** 2 * white + _SLOWS_MM[None, :, None] ** 2 * one
        power[:, :, 0] += drifted
        evidence[:, :, shape] = -(np.log(power) + seen / power) @ weight
    return evidence


def _of_scales(lap: Array, rows: float, lap_s: float) -> Array:
    """Log likelihood (whites, slows, shapes) of the third differences of one lap (NODES,) mm at several scales.

    Each is a mixture: noise alone, or noise and curve, which is larger by some factor.
    """
    slow = _shapes(lap_s, 1)[0]
    evidence = np.zeros((len(_WHITES_MM), len(_SLOWS_MM), len(slow)))
    for scale, curved in zip(_SCALES, _CURVED, strict=True):
        passed = _third_difference_passes(scale)
        variance = _WHITES_MM[:, None, None] ** 2 * (_white(rows) @ passed)
        variance = variance + _SLOWS_MM[None, :, None] ** 2 * (slow @ passed)
        seen = (1.4826 * float(np.median(np.abs(_third_difference(lap, scale))))) ** 2
        # A median of NODES / scale differences, neighbours of which overlap, knows a variance with a quarter as many
        # degrees of freedom.
        spread = np.sqrt(8.0 * scale / NODES)
        off = np.log(max(seen, 1e-18) / variance)
        close = np.exp(-0.5 * (off / spread) ** 2)
        with_curve = np.where(off > 0, np.exp(-np.maximum(off, 0.0) / _LARGER), close) / _LARGER
        evidence += np.log((1 - curved) * close / (spread * np.sqrt(2 * np.pi)) + curved * with_curve + 1e-300)
    return evidence


def _third_difference(lap: Array, scale: int) -> Array:
    """Third differences (NODES,) of means of `scale` nodes, as far apart, around a closed lap."""
    summed = np.cumsum(np.concatenate([[0.0], lap, lap[:scale]]))
    means = (summed[scale:] - summed[:-scale])[:NODES] / scale
    third: Array = means - 3 * np.roll(means, -scale) + 3 * np.roll(means, -2 * scale) - np.roll(means, -3 * scale)
    return third


@lru_cache(maxsize=16)
def _third_difference_passes(scale: int) -> Array:
    """What of the mean square of each order (NODES // 2 + 1,) a third difference passes, both halves of a spectrum."""
    half = np.pi * ORDERS / NODES
    mean = np.ones(len(ORDERS))
    mean[1:] = np.sin(scale * half[1:]) / (scale * np.sin(half[1:]))
    passed: Array = (2 * np.sin(scale * half)) ** 6 * mean**2
    passed[1:-1] *= 2
    return passed


@lru_cache(maxsize=4)
def _prior() -> Array:
    """Log prior (whites, slows, 1): even on a logarithmic scale over the table of real cells, falling beyond."""
    white = -2.0 * (_beyond(0.5 * WHITE_MM.low / _WHITES_MM) + _beyond(_WHITES_MM / (2 * WHITE_MM.high)))
    slow = -1.0 * _beyond(0.6 * SLOW_MM.low / _SLOWS_MM) - 2.0 * _beyond(_SLOWS_MM / (1.5 * SLOW_MM.high))
    prior: Array = (white[:, None] + slow[None, :])[:, :, None]
    return prior


def _beyond(ratio: Array) -> Array:
    return np.maximum(0.0, np.log(ratio))


def _white(rows: float) -> Array:
    """Mean square (NODES // 2 + 1,) of the coefficients of unit white noise in `rows` rows, reduced to nodes."""
    turn = 2 * np.pi * ORDERS / NODES
    return 3 / (2 + np.cos(turn)) / node_response() ** 2 / rows


@lru_cache(maxsize=1)
def node_response() -> Array:
    """What the least-squares broken line through NODES makes of each order (NODES // 2 + 1,) of a smooth curve.

    A broken line swings beyond a curve at its nodes (Unser, Splines: a perfect fit, 1999): 2 % at order 60.
    """
    turn = 2 * np.pi * ORDERS / NODES
    response: Array = np.sinc(ORDERS / NODES) ** 2 * 3 / (2 + np.cos(turn))
    return response


@lru_cache(maxsize=8)
def _shapes(lap_s: float, laps: int) -> tuple[Array, Array]:
    """For each kind of slow noise of unit variance the mean squares (shapes, orders) of the coefficients of a lap about
    the mean of some laps (of one lap itself), and of that mean."""
    turn_s = np.asarray(2 * np.pi * ORDERS / lap_s, dtype=np.float64)
    of_lap = np.array([_coefficients(tau, lap_s, turn_s) for tau in (*_TIMES_S, *_PINK_S)])
    of_mean = np.array([_coefficients(tau, laps * lap_s, turn_s) for tau in (*_TIMES_S, *_PINK_S)])
    about = laps * (of_lap - of_mean) / (laps - 1) if laps > 1 else of_lap
    return _with_pink(about), _with_pink(of_mean)


def _with_pink(power: Array) -> Array:
    count = len(_TIMES_S)
    return np.concatenate([power[:count], power[count:].mean(axis=0, keepdims=True)])


def _coefficients(tau_s: float, window_s: float, turn_s: Array) -> Array:
    """Mean squares (k,) of Fourier coefficients, at angular frequencies turn_s (k,) of which the window holds whole
    turns, of an Ornstein-Uhlenbeck process of unit variance: the double integral of its covariance over the window."""
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


def _weights() -> Array:
    """Orders (bands,) in each band; order 0 is a single real number, and half one."""
    weights = np.diff(_edges()).astype(float)
    weights[0] = 0.5
    return weights
