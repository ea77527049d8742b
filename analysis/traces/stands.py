"""Where the robot stood still: stands, found in the recorded joints, and the readings of each without wild ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.kinematics.arm import Array

STANDS_RAD = float(np.radians(0.01))
"""Joints that move by less within the window stand; an encoder's noise is a tenth of it."""
FLICKER_DEG = 0.03
"""A joint seen live that is at rest flickers by less; the slowest circle moves some joint by more in half a second."""
STOOD_RAD = float(np.radians(0.2))
"""Joints that move by less in a whole run stood still."""
_WINDOW_S = 0.3
_INSTANT_S = 1e-6
"""A rounding error of a time."""
_SETTLED = 0.5
"""Share of a stand, at its end, that is averaged: the arm has stopped swinging by then."""
_OUTLYING = 6.0
"""Scaled median deviations beyond which a sample of a stand is an outlier: Hampel's usual three, twice as wary."""
_MOST_OUTLYING = 0.1
"""More of a stand than this share is not an outlier: the arm or the gauge really moved."""


@dataclass(frozen=True)
class Stand:
    """Rows [begin, end) in which all joints stood; mean angles (6,) rad and mean readings (k,) mm of the settled part,
    without its `outliers`."""

    begin: int
    end: int
    t_s: float
    q: Array
    g_mm: Array
    outliers: int

    @property
    def settled(self) -> slice:
        """The rows that are averaged."""
        return _settled(self.begin, self.end)


def stands_of(t_s: Array, q: Array, g_mm: Array) -> list[Stand]:
    """The stands of a motion: times t_s (n,) s, reported angles q (n, 6) rad, readings g_mm (n, k) of k gauges."""
    stands = []
    for begin, end in standing(t_s, q, STANDS_RAD, _WINDOW_S):
        settled = _settled(begin, end)
        mean_mm, outliers = _averaged(g_mm[settled])
        stands.append(Stand(begin, end, float(t_s[settled].mean()), _averaged(q[settled])[0], mean_mm, outliers))
    return stands


def standing(t_s: Array, q: Array, still_rad: float, window_s: float) -> list[tuple[int, int]]:
    """Return the rows [begin, end) of each period in which no joint moves by still_rad or more within window_s: times
    t_s (n,) s, reported angles q (n, 6) rad. Periods do not overlap."""
    rows = np.arange(len(t_s))
    ahead = np.searchsorted(t_s, t_s + window_s - _INSTANT_S).clip(max=len(t_s) - 1)
    # A robot that turns back without a stop is where it was, but not in between.
    moved = np.maximum(np.abs(q[ahead] - q), np.abs(q[(rows + ahead) // 2] - q)).max(axis=1)
    still = (moved < still_rad) & (t_s[ahead] - t_s >= 0.9 * window_s)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
    periods: list[tuple[int, int]] = []
    for begin, last in edges.reshape(-1, 2).tolist():
        end = int(ahead[last - 1]) + 1
        if periods and begin < periods[-1][1]:
            periods[-1] = (periods[-1][0], end)
        else:
            periods.append((begin, end))
    return periods


def _settled(begin: int, end: int) -> slice:
    return slice(begin + int((end - begin) * (1 - _SETTLED)), end)


def _averaged(values: Array) -> tuple[Array, int]:
    """Mean (k,) of the readings, or angles, (n, k) of a stand without single wild ones, and how many those were."""
    away = np.abs(values - np.median(values, axis=0))
    limit = _OUTLYING * 1.4826 * np.median(away, axis=0)
    # Readings of a coarse gauge that mostly agree have no median deviation: nothing is called wild there.
    sound = (away <= limit) | (limit == 0)
    sound |= sound.mean(axis=0) < 1 - _MOST_OUTLYING
    mean: Array = np.where(sound, values, 0.0).sum(axis=0) / sound.sum(axis=0)
    return mean, int((~sound).sum())
