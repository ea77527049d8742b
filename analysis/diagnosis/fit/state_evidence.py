"""Log evidence of a set of selected effects for a given linearisation, and the gain of adding or removing effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from analysis.diagnosis.evidence.significance import SURE_SIGMA
from analysis.diagnosis.fit.background import CoefficientPosterior, cavity_evidence, fault_evidence
from analysis.diagnosis.fit.candidates import LARGEST_FAULT, Columns
from analysis.diagnosis.fit.effect_prices import HEALTHY_PRICE, EffectPrices
from analysis.diagnosis.fit.refine import whole_order_gain
from analysis.diagnosis.fit.responses import Linearisation
from analysis.diagnosis.fit.selection_state import (
    FAULT,
    Backgrounds,
    Hyperparameters,
    SelectionState,
    has_compliant_base_only,
)
from analysis.diagnosis.fit.unknown import UnknownCauses
from analysis.robot.kinematics.arm import Array
from rigs.effects import healthy_size
from rigs.schema.effect import name_of

_OFF = 0.1
"""Largest difference of the response of the faults from that of the reference faults, as a share.

Chosen: columns computed with no faults were wrong by up to 1 % of a large fault; with this limit it is 0.1 %.
"""
_FEW_SIGMA = 100.0
"""Norm of the difference between the responses of the faults and the reference faults, in standard deviations of the
noise, up to which columns remain valid for any size of fault. Chosen: columns with an error of 1 % of it (6 % at
worst) miss 1 (6) standard deviations.
"""


@dataclass(frozen=True)
class StateEvidence:
    """Evidence of states that explain the residual (N,) of a linearisation."""

    linear: Linearisation
    columns: Columns

    @cached_property
    def prices(self) -> EffectPrices:
        """The prior log odds (price) of each effect."""
        return EffectPrices(self.linear, self.columns)

    @cached_property
    def causes(self) -> UnknownCauses:
        """The kinds of unknown causes that the runs may show."""
        return UnknownCauses.in_runs(self.linear)

    @cached_property
    def causes_of_circles(self) -> UnknownCauses:
        """The kinds that may replace names during a search.

        At targets, an unknown cause follows the scatter: on poses of a UR10 it replaced names, and the rms of held-out
        poses was 0.317 mm instead of the 0.141 mm with names only.
        """
        return self.causes.of_circles() if any(block.sampling for block in self.linear.blocks) else UnknownCauses({})

    @cached_property
    def hyperparameters(self) -> Hyperparameters:
        """The noise, its weights and the level of states."""
        return Hyperparameters(self.linear, self.columns)

    @cached_property
    def backgrounds(self) -> Backgrounds:
        """The backgrounds of states: all contributions not fitted as an effect."""
        return Backgrounds(self.columns, self.linear.blocks[0].model.rig.reference)

    def posterior(self, state: SelectionState) -> CoefficientPosterior:
        """Return the posterior of all coefficients in a state."""
        return self.backgrounds.of(state).posterior(state.refined.fitted_terms)

    def evidence(self, state: SelectionState) -> float:
        """Return the log evidence of a state, up to a constant."""
        evidence = self.backgrounds.of(state).evidence(state.refined.fitted_terms)
        prices = sum(self.prices.price(effect, state.level) for effect in state.effects)
        prices += sum(whole_order_gain(state.refined, place) for place in range(len(state.effects)))
        if has_compliant_base_only(state.effects):
            prices -= HEALTHY_PRICE  # the softness of the shoulder is then free, as if it were fitted
        if state.unknown:
            prices -= len(state.unknown) * self.causes_of_circles.price
        return evidence + prices

    def evidence_of_names(self, state: SelectionState) -> float:
        """Return the log evidence of a state, up to a constant, for a comparison of names."""
        return self.evidence(state) + sum(self.prices.usual_gain(effect, state.level) for effect in state.effects)

    def likeliest(self, states: Sequence[SelectionState]) -> tuple[float, SelectionState]:
        """Return the largest log evidence of several states, and the first state that has it."""
        return max(((self.evidence(state), state) for state in states), key=lambda both: both[0])

    def gains(self, state: SelectionState, posterior: CoefficientPosterior) -> Array:
        """Return the log odds (n,) of each form as a named effect against remaining in the background.

        The larger of the odds as a fault and as an effect of healthy size.
        """
        gains = posterior.gains(self.columns.forms, state.level)
        curves, pieces = self.prices.waves_of_curves
        levels = np.array([state.level.of(form.effect) for form in self.columns.forms])
        is_usual = gains.size < FAULT * np.maximum(levels, 1.0)  # of healthy arms or of arms of this level
        gains.fault[curves & (pieces | is_usual)] = gains.healthy[curves] = -np.inf
        fault = gains.fault - self.prices.thresholds + self.prices.fault_price - self.prices.log_choices
        healthy = gains.healthy - self.prices.thresholds - HEALTHY_PRICE - self.prices.log_choices
        return np.asarray(np.maximum(fault, healthy), dtype=float)

    def gain_of(self, state: SelectionState, posterior: CoefficientPosterior, place: int) -> float:
        """Return the approximate log odds of a named effect against its form remaining in the background.

        The size has the normal likelihood that results when the prior is removed from the posterior (cavity).
        """
        refined, effect = state.refined, state.effects[place]
        row = next(k for k, u in enumerate(refined.unknowns) if u.effect == place)
        unit, variance = healthy_size(effect), posterior.term_covariance[row, row]
        values = np.array([max(1 / variance - refined.unknowns[row].spread ** -2, 0.0) * unit**2])
        seen = np.array([((refined.values[row] + posterior.term_means[row]) / variance * unit) ** 2])
        # The variance that an arm of this state has in the form nearest to the effect.
        forms, level = self.columns.forms, state.level.of(effect)
        usual = level**2
        if (nearest := self.prices.nearest_form(effect)) is not None:
            usual *= self.columns.likelihoods[nearest]
            if state.curves is not None and self.prices.is_of_curve(effect):
                usual = self.columns.variance(state.level, state.curves)[list(forms[nearest].columns)].sum()
        share = cavity_evidence(values, seen, float(usual))
        fault = fault_evidence(values, seen, level) - share + self.prices.fault_price
        healthy = cavity_evidence(values, seen, level**2) - share - HEALTHY_PRICE
        gain = float(fault if self.prices.is_of_curve(effect) else max(fault, healthy))
        return gain - self.prices.choice_cost(effect)

    def not_testable(self, state: SelectionState, posterior: CoefficientPosterior) -> tuple[str, ...]:
        """Return the effects that these tests would not show even as a large fault, with all other effects possible."""
        sigma = posterior.gains(self.columns.forms, state.level).sigma
        named = {name_of(effect) for effect in state.effects}
        seen = {self.columns.forms[k].name for k in np.flatnonzero(LARGEST_FAULT * sigma > SURE_SIGMA).tolist()}
        hidden = dict.fromkeys([*self.columns.not_seen, *(form.name for form in self.columns.forms)])
        return tuple(name for name in hidden if name not in seen | named)

    def moves(self, state: SelectionState) -> Array:
        """Return the terms of the set-ups (s,) mm that fit the readings best with the effects of a state; for poses
        also with all other known contributions.

        A target moves with the response of the last link to the arm's constants, and is therefore fitted together with
        all contributions.
        """
        moves, poses = self.linear.moves_with(state.effects), sorted(self.linear.terms_of_poses)
        if poses:
            moves[poses] = self.posterior(state).mean[self.columns.set_ups][poses]
        return moves

    def is_valid_for(self, state: SelectionState) -> bool:
        """Return whether the columns are valid for a state: the effects hardly move the set-ups, and the reference
        faults of the columns have nearly the response of the faults of the state.
        """
        linear = self.linear
        if not linear.is_straight(self.moves(state)):
            return False
        reference, faults = state.possible_faults(linear.reference), state.possible_faults(state.effects)
        if not (reference or faults):
            return True
        with_reference, with_faults, without = (linear.residual(effects) for effects in (reference, faults, ()))
        off, whole = (linear.without_set_up(residual - with_faults) for residual in (with_reference, without))
        return float(np.linalg.norm(off)) <= max(_OFF * float(np.linalg.norm(whole)), _FEW_SIGMA)
