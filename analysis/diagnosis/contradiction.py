"""Contradiction: readings that, taken alone, are likelier without a name than with it.

An error that no name describes can look like a name in one test: an error that goes with the sum of two angles looks
like a gear where both turn together. It does so in every repeat of that test, so held-out repeats prove nothing. In
another test, or at another place, the two differ; there the search takes what the name adds wrongly for strength of the
residual. Therefore each set-up used, and each run at an unseen place, is asked by itself.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.diagnosis.background import background_of
from analysis.diagnosis.blocks import blocks_of
from analysis.diagnosis.diagnosis import ODDS
from analysis.diagnosis.linearisation import linearise
from analysis.diagnosis.observed_run import ObservedRun
from analysis.diagnosis.run_setups import fit_run_setups, with_effects
from analysis.diagnosis.search import SearchResult
from analysis.diagnosis.worth import LEAST_MATERIAL_UM, worth
from analysis.kinematics.arm import Array, Mask

_SHOWN = 1 / 3
"""Share of a name's largest worth that it must have in readings for them to judge it. Chosen: where a large name shows
little, what its fit leaves may be as large."""
_SET_UP_MM = 10.0
"""Standard deviation of a set-up term about its fit. Chosen: larger than any error of a fitted set-up."""


def contradicted(result: SearchResult, unseen: Sequence[ObservedRun]) -> list[bool]:
    """Return, for each name, whether a set-up used, or a run at an unseen place, contradicts it; readings are (m, k)
    mm. Only faults are judged."""
    faults = [k for k in range(len(result.contributions)) if result.state.is_fault(k)]
    wrong = np.zeros(len(result.contributions), dtype=bool)
    if faults:
        wrong[faults] = _by_setups(result, faults)
        for run in unseen:
            wrong[faults] |= _by_run(result, faults, run)
    return [bool(one) for one in wrong]


def _by_setups(result: SearchResult, faults: Sequence[int]) -> Mask:
    """Return whether a set-up used contradicts each of some faults, (n,)."""
    linear, fitted = result.linear, result.state.refined
    own = result.selection.background(result.state)
    changes = np.stack([result.contributions[k] for k in faults], axis=1)
    um = np.stack([worth(linear, change).um for change in changes.T], axis=1)
    allowed = fitted.known.T[:, len(fitted.values) :]
    wrong = np.zeros(len(faults), dtype=bool)
    for setup in dict.fromkeys(block.one.setup for block in linear.blocks):
        blocks = np.array([block.one.setup == setup for block in linear.blocks])
        here = np.repeat(blocks, [len(block.y_mm) for block in linear.blocks])
        alone = background_of(own.columns, own.weight * here, own.variance)
        weighed = alone.weighed(np.column_stack([allowed, fitted.residual, changes]))
        products, f = weighed.products(weighed), allowed.shape[1]
        across = products[:f, f:]
        left = products[f:, f:] - across.T @ np.linalg.solve(products[:f, :f] + np.eye(f), across)
        wrong |= _is_unlikely(left) & _is_shown(um[blocks].max(axis=0), um.max(axis=0))
    return wrong


def _by_run(result: SearchResult, faults: Sequence[int], run: ObservedRun) -> Mask:
    """Return whether a run at an unseen place contradicts each of some faults, (n,). A healthy arm's share of every
    effect is taken from the runs used, with its uncertainty."""
    effects, forms = result.state.refined.effects, result.posterior.background.columns.forms
    placed = fit_run_setups(with_effects([run], effects))[0]
    alone = linearise(blocks_of([run], placed, effects), placed, effects)
    sizes = np.repeat([form.size for form in forms], [len(form.columns) for form in forms])
    share = alone.columns([effect for form in forms for effect in form.effects]) / sizes
    residual = alone.residual(effects)
    changes = np.stack([alone.residual([*effects[:k], *effects[k + 1 :]]) - residual for k in faults], axis=1)
    um = np.array([worth(alone, change).um.max() for change in changes.T])
    largest = np.array([worth(result.linear, result.contributions[k]).um.max() for k in faults])
    p = share.shape[1]
    covariance = share @ result.posterior.A[:p, :p] @ share.T + _SET_UP_MM**2 * alone.U @ alone.U.T
    covariance[np.diag_indices_from(covariance)] += 1.0
    both = np.column_stack([residual - share @ result.posterior.mean[:p], changes])
    wrong: Mask = _is_unlikely(both.T @ np.linalg.solve(covariance, both)) & _is_shown(um, largest)
    return wrong


def _is_unlikely(products: Array) -> Mask:
    """Return whether readings are 20 times likelier without each change than with it, (n,), given the products
    (1 + n, 1 + n) of the residual and the changes with the inverse of the covariance."""
    unlikely: Mask = products[0, 1:] + np.diag(products)[1:] / 2 < -np.log(ODDS)
    return unlikely


def _is_shown(um: Array, largest_um: Array) -> Mask:
    """Return whether changes of um (n,) are a main part of those of largest_um (n,)."""
    shown: Mask = um > np.maximum(_SHOWN * largest_um, LEAST_MATERIAL_UM)
    return shown
