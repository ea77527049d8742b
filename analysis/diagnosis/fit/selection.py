"""Selection of the effects that explain the readings: one is added, removed or refitted at a time, until none pays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from analysis.diagnosis.fit.background import CoefficientPosterior, Coefficients, ResizedCoefficients
from analysis.diagnosis.fit.candidates import HEALTHY, HEALTHY_APART, Form
from analysis.diagnosis.fit.joint_curves import JointCurves, is_of_curve
from analysis.diagnosis.fit.leave_out import UNDECIDED, LeaveOut
from analysis.diagnosis.fit.refine import FIT_ROUNDS, Refined, no_effects, refine
from analysis.diagnosis.fit.responses import Response
from analysis.diagnosis.fit.selection_state import (
    FAULT,
    LEAST_SHARE,
    SelectionState,
    beginnings,
    is_alike,
    is_duplicate,
    is_one,
    spurious_wave_series,
)
from analysis.diagnosis.fit.starting_effects import starting_effects
from analysis.diagnosis.fit.state_evidence import HEALTHY_PRICE, MOST_LEVEL, StateEvidence
from analysis.robot.kinematics.arm import Array
from rigs.effects import Effect
from rigs.schema.effect import is_wave, name_of, size_of

# ----------------------------------------------------------------------------------------------------------------------
# Selection of the effects that explain the readings: faults and the visible effects of a healthy arm compete by
# evidence.
#
# The residual of a band of orders, or of targets, has a separate strength beyond the noise, estimated in each round;
# every effect must explain more than that. Each round adds the form with the largest gain as an effect, and fits size
# and shape on the simulator before the next round, because the residual of a wrong shape would support wrong names.
# Backlash and gear errors of usual size are fitted like faults while a band is louder than twice its noise, or an
# unknown cause would explain a part, and stay in the background otherwise. Effects whose evidence no longer covers
# their penalty are removed.

_SEARCH_ROUNDS = 40
"""Largest number of rounds; each adds or removes an effect, and the limit therefore equals that of the effects."""
_SURE_EVIDENCE = 5.0
"""Log evidence of the cavity above which an effect is not tested for removal. Chosen: odds of 150 to 1."""
_CURVE_ROUNDS, _ENOUGH_OF_CURVES = 3, 2.0
"""Largest number of fits of curves alternating with the weights of outliers, and the log evidence that a fit must gain
for the next. Chosen: an outlier among 30 poses took three.
"""
_DEPTH = 40
"""Largest number of fitted effects: real arms that were never calibrated have 9 to 14 faults, and as many visible
healthy effects."""
_MUCH = 50.0
"""Log evidence from which an unknown cause competes with names. Chosen: foreign effects leave 50 to 500, effects of the
library mostly less than 8.
"""
_MARGIN = 1.2
"""Factor by which an unknown cause must explain more than the best name, whose first fit is not optimal. Chosen."""
_UNEXPLAINED, _ENOUGH_FROM_NOISE = 4.0, 5.0
"""Strength of a band, relative to the noise, from which it is louder than the noise and effects are tried in its place,
and the log evidence that they must gain. Chosen: twice the noise, and odds of 150 to 1.
"""
_TRIED, _CLOSE = 3, 0.5
"""Largest number of names fitted before a name is added, and the share of the largest gain that the others must
have. Chosen: each fit costs a fraction of a round.
"""
_IMITATED = 0.05
"""Share of the gain of an effect that the residual of its imperfect form may give to others. Chosen: orders of waves
and widths of backlashes are scanned at steps that leave less.
"""
_USUAL = FAULT / 2
"""Size, in healthy sizes, below which an effect is not compared with others before it is added. Chosen: a fit hardly
ever doubles a size.
"""
_BENT, _PLAIN_TO_SEE = -5.0, 10.0
"""Log evidence a form must have for its name to be fitted although no name gains much, and its significance in sigmas.

