"""The noise of runs as a fit leaves it, at as many degrees of freedom as the fit leaves, and which readings are wild.

The runs of a set-up share one level: what they differ by is smooth along a lap and can be fitted, so that with a noise
of its own any run would draw the fit to itself. A reading is sound or wild by the odds of two normal laws (Tukey's
contaminated normal), wild ones many times wider.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.fitting.observation import Observation
from analysis.kinematics.arm import Array
from analysis.measures.pose import SAME_RAD, groups
from analysis.noise.cell import TARGET_MM, WHITE_MM
from analysis.traces.tables import CircleTable, RepeatabilityTable

_WILD_SHARE, _WILDER = 0.01, 30.0
"""How many readings are wild beforehand, and how much wider they scatter: 10 to 100 standard deviations."""
_TAILS = 1.5
"""How much wider sound readings count than their median says: stops of real robots, and what no effect explains, leave
more far readings than a normal law."""
_KNOWN_FREEDOM = 3.0
"""So many degrees of freedom the noise of repeats, or the one assumed, counts beside what a fit leaves, which has what
no effect explains in it as well."""
_FEWEST_REPEATS = 3
"""Below so many degrees of freedom repeats say nothing."""
LAG_S = 2.5
"""Residuals further apart in time have forgotten each other."""
_MEDIAN_CHI2 = {1: 0.4549, 2: 1.3863, 3: 2.3660}
"""Of chi square with so many degrees of freedom."""


@dataclass(frozen=True)
class Repeats:
    """sd_mm: standard deviation of one coordinate of one visit; freedom: degrees of freedom that it is known by."""

    sd_mm: float
    freedom: int


def soundness(residual: Array, leverage: Array) -> Array:
    """How sound each reading is, all coordinates (m, k) of a pose alike, by its distance in the noise of the others."""
    coordinates = residual.shape[1]
    distance = (residual**2 / (1 - leverage)).sum(axis=1)
    variance = max(float(np.median(distance)) / _MEDIAN_CHI2[coordinates], WHITE_MM.low**2)
    distance /= _TAILS**2 * variance
    normal = np.log1p(-_WILD_SHARE) - distance / 2
    wild = np.log(_WILD_SHARE) - coordinates * np.log(_WILDER) - distance / (2 * _WILDER**2)
    share: Array = 1 / (1 + np.exp(np.clip(wild - normal, -700, 700)))
    return np.broadcast_to(share[:, None], residual.shape)


@dataclass(frozen=True)
class RunShare:
    """A run's share of a set-up's noise: residual, leverage and sound (m, k), memory in readings."""

    residual: Array
    leverage: Array
    sound: Array
    memory: float


def noise_of(parts: Sequence[RunShare], repeats: Repeats | None, usual_mm: float = TARGET_MM.middle) -> float:
    """Of the runs of a set-up, with what repeats show, else with what is usual, where readings are few: so large that
    readings count for what they tell together."""
    freedom = sum(float((part.sound - part.leverage).clip(min=0).sum()) / part.memory for part in parts)
    squares = sum(float((part.sound * part.residual**2).sum()) / part.memory for part in parts)
    known_mm = repeats.sd_mm if repeats else usual_mm
    level = float(np.sqrt((squares + _KNOWN_FREEDOM * known_mm**2) / (freedom + _KNOWN_FREEDOM)))
    if repeats:
        level = max(level, repeats.sd_mm)
    memory = float(np.average([part.memory for part in parts], weights=[part.residual.size for part in parts]))
    return max(level, WHITE_MM.low) * float(np.sqrt(memory))


def memory_of(one: Observation, residual: Array) -> float:
    """Of how many neighbours on a lap one reading is worth: the variance of a mean over that of white noise."""
    if not isinstance(one.table, CircleTable):
        return 1.0
    step_s = float(np.median(np.diff(one.table.t_s[one.rows])))
    lags = max(1, min(len(residual) // 4, int(LAG_S / max(step_s, 1e-6))))
    spectrum = np.fft.rfft(residual - residual.mean(axis=0), n=2 * len(residual), axis=0)
    likeness = np.fft.irfft(np.abs(spectrum) ** 2, axis=0)[: lags + 1].sum(axis=1)
    bartlett = 1 - np.arange(lags + 1) / (lags + 1)
    return max(1.0, float(2 * bartlett @ likeness / max(float(likeness[0]), 1e-300)) - 1.0)


def repeats_of(observations: Sequence[Observation], residuals: Sequence[Array]) -> dict[str, Repeats]:
    """What visits of the same place from the same side differ by, of each set-up that has any."""
    parts: dict[str, list[tuple[float, int]]] = {}
    for one, residual in zip(observations, residuals, strict=True):
        if isinstance(one.table, CircleTable):
            continue
        q = one.table.q[one.rows]
        if isinstance(one.table, RepeatabilityTable):
            q = np.column_stack([q, np.unique(one.table.approach[one.rows], return_inverse=True)[1]])
        group = groups(q, SAME_RAD)
        for number in np.flatnonzero(np.bincount(group) > 1):
            own = residual[group == number]
            freedom = (len(own) - 1) * own.shape[1]
            parts.setdefault(one.setup, []).append((float(((own - own.mean(axis=0)) ** 2).sum()), freedom))
    return {setup: _pooled(own) for setup, own in parts.items() if sum(n for _, n in own) >= _FEWEST_REPEATS}


def _pooled(parts: Sequence[tuple[float, int]]) -> Repeats:
    """By the median over the places, so that a wild visit does not count."""
    squares, freedom = np.array(parts).T
    median = (1 - 2 / (9 * freedom)) ** 3  # of chi square over its degrees of freedom (Wilson and Hilferty 1931)
    typical = float(np.median(squares / freedom / median))
    return Repeats(max(float(np.sqrt(typical)), WHITE_MM.low), int(freedom.sum()))
