"""Comparison of faults with their rivals: effects that could replace a fault, fitted in the same role, and their
odds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from analysis.diagnosis.fit.background import CoefficientPosterior, Coefficients
from analysis.diagnosis.fit.leave_out import LeaveOut
from analysis.diagnosis.fit.selection import Selection
from analysis.diagnosis.fit.selection_state import SelectionState, least_fault
from analysis.robot.kinematics.arm import Array
from rigs.schema.effect import label_of, name_of, size_of

_NEAR = 6.0
"""Log evidence behind a named effect within which rivals are fitted: beyond, the odds are below 1 in 400."""
_MISSED = 0.9
"""Share of the evidence of a named effect above which the linear form of a rival is also fitted. Chosen: the linear
approximation underestimates similar effects by nearly equal shares.
"""
_SWAPS = 4
"""Largest number of replacements of a named effect by a rival. Chosen: each costs a search."""
_RIVALS = 4
"""Largest number of rivals that are fitted. Chosen: others have negligible odds."""
_CAUTIOUS = 0.25
"""Level of an arm up to which its odds are averaged with those at this level. Chosen: one prior standard deviation
below a healthy arm.
"""
_NEARLY = 0.5
"""Share of the smallest fault that the linear form of a rival must reach, if only faults count. Chosen: a fit hardly
ever doubles a size.
"""
_DOUBT = 5.0
"""Log evidence behind a named effect within which a rival is also fitted together with it, in case it explains a
different part. Chosen: odds of 150 to 1.
"""


@dataclass(frozen=True)
class RivalOdds:
    """Odds of the causes of the readings: a named effect, each of its rivals, and a healthy arm."""

    odds: float
    rivals: tuple[tuple[SelectionState, float], ...] = ()
    """Rivals, best first: the state with the rival in place of the effect, and the odds of the rival."""
    healthy_odds: float = 0.0

    def averaged(self, other: RivalOdds) -> RivalOdds:
        """The mean of these odds and others of the same effect. A rival of both keeps its state here."""
        likely: dict[str, tuple[SelectionState, float]] = {}
        for tried, share in (*self.rivals, *other.rivals):
            name = name_of(tried.effects[-1])
            first, before = likely.get(name, (tried, 0.0))
            likely[name] = first, before + share / 2
        rivals = tuple(sorted(likely.values(), key=lambda rival: -rival[1]))
        return RivalOdds((self.odds + other.odds) / 2, rivals, (self.healthy_odds + other.healthy_odds) / 2)


def compare_with_rivals(selection: Selection, state: SelectionState) -> tuple[SelectionState, tuple[RivalOdds, ...]]:
    """Compare each fault with its rivals. One with more evidence replaces the fault, and the search continues from
    there.

    An effect that is not reported as a fault (of healthy size, or with changes that are not material) competes only
    with rivals that would be faults.
    """
    swapped: set[int] = set()
    compared: list[RivalOdds] = []
    for swaps_left in reversed(range(_SWAPS + 1)):
        compared, rivals = [], Rivals(selection, state)
        usual = rivals.in_usual_arm
        for place in range(len(state.effects)):
            faults_only = not selection.is_reported(state, place)
            odds = rivals.odds(place, faults_only=faults_only)
            if usual:
                odds = odds.averaged(usual.odds(place, faults_only=faults_only))
            compared.append(odds)
            if swaps_left and place not in swapped and odds.rivals and odds.rivals[0][1] > odds.odds:
                rival_state = selection.select(odds.rivals[0][0])
                swapped.add(place)
                if selection.evidence_of_names(rival_state) > selection.evidence_of_names(state):
                    state, swapped = rival_state, set()
                    break
        else:
            break
    return state, tuple(compared)


def without_needless_names(selection: Selection, state: SelectionState) -> SelectionState:
    """Remove the faults that are no longer justified after all other terms are refitted.

    An effect added before a large fault was fitted closely may have absorbed the residual of that fault. Not tried:
    effects that are not material, and the largest fault, because the others are compared in its presence.
    """
    state = selection.settled(state)
    tried: set[str] = set()
    while (simpler := _without_needless_name(selection, state, tried)) is not None:
        state = simpler
    return state


def _without_needless_name(selection: Selection, state: SelectionState, tried: set[str]) -> SelectionState | None:
    """The state without the first name that it does not need, of those not yet `tried`."""
    left_out, whole = LeaveOut(selection, state), selection.evidence(state)
    of = {k: selection.rms_of(state, k) for k in range(len(state.effects)) if state.may_be_fault(k)}
    for place in sorted(of, key=lambda k: of[k].um.max())[:-1]:
        name = label_of(state.effects[place])
        if name in tried or not of[place].is_material(selection.limits_um):
            continue
        tried.add(name)
        if not left_out.is_close([place]):
            continue
        without = selection.settled(selection.renewed(selection.without(state, place)), least=whole)
        if selection.evidence(without) > whole:
            return selection.refusing(without, state.effects[place], state.origins[place])
    return None


@dataclass(frozen=True, eq=False)
class Rivals:
    """The rivals of each effect of a state."""

    selection: Selection
    state: SelectionState
    fitted: Rivals | None = None
    """Rivals of the same effects in an arm of another level, whose fits are used."""
    _fits: dict[tuple[int | str, ...], SelectionState] = field(default_factory=dict, init=False, repr=False)

    def odds(self, place: int, *, faults_only: bool = False) -> RivalOdds:
        """Odds of a named effect and of its rivals. A rival explains as much if it replaces the effect, and nothing
        more if it is added to it.

        faults_only: only rivals that would be faults.
        """
        selection, state, effect = self.selection, self.state, self.state.effects[place]
        forms, reference = selection.columns.forms, selection.backgrounds.reference
        if not state.is_large(place):
            # A small effect is nearly linear: without a rival in a linear model, nothing is fitted again.
            reduced = self._left_out.without([place])
            linear = self._left_out.coefficients_without([place])
            if not self._likely_forms(place, reduced.bare, reduced.evidence, linear, faults_only=faults_only):
                return self._weighed(place, self._gain(place, reduced.evidence), [])
        without = self._without(place)
        bare, without_name = selection.evidence(without), selection.posterior(without)
        gain = self._gain(place, bare)
        rivals: list[tuple[SelectionState, float]] = []
        seen: set[str] = set()
        for k in self._likely_forms(place, without, bare, without_name, faults_only=faults_only):
            if len(seen) == _RIVALS:
                break
            if forms[k].name in seen:
                continue
            tried = self._instead(place, k, without_name)
            if name_of(tried.effects[-1]) == name_of(effect):
                continue
            seen.add(name_of(tried.effects[-1]))
            if faults_only and abs(size_of(tried.effects[-1])) <= least_fault(tried.effects[-1], reference):
                continue
            instead = selection.evidence(tried) - bare + selection.usual_gain(tried.effects[-1], without.level)
            gain_over = instead - max(float(self._gains[k]), 0.0)
            # A wave may already be fitted with the name, and have a different order only if the name is removed.
            is_new = np.isfinite(self._gains[k])
            if is_new and gain_over > gain - _DOUBT:
                # A rival that explains as much in addition to the name explains a different part of the readings.
                gain_over = instead - max(selection.evidence(self._beside(k)) - self._evidence, 0.0)
            rivals.append((tried, gain_over))
        return self._weighed(place, gain, rivals)

    def _without(self, place: int) -> SelectionState:
        return self._fit(("without", place), lambda arm: arm.selection.without(arm.state, place))

    def _instead(self, place: int, k: int, without_name: CoefficientPosterior) -> SelectionState:
        """The state with form k in place of an effect. One form of each name is fitted."""
        key = ("instead", place, self.selection.columns.forms[k].name)
        return self._fit(key, lambda arm: arm.selection.with_form(arm._without(place), without_name, k))

    def _beside(self, k: int) -> SelectionState:
        """The state with form k in addition."""
        return self._fit(("beside", k), lambda arm: arm.selection.with_form(arm.state, arm._posterior, k))

    def _fit(self, key: tuple[int | str, ...], fit: Callable[[Rivals], SelectionState]) -> SelectionState:
        """A fit, cached. Sizes and shapes hardly depend on the level, so a fit at another level is used if given."""
        if self.fitted is not None:
            return replace(self.fitted._fit(key, fit), level=self.state.level)
        if key not in self._fits:
            self._fits[key] = fit(self)
        return self._fits[key]

    def _likely_forms(
        self, place: int, without: SelectionState, bare: float, coefficients: Coefficients, *, faults_only: bool
    ) -> list[int]:
        """Forms of other names, best first, that explain nearly as much as an effect in a linear model of the state
        `without` it, which has the log evidence `bare`.
        """
        selection, effect = self.selection, self.state.effects[place]
        forms = selection.columns.forms
        gain, size = self._gain(place, bare), coefficients.gains(forms, without.level).size
        linear = selection.gains(without, coefficients)
        linear += selection.usual_gains([form.effect for form in forms], size, without.level)
        # The linear form of a large effect may lose a third of the evidence gained by the fit, and so may the rivals.
        own_linear = max((linear[k] for k, form in enumerate(forms) if form.name == name_of(effect)), default=gain)
        least = max(min(gain - _NEAR, _MISSED * min(gain, own_linear)), 0.0)  # below, no effect explains as much
        score = linear - np.maximum(self._gains, 0.0)
        if faults_only:
            least_faults = np.array([least_fault(form.effect, selection.backgrounds.reference) for form in forms])
            score[size < _NEARLY * least_faults] = -np.inf
        likely = [k for k in np.argsort(-score).tolist() if score[k] > least]
        return [k for k in likely if forms[k].name != name_of(effect)]

    def _gain(self, place: int, bare: float) -> float:
        return self._evidence - bare + self.selection.usual_gain(self.state.effects[place], self.state.level)

    def _weighed(self, place: int, gain: float, rivals: list[tuple[SelectionState, float]]) -> RivalOdds:
        """Odds of an effect that gains `gain` and of rivals with their gains."""
        rivals = sorted(rivals, key=lambda rival: -rival[1])
        # A single large constant determines the width of constants: a healthy constant of that width is equally large.
        healthy = 0.0
        if self.selection.columns.constants_apart:
            healthy = min(0.0, gain - self.selection.gain_of(self.state, self._posterior, place))
        scores = np.array([gain, healthy, *(score for _, score in rivals)])
        weight = np.exp(scores - scores.max())
        odds = (weight / weight.sum()).tolist()
        rivals_found = tuple((tried, odds_of) for (tried, _), odds_of in zip(rivals, odds[2:], strict=True))
        return RivalOdds(odds[0], rivals_found, odds[1])

    @cached_property
    def _evidence(self) -> float:
        return self.selection.evidence(self.state)

    @cached_property
    def _posterior(self) -> CoefficientPosterior:
        return self.selection.posterior(self.state)

    @cached_property
    def _gains(self) -> Array:
        return self.selection.gains(self.state, self._posterior)

    @cached_property
    def _left_out(self) -> LeaveOut:
        return LeaveOut(self.selection, self.state)

    @property
    def in_usual_arm(self) -> Rivals | None:
        """The rivals at a usual level, for an arm that seems quiet; None for others.

        The level is estimated from the dominant part of the readings, mostly waves of gears. Constants that a set-up
        absorbs may be usual in the same arm, and a rival may then explain as much: the odds at both are averaged.
        """
        level = self.state.level
        if level.values.min() >= _CAUTIOUS:
            return None
        return Rivals(self.selection, replace(self.state, level=level.at_least(_CAUTIOUS)), self)