The shape tried may differ too much from the true shape for a gain: a spike with 21 sigma lost 2.5 and gained 420 when
fitted.
"""
_FEW_ROUNDS = 3
"""Number of rounds of preliminary fits, of which only the likeliest continues. Chosen: two gained nearly all."""
_SETTLING_ROUNDS, _ENOUGH = 6, 5.0
"""Largest number of fits after an update of the noise, and log evidence that a round must gain for the next. Chosen:
most states need three; odds of 150 to 1.
"""
_MOST_ROUNDS = 60
"""Largest number of rounds of all selections of a search. Chosen: cells with up to three faults took 10 to 30, and a
cell with an unknown cause did not converge. Then the residual widens the uncertainties by the strength of the band.
"""
_USUAL_ROUNDS, _MOST_VAIN = 10, 4
"""Number of rounds from which vain rounds count, and largest number of successive ones. Chosen: sound cells and poses
of a UR10 end after 1 to 9 rounds, of which up to five are vain.
"""
_UNEXPLAINED_SHARE, _REDUCED = 0.02, 0.02
"""Energy beyond the noise, as a share of the noise, from which a part is unexplained, and the share of it that a round
must remove. Chosen: both change a standard uncertainty by 1 %.
"""


@dataclass
class Effort:
    """Number of rounds of a search, limited because an error that no effect reduces would never end it.

    `vain`: number of the latest rounds that gained little and hardly reduced the unexplained energy.
    """

    rounds: int = 0
    vain: int = 0

    def note(self, gain: float, before: float, after: float) -> None:
        """Note a round: log evidence gained, and energies beyond the noise before and after it, as shares of the
        noise.
        """
        self.rounds += 1
        is_vain = before > _UNEXPLAINED_SHARE and gain < _MUCH and after > (1 - _REDUCED) * before
        self.vain = self.vain + 1 if is_vain else 0

    @property
    def is_spent(self) -> bool:
        is_vain = self.rounds >= _USUAL_ROUNDS and self.vain >= _MOST_VAIN
        return is_vain or self.rounds >= _MOST_ROUNDS


def is_usual(size: Array) -> bool:
    """Whether coefficients (q,), in healthy sizes, are far smaller than a fault."""
    return float(np.linalg.norm(size)) < _USUAL


def are_usual(effects: Sequence[Effect]) -> bool:
    """Whether all effects are far smaller than a fault."""
    return max(abs(size_of(effect)) for effect in effects) < _USUAL


@dataclass(frozen=True)
class _Apart:
    """Coefficients of a background in which the forms `usual` have the prior of a single effect each."""

    coefficients: ResizedCoefficients
    usual: list[int]


@dataclass(frozen=True)
class Selection(StateEvidence):
    """Selection of effects for the residual (N,) of a linearisation."""

    effort: Effort = field(default_factory=Effort, compare=False)

    def initial_state(self, effects: Sequence[Effect] = (), previous: SelectionState | None = None) -> SelectionState:
        """Fit the given effects in an arm at healthy level, with noise and joint curves estimated from those of
        `previous` on.
        """
        strength, robust = np.ones(len(self.columns.count)), np.ones(len(self.linear.y))
        axes = max(self.linear.axes, self.columns.curves.count)
        curves = JointCurves((1.0,) * axes) if self.shows_curves else None
        if curves is not None and previous is not None and previous.curves is not None:
            curves = previous.curves
            if self._of_tracker and len(previous.strength) == len(strength) and len(previous.robust) == len(robust):
                strength, robust = previous.strength, previous.robust
        none, first = replace(no_effects(self.linear), effects=tuple(effects)), curves if self._of_tracker else None
        level = HEALTHY if self.columns.constants_apart else HEALTHY_APART
        bare = SelectionState(none, (-1,) * len(effects), level, strength, robust, curves=first)
        state = replace(bare, refined=self._fitted(bare, effects))
        if first is not None:
            # Alternate between the likeliest curves and noise, and the weights of outliers. With weights computed
            # before the curves, readings looked like outliers wherever a curve was large, and 30 poses of a UR10 left a
            # tenth more.
            for _ in range(_CURVE_ROUNDS):
                whole = self.evidence(state)
                state = self.renewed(self._with_likeliest_curves(state, self.strength_limits))
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
        return all(block.facts.of_tracker for block in self.linear.blocks)

    def state_with(self, effects: Sequence[Effect], previous: SelectionState | None = None) -> SelectionState:
        """Fit the given effects from any initial size and shape.

        Readings are not proportional to the size of some effects, such as a backlash: started from a small width, its
        fit may end at 0. Such effects are added one by one, at the size that explains most of what the previous effects
        leave.
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
        """Fit the joint curves together with the noise strengths within `limits` (2, b)."""
        assert state.curves is not None  # noqa: S101 - poses alone have them
        of_curves, terms = self.columns.curves.columns, state.refined.fitted_terms

        def likelihood(curves: JointCurves, strength: Array) -> tuple[float, Array, Array]:
            background = self.backgrounds.of(replace(state, curves=curves, strength=strength))
            posterior, prior = background.posterior(terms), background.variance[of_curves]
            by_strength = self.by_strength(posterior)  # first, because its covariance, if computed, has the variances
            shown = (posterior.mean - background.mean)[of_curves] ** 2 + posterior.variance[of_curves]
            ratio = np.divide(shown, prior, out=np.ones_like(prior), where=prior > 0)
            return background.evidence(terms), 0.5 * (ratio - 1), by_strength

        curves, strength = self.columns.curves.fitted(state.curves, state.strength, limits, likelihood)
        return replace(state, curves=curves, strength=strength)

    def fitted_again(self, state: SelectionState, refitted: Sequence[Effect] = ()) -> SelectionState:
        """Refit each fault from the best form of the effect, if that explains more, except `refitted` ones.

        A shape found with other set-ups may be a local optimum, such as a decay time of a spike.
        """
        place = 0
        for effect in state.effects:
            again = None
            if state.is_large(place) and not any(is_one(earlier, effect) for earlier in refitted):
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
        """Find the state with all effects that cover their penalty and no others.

        If an unknown cause explained more than the best name, the search accepting it is tried too. If `stops` is set,
        the search ends at the first new fault that invalidates the columns, unless an unknown cause explained more
        before.
        """
        named, with_unknown = self._stepwise(state, accept_unknown=False, stops=stops)
        if with_unknown is None:
            return named
        return self.likeliest([named, self._stepwise(with_unknown, accept_unknown=True)[0]])[1]

    def _stepwise(
        self, state: SelectionState, *, accept_unknown: bool, stops: bool = False
    ) -> tuple[SelectionState, SelectionState | None]:
        """Search step by step; also return the first state in which an unknown cause explained more than the best name.

        accept_unknown: use such a cause. The search also ends at a series of waves.
        """
        with_unknown = None
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
                posterior = self.posterior(state)
                # Effects that pay nothing are removed first, and only then is an effect added. If none gains, doubtful
                # effects are removed.
                changed = self.backward_step(state, posterior, below=0.0)
                if changed is None:
                    may_try_unknown = accept_unknown or with_unknown is None
                    changed, unnamed = self.forward_step(state, posterior, try_unknown=may_try_unknown)
                    with_unknown = with_unknown or unnamed
                    if accept_unknown and unnamed:
                        changed = unnamed
                    elif changed is not None and changed.is_large(-1):
                        newest = changed.effects[-1]
                        is_new = not any(is_alike(effect, newest) for effect in self.linear.reference)
                        if stops and with_unknown is None and is_new and not self.is_valid_for(changed):
                            self._note_round(state, changed)
                            return changed, None
                        changed = self.settled(*beginnings(changed))
                    elif changed is not None:
                        changed = self.with_usual_effects(changed, posterior)
                changed = changed or self.backward_step(state, posterior, below=_SURE_EVIDENCE)
                changed = changed or self.without_unknown_cause(state) or self.step_from_noise(state)
                if changed is None:
                    break
                before, state = state, self.renewed(changed)
                self._note_round(before, state)
        return self.renewed(self.refitted(state, only_large=True)), with_unknown

    def against_unknown(self, state: SelectionState) -> SelectionState:
        """Compare the names with unknown causes: add those that the readings still show, and replace names that they
        explain as well.

        A name that imitates an unknown cause leaves a residual, to which the next name is fitted. All waves of joints
        are therefore also tried together: they approximate any function of angles. Of single names, those that are
        reported as faults compete.
        """
        if not self.causes_of_circles.responses:
            return state
        while (more := self._with_cause(state)) is not None:
            state = more
        waves = [k for k, effect in enumerate(state.effects) if is_of_curve(effect)]
        left_out = LeaveOut(self, state, self.causes_of_circles)
        if len(waves) > 1 and (instead := self._cause_instead(left_out, waves)):
            left_out = replace(left_out, state=instead)
        place = 0
        while place < len(left_out.state.effects):
            if not self.is_reported(left_out.state, place):
                place += 1
            elif instead := self._cause_instead(left_out, [place]):
                left_out = replace(left_out, state=instead)
            else:
                place += 1
        return left_out.state

    def _with_cause(self, state: SelectionState) -> SelectionState | None:
        begins = beginnings(state)
        tried = [self._likeliest_cause_in(begun, self._apart(begun, self.posterior(begun))) for begun in begins]
        found = [self.settled(each) for each in tried if each is not None]
        evidence, likeliest = self.likeliest(found) if found else (-np.inf, None)
        return likeliest if evidence > self.evidence(state) else None

    def _cause_instead(self, left_out: LeaveOut, places: Sequence[int]) -> SelectionState | None:
        """The state without the names at these places, with or without an unknown cause instead, if that explains as
        much.
        """
        if not left_out.is_close(places):
            return None
        state = without = left_out.state
        for place in reversed(places):
            without = self.without(without, place)
        tried = [without, *filter(None, [self._likeliest_cause_in(without)])]
        evidence, likeliest = self.likeliest([self.settled(each) for each in tried])
        return likeliest if evidence >= self.evidence(state) else None

    def _likeliest_cause_in(self, state: SelectionState, apart: _Apart | None = None) -> SelectionState | None:
        """The state with the likeliest unknown cause, None if none gains. apart: usual effects that compete with it."""
        posterior = (
            apart.coefficients.background.posterior(state.refined.fitted_terms) if apart else self.posterior(state)
        )
        cause = self.causes_of_circles.likeliest(posterior, {cause.kind for cause in state.unknown})
        return None if cause is None or cause.gain < 0 else replace(state, unknown=(*state.unknown, cause))

    def _note_round(self, before: SelectionState, after: SelectionState) -> None:
        count = self.columns.count
        unexplained = [float(count @ np.maximum(state.strength - 1, 0)) / count.sum() for state in (before, after)]
        self.effort.note(self.evidence(after) - self.evidence(before), *unexplained)

    # Steps from one state to the next.

    def forward_step(
        self, state: SelectionState, posterior: CoefficientPosterior, *, try_unknown: bool
    ) -> tuple[SelectionState | None, SelectionState | None]:
        """Add the effect of largest gain, if one covers the penalty; and the unknown cause, if one explains much
        more.
        """
        gain = self._gains_to_add(state, posterior)
        most_gain, changed, best = 0.0, None, self._worth_trying(state, posterior, gain)
        if best:
            # The linear prediction may gain less, or more, than the shape that is fitted on the simulator.
            with_each = {k: self.with_form(state, posterior, k) for k in best}
            if twice := frozenset(k for k, added in with_each.items() if is_duplicate(added.effects)):
                state = replace(state, refused=state.refused | twice)
                return self.forward_step(state, posterior, try_unknown=try_unknown)
            # The level remaining after each name may decide: with the right name the arm is quieter.
            # The present state is renewed too, because a new estimate of noise or level alone would look like a gain.
            close = self._within(UNDECIDED, [*with_each.values()])
            renewed = self.renewed if len(close) > 1 else (lambda added: added)
            rise, changed = self.likeliest([renewed(added) for added in close])
            before = renewed(state)
            rise -= self.likeliest([before, replace(before, level=changed.level)])[0]
            if gain[best[0]] < _MUCH and rise <= 0:
                for k in best:
                    state = self.refusing(state, self.columns.forms[k].effect)
                return self.forward_step(state, posterior, try_unknown=try_unknown)
            most_gain = max(float(gain[best[0]]), rise)
        taken = state.replaced | {cause.kind for cause in state.unknown}
        cause = self.causes_of_circles.likeliest(posterior, taken) if try_unknown else None
        # A fit may be worse than the linear prediction if it moves the set-up by a large amount; the next turn corrects
        # that.
        if cause is None or cause.gain < max(_MUCH, _MARGIN * most_gain):
            return changed, None
        return changed, self.refitted(replace(state, unknown=(*state.unknown, cause)))

    def _within(self, log_evidence: float, states: Sequence[SelectionState]) -> list[SelectionState]:
        """The likeliest of several states, and all that are less likely by at most `log_evidence`."""
        each = [self.evidence(state) for state in states]
        return [state for value, state in zip(each, states, strict=True) if value >= max(each) - log_evidence]

    def _gains_of_allowed(self, state: SelectionState, posterior: Coefficients) -> Array:
        """Gains (n,) of the forms, minus infinity for refused ones."""
        gain = self.gains(state, posterior)
        gain[[k for k in state.refused if k >= 0]] = -np.inf
        return gain

    def _gains_to_add(self, state: SelectionState, posterior: CoefficientPosterior) -> Array:
        """Gains (n,) of the forms that may be added, minus infinity for all others.

        Every arm shows effects of usual size. While they leave a band louder than its noise, or what an unknown cause
        would explain, the forms of the background do not describe them, and others could imitate them: they are added
        like faults, and so is one that causes a material share of the error. All others stay in the background.
        """
        gain, apart = self._gains_of_allowed(state, posterior), self._apart(state, posterior)
        if apart is None or self._likeliest_cause_in(state, apart) is not None:
            return gain
        gain = self._gains_of_allowed(state, apart.coefficients)
        gain[apart.usual] = -np.inf
        gain[apart.coefficients.gains(self.columns.forms, state.level).size < _USUAL] = -np.inf
        return gain

    def _apart(self, state: SelectionState, posterior: CoefficientPosterior) -> _Apart | None:
        """The background in which usual effects that gain more than any possible fault have the prior of a single
        effect, so that neither a fault nor an unknown cause is found in their place. None for a state in which they are
        added like faults.
        """
        if (state.strength >= _UNEXPLAINED).any():
            return None
        forms, coefficients, usual = self.columns.forms, posterior.as_coefficients(), list[int]()
        while len(usual) < _DEPTH:
            gain = self._gains_of_allowed(state, coefficients)
            gain[usual] = -np.inf
            best = int(np.argmax(gain))
            size = coefficients.size(forms[best])
            if not gain[best] > 0 or not is_usual(size):
                break
            if self._share_of_error(forms[best], size) > LEAST_SHARE:
                return None
            coefficients = coefficients.with_fault(forms[best])
            usual.append(best)
        return _Apart(coefficients, usual)

    def _share_of_error(self, form: Form, size: Array) -> float:
        """Share of the squared error of the nominal arm that a form of `size` (q,), in healthy sizes, causes."""
        shown = self.linear.without_set_up(self.columns.X[:, list(form.columns)] @ size)
        return float(shown @ shown) / self._squared_error

    @cached_property
    def _squared_error(self) -> float:
        error = self.linear.without_set_up(self.linear.residual(()))
        return max(float(error @ error), np.finfo(float).tiny)

    def step_from_noise(self, state: SelectionState) -> SelectionState | None:
        """Explain a residual that counted as noise by an effect, if that is likelier.

        If the complete residual of a band counts as noise, no effect gains any more: a local optimum.
        """
        if (state.strength < _UNEXPLAINED).all():
            return None
        quiet = replace(state, strength=np.minimum(state.strength, 1.0))
        posterior = self.posterior(quiet)
        gain = self._gains_of_allowed(quiet, posterior)
        added = [self.with_form(quiet, posterior, k) for k in self._worth_trying(quiet, posterior, gain)]
        settled = [self.settled(each) for each in added if not is_duplicate(each.effects)]
        if not settled:
            return None
        evidence, likeliest = self.likeliest(settled)
        explains = evidence > self.evidence(state) + _ENOUGH_FROM_NOISE and (likeliest.strength < _UNEXPLAINED).all()
        return likeliest if explains else None

    def _worth_trying(self, state: SelectionState, posterior: CoefficientPosterior, gain: Array) -> list[int]:
        """The best form of each of the few effects with the largest gains (n,), best first, and only the first if it is
        far smaller than a fault.

        If none gains much, also a clearly visible effect whose gain may be low only because of its shape.
        """
        forms, best_of = self.columns.forms, dict[str, int]()
        for k in np.argsort(-gain).tolist() if len(state.effects) < _DEPTH else ():
            if not gain[k] > max(_CLOSE * gain.max(), 0.0) or len(best_of) == _TRIED:
                break
            best_of.setdefault(forms[k].name, k)
            if is_usual(posterior.size(forms[k])):
                break
        if gain.max(initial=-np.inf) < _MUCH and len(state.effects) < _DEPTH:
            shown = posterior.gains(forms, state.level)
            plain = np.flatnonzero((gain > _BENT) & (shown.size * shown.sigma > _PLAIN_TO_SEE)).tolist()
            bent = [k for k in plain if forms[k].effect.STRETCHED and not is_wave(forms[k].effect)]
            if bent:
                best = max(bent, key=lambda k: float(gain[k]))
                best_of.setdefault(forms[best].name, best)
        return list(best_of.values())

    def backward_step(
        self, state: SelectionState, posterior: CoefficientPosterior, *, below: float
    ) -> SelectionState | None:
        """Remove the effect of least evidence if it does not cover its penalty, among those that gain less than
        `below`.
        """
        doubtful = [k for k in range(len(state.effects)) if self.gain_of(state, posterior, k) < below]
        if not doubtful:
            return None
        whole = self.evidence(state)
        left_out = LeaveOut(self, state)
        gains = {k: whole - left_out.without([k]).evidence for k in doubtful}
        place = min(gains, key=lambda k: gains[k])
        without = self.without(state, place)
        if whole >= self.evidence(without):
            return None
        return self.refusing(without, state.effects[place], state.origins[place])

    def without_unknown_cause(self, state: SelectionState) -> SelectionState | None:
        """Remove an unknown cause if the best name in its place, or no effect, explains as much."""
        whole = self.evidence(state) if state.unknown else 0.0
        for k, cause in enumerate(state.unknown):
            without_it = self.refitted(replace(state, unknown=(*state.unknown[:k], *state.unknown[k + 1 :])))
            posterior = self.posterior(without_it)
            best = int(np.argmax(self.gains(without_it, posterior)))
            for simpler in (without_it, self.refitted(self.with_form(without_it, posterior, best))):
                if self.evidence(simpler) > whole:
                    return replace(simpler, replaced=state.replaced | {cause.kind})
        return None

    def refusing(self, state: SelectionState, effect: Effect, origin: int = -1) -> SelectionState:
        """Refuse all forms of an effect, and the form of origin."""
        of_effect = {k for k, form in enumerate(self.columns.forms) if is_alike(form.effect, effect)} | {origin}
        return replace(state, refused=state.refused | of_effect)

    def with_form(self, state: SelectionState, posterior: CoefficientPosterior, k: int) -> SelectionState:
        """Add form k as an effect and fit it; the other effects move along their earlier tangents."""
        effects = starting_effects(self.linear, self.columns, posterior, self.columns.forms[k])
        if len(effects) > 1 and not are_usual(effects):
            begun = [self._with_effect(state, effect, k, begins=True) for effect in effects]
            effects = [self.likeliest(begun)[1].refined.effects[-1]]
        return self._with_effect(state, effects[0], k)

    def _with_effect(self, state: SelectionState, effect: Effect, k: int, *, begins: bool = False) -> SelectionState:
        return self._with_effects(state, {k: effect}, begins=begins)

    def _with_effects(
        self, state: SelectionState, added: Mapping[int, Effect], *, begins: bool = False
    ) -> SelectionState:
        """Add effects, by the forms they come from, and fit them together."""
        effects, rounds = (*state.effects, *added.values()), _FEW_ROUNDS if begins else FIT_ROUNDS
        bare = replace(state, refined=replace(state.refined, effects=effects), origins=(*state.origins, *added))
        return replace(
            bare,
            refined=self._fitted(bare, effects, state.refined, rounds=rounds, with_alike=False if begins else None),
        )

    def with_usual_effects(self, state: SelectionState, before: CoefficientPosterior) -> SelectionState:
        """Add all further effects of usual size that explain as much as the one just added, and fit them together.

        Each round of a search costs several fits. They are chosen by low-rank changes of the posterior `before` the
        addition, one of each name, and only those that the imperfect form of another cannot imitate. One whose fit
        would begin at the size of a fault waits for a comparison of its shapes.
        """
        forms, added = self.columns.forms, dict[int, Effect]()
        posterior = self.posterior(state)
        coefficients = posterior.as_coefficients()
        first = self.gains(state, before)[state.origins[-1]]
        names = {name_of(state.effects[-1])}
        while len(state.effects) + len(added) < _DEPTH:
            gain = self._gains_of_allowed(state, coefficients)
            gain[[k for k, form in enumerate(forms) if form.name in names]] = -np.inf
            best = int(np.argmax(gain))
            if not gain[best] > max(_IMITATED * first, HEALTHY_PRICE):
                break
            if not is_usual(coefficients.size(forms[best])):
                break
            begins = starting_effects(self.linear, self.columns, posterior, forms[best])
            if not are_usual(begins):
                break
            names.add(forms[best].name)
            if not any(is_one(effect, begins[0]) for effect in state.effects):
                added[best] = begins[0]
            coefficients = coefficients.with_fault(forms[best])
        return self._with_effects(state, added) if added else state

    def without(self, state: SelectionState, place: int) -> SelectionState:
        """Remove an effect and refit the others along their tangents."""
        kept = state.refined.without(place)
        kept = replace(kept, residual=self.linear.residual(kept.effects))
        bare = replace(state, refined=kept, origins=(*state.origins[:place], *state.origins[place + 1 :]))
        return replace(bare, refined=self._fitted(bare, bare.effects, bare.refined))

    def with_names_only(self, state: SelectionState) -> SelectionState:
        """Remove the unknown causes and estimate the noise again."""
        none = Response(np.empty((len(self.linear.y), 0)))
        return self.renewed(replace(state, unknown=(), refined=replace(state.refined, free=none)))

    def refitted(self, state: SelectionState, rounds: int = FIT_ROUNDS, *, only_large: bool = False) -> SelectionState:
        """Fit all effects together. only_large: effects of usual size move along their tangents, and come first."""
        free = np.concatenate([np.empty((len(self.linear.y), 0)), *(cause.columns for cause in state.unknown)], axis=1)
        places = range(len(state.effects))
        usual = [k for k in places if only_large and not state.is_large(k)]
        order = usual + [k for k in places if k not in usual]
        effects, fitted = [state.effects[k] for k in order], state.refined.only(usual) if usual else None
        refined = self._fitted(state, effects, fitted, free=free, rounds=rounds, with_alike=True)
        return replace(state, refined=refined, origins=tuple(state.origins[k] for k in order))

    def _fitted(
        self,
        state: SelectionState,
        effects: Sequence[Effect],
        fitted: Refined | None = None,
        *,
        free: Array | None = None,
        rounds: int = FIT_ROUNDS,
        with_alike: bool | None = None,
    ) -> Refined:
        self.work.fits += 1
        background = self.backgrounds.of(state)
        return refine(self.linear, background, effects, fitted, free, rounds, with_alike=with_alike)

    def settled(self, *begins: SelectionState, least: float = -np.inf) -> SelectionState:
        """Fit effects and noise in turn from each of several states, until the evidence hardly rises, and return the
        likeliest state reached.

        Fits end early if the remaining rounds, each with the gain of the last, could not reach `least`.
        """
        states = []
        for begin in begins:
            now, gain = self.refitted(begin, _FEW_ROUNDS, only_large=True), np.inf
            for rounds in reversed(range(_SETTLING_ROUNDS)):
                previous, last_gain = now, gain
                now = self.refitted(self.renewed(now), _FEW_ROUNDS, only_large=True)
                gain = self.evidence(now) - self.evidence(previous)
                if gain < _ENOUGH or (gain < last_gain < np.inf and self.evidence(now) + rounds * gain < least):
                    break
            states += [previous, now]
        return self.likeliest(states)[1]
