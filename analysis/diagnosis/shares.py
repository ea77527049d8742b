"""The size of a name that each set-up shows: an effect of the arm acts at every place with one size.

An error that no effect explains can look like one on a circle, and even on two, but hardly with the same size at
every place. So where set-ups disagree on the size of a name, the name imitates something else.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnosis.background import Posterior
from analysis.diagnosis.diagnosis import Share
from analysis.diagnosis.response import Response
from analysis.diagnosis.search import SearchResult
from analysis.diagnosis.worth import worth
from analysis.kinematics.arm import Array
from rigs.schema.effect import size_field

_WIDE = 100.0
"""Prior standard deviation of a share. It only bounds what the readings of a set-up hardly show. Chosen: far beyond any
share of interest."""
_CHANCE = 0.05
"""Probability that set-ups that agree seem to disagree on a size. Chosen: the usual level of a test."""


@dataclass(frozen=True)
class SizesBySetUp:
    """The size of a name in each of n set-ups that show it, fitted together with everything else that may be present:
    `value` (n,) as a share of the size in all runs, and `covariance` (n, n). A name that fewer than two show has
    none."""

    setups: tuple[str, ...]
    value: Array
    covariance: Array

    def shares(self) -> tuple[Share, ...]:
        """Return the share that each set-up shows, with its standard uncertainty."""
        sds = np.sqrt(np.diag(self.covariance))
        return tuple(Share(*one) for one in zip(self.setups, self.value.tolist(), sds.tolist(), strict=True))

    def birge_ratio(self) -> float:
        """Return the factor by which the uncertainties of the name are larger than the noise of the readings explains,
        because its set-ups disagree on its size; 1 where they agree.

        An error of the form, as of a play that is crossed in another way, makes another size of it on each path. The
        ratio is that of Birge (1932), as CODATA uses it for constants, where chance explains a disagreement in one of
        20 cases.
        """
        from scipy.special import chdtri  # noqa: PLC0415 - slow to import

        if not self.setups:
            return 1.0
        weight, freedom = np.linalg.inv(self.covariance), len(self.setups) - 1
        away = self.value - (weight @ self.value).sum() / weight.sum()
        disagreement = float(away @ weight @ away)
        return float(np.sqrt(disagreement / freedom)) if disagreement > chdtri(freedom, _CHANCE) else 1.0


def sizes_by_setup(result: SearchResult, k: int, limits: Array) -> SizesBySetUp:
    """Return the sizes of name k in the set-ups in which it changes readings by more than the limits (b,) µm."""
    linear, change = result.linear, result.contributions[k]
    setups = np.array([block.one.setup for block in linear.blocks])
    shown = list(dict.fromkeys(setups[worth(linear, change).um > limits].tolist()))
    if len(shown) < 2:
        return SizesBySetUp((), np.empty(0), np.empty((0, 0)))
    # One column for each of these set-ups and one for all others, in which the name is free as well.
    number = np.array([shown.index(setup) if setup in shown else len(shown) for setup in setups])
    columns = np.zeros((len(change), number.max() + 1))
    for rows, column in zip(linear.rows, number, strict=True):
        columns[rows, column] = change[rows]
    precision, slope = _beside_size(result, k).cavity(columns)
    covariance = np.asarray(np.linalg.inv(precision + np.eye(len(slope)) / _WIDE**2), dtype=float)
    own = slice(len(shown))
    return SizesBySetUp(tuple(shown), (1 + covariance @ slope)[own], covariance[own, own])


def _beside_size(result: SearchResult, k: int) -> Posterior:
    """Return the posterior of everything else, in which the size of name k stays as it was fitted."""
    refined, known = result.state.refined, result.state.refined.known
    own = size_field(refined.effects[k])
    kept = np.ones(len(known.mean), dtype=bool)
    kept[: len(refined.unknowns)] = [unknown.effect != k or unknown.field != own for unknown in refined.unknowns]
    precision = known.precision[np.ix_(kept, kept)]
    terms = replace(
        known,
        responses=(Response(known.T[:, kept]),),
        precision=precision,
        mean=known.mean[kept],
        held=known.held[kept],
    )
    return Posterior(result.posterior.background, terms)
