"""Selection of the effects that explain the readings.

A state (`selection_state.py`) contains the fitted effects. `Selection.select` changes it round by round. It adds the
form of a candidate whose fit gains most log evidence, drops an effect that no longer pays the penalty, and reestimates
the noise, until neither pays. All unnamed effects remain possible as the background of columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from analysis.diagnosis.fit.candidates import HEALTHY, HEALTHY_APART
from analysis.diagnosis.fit.effort import Effort
from analysis.diagnosis.fit.joint_curves import JointCurves, is_of_curve
from analysis.diagnosis.fit.refine import no_effects, refine
from analysis.diagnosis.fit.selection_state import (
    MOST_LEVEL,
    SelectionState,
    beginnings,
    is_alike,
    is_duplicate,
    is_one,
    spurious_wave_series,
)
from analysis.diagnosis.fit.selection_steps import SelectionSteps
from analysis.procedures.shared.test_kind import facts_of
from analysis.robot.kinematics.arm import Array
from rigs.effects import Effect
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

_SEARCH_ROUNDS = 40
"""Largest number of rounds; each adds or removes an effect, and the limit therefore equals that of the effects."""
_SURE_EVIDENCE = 5.0
"""Log evidence of the cavity above which an effect is not tested for removal. Chosen: odds of 150 to 1."""
_CURVE_ROUNDS, _ENOUGH_OF_CURVES = 3, 2.0
"""Largest number of fits of curves alternating with the weights of outliers, and the log evidence that a fit must
gain for the next. Chosen: an outlier among 30 poses of a UR10 took three."""


@dataclass(frozen=True)
class Selection(SelectionSteps):
    """Selection of effects for the residual (N,) of a linearisation."""

    effort: Effort = field(default_factory=Effort, compare=False)

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
        level = HEALTHY if self.columns.constants_apart else HEALTHY_APART
        bare = SelectionState(none, (-1,) * len(effects), level, strength, robust, curves=first)
        state = replace(bare, refined=refine(self.linear, self.backgrounds.of(bare), effects))
        if first is not None:
            # Alternate between the likeliest curves and noise, and the weights of outliers. With weights computed
            # before the curves, readings looked like outliers wherever a curve was large, and 30 poses of a UR10 left a
            # tenth more.
            for _ in range(_CURVE_ROUNDS):
                whole = self.evidence(state)
                state = self.renewed(self._with_likeliest_curves(state, self.hyperparameters.strength_limits))
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

        The readings are not proportional to the size of some effects, such as a backlash. Such an effect starts at the
        size that explains most of what the previous effects leave. The effects are added in the order of the part they
        explain. When started from a small width, the fit of a backlash of 0.03° ended at 0.
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
        of_curves, terms, noise = self.columns.curves.columns, state.refined.fitted_terms, self.hyperparameters

        def likelihood(curves: JointCurves, strength: Array) -> tuple[float, Array, Array]:
            background = self.backgrounds.of(replace(state, curves=curves, strength=strength))
            posterior, prior = background.posterior(terms), background.variance[of_curves]
            by_strength = noise.by_strength(posterior)  # first, because its covariance, if computed, has the variances
            shown = (posterior.mean - background.mean)[of_curves] ** 2 + posterior.variance[of_curves]
            ratio = np.divide(shown, prior, out=np.ones_like(prior), where=prior > 0)
            return background.evidence(terms), 0.5 * (ratio - 1), by_strength

        curves, strength = self.columns.curves.fitted(state.curves, state.strength, limits, likelihood)
        return replace(state, curves=curves, strength=strength)

    def fitted_again(self, state: SelectionState, refitted: Sequence[Effect] = ()) -> SelectionState:
        """Return the state with each fault refitted from the best form of the effect, if that explains more.

        The `refitted` faults are not tried again. A shape found with other set-ups may be a local optimum. For example,
        the decay time of a spike of 0.18 s remained at 0.05 s, although most of the spike took four times as long.
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

        If an unknown cause explained more than the best named effect, the search accepting it is tried too, and the
        state with more evidence is returned. If `stops` is set, the search ends at the first new fault that invalidates
        the columns, unless an unknown cause explained more before.
        """
        named, with_unknown = self._stepwise(state, accept_unknown=False, stops=stops)
        if with_unknown is None:
            return named
        return self.likeliest([named, self._stepwise(with_unknown, accept_unknown=True)[0]])[1]

    def _stepwise(
        self, state: SelectionState, *, accept_unknown: bool, stops: bool = False
    ) -> tuple[SelectionState, SelectionState | None]:
        """Return the result of a stepwise search, and the first state in which an unknown cause explained more than the
        best name, if any.

        accept_unknown: use such a cause. stops: end at a new fault that invalidates the columns, unless there is such
        a cause. The search also ends at a series of waves.
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
                    elif changed is not None and changed.may_be_fault(-1):
                        newest = changed.effects[-1]
                        is_new = not any(is_alike(effect, newest) for effect in self.linear.reference)
                        if stops and with_unknown is None and is_new and not self.is_valid_for(changed):
                            self._note_round(state, changed)
                            return changed, None
                        changed = self.settled(*beginnings(changed))
                changed = changed or self.backward_step(state, posterior, below=_SURE_EVIDENCE)
                changed = changed or self.without_unknown_cause(state) or self.step_from_noise(state)
                if changed is None:
                    break
                before, state = state, self.renewed(changed)
                self._note_round(before, state)
        return self.renewed(self.refitted(state)), with_unknown

    def against_unknown(self, state: SelectionState) -> SelectionState:
        """Compare the names with unknown causes: add the causes that the readings still show, and put one in place of
        the names that it explains as well.

        A name that imitates an unknown cause leaves a residual, to which the next name is fitted. All waves of joints
        are therefore also tried together: they approximate any function of angles.
        """
        if not self.causes_of_circles.responses:
            return state
        while (more := self._with_cause(state)) is not None:
            state = more
        waves = [k for k, effect in enumerate(state.effects) if is_of_curve(effect)]
        if len(waves) > 1:
            state = self._cause_instead(state, waves) or state
        place = 0
        while place < len(state.effects):
            instead = self._cause_instead(state, [place])
            place, state = (place + 1, state) if instead is None else (place, instead)
        return state

    def _with_cause(self, state: SelectionState) -> SelectionState | None:
        """Return the state with one more unknown cause, if that is likelier."""
        tried = [self._likeliest_cause_in(begun) for begun in beginnings(state)]
        found = [self.settled(each) for each in tried if each is not None]
        evidence, likeliest = self.likeliest(found) if found else (-np.inf, None)
        return likeliest if evidence > self.evidence(state) else None

    def _cause_instead(self, state: SelectionState, places: Sequence[int]) -> SelectionState | None:
        """Return the state without the names at these places, with or without an unknown cause in place of them, if
        that explains the readings as well."""
        without = state
        for place in reversed(places):
            without = self.without(without, place)
        tried = [without, *filter(None, [self._likeliest_cause_in(without)])]
        evidence, likeliest = self.likeliest([self.settled(each) for each in tried])
        return likeliest if evidence >= self.evidence(state) else None

    def _likeliest_cause_in(self, state: SelectionState) -> SelectionState | None:
        cause = self.causes_of_circles.likeliest(self.posterior(state), {cause.kind for cause in state.unknown})
        return None if cause is None or cause.gain < 0 else replace(state, unknown=(*state.unknown, cause))

    def _note_round(self, before: SelectionState, after: SelectionState) -> None:
        """Note the effort of a round of the search, by its gain of log evidence and of unexplained energy."""
        count = self.columns.count
        unexplained = [float(count @ np.maximum(state.strength - 1, 0)) / count.sum() for state in (before, after)]
        self.effort.note(self.evidence(after) - self.evidence(before), *unexplained)
