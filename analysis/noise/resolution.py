"""The step of a gauge as readings at stops show it, and what of it visiting a target again does not average out."""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Array
from analysis.noise.readings import step_of

_COARSEST_MM = 0.03
"""Of gauges in use: those of 0.001 inch."""
_USUAL_MM = np.array([0.010, 0.005, 0.001, 0.0005, 0.0001])
"""Resolutions of data sheets."""
_FEWEST_GAPS = 6
"""Distances between distinct readings, each within 0.05 of a whole number of steps by chance in one case of ten."""
_NOT_WHOLE = 0.05
_STEPS_APART = np.arange(1, 11)
"""Steps by which the two nearest of a few readings may differ."""
_HARMONICS = np.arange(1, 21)[:, None, None]


def step_of_stops(readings_mm: Array) -> float:
    """The step that readings (n,) mm of stops are rounded to; 0 where they show none.

    Few stops repeat a value, and the nearest two need not be one step apart: then the largest step of which all
    distances between distinct readings are multiples. Where that is coarser than any gauge, as where nearly all read
    the same, the largest usual resolution of which it is a multiple.
    """
    step = step_of(readings_mm) or _common_step(np.diff(np.unique(readings_mm)))
    if step <= _COARSEST_MM:
        return step
    multiples = step / _USUAL_MM
    fits = np.abs(multiples - np.round(multiples)) < _NOT_WHOLE
    return float(_USUAL_MM[np.argmax(fits)]) if fits.any() else 0.0


def _common_step(gaps: Array) -> float:
    gaps = gaps[gaps > 1e-6 * gaps.max(initial=0.0)]
    if len(gaps) < _FEWEST_GAPS:
        return 0.0
    steps = gaps.min() / _STEPS_APART
    multiples = gaps / steps[:, None]
    whole = np.abs(multiples - np.round(multiples)).max(axis=1) < _NOT_WHOLE
    return float(steps[np.argmax(whole)]) if whole.any() else 0.0


def shared_rounding(step_mm: float, noise_sq: Array) -> Array:
    """Variance (m, t) mm² of the rounding error that all readings of one place share, of the variance noise_sq (m, t)
    mm² that they have before they are rounded.

    Without noise it is that of one reading, step²/12; noise of half a step leaves nothing of it (Widrow and Kollár,
    Quantization Noise, 2008).
    """
    if step_mm == 0:
        return np.zeros_like(noise_sq)
    left = np.exp(-((2 * np.pi * _HARMONICS / step_mm) ** 2) * noise_sq) / _HARMONICS**2
    values: Array = step_mm**2 / (2 * np.pi**2) * left.sum(axis=0)
    return values
