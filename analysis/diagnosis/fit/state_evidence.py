"""Log evidence of a set of selected effects for a given linearisation: prior odds, and gains of adding or removing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.evidence.noise import LEAST_ASSUMED
from analysis.diagnosis.evidence.significance import SURE_SIGMA
from analysis.diagnosis.fit.background import (
    Background,
    CoefficientPosterior,
    Coefficients,
    Work,
    cavity_evidence,
    fault_evidence,
)
from analysis.diagnosis.fit.candidates import LARGEST_FAULT, WEIGHT_DIGITS, Columns, Level, fault_sizes, order_of
from analysis.diagnosis.fit.joint_curves import is_of_curve
from analysis.diagnosis.fit.refine import whole_order_gain
from analysis.diagnosis.fit.responses import Linearisation, RmsByBlock, limits_um, rms_by_block
from analysis.diagnosis.fit.selection_state import (
    DRIVEN_WAVES,
    FAULT,
    Backgrounds,
    SelectionState,
    has_compliant_base_only,
    large_effects,
)
from analysis.diagnosis.fit.unknown import UnknownCauses
from analysis.robot.kinematics.arm import Array, Mask
from rigs.effects import Effect, healthy_size
from rigs.schema.effect import name_of, size_of

_FAULTS = 2.0
"""Expected number of faults of an arm sent for diagnosis. Chosen: between a single fault and the 9 to 14 of an arm that
was never calibrated.
"""
HEALTHY_PRICE = 6.0
"""Log evidence that a single form at healthy size must gain to be fitted. Chosen: a smaller gain changes no verdict."""
_OF_SET_UP = 0.01
"""Share of a column that remains after a set-up is fitted, below which the column is a term of the set-up. Chosen: the
last length leaves 0.002 next to a soft joint, columns of other terms 0.6 and more.
"""
_OFF = 0.1
"""Largest relative difference of the response of the faults from that of the reference faults. Chosen: columns are then
wrong by 0.1 % of a large fault.
"""
_FEW_SIGMA = 100.0
"""Norm of that difference in noise standard deviations up to which columns remain valid for any size of fault. Chosen:
columns with an error of 1 % of it miss 1 standard deviation.
"""
_BAND_PRICE, _TARGET_PRICE = 3.0, 8.0
"""Log evidence that the strength of a band of orders, and of targets, must gain to exceed the noise. Chosen: the noise
of targets has heavy tails.
"""
_MOST_STRENGTH = 1e6
"""Largest strength of the noise: a thousand times the scatter of a real pose, exceeded only by a wrong arm."""
_TAIL = 4.0
"""Degrees of freedom of Student's distribution of readings at targets. Chosen: stops of robots have heavy tails."""
MOST_LEVEL = 8.0
"""Largest level of a background. Chosen: an arm with eight times the healthy size of every effect has faults instead.
"""
_LEVELS = np.geomspace(0.003, MOST_LEVEL, 80)
"""Levels of a background that are tried, from that of a simulated arm that has only named effects. Chosen: consecutive
levels differ by a tenth.
"""
_LEVEL_ROUNDS, _SAME_LEVEL = 12, 0.15
"""Largest number of successive estimates of the level, and the logarithm of their ratio at which they agree. Twelve
rounds lead from a healthy arm to a hundred times quieter arm.
"""
_QUIETER = 1.4
"""Factor between levels that are compared by evidence. Chosen: a tenth of the width of the prior."""
_NO_GAIN = -0.5
"""Approximate log evidence below which a lower level is not tried. Chosen: none of 171 such levels gained anything."""
_QUIETEST = 0.03
"""Level below which the evidence is not used to try a lower level: there, a search finds ever smaller effects."""
_SAME_STRENGTH = 0.01
"""Largest logarithm of the ratio of strengths treated as equal: half a percent of an uncertainty."""
_LEVEL_TAIL = 4.0
"""Degrees of freedom of Student's distribution of the effects of an arm, limiting the weight of a fault. Chosen."""
_LEVEL_SPREAD = 1.4
"""Prior standard deviation of the logarithm of a level: a factor of four in either direction. Chosen."""


def _level_costs(levels: Array) -> Array:
    return np.log(levels) ** 2 / (2 * _LEVEL_SPREAD**2)


