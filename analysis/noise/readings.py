"""What single readings show of their gauge: the step they are rounded to, the noise beneath it, and wild values."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.kinematics.arm import Array

Mask = NDArray[np.bool_]

_SAMPLE = 20_000
"""Readings that are enough to see steps and spreads by."""
_SPREADS, _TAIL = 6.0, 2.5
"""A wild reading leaves the running median by 6 robust standard deviations and by 2.5 times what 98 % of all readings
do: by the first alone steps and slow noise at a high rate would have 44 % of sound readings called wild."""
_JUMPS = 2.0
"""Times what the curve changes by within some rows."""
_SORTING = ((0, 5), (0, 3), (1, 6), (2, 4), (0, 1), (3, 5), (2, 6), (2, 3), (3, 6), (4, 5), (1, 4), (1, 3), (3, 4))
"""Compare and exchange, after which the fourth of seven is their median (Devillard, Fast median search, 1998)."""
_SEEN = 0.35
"""Of a step: readings without noise may show as much, where the curve goes on by about a step from one to the next."""
_HARMONICS = 5
"""Of a sawtooth, which hold nine tenths of its energy."""
_BLOCK = 1 << 16
"""Rows at a time, so that they stay in the processor's cache."""


def running_median(values: Array) -> Array:
    """Median (n,) of each value and its three neighbours on either side, the ends repeated."""
    padded = np.pad(values, 3, mode="edge")
    found = np.empty(len(values))
    for begin in range(0, len(values), _BLOCK):
        end = min(begin + _BLOCK, len(values))
        seven = [padded[begin + k : end + k] for k in range(7)]
        for low, high in _SORTING:
            seven[low], seven[high] = np.minimum(seven[low], seven[high]), np.maximum(seven[low], seven[high])
        found[begin:end] = seven[3]
    return found


def is_wild(values: Array) -> Mask:
    """Which readings (n,), in order of time, leave what their neighbours read: chips, oil, a knock.

    Where the curve itself jumps, as where a play is crossed, a reading must leave it by more than that.
    """
    if len(values) < 7:
        return np.zeros(len(values), dtype=bool)
    median = running_median(values)
    away = np.abs(values - median)
    return beyond_neighbours(away) & (away > _JUMPS * _change(median, 4))


def _change(values: Array, reach: int) -> Array:
    """How far (n,) a curve goes within `reach` rows, before or after each; the ends repeated."""
    padded = np.pad(values, reach, mode="edge")
    before = np.abs(values - padded[: -2 * reach])
    change: Array = np.maximum(before, np.abs(padded[2 * reach :] - values))
    return change


def beyond_neighbours(away: Array) -> Mask:
    """Which distances (n,) are too large to belong to the rest, by two robust limits at once."""
    seen = away[:: max(1, len(away) // _SAMPLE)]
    limit = max(_SPREADS * 1.4826 * float(np.median(seen)), _TAIL * float(np.quantile(seen, 0.98)))
    return away > limit if limit > 0 else np.zeros(len(away), dtype=bool)


def step_of(values: Array) -> float:
    """The step that readings (n,) are rounded to, in their unit; 0 where they show none.

    All distances between neighbouring distinct values are multiples of it. Where hardly any value comes twice they are
    multiples of something by the writing of numbers only.
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
    """Standard deviation of the white noise of readings (n,) before they were rounded to `step`.

    By third differences, which a smooth curve barely passes (Gasser, Sroka and Jennen-Steinmetz 1986), and by their
    median, so that jumps do not count; the variance of rounding, step²/12, is taken off. Differences of rounded
    readings are whole steps: their median is that of grouped data. Noise of less than a third of a step is taken for
    none.
    """
    third = np.abs(np.diff(values[:_SAMPLE], 3))
    if len(third) == 0:
        return 0.0
    median = _grouped_median(third, step) if step else float(np.median(third))
    noise = float(np.sqrt(max((median / 0.6745) ** 2 / 20.0 - step**2 / 12, 0.0)))
    return noise if noise > _SEEN * step else 0.0


def _grouped_median(values: Array, step: float) -> float:
    """Median of sizes (n,) that were rounded to `step`, as if those of one group lay evenly in it."""
    counts = np.bincount(np.rint(values / step).astype(np.int64))
    bounds = np.concatenate([[0.0], (np.arange(len(counts)) + 0.5) * step])
    return float(np.interp(len(values) / 2, np.concatenate([[0], np.cumsum(counts)]), bounds))


def rounding_error(curve: Array, step: float, noise: float, phase: Array) -> tuple[Array, Array]:
    """Mean errors (m, n) by rounding a closed curve (n,) of readings with noise, for m places `phase` (m,) of the
    steps; and the variance (n,) of a reading's own about that mean.

    The sawtooth of rounding as a Fourier series (Widrow and Kollár, Quantization Noise, 2008): noise smooths it, and so
    does the curve's own slope between two points, where each reading falls on another part of the sawtooth.
    """
    k = np.arange(1, _HARMONICS + 1)[:, None]
    slope = (np.roll(curve, -1) - np.roll(curve, 1)) / 2
    whole = (-1.0) ** k * step / (np.pi * k) * np.exp(-2 * (np.pi * k * noise / step) ** 2)
    mean = whole * np.sinc(k * slope / step)
    at, by = 2 * np.pi * k * curve / step, 2 * np.pi * k * phase / step
    errors: Array = np.cos(by).T @ (mean * np.sin(at)) + np.sin(by).T @ (mean * np.cos(at))
    return errors, (whole**2 - mean**2).sum(axis=0) / 2
