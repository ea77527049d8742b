"""The share of a name that each set-up shows: an effect of the arm acts at every place with one size.

An error that no effect explains can look like one on a circle, and even on two, but hardly with the same size at
every place. So where set-ups disagree on the size of a name, the name imitates something else.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.diagnosis.background import Posterior
from analysis.diagnosis.diagnosis import Share
from analysis.diagnosis.search import SearchResult
from analysis.diagnosis.worth import worth
from analysis.kinematics.arm import Array
from rigs.schema.effect import size_field

_WIDE = 100.0
"""Prior standard deviation of a share. It only bounds what the readings of a set-up hardly show. Chosen: far beyond any
share of interest."""
_CHANCE = 0.05
"""Probability that set-ups that agree seem to disagree on a size. Chosen: the usual level of a test."""


def shares_of(result: SearchResult, k: int, limits: Array) -> tuple[Share, ...]:
    """Return the shares of name k in the set-ups in which it changes readings by more than the limits (b,) µm, or none
    where there are fewer than two.

    Each set-up has a size of its own for the name, fitted together with everything else that may be present. Only
    effects that depend on the posture alone are judged: others may differ from run to run, or from day to day.
    """
    if result.state.refined.effects[k].compensation().use == "none":
        return ()
    shown, value, covariance = _by_setup(result, k, limits)
    sd = np.sqrt(np.diag(covariance))
    return tuple(Share(setup, float(value[i]), float(sd[i])) for i, setup in enumerate(shown))


def birge_ratio(result: SearchResult, k: int, limits: Array) -> float:
    """Return the factor by which the uncertainties of name k are larger than the noise of the readings explains,
    because the set-ups in which it exceeds the limits (b,) µm disagree on its size; 1 where they agree.

    An error of the form, as of a play that is crossed in another way, makes another size of it on each path. The ratio
    is that of Birge (1932), as CODATA uses it for constants, where chance explains a disagreement in one of 20 cases.
    """
    from scipy.stats import chi2  # noqa: PLC0415 - slow to import

    shown, value, covariance = _by_setup(result, k, limits)
    if not shown:
        return 1.0
    weight, freedom = np.linalg.inv(covariance), len(shown) - 1
    away = value - (weight @ value).sum() / weight.sum()
    disagreement = float(away @ weight @ away)
    return float(np.sqrt(disagreement / freedom)) if disagreement > chi2.isf(_CHANCE, freedom) else 1.0


def _by_setup(result: SearchResult, k: int, limits: Array) -> tuple[list[str], Array, Array]:
    """Return the set-ups (n) in which name k exceeds the limits (b,) µm, its shares there (n,), and their covariance
    (n, n); none where there are fewer than two."""
    linear, change = result.linear, result.contributions[k]
    setups = np.array([block.one.setup for block in linear.blocks])
    shown = list(dict.fromkeys(setups[worth(linear, change).um > limits].tolist()))
    if len(shown) < 2:
        return [], np.empty(0), np.empty((0, 0))
    # One column for each of these set-ups and one for all others, in which the name is free as well.
    number = np.array([shown.index(setup) if setup in shown else len(shown) for setup in setups])
    columns = np.zeros((len(change), number.max() + 1))
    for rows, column in zip(linear.rows, number, strict=True):
        columns[rows, column] = change[rows]
    precision, slope = _beside_size(result, k).cavity(columns)
    covariance = np.asarray(np.linalg.inv(precision + np.eye(len(slope)) / _WIDE**2), dtype=float)
    own = slice(len(shown))
    return shown, (1 + covariance @ slope)[own], covariance[own, own]


def _beside_size(result: SearchResult, k: int) -> Posterior:
    """Return the posterior of everything else, in which the size of name k stays as it was fitted."""
    refined, known = result.state.refined, result.state.refined.known
    own = size_field(refined.effects[k])
    kept = np.ones(len(known.mean), dtype=bool)
    kept[: len(refined.unknowns)] = [unknown.effect != k or unknown.field != own for unknown in refined.unknowns]
    precision = known.precision[np.ix_(kept, kept)]
    terms = replace(known, T=known.T[:, kept], precision=precision, mean=known.mean[kept], free=known.free[kept])
    return Posterior(result.posterior.background, terms)
