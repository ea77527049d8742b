"""The hyperparameters of a state: the healthy level of the arm, the strength of the residual in each band, and the
robust weights."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from analysis.diagnosis.background import Posterior
from analysis.diagnosis.columns import Columns
from analysis.diagnosis.linearisation import Linearisation
from analysis.diagnosis.repeat_noise import LEAST_ASSUMED
from analysis.diagnosis.selection_state import SelectionState
from analysis.kinematics.arm import Array, Mask
from rigs.schema.effect import name_of, size_of

_BAND_PRICE, _TARGET_PRICE = 3.0, 8.0
"""Log evidence that the strength of a band of orders, and of targets, must gain to exceed that of the noise. Chosen:
targets have the higher price, because their noise has heavy tails."""
_TAIL = 4.0
"""Degrees of freedom of Student's distribution of readings at targets. Chosen: stops of real robots have heavy tails.
"""
MOST_LEVEL = 8.0
"""Largest level of a background. Chosen: an arm that shows eight times the healthy size of every effect has faults
instead."""
LEAST_LEVEL = 0.003
"""Smallest level of a background. Chosen: a simulated arm that has named effects alone."""
_LEVELS = np.geomspace(LEAST_LEVEL, MOST_LEVEL, 80)
"""Levels of a background that are tried; consecutive ones differ by a tenth."""
_LEVEL_ROUNDS, _SAME_LEVEL = 12, 0.15
"""Estimates of the level in a row, most, and the logarithm of their ratio at which they agree. An estimate moves a
third of the way, so twelve rounds lead from a healthy arm to one that is a hundred times quieter."""
_LEVEL_TAIL = 4.0
"""Degrees of freedom of Student's distribution of the effects of an arm, so that a fault has little weight in its
level. Chosen."""
_LEVEL_SPREAD = 1.4
"""Prior standard deviation of the logarithm of a level about that of a healthy arm: a factor of four either way.
Chosen."""


@dataclass(frozen=True)
class Hyperparameters:
    """The hyperparameters of one linearisation, with N entries in b bands."""

    linear: Linearisation
    columns: Columns

    @cached_property
    def _least(self) -> Array:
        """The smallest strength (b,) of each band."""
        assumed = np.concatenate([np.full(len(b.y_mm), not b.measured) for b in self.linear.blocks])
        return np.where(np.bincount(self.columns.band, assumed) > 0, LEAST_ASSUMED, 1.0)

    @cached_property
    def _targets(self) -> Mask:
        """Whether each entry (N,) is at a target."""
        return np.concatenate([np.full(len(b.y_mm), b.sampling is None) for b in self.linear.blocks])

    @cached_property
    def _band_price(self) -> Array:
        """The log evidence (b,) that the strength of each band must gain."""
        return np.where(np.bincount(self.columns.band, self._targets) > 0, _TARGET_PRICE, _BAND_PRICE)

    def level(self, state: SelectionState, posterior: Posterior) -> float:
        """Return the level of the background: the ratio of the mean square of each name's effects to its expectation in
        an arm at level one.

        A name counts once however many forms it has, because a gear shows only a few of its orders; a fault has little
        weight. What is only expected, and not shown, does not count.
        """
        columns, background = self.columns, posterior.background
        leveled = (columns.healthy > 0) & (background.variance > 0)
        if state.curves is not None:
            leveled[columns.curves.columns] = False  # curves have widths of their own
        cols = np.flatnonzero(leveled)
        freedom = np.clip(1 - posterior.variance[cols] / background.variance[cols], 0.0, 1.0)
        names, count = columns.name_of_column[cols], len(columns.among)
        # Of the coefficients, the prior means alone make this much; readings show the rest.
        unseen = posterior.covariance_times(background.pull)
        shown = (posterior.mean - unseen)[cols]
        expected = columns.healthy[cols] * freedom + ((background.mean - unseen)[cols] / state.level) ** 2
        squares = np.asarray(np.bincount(names, shown**2, count), dtype=float)
        seen = np.asarray(np.bincount(names, expected, count), dtype=float)
        for k, name in enumerate(columns.among):
            if own := [size_of(effect) for effect in state.refined.effects if name_of(effect) == name]:
                squares[k] += np.sum(np.square(own))
                seen[k] = 1.0
        weight = (_LEVEL_TAIL + 1) / (_LEVEL_TAIL + squares / np.maximum(seen, 1e-3) / state.level**2)
        likely = -seen.sum() * np.log(_LEVELS) - float(weight @ squares) / (2 * _LEVELS**2)
        likely -= np.log(_LEVELS) ** 2 / (2 * _LEVEL_SPREAD**2)
        return float(min(_LEVELS[np.argmax(likely)], state.most))

    def robust(self, posterior: Posterior) -> Array:
        """Return the weights (N,) of the entries: those of Student's distribution at targets, and 1 elsewhere."""
        weight, targets = np.ones(len(self._targets)), self._targets
        if targets.any():
            left = posterior.residual[targets]
            scale = max(1.0, 1.4826 * float(np.median(np.abs(left))))
            weight[targets] = np.minimum(1.0, (_TAIL + 1) / (_TAIL + (left / scale) ** 2))
        return weight

    def strength(self, state: SelectionState, posterior: Posterior) -> Array:
        """Return the strength (b,) of each band: that of the residual where it exceeds the noise by more than its
        price. Assumed noise, which is wide, may also be reduced."""
        energy, spent = self._energy(state, posterior)
        free: Array = np.maximum(self.columns.count - spent / state.strength, 0.25 * self.columns.count)
        ratio: Array = np.maximum(energy / free, 1e-9)
        gain = 0.5 * free * (ratio - 1 - np.log(ratio)) - self._band_price
        return np.where((ratio > 1) & (gain > 0), ratio, np.clip(ratio, self._least, 1.0))

    def nearer_strength(self, state: SelectionState, posterior: Posterior) -> Array:
        """Return the strength (b,) after a shorter step, which never makes the readings less likely (expectation
        maximisation: Dempster, Laird and Rubin 1977)."""
        energy, spent = self._energy(state, posterior)
        nearer: Array = np.maximum((energy + spent) / self.columns.count, self._least)
        return nearer

    def update(
        self,
        state: SelectionState,
        posterior: Posterior,
        evidence: Callable[[SelectionState], float],
        posterior_of: Callable[[SelectionState], Posterior],
    ) -> SelectionState:
        """Return a state with strengths and robust weights that increase its evidence, and the level that it shows.

        Strengths are estimated from the state's posterior with all else unchanged, so that an estimate may go too far;
        then a shorter step is tried, and where that does not help either, they do not change.
        """
        whole, robust = evidence(state), self.robust(posterior)
        for estimate in (self.strength, self.nearer_strength):
            tried = replace(state, strength=estimate(state, posterior), robust=robust)
            if evidence(tried) > whole:
                state = tried
                break
        for _ in range(_LEVEL_ROUNDS):
            level = self.level(state, posterior)
            if abs(np.log(level / state.level)) < _SAME_LEVEL:
                break
            tried = replace(state, level=level)
            # Effects that are not named yet look like an arm that shows more of everything.
            if level > max(state.level, 1.0) and evidence(tried) <= evidence(state):
                break
            state, posterior = tried, posterior_of(tried)
        return state

    def _energy(self, state: SelectionState, posterior: Posterior) -> tuple[Array, Array]:
        """Return, for each band (b,) and in variances of the noise, the robust energy of the residual and the energy
        that the uncertainty of the coefficients may hide."""
        columns = self.columns
        raw = posterior.background.weight * state.strength[columns.band] * posterior.residual**2
        energy = np.asarray(np.bincount(columns.band, raw), dtype=float)
        return energy, posterior.spent
