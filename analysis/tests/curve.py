"""A curve sampled along a lap: its noise, and what its noise and its time do to figures taken from it.

Uncertainties are by Monte Carlo (JCGM 101): reading noise as the data show it, where the samples happened
to fall, and the gauges' time against the robot's. The largest less the smallest of noisy values is too large
on average; the same draws tell by how much, and ranges are corrected for it.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cache

import numpy as np

from analysis.kinematics.arm import Array
from analysis.reading.lap import Lap

DRAWS = 400
SEED = 0
"""Fixed, so that the same run gives the same report."""
_WINDOWS = (7, 13, 25, 49, 97)
_AGREE = 4.0


@dataclass(frozen=True)
class Curve:
    """Values y over circle angle phi, in order of time: (n,) each; smooth: y with its noise reduced;
    rate: (n,) rad/s of phi; noise: standard deviation of the white part of y; u_t_s: (n,) of each row's time."""

    phi: Array
    y: Array
    smooth: Array
    rate: Array
    noise: float
    u_t_s: Array

    def drawn(self, rng: np.random.Generator, lag_s: float, scale: float = 1.0) -> tuple[Array, Array, Array]:
        """phi and y (n,) as another run might have shown them, and that y without its noise: each row might as well
        have fallen half way to its neighbours, the gauges' clock be off by lag_s and each row by its own, the readings
        be noisy and be `scale` times too large."""
        rows = np.arange(len(self.y))
        fallen = rows + rng.uniform(-0.5, 0.5, len(rows))
        calm = np.interp(fallen, rows, self.smooth) / scale
        y: Array = calm + rng.normal(0.0, self.noise, len(rows)) / scale
        off_s = lag_s + rng.normal(0.0, 1.0, len(rows)) * self.u_t_s if self.u_t_s.any() else lag_s
        return np.interp(fallen, rows, self.phi) + self.rate * off_s, y, calm


def curve_of(lap: Lap, y: Array, base: Array | None = None) -> Curve:
    """The curve y (n,) of a lap. base (n,): its smooth bulk, known by a fit, which smoothing need not touch."""
    base = np.zeros_like(y) if base is None else base
    rate = np.gradient(lap.phi, lap.t_s) if len(lap.phi) > 2 else np.zeros_like(lap.phi)
    noise = noise_sd(y - base)
    u_t_s = np.zeros(len(y)) if lap.u_t_s is None else lap.u_t_s
    return Curve(lap.phi, y, smoothed(y - base, noise) + base, rate, noise, u_t_s)


def noise_sd(y: Array) -> float:
    """Standard deviation of the white part of a curve (n,) sampled in order.

    By third differences, which a smooth curve barely passes (Gasser, Sroka and Jennen-Steinmetz 1986),
    and by their median, so that a jump or two do not count.
    """
    third = np.diff(y, 3)
    return float(np.median(np.abs(third)) / 0.6745 / np.sqrt(20.0))


def smoothed(y: Array, noise: float) -> Array:
    """A curve (n,) sampled in order, its noise (standard deviation) reduced, by quadratics over some rows.

    At each row the widest window is taken that agrees, within its noise, with all narrower ones (Savitzky and Golay
    1964; Lepski 1991): wide where the curve is smooth, narrow at jumps.
    """
    best: Array = y
    reach = _WINDOWS[-1] // 2
    padded = np.pad(y, reach, mode="reflect")
    agreed = np.ones(len(y), dtype=bool)
    narrower: list[tuple[Array, float]] = []
    for window in _WINDOWS:
        if window > len(y) // 4 and narrower:
            break
        kernel = _kernel(window)
        aside = reach - window // 2
        wide = np.convolve(padded[aside : len(padded) - aside], kernel, mode="valid")
        share = float(kernel @ kernel)  # what such a window leaves of the noise's variance
        for other, its_share in narrower:
            agreed &= np.abs(wide - other) <= _AGREE * noise * np.sqrt(its_share - share)
        best = np.where(agreed, wide, best)
        narrower.append((wide, share))
    return best


@cache
def _kernel(window: int) -> Array:
    """Weights (window,) of the quadratic's value in the middle."""
    x = np.arange(window) - window // 2
    weights: Array = np.linalg.pinv(np.vander(x, 3))[2]
    return weights


def means(draws: list[dict[str, float]], names: Collection[str]) -> dict[str, float]:
    """The mean of some figures over draws."""
    return {name: float(np.mean([draw[name] for draw in draws])) for name in draws[0] if name in names}


def stacked(draws: list[dict[str, float]]) -> dict[str, Array]:
    """Draws of figures as arrays (m,) by name."""
    return {name: np.array([draw[name] for draw in draws]) for name in draws[0]}