@dataclass(frozen=True)
class StateEvidence:
    """Prior odds of effects, and evidence of states that explain the residual (N,) of a linearisation."""

    linear: Linearisation
    columns: Columns
    work: Work = field(default_factory=Work, compare=False)

    @cached_property
    def fault_price(self) -> float:
        """Prior log odds that a named effect is a fault."""
        return float(np.log(_FAULTS / max(len(self.columns.among), 1)))

    @cached_property
    def log_choices(self) -> Array:
        """Logarithm (n,) of the inverse likelihood of each form among the forms of the effect."""
        return -np.log(self.columns.likelihoods)

    @cached_property
    def shows_curves(self) -> bool:
        """True if the readings show curves of joints but no single waves of a healthy joint.

        Poses cover long sections of the error of a joint over its angle, and no wave of a healthy joint is dominant.
        """
        return not any(block.sampling for block in self.linear.blocks)

    def is_of_curve(self, effect: Effect) -> bool:
        """Whether an effect is a wave of a joint curve, unless it is a fault."""
        return self.shows_curves and is_of_curve(effect)

    def nearest_form(self, effect: Effect) -> int | None:
        """Index of the form of an effect, for waves of the nearest order; None without a form."""
        indices, orders = self._forms_of_name.get(name_of(effect), ([], np.empty(0)))
        if not indices:
            return None
        return indices[int(np.argmin(np.nan_to_num(np.abs(orders - order_of(effect)))))]

    @cached_property
    def _forms_of_name(self) -> dict[str, tuple[list[int], Array]]:
        indices: dict[str, list[int]] = {}
        for k, form in enumerate(self.columns.forms):
            indices.setdefault(form.name, []).append(k)
        orders = np.array([order_of(form.effect) for form in self.columns.forms])
        return {name: (of_name, orders[of_name]) for name, of_name in indices.items()}

    def choice_cost(self, effect: Effect) -> float:
        """Log evidence required for choosing an effect among its possible forms. For waves, each octave of orders is
        equally likely, as in the background.
        """
        nearest = self.nearest_form(effect) if np.isfinite(order_of(effect)) else None
        if nearest is not None:
            return float(self.log_choices[nearest])
        return float(np.log(self.columns.among.get(name_of(effect), 1)))

    def price(self, effect: Effect, level: Level) -> float:
        """Log prior probability of an effect with its size and form, relative to the wide prior used in the fit."""
        size, of_it, healthy = size_of(effect), level.of(effect), -np.inf
        if not self.is_of_curve(effect):
            healthy = -HEALTHY_PRICE - 0.5 * (size / of_it) ** 2 - np.log(of_it)
        odds = float(self._size_odds(size, of_it, healthy))
        return odds - self.choice_cost(effect) - self.stated_penalty(effect)

    def usual_gain(self, effect: Effect, level: Level) -> float:
        return float(self.usual_gains([effect], np.array([size_of(effect)]), level)[0])

    def usual_gains(self, effects: Sequence[Effect], size: Array, level: Level) -> Array:
        """Log odds (n,) that offset the penalties of effects with given sizes (n,), in healthy sizes.

        Every arm has a usual amount of every effect. It is therefore no evidence against an effect that a search
        ignores it below a given gain, or that the arm shows little of most other effects.
        """
        reference = self.linear.blocks[0].model.rig.reference
        levels = np.array([level.of(effect) for effect in effects])
        usual = np.maximum(levels, [effect.usual_times(reference) for effect in effects])
        healthy = -HEALTHY_PRICE - 0.5 * (size / levels) ** 2 - np.log(levels)
        as_usual, gains = -0.5 * (size / usual) ** 2 - np.log(usual), np.zeros(len(effects))
        for of_these in np.unique(levels).tolist():
            k = levels == of_these
            gains[k] = self._size_odds(size[k], of_these, as_usual[k]) - self._size_odds(size[k], of_these, healthy[k])
        return np.where([self.is_of_curve(effect) for effect in effects], 0.0, gains)

    def _size_odds(self, size: Array | float, level: float, healthy: Array | float) -> Array:
        """Prior log odds (n,) of sizes (n,), in healthy sizes, relative to the wide prior of the fit. A size belongs to
        a fault, or with the log odds `healthy` (n,) to an effect present in every arm.
        """
        sizes, each = fault_sizes(level), np.asarray(size, dtype=float)[..., None]
        fault = self.fault_price + np.log(np.mean(np.exp(-0.5 * (each / sizes) ** 2) / sizes, axis=-1) + 1e-300)
        wide = -0.5 * (np.asarray(size) / LARGEST_FAULT) ** 2 - np.log(LARGEST_FAULT)
        return np.asarray(np.logaddexp(fault, healthy) - wide, dtype=float)

    def stated_penalty(self, effect: Effect) -> float:
        """Log evidence required for shapes of an effect that differ from the rig file: with unknown link masses, a soft
        joint and a heavy load look the same.
        """
        free = effect.free(self.linear.payload)
        off = [abs(getattr(effect, one.field) - one.expected) > SURE_SIGMA * one.spread for one in free if one.stated]
        return HEALTHY_PRICE * float(sum(off))

    @cached_property
    def waves_of_curves(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Masks (n,) of the forms that are waves of a joint's curve, and of forms of such low order that the joint was
        driven over few waves in any run.
        """
        effects = [form.effect for form in self.columns.forms]
        turned = np.max([block.turns for block in self.linear.blocks], axis=0)
        driven = [
            order_of(effect) * float(turned[getattr(effect, "axis", 1) - 1]) if is_of_curve(effect) else np.inf
            for effect in effects
        ]
        return np.array([self.is_of_curve(effect) for effect in effects], dtype=bool), np.array(driven) < DRIVEN_WAVES

    @cached_property
    def thresholds(self) -> Array:
        """Log evidence (n,) that a form must gain in addition to the penalty; infinite if a set-up of poses or touches
        has the same effect, as the last length.
        """
        against = np.array([self.stated_penalty(form.effect) for form in self.columns.forms], dtype=float)
        if self.shows_curves:
            columns = self.columns.X[:, : self.columns.set_ups.start]
            remaining = np.linalg.norm(self.linear.without_set_up(columns), axis=0)
            is_absorbed = remaining < _OF_SET_UP * np.linalg.norm(columns, axis=0)
            against[[bool(is_absorbed[list(form.columns)].all()) for form in self.columns.forms]] = np.inf
        return against

    @cached_property
    def causes(self) -> UnknownCauses:
        return UnknownCauses.in_runs(self.linear)

    @cached_property
    def causes_of_circles(self) -> UnknownCauses:
        """The kinds that may replace names during a search. At targets, an unknown cause follows the scatter: on poses
        of a UR10 it replaced right names.
        """
        return self.causes.of_circles() if any(block.sampling for block in self.linear.blocks) else UnknownCauses({})

    @cached_property
    def backgrounds(self) -> Backgrounds:
        return Backgrounds(self.columns, self.linear.blocks[0].model.rig.reference, self.work)

    def posterior(self, state: SelectionState) -> CoefficientPosterior:
        return self.backgrounds.of(state).posterior(state.refined.fitted_terms)

    def evidence(self, state: SelectionState) -> float:
        """Log evidence of a state, up to a constant."""
        return self.backgrounds.of(state).evidence(state.refined.fitted_terms) + self.log_prior(state)

    def log_prior(self, state: SelectionState) -> float:
        """Log prior odds of the effects and unknown causes of a state, relative to the wide priors of the fit."""
        prices = sum(self.price(effect, state.level) for effect in state.effects)
        prices += sum(whole_order_gain(state.refined, place) for place in range(len(state.effects)))
        if has_compliant_base_only(state.effects):
            prices -= HEALTHY_PRICE  # the softness of the shoulder is then free, as if it were fitted
        if state.unknown:
            prices -= len(state.unknown) * self.causes_of_circles.price
        return prices

    def evidence_of_names(self, state: SelectionState) -> float:
        """The same for a comparison of names, each of which may be of usual size."""
        return self.evidence(state) + sum(self.usual_gain(effect, state.level) for effect in state.effects)

    def likeliest(self, states: Sequence[SelectionState]) -> tuple[float, SelectionState]:
        """The largest log evidence of several states, and the first state that has it."""
        return max(((self.evidence(state), state) for state in states), key=lambda both: both[0])

    def gains(self, state: SelectionState, posterior: Coefficients) -> Array:
        """Log odds (n,) of each form as a named effect, as a fault or of healthy size, against remaining in the
        background.
        """
        gains = posterior.gains(self.columns.forms, state.level)
        curves, pieces = self.waves_of_curves
        levels = np.array([state.level.of(form.effect) for form in self.columns.forms])
        is_usual = gains.size < FAULT * np.maximum(levels, 1.0)  # of healthy arms or of arms of this level
        gains.fault[curves & (pieces | is_usual)] = gains.healthy[curves] = -np.inf
        fault = gains.fault - self.thresholds + self.fault_price - self.log_choices
        healthy = gains.healthy - self.thresholds - HEALTHY_PRICE - self.log_choices
        return np.maximum(fault, healthy)

    def gain_of(self, state: SelectionState, posterior: CoefficientPosterior, place: int) -> float:
        """Approximate log odds of a named effect against its form remaining in the background.

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
        if (nearest := self.nearest_form(effect)) is not None:
            usual *= self.columns.likelihoods[nearest]
            if state.curves is not None and self.is_of_curve(effect):
                usual = self.columns.variance(state.level, state.curves)[list(forms[nearest].columns)].sum()
        share = cavity_evidence(values, seen, float(usual))
        fault = fault_evidence(values, seen, level) - share + self.fault_price
        healthy = cavity_evidence(values, seen, level**2) - share - HEALTHY_PRICE
        gain = float(fault if self.is_of_curve(effect) else max(fault, healthy))
        return gain - self.choice_cost(effect)

    def not_testable(self, state: SelectionState, posterior: CoefficientPosterior) -> tuple[str, ...]:
        """The effects that these tests would not show even as a large fault, with all other effects possible."""
        sigma = posterior.gains(self.columns.forms, state.level).sigma
        named = {name_of(effect) for effect in state.effects}
        seen = {self.columns.forms[k].name for k in np.flatnonzero(LARGEST_FAULT * sigma > SURE_SIGMA).tolist()}
        hidden = dict.fromkeys([*self.columns.not_seen, *(form.name for form in self.columns.forms)])
        return tuple(name for name in hidden if name not in seen | named)

    def moves(self, state: SelectionState) -> Array:
        """Terms of the set-ups (s,) mm that fit the readings best with the effects of a state. A target moves with the
        arm's constants, so set-ups of poses are fitted with all other contributions.
        """
        moves, poses = self.linear.moves_with(state.effects), sorted(self.linear.terms_of_poses)
        if poses:
            moves[poses] = self.posterior(state).mean[self.columns.set_ups][poses]
        return moves

    def is_valid_for(self, state: SelectionState) -> bool:
        """Whether the columns are valid for a state: its effects hardly move the set-ups, and respond nearly like the
        reference faults of the columns.
        """
        linear = self.linear
        if not linear.is_straight(self.moves(state)):
            return False
        reference, faults = large_effects(linear.reference), large_effects(state.effects)
        if not (reference or faults):
            return True
        with_reference, with_faults, without = (linear.residual(effects) for effects in (reference, faults, ()))
        off, whole = (linear.without_set_up(residual - with_faults) for residual in (with_reference, without))
        return float(np.linalg.norm(off)) <= max(_OFF * float(np.linalg.norm(whole)), _FEW_SIGMA)

    @cached_property
    def limits_um(self) -> Array:
        return limits_um(self.linear)

    def rms_of(self, state: SelectionState, place: int) -> RmsByBlock:
        """Changes of the readings by an effect."""
        change = self.linear.residual(state.refined.without(place).effects) - state.refined.residual
        return rms_by_block(self.linear, change)

    def is_reported(self, state: SelectionState, place: int) -> bool:
        """Whether an effect is reported as a fault: of that size, or larger than usual in this arm and material."""
        if not state.may_be_fault(place):
            return False
        is_large = abs(size_of(state.effects[place])) >= FAULT
        return is_large or self.rms_of(state, place).is_material(self.limits_um)

    # The noise and the level of a state.

    @cached_property
    def _targets(self) -> Mask:
        return self.linear.at_entries([np.full(len(b.y_mm), b.sampling is None) for b in self.linear.blocks])

    @cached_property
    def _band_price(self) -> Array:
        """Log evidence (b,) that each band's strength must gain; known distances have their stated uncertainty."""
        price = np.where(np.bincount(self.columns.band, self._targets) > 0, _TARGET_PRICE, _BAND_PRICE)
        price[self.columns.band[self.linear.of_distances]] = np.inf
        return price

    def level(self, state: SelectionState, posterior: CoefficientPosterior) -> Level:
        """Estimate the level: mean square of the coefficients of each effect, relative to an arm at level 1.

        An effect with any number of forms counts once, because a gear shows only a few orders; a fault has little
        weight. Expected but unobserved effects do not count.
        """
        columns, background, now = self.columns, posterior.background, state.level
        cols = np.flatnonzero(self._leveled(state, background))
        freedom = np.clip(1 - posterior.variance[cols] / background.variance[cols], 0.0, 1.0)
        # Contribution of the prior means to the coefficients; readings show the rest.
        unseen = posterior.covariance_times(background.pull)
        shown = (posterior.mean - unseen)[cols] ** 2
        expected = columns.healthy[cols] * freedom
        expected += ((background.mean - unseen)[cols] / columns.levels(now)[cols]) ** 2
        names, of_columns, count = columns.name_of_column[cols], columns.level_indices(now)[cols], len(columns.among)
        likeliest = []
        for k, value in enumerate(now.values.tolist()):
            leveled_k = of_columns == k
            squares = np.bincount(names[leveled_k], shown[leveled_k], count)
            seen = np.bincount(names[leveled_k], expected[leveled_k], count)
            for place, name in enumerate(columns.among):
                named = [effect for effect in state.effects if name_of(effect) == name and now.index(effect) == k]
                if named:
                    squares[place] += sum(size_of(effect) ** 2 for effect in named)
                    seen[place] = 1.0
            weight = (_LEVEL_TAIL + 1) / (_LEVEL_TAIL + squares / np.maximum(seen, 1e-3) / value**2)
            likely = -seen.sum() * np.log(_LEVELS) - float(weight @ squares) / (2 * _LEVELS**2) - _level_costs(_LEVELS)
            likeliest.append(min(_LEVELS[np.argmax(likely)], state.level_cap))
        return Level.of_values(np.array(likeliest))

    def _leveled(self, state: SelectionState, background: Background) -> Mask:
        leveled = (self.columns.healthy > 0) & (background.variance > 0)
        if state.curves is not None:
            leveled[self.columns.curves.columns] = False  # curves have separate widths
        return leveled

    def robust(self, posterior: CoefficientPosterior) -> Array:
        """Weights (N,) of the entries: of Student's distribution at targets, and 1 elsewhere."""
        weight, targets = np.ones(len(self._targets)), self._targets
        if targets.any():
            at_targets = posterior.residual[targets]
            scale = max(1.0, 1.4826 * float(np.median(np.abs(at_targets))))
            fair = np.minimum(1.0, (_TAIL + 1) / (_TAIL + (at_targets / scale) ** 2))
            weight[targets] = np.round(fair, WEIGHT_DIGITS)
        return weight

    def strength(self, state: SelectionState, posterior: CoefficientPosterior) -> Array:
        """Strength (b,) of each band: the residual's if it exceeds the noise by more than the price. Assumed noise,
        which is wide, may also be reduced.
        """
        count = self.columns.count
        free: Array = np.maximum(count - posterior.spent / state.strength, 0.25 * count)
        ratio: Array = np.maximum(self._energy(state, posterior) / free, 1e-9)
        gain = 0.5 * free * (ratio - 1 - np.log(ratio)) - self._band_price
        return np.where((ratio > 1) & (gain > 0), ratio, np.clip(ratio, self.strength_limits[0], 1.0))

    @cached_property
    def strength_limits(self) -> Array:
        """Smallest and largest strength (2, b) of each band: at least 1 if repeats show the noise, less if it is
        assumed.
        """
        assumed = self.linear.at_entries([np.full(len(b.y_mm), not b.measured) for b in self.linear.blocks])
        least = np.where(np.bincount(self.columns.band, assumed) > 0, LEAST_ASSUMED, 1.0)
        return np.stack([least, np.where(np.isfinite(self._band_price), _MOST_STRENGTH, 1.0)])

    def by_strength(self, posterior: CoefficientPosterior) -> Array:
        """Derivatives (b,) of the log evidence by the logarithms of the strengths."""
        energy = np.bincount(self.columns.band, posterior.background.weight * posterior.residual**2)
        return 0.5 * (energy + posterior.weighted_spent - self.columns.count)

    def renewed(self, state: SelectionState) -> SelectionState:
        """Improve strengths and robust weights, then the level.

        An estimate with all other values unchanged may overshoot; a shorter step is then tried, and if that does not
        help either, they do not change.
        """
        posterior = self.posterior(state)
        whole, robust, whole_step = self.evidence(state), self.robust(posterior), self.strength(state, posterior)
        # A step of expectation maximisation never makes the readings less likely (Dempster, Laird and Rubin 1977).
        energy = self._energy(state, posterior) + posterior.spent
        nearer = np.clip(energy / self.columns.count, *self.strength_limits)
        apart = float(np.abs(np.log(whole_step / nearer)).max())
        for strength in (whole_step, nearer) if apart > _SAME_STRENGTH else (whole_step,):
            tried = replace(state, strength=strength, robust=robust)
            if self.evidence(tried) > whole:
                state = tried
                break
        for _ in range(_LEVEL_ROUNDS):
            level, now = self.level(state, posterior).values, state.level.values
            # Effects not yet named look like an arm with a higher level.
            raised = replace(state, level=Level.of_values(level))
            if (level > now).any() and self._with_prior(raised) <= self._with_prior(state):
                level = np.minimum(level, now)
            if np.abs(np.log(level / now)).max() < _SAME_LEVEL:
                break
            state = replace(state, level=Level.of_values(level))
            posterior = self.posterior(state)
        return state if state.unknown else self._at_quieter_level(state, posterior)

    def _with_prior(self, state: SelectionState) -> float:
        return self.evidence(state) - float(_level_costs(state.level.values).sum())

    def _at_quieter_level(self, state: SelectionState, posterior: CoefficientPosterior) -> SelectionState:
        """Lower each level while that is likelier.

        Estimates from the posterior converge ever more slowly to a quiet level, and at too high a level wrong names
        were confirmed.
        """
        whole = self._with_prior(state)
        for k in range(state.level.values.size):
            if self._gain_when_quieter(state, posterior, k) < _NO_GAIN:
                continue
            while state.level.values[k] / _QUIETER >= _QUIETEST:
                levels = state.level.values
                levels[k] /= _QUIETER
                tried = replace(state, level=Level.of_values(levels))
                if (quieter := self._with_prior(tried)) <= whole:
                    break
                state, whole = tried, quieter
        return state

    def _gain_when_quieter(self, state: SelectionState, posterior: CoefficientPosterior, k: int) -> float:
        """Approximate log evidence that the next lower value of level k gains, coefficient by coefficient."""
        background, columns = posterior.background, self.columns
        cols = self._leveled(state, background) & (columns.level_indices(state.level) == k)
        variance, mean = background.variance[cols], background.mean[cols]
        precision = np.maximum(1 / posterior.variance[cols] - 1 / variance, 0.0)
        eta = posterior.mean[cols] / posterior.variance[cols] - background.pull[cols]

        def of_times(times: float) -> float:
            expected = times * mean
            of_variance = cavity_evidence(precision, (eta - precision * expected) ** 2, times**2 * variance)
            return float(of_variance + expected @ eta - 0.5 * precision @ expected**2)

        levels = state.level.values[k] / np.array([1.0, _QUIETER])
        return of_times(1 / _QUIETER) - of_times(1.0) - float(np.diff(_level_costs(levels))[0])

    def _energy(self, state: SelectionState, posterior: CoefficientPosterior) -> Array:
        raw = posterior.background.weight * state.strength[self.columns.band] * posterior.residual**2
        return np.asarray(np.bincount(self.columns.band, raw), dtype=float)
