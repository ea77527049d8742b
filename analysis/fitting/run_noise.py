"""The noise of runs from the residuals of a fit, at the fit's degrees of freedom, and the classification of wild
readings.

The runs of a set-up share one level. Their differences are smooth along a lap and can be fitted, so a run with a noise
of its own would draw the fit to itself. A reading is sound or wild by the odds of two normal distributions (Tukey's
contaminated normal), of which the wild one is many times wider.
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
"""Prior share of wild readings, and the ratio of their scatter to that of the others: outliers of real cells are 10 to
100 standard deviations, with a geometric mean of about 30."""
_TAILS = 1.5
"""Factor by which sound readings are taken to be wider than their median implies. Chosen: stops of real robots, and
unmodelled effects, have heavier tails than a normal distribution."""
_KNOWN_FREEDOM = 3.0
"""Degrees of freedom of the noise of repeats, or of the assumed noise, beside that of the residual, which also contains
unmodelled effects. Chosen: one pose."""
_FEWEST_REPEATS = 3
"""Degrees of freedom below which repeats are not used. Chosen: one repeated pose."""
LAG_S = 2.5
"""Separation in time beyond which residuals are taken to be uncorrelated. Chosen: slow noise of real cells has
correlation times of 0.1 to 5 s."""
_MEDIAN_CHI2 = {1: 0.4549, 2: 1.3863, 3: 2.3660}
"""The median of chi-square for one, two and three degrees of freedom."""


@dataclass(frozen=True)
class Repeats:
    """The scatter of repeats: `sd_mm` is the standard deviation of one coordinate of one visit, with `freedom` degrees
    of freedom."""

    sd_mm: float
    freedom: int


def soundness(residual: Array, leverage: Array) -> Array:
    """Return how sound each reading is, between 0 and 1, with the same value for all coordinates (m, k) of a pose, by
    its distance relative to the noise of the others."""
    coordinates = residual.shape[1]
    distance = (residual**2 / (1 - leverage)).sum(axis=1)
    variance = max(float(np.median(distance)) / _MEDIAN_CHI2[coordinates], WHITE_MM.low**2)
    distance /= _TAILS**2 * variance
    normal = np.log1p(-_WILD_SHARE) - distance / 2
    wild = np.log(_WILD_SHARE) - coordinates * np.log(_WILDER) - distance / (2 * _WILDER**2)
    share: Array = 1 / (1 + np.exp(np.clip(wild - normal, -700, 700)))
    return np.broadcast_to(share[:, None], residual.shape)


@dataclass(frozen=True)
class RunResiduals:
    """A run's contribution to the noise of a set-up: residual (m, k) mm, leverage (m, k), soundness (m, k), and the
    number of neighbouring readings that carry the information of one."""

    residual: Array
    leverage: Array
    sound: Array
    correlation_length: float


def setup_noise_mm(parts: Sequence[RunResiduals], repeats: Repeats | None, usual_mm: float = TARGET_MM.middle) -> float:
    """Return the noise of the runs of a set-up from their residuals (m, k) mm, combined with the scatter of repeats, or
    with a usual value where readings are few. It is scaled so that correlated readings have the weight of the
    information that they contain."""
    freedom = sum(float((part.sound - part.leverage).clip(min=0).sum()) / part.correlation_length for part in parts)
    squares = sum(float((part.sound * part.residual**2).sum()) / part.correlation_length for part in parts)
    known_mm = repeats.sd_mm if repeats else usual_mm
    level = float(np.sqrt((squares + _KNOWN_FREEDOM * known_mm**2) / (freedom + _KNOWN_FREEDOM)))
    if repeats:
        level = max(level, repeats.sd_mm)
    correlation_length = float(
        np.average([part.correlation_length for part in parts], weights=[part.residual.size for part in parts])
    )
    return max(level, WHITE_MM.low) * float(np.sqrt(correlation_length))


def correlation_length(one: Observation, residual: Array) -> float:
    """Return how many neighbouring readings of a lap carry the information of one, from the residual (m, k) mm: the
    ratio of the variance of a mean to that of white noise."""
    if not isinstance(one.table, CircleTable):
        return 1.0
    step_s = float(np.median(np.diff(one.table.t_s[one.rows])))
    lags = max(1, min(len(residual) // 4, int(LAG_S / max(step_s, 1e-6))))
    spectrum = np.fft.rfft(residual - residual.mean(axis=0), n=2 * len(residual), axis=0)
    likeness = np.fft.irfft(np.abs(spectrum) ** 2, axis=0)[: lags + 1].sum(axis=1)
    bartlett = 1 - np.arange(lags + 1) / (lags + 1)
    return max(1.0, float(2 * bartlett @ likeness / max(float(likeness[0]), 1e-300)) - 1.0)


def repeats_of(observations: Sequence[Observation], residuals: Sequence[Array]) -> dict[str, Repeats]:
    """Return the scatter of visits of the same place from the same side, for each set-up that has any, from residuals
    (m, k) mm."""
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
    """Return the scatter from the median over the places, so that a wild visit has no influence."""
    squares, freedom = np.array(parts).T
    median = (1 - 2 / (9 * freedom)) ** 3  # of chi square over its degrees of freedom (Wilson and Hilferty 1931)
    typical = float(np.median(squares / freedom / median))
    return Repeats(max(float(np.sqrt(typical)), WHITE_MM.low), int(freedom.sum()))
