"""Selection of the effects that explain the readings.

A state (`selection_state.py`) contains the fitted effects. `Selection.select` changes it round by round. It adds the
form of a candidate whose fit gains most log evidence, drops an effect that no longer pays the penalty, and reestimates
the noise, until neither pays. All unnamed effects remain possible as the background of columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from analysis.diagnosis.fit.background import CoefficientPosterior, cavity_evidence, fault_evidence
from analysis.diagnosis.fit.candidates import LARGEST_FAULT, Columns
from analysis.diagnosis.fit.effect_prices import HEALTHY_PRICE, EffectPrices
from analysis.diagnosis.fit.effort import Effort
from analysis.diagnosis.fit.free_forms import FREE_PRICE, FreeForm, best_free_form, free_forms_of
from analysis.diagnosis.fit.joint_curves import JointCurves
from analysis.diagnosis.fit.refine import FIT_ROUNDS, no_effects, refine, whole_order_gain
from analysis.diagnosis.fit.responses import Linearisation, Response
from analysis.diagnosis.fit.selection_state import (
    FAULT,
    MOST_LEVEL,
    Backgrounds,
    Hyperparameters,
    SelectionState,
    beginnings,
    has_compliant_base_only,
    is_alike,
    is_duplicate,
    is_one,
    settled,
    spurious_wave_series,
    starting_effects,
)
from analysis.procedures.facts import facts_of
from analysis.robot.kinematics.arm import Array
from rigs.effects import Effect, healthy_size
from rigs.schema.effect import is_wave, name_of

# ----------------------------------------------------------------------------------------------------------------------
# Selection of the effects that explain the readings: faults and the visible effects of a healthy arm compete by
# evidence.
#
# The residual of a band of orders, or of targets, has a separate strength beyond the noise, estimated in each round;
# every effect must explain more than that. Each round adds the form with the largest gain as an effect, and fits size
# and shape on the simulator before the next round, because the residual of a wrong shape would support wrong names. The
# visible backlash and gear errors of a healthy arm are fitted like faults, and the size of an effect distinguishes the
# two. Effects whose evidence no longer covers their penalty are removed.

_OFF = 0.1
"""Largest relative difference between the responses of the current faults and of the reference faults. Chosen:
columns computed without faults had errors of up to 1 % of a large fault; with this limit they have 0.1 %.
"""
_FEW_SIGMA = 100.0
"""Norm of the difference between the responses of the faults and the reference faults, in standard deviations of the
noise, up to which columns remain valid for any size of fault. Chosen: columns with an error of 1 % of it (6 % at
worst) miss 1 (6) standard deviations.
"""
_DEPTH = 40
"""Largest number of fitted effects: real arms that were never calibrated have 9 to 14 faults, and as many visible
healthy effects."""
_SEARCH_ROUNDS = 40
"""Largest number of rounds; each adds or removes an effect, and the limit therefore equals that of the effects."""
_SEEN = 4.0
"""Sigmas that the largest fault must have for an effect to be testable. Chosen: below the 7 sigma at which an effect
is detected, to avoid reporting named effects in between as hidden.
"""
_SURE_EVIDENCE = 5.0
"""Log evidence of the cavity above which an effect is not tested for removal. Chosen: odds of 150 to 1."""
_MUCH = 50.0
"""Log evidence from which a free form competes with named effects. Chosen: foreign effects leave 50 to 500 in log
evidence, and effects of the library mostly less than 8.
"""
_MARGIN = 1.2
"""Factor by which a free form must explain more than the best named effect, whose first fit is not at the optimum.
Chosen.
"""
_TRIED, _CLOSE = 3, 0.5
"""Maximum number of candidate effects that are fitted before the best is named, and the minimum linear gain of each
as a share of the largest gain. Chosen: each fit costs a fraction of a round.
"""
_BENT, _PLAIN_TO_SEE = -5.0, 10.0
"""Minimum log evidence of a form whose effect is also fitted if no effect gains much, and minimum sigmas of the form
in the readings. The available shapes may all differ too much from the true shape. The spike of an axis with a
decay of 0.93 s, 21 sigma, lost 2.5 with the shape of 1 s and gained 420 when fitted; when omitted, a lag of 0.6
ms became 33 ms.
"""
_CURVE_ROUNDS, _ENOUGH_OF_CURVES = 3, 2.0
"""Largest number of fits of curves alternating with the weights of outliers, and the log evidence that a fit must
gain for the next. Chosen: an outlier among 30 poses of a UR10 took three."""
_FEW_ROUNDS = 3
"""Number of rounds of preliminary fits: fits from several starts, of which only the likeliest continues, and fits
alternating with the noise. Chosen: in a development case the first two gained nearly all that a fit gained.
"""


@dataclass(frozen=True)
class Selection:
    """Selection of effects for the residual (N,) of a linearisation."""

    linear: Linearisation
    columns: Columns
    effort: Effort = field(default_factory=Effort, compare=False)

    @cached_property
    def prices(self) -> EffectPrices:
        """The prior odds of effects."""
        return EffectPrices(self.linear, self.columns)

    @cached_property
    def _hyperparameters(self) -> Hyperparameters:
        return Hyperparameters(self.linear, self.columns)

    @cached_property
    def backgrounds(self) -> Backgrounds:
        """The backgrounds of states: all contributions not fitted as an effect."""
        return Backgrounds(self.columns, self.linear.blocks[0].model.rig.robot.design)

    @property
    def shows_free_forms(self) -> bool:
        """True if the readings can show unnamed errors."""
        return bool(self._free)

    @cached_property
    def _free(self) -> tuple[FreeForm, ...]:
        # With targets only, a free form follows the scatter: on poses of a UR10 it replaced names, and the rms of
        # held-out poses was 0.317 mm instead of the 0.141 mm with names only.
        return tuple(free_forms_of(self.linear)) if any(block.sampling for block in self.linear.blocks) else ()

    def initial_state(self, effects: Sequence[Effect] = (), previous: SelectionState | None = None) -> SelectionState:
        """Return a state with the given effects fitted, in an arm at healthy level and with the estimated noise.

        The search for the noise and the curves of joints shown by poses starts from those of the `previous` state.
        """
        strength, robust = np.ones(len(self.columns.count)), np.ones(len(self.linear.y))
        axes = max(self.linear.axes, self.columns.curves.count)
        curves = JointCurves((1.0,) * axes) if self.prices.shows_curves else None
        if curves is not None and previous is not None and previous.curves is not None:
            curves = previous.curves
            if self._of_tracker and len(previous.strength) == len(strength) and len(previous.robust) == len(robust):
                strength, robust = previous.strength, previous.robust
        none, first = replace(no_effects(self.linear), effects=tuple(effects)), curves if self._of_tracker else None
        bare = SelectionState(none, (-1,) * len(effects), 1.0, strength, robust, curves=first)
        state = replace(bare, refined=refine(self.linear, self.backgrounds.of(bare), effects))
        if first is not None:
            # Alternate between the likeliest curves and noise, and the weights of outliers. With weights computed
            # before the curves, readings looked like outliers wherever a curve was large, and 30 poses of a UR10 left a
            # tenth more.
            for _ in range(_CURVE_ROUNDS):
                whole = self.evidence(state)
                state = self.renewed(self._with_likeliest_curves(state, self._hyperparameters.strength_limits))
                if self.evidence(state) - whole < _ENOUGH_OF_CURVES:
                    break
            return state
        state = self.renewed(self.renewed(state))
        if curves is None:
            return state
        # Gauges at few targets, and balls in sockets that move with the arm's constants, separate curves poorly from
        # scatter. When searched with the curves, the noise left 1.1 instead of 0.4 mm of a Panda at a held-out
        # placement.
        return self.renewed(self._with_likeliest_curves(replace(state, curves=curves), np.stack([state.strength] * 2)))

    @property
    def _of_tracker(self) -> bool:
        """True if all readings are poses of a tracker."""
        return all(facts_of(block.table.test).of_tracker for block in self.linear.blocks)

    def state_with(self, effects: Sequence[Effect], previous: SelectionState | None = None) -> SelectionState:
        """Return a state with the given effects fitted, from any initial size and shape.

        An effect with readings not proportional to the size, such as a backlash, starts at the size explaining most in
        addition to the previous effects, in the order of their explained part. Fitted from a small width, a backlash of
        0.03° ended at 0.
        """
        forms = self.columns.forms
        waiting = [effect for effect in effects if effect.FREE or (effect.STRETCHED and not is_wave(effect))]
        state = self.initial_state([effect for effect in effects if effect not in waiting], previous)
        while waiting:
            posterior = self.posterior(state)
            gain = self.gains(state, posterior)
            best: dict[Effect, int | None] = {}
            for effect in waiting:
                alike = [k for k, form in enumerate(forms) if is_alike(form.effect, effect) and np.isfinite(gain[k])]
                best[effect] = max(alike, key=lambda k: gain[k], default=None)
            effect = max(waiting, key=lambda candidate: -np.inf if best[candidate] is None else gain[best[candidate]])
            waiting.remove(effect)
            k = best[effect]
            added = self._with_effect(state, effect, -1) if k is None else self.with_form(state, posterior, k)
            state = self.settled(*beginnings(added)) if added.may_be_fault(-1) else self.renewed(added)
        return state

    def _with_likeliest_curves(self, state: SelectionState, limits: Array) -> SelectionState:
        """Return the state with the likeliest sizes of the joint curves, and the corresponding likeliest strengths
        of the noise within `limits` (2, b).
        """
        assert state.curves is not None  # noqa: S101 - poses alone have them
        of_curves, terms, noise = self.columns.curves.columns, state.refined.fitted_terms, self._hyperparameters

        def likelihood(curves: JointCurves, strength: Array) -> tuple[float, Array, Array]:
            background = self.backgrounds.of(replace(state, curves=curves, strength=strength))
            posterior, prior = background.posterior(terms), background.variance[of_curves]
            shown = (posterior.mean - background.mean)[of_curves] ** 2 + posterior.variance[of_curves]
            ratio = np.divide(shown, prior, out=np.ones_like(prior), where=prior > 0)
            return background.evidence(terms), 0.5 * (ratio - 1), noise.by_strength(posterior)

        curves, strength = self.columns.curves.fitted(state.curves, state.strength, limits, likelihood)
        return replace(state, curves=curves, strength=strength)

    def fitted_again(self, state: SelectionState, refitted: Sequence[Effect] = ()) -> SelectionState:
        """Return the state with each fault refitted from the best form of the effect, if that explains more, except the
        `refitted` faults.

        A shape found with other set-ups may be a local optimum: a spike of 0.18 s remained at 0.05 s, although most of
        it took four times as long.
        """
        place = 0
        for effect in state.effects:
            again = None
            if state.may_be_fault(place) and not any(is_one(earlier, effect) for earlier in refitted):
                without = self.without(state, place)
                posterior = self.posterior(without)
                gain = self.gains(without, posterior)
                of_name = [k for k, form in enumerate(self.columns.forms) if form.name == name_of(effect)]
                best = max((k for k in of_name if np.isfinite(gain[k])), key=lambda k: gain[k], default=None)
                again = None if best is None else self.with_form(without, posterior, best)
            if again is not None and not is_duplicate(again.effects) and self.evidence(again) > self.evidence(state):
                state = again  # it is the last now, and the next effect has moved to this index
            else:
                place += 1
        return state

    def select(self, state: SelectionState, *, stops: bool = False) -> SelectionState:
        """Return the state with all effects that cover their penalty and no others.

        If a free form explained more than the best named effect, the search accepting it is tried too, and the state
        with more evidence is returned. If `stops` is set, the search ends at the first new fault that invalidates the
        columns, unless a free form explained more before.
        """
        named, with_free_form = self._stepwise(state, accept_free_forms=False, stops=stops)
        if with_free_form is None:
            return named
        return self.likeliest([named, self._stepwise(with_free_form, accept_free_forms=True)[0]])[1]

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

    def _stepwise(
        self, state: SelectionState, *, accept_free_forms: bool, stops: bool = False
    ) -> tuple[SelectionState, SelectionState | None]:
        """Return the result of a stepwise search, and the first state in which a free form explained more than the best
        name, if any.

        accept_free_forms: use such a form. stops: end at a new fault that invalidates the columns, unless there is such
        a form. The search also ends at a series of waves.
        """
        with_free_form = None
        # Unnamed faults resemble an arm with a high level; names are therefore selected at level 1 first.
        for level_cap in (1.0, MOST_LEVEL):
            level, state = state.level, self.renewed(replace(state, level_cap=level_cap))
            if level_cap > 1.0 and state.level == level:
                break
            for _ in range(_SEARCH_ROUNDS):
                if spurious_wave_series(state.effects) or self.effort.is_spent:
                    # further names would only describe the residual of a series approximating an error of a different
                    # form
                    break
                self.effort.rounds += 1
                posterior = self.posterior(state)
                # Effects that pay nothing are removed first, and only then is an effect added. If none gains, doubtful
                # effects are removed.
                changed = self._backward_step(state, posterior, below=0.0)
                if changed is None:
                    may_try_free = accept_free_forms or with_free_form is None
                    changed, unnamed = self._forward_step(state, posterior, try_free_forms=may_try_free)
                    with_free_form = with_free_form or unnamed
                    if accept_free_forms and unnamed:
                        changed = unnamed
                    elif changed is not None and changed.may_be_fault(-1):
                        newest = changed.effects[-1]
                        is_new = not any(is_alike(effect, newest) for effect in self.linear.reference)
                        if stops and with_free_form is None and is_new and not self.is_valid_for(changed):
                            return changed, None
                        changed = self.settled(*beginnings(changed))
                changed = changed or self._backward_step(state, posterior, below=_SURE_EVIDENCE)
                changed = changed or self._without_free_form(state)
                if changed is None:
                    break
                state = self.renewed(changed)
        return self.renewed(self.refitted(state)), with_free_form

    def posterior(self, state: SelectionState) -> CoefficientPosterior:
        """Return the posterior of all coefficients in a state."""
        return self.backgrounds.of(state).posterior(state.refined.fitted_terms)

    def without_free_forms(self, state: SelectionState) -> SelectionState:
        """Return the state with the free forms removed, with the same effects and the noise reestimated."""
        none = Response(np.empty((len(self.linear.y), 0)))
        return self.renewed(replace(state, free_forms=(), discrepancy=0.0, refined=replace(state.refined, free=none)))

    def not_testable(self, state: SelectionState, posterior: CoefficientPosterior) -> tuple[str, ...]:
        """Return the named effects that these tests would not show at the size of a large fault, with all other
        possible effects present.
        """
        sigma = posterior.gains(self.columns.forms, state.level).sigma
        named = {name_of(effect) for effect in state.effects}
        seen = {self.columns.forms[k].name for k in np.flatnonzero(LARGEST_FAULT * sigma > _SEEN).tolist()}
        hidden = dict.fromkeys([*self.columns.not_seen, *(form.name for form in self.columns.forms)])
        return tuple(name for name in hidden if name not in seen | named)

    def renewed(self, state: SelectionState) -> SelectionState:
        """Return the state with strengths, robust weights and level estimated again."""
        return self._hyperparameters.update(state, self.posterior(state), self.evidence, self.posterior)

    def _backward_step(
        self, state: SelectionState, posterior: CoefficientPosterior, *, below: float
    ) -> SelectionState | None:
        """Return the state with the effect of least evidence removed, if that does not cover the penalty, and None
        otherwise.

        Only effects whose cavity gains log evidence below `below` are tested.
        """
        doubtful = [k for k in range(len(state.effects)) if self.gain_of(state, posterior, k) < below]
        if not doubtful:
            return None
        whole = self.evidence(state)
        gains = {k: whole - self.evidence(self._without_refit(state, k)) for k in doubtful}
        place = min(gains, key=lambda k: gains[k])
        without = self.without(state, place)
        if whole >= self.evidence(without):
            return None
        return self.refusing(without, state.effects[place], state.origins[place])

    def refusing(self, state: SelectionState, effect: Effect, origin: int = -1) -> SelectionState:
        """Return the state in which all forms of an effect, and the form of origin, are refused."""
        of_effect = {k for k, form in enumerate(self.columns.forms) if is_alike(form.effect, effect)} | {origin}
        return replace(state, refused=state.refused | of_effect)

    def _without_free_form(self, state: SelectionState) -> SelectionState | None:
        """Return the state with a free form removed if the best named effect in the same role, or no effect,
        explains as much, and None otherwise.
        """
        whole = self.evidence(state) if state.free_forms else 0.0
        for k in range(len(state.free_forms)):
            kept = (*state.free_forms[:k], *state.free_forms[k + 1 :])
            without_it = self.refitted(replace(state, free_forms=kept))
            posterior = self.posterior(without_it)
            best = int(np.argmax(self.gains(without_it, posterior)))
            for simpler in (without_it, self.refitted(self.with_form(without_it, posterior, best))):
                if self.evidence(simpler) > whole:
                    return replace(simpler, replaced_forms=state.replaced_forms | {state.free_forms[k].words})
        return None

    def gain_of(self, state: SelectionState, posterior: CoefficientPosterior, place: int) -> float:
        """Return the approximate log evidence of an effect over the share of a healthy arm in the form, from the
        cavity of the size.
        """
        refined, effect = state.refined, state.effects[place]
        row = next(k for k, u in enumerate(refined.unknowns) if u.effect == place)
        unit, variance = healthy_size(effect), posterior.term_covariance[row, row]
        values = np.array([max(1 / variance - refined.unknowns[row].spread ** -2, 0.0) * unit**2])
        seen = np.array([((refined.values[row] + posterior.term_means[row]) / variance * unit) ** 2])
        # The variance that an arm of this state has in the form nearest to the effect.
        forms, usual = self.columns.forms, state.level**2
        if (nearest := self.prices.nearest_form(effect)) is not None:
            usual *= self.columns.likelihoods[nearest]
            if state.curves is not None and self.prices.is_of_curve(effect):
                usual = self.columns.variance(1.0, state.curves)[list(forms[nearest].columns)].sum()
        share = cavity_evidence(values, seen, float(usual))
        fault = fault_evidence(values, seen, state.level) - share + self.prices.fault_price
        healthy = cavity_evidence(values, seen, state.level**2) - share - HEALTHY_PRICE
        gain = float(fault if self.prices.is_of_curve(effect) else max(fault, healthy))
        return gain - self.prices.choice_cost(effect)

    def evidence(self, state: SelectionState) -> float:
        """Return the log evidence of a state, up to a constant."""
        evidence = self.backgrounds.of(state).evidence(state.refined.fitted_terms)
        prices = sum(self.prices.price(effect, state.level) for effect in state.effects)
        prices += sum(whole_order_gain(state.refined, place) for place in range(len(state.effects)))
        if has_compliant_base_only(state.effects):
            prices -= HEALTHY_PRICE  # the softness of the shoulder is then free, as if it were fitted
        return evidence + prices - FREE_PRICE * len(state.free_forms)

    def evidence_of_names(self, state: SelectionState) -> float:
        """Return the log evidence of a state, up to a constant, for a comparison of named effects."""
        return self.evidence(state) + sum(self.prices.usual_gain(effect, state.level) for effect in state.effects)

    def without(self, state: SelectionState, place: int) -> SelectionState:
        """Return the state with an effect removed and the others fitted again along their tangents."""
        bare = self._without_refit(state, place)
        return replace(bare, refined=refine(self.linear, self.backgrounds.of(bare), bare.effects, bare.refined))

    def _without_refit(self, state: SelectionState, place: int) -> SelectionState:
        """Return the state with an effect removed and the others unchanged; the posterior moves them linearly."""
        kept = state.refined.without(place)
        origins = (*state.origins[:place], *state.origins[place + 1 :])
        return replace(state, refined=replace(kept, residual=self.linear.residual(kept.effects)), origins=origins)

    def gains(self, state: SelectionState, posterior: CoefficientPosterior) -> Array:
        """Return the log odds (n,) of each form over an equal share, as a fault or at the healthy size of the
        effect, whichever are larger.
        """
        gains = posterior.gains(self.columns.forms, state.level)
        curves, pieces = self.prices.waves_of_curves
        is_usual = gains.size < FAULT * max(state.level, 1.0)  # of healthy arms or of arms of this level
        gains.fault[curves & (pieces | is_usual)] = gains.healthy[curves] = -np.inf
        fault = gains.fault - self.prices.thresholds + self.prices.fault_price - self.prices.log_choices
        healthy = gains.healthy - self.prices.thresholds - HEALTHY_PRICE - self.prices.log_choices
        return np.asarray(np.maximum(fault, healthy), dtype=float)

    def _forward_step(
        self, state: SelectionState, posterior: CoefficientPosterior, *, try_free_forms: bool
    ) -> tuple[SelectionState | None, SelectionState | None]:
        """Return the state with the effect of largest gain, if an effect covers the penalty, and the state with a
        free form instead, if those are tried and any explains much more.
        """
        gain = self.gains(state, posterior)
        gain[[k for k in state.refused if k >= 0]] = -np.inf
        most_gain, changed, best = 0.0, None, self._worth_trying(state, posterior, gain)
        if best:
            # The linear prediction may gain less, or more, than the shape that is fitted on the simulator.
            with_each = {k: self.with_form(state, posterior, k) for k in best}
            if twice := frozenset(k for k, added in with_each.items() if is_duplicate(added.effects)):
                state = replace(state, refused=state.refused | twice)
                return self._forward_step(state, posterior, try_free_forms=try_free_forms)
            # The level remaining after each name may decide: with the right name the arm is quieter.
            renewed = self.renewed if len(with_each) > 1 else (lambda added: added)
            rise, changed = self.likeliest([renewed(added) for added in with_each.values()])
            rise -= self.evidence(state)
            if gain[best[0]] < _MUCH and rise <= 0:
                for k in best:
                    state = self.refusing(state, self.columns.forms[k].effect)
                return self._forward_step(state, posterior, try_free_forms=try_free_forms)
            most_gain = max(float(gain[best[0]]), rise)
        taken = state.replaced_forms | {form.words for form in state.free_forms}
        forms = [form for form in self._free if form.words not in taken] if try_free_forms else []
        free_form = best_free_form(forms, posterior) if forms else None
        # A fit may be worse than the linear prediction if it moves the set-up by a large amount; the next turn corrects
        # that.
        if free_form is None or free_form.gain < max(_MUCH, _MARGIN * most_gain):
            return changed, None
        return changed, self.refitted(replace(state, free_forms=(*state.free_forms, free_form)))

    def _worth_trying(self, state: SelectionState, posterior: CoefficientPosterior, gain: Array) -> list[int]:
        """Return the best form of each of the few named effects with the largest gains (n,), best first.

        If none gains much, also return the form of a clearly visible effect whose gain may be low only because of the
        stretched shape.
        """
        forms, best_of = self.columns.forms, dict[str, int]()
        for k in np.argsort(-gain).tolist() if len(state.effects) < _DEPTH else ():
            if not gain[k] > max(_CLOSE * gain.max(), 0.0) or len(best_of) == _TRIED:
                break
            best_of.setdefault(forms[k].name, k)
        if gain.max(initial=-np.inf) < _MUCH and len(state.effects) < _DEPTH:
            shown = posterior.gains(forms, state.level)
            plain = np.flatnonzero((gain > _BENT) & (shown.size * shown.sigma > _PLAIN_TO_SEE)).tolist()
            bent = [k for k in plain if forms[k].effect.STRETCHED and not is_wave(forms[k].effect)]
            if bent:
                best = max(bent, key=lambda k: float(gain[k]))
                best_of.setdefault(forms[best].name, best)
        return list(best_of.values())

    def with_form(self, state: SelectionState, posterior: CoefficientPosterior, k: int) -> SelectionState:
        """Return the state with form k added as an effect and fitted; the other effects move along their earlier
        tangents."""
        effects = starting_effects(self.linear, self.columns, posterior, self.columns.forms[k])
        if len(effects) > 1:
            begun = [self._with_effect(state, effect, k, begins=True) for effect in effects]
            effects = [self.likeliest(begun)[1].refined.effects[-1]]
        return self._with_effect(state, effects[0], k)

    def likeliest(self, states: Sequence[SelectionState]) -> tuple[float, SelectionState]:
        """Return the largest log evidence of several states, and the first state that has it."""
        return max(((self.evidence(state), state) for state in states), key=lambda both: both[0])

    def _with_effect(self, state: SelectionState, effect: Effect, k: int, *, begins: bool = False) -> SelectionState:
        """Return the state with an additional effect, from form k, fitted, in few rounds if `begins` is set."""
        effects, rounds = (*state.effects, effect), _FEW_ROUNDS if begins else FIT_ROUNDS
        bare = replace(state, refined=replace(state.refined, effects=effects), origins=(*state.origins, k))
        background = self.backgrounds.of(bare)
        refined = refine(self.linear, background, effects, state.refined, rounds=rounds, begins=begins)
        return replace(bare, refined=refined)

    def settled(self, *begins: SelectionState, least: float = -np.inf) -> SelectionState:
        """Return the likeliest state reached from several states by fitting all effects and the noise until the
        evidence hardly rises, or could hardly reach the log evidence `least`.
        """
        return settled(begins, lambda state: self.refitted(state, _FEW_ROUNDS), self.renewed, self.evidence, least)

    def refitted(self, state: SelectionState, rounds: int = FIT_ROUNDS) -> SelectionState:
        """Return the state with all effects fitted together in at most this number of rounds."""
        free = np.concatenate([np.empty((len(self.linear.y), 0)), *(form.columns for form in state.free_forms)], axis=1)
        refined = refine(self.linear, self.backgrounds.of(state), state.effects, free=free, rounds=rounds)
        return replace(state, refined=refined)
