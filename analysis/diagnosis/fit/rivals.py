"""Comparison of faults with their rivals: effects that could replace a fault, fitted in the same role, and their
odds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnosis.fit.leave_out import RECOVERED, LeaveOut
from analysis.diagnosis.fit.responses import RmsByBlock, rms_by_block
from analysis.diagnosis.fit.selection import Selection
from analysis.diagnosis.fit.selection_state import FAULT, SelectionState, least_fault
from analysis.robot.kinematics.arm import Array
from rigs.schema.effect import label_of, name_of, size_of

_NEAR = 6.0
"""Log evidence behind a named effect within which rivals are fitted: beyond, the odds are below 1 in 400."""
_MISSED = 0.9
"""Share of the evidence of a named effect above which the linear form of a rival is also fitted. Chosen: the linear
approximation underestimates similar effects by nearly equal shares.
"""
_NEEDED = 100.0
"""Log evidence lost without a name, after a linear fit of all others, above which it is not tried further. Chosen:
further fits regained at most 63 % of a larger loss.
"""
_SWAPS = 4
"""Largest number of replacements of a named effect by a rival. Chosen: each costs a search."""
_RIVALS = 4
"""Largest number of fitted rivals. Chosen: others have negligible odds."""
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


def compare_with_rivals(
    selection: Selection, state: SelectionState, limits: Array
) -> tuple[SelectionState, tuple[RivalOdds, ...]]:
    """Compare each fault with its rivals. One with more evidence replaces the fault, and the search continues from
    there.

    An effect that is not reported as a fault (of healthy size, or with changes below the limits (b,) µm) competes only
    with rivals that would be faults.
    """
    state = without_needless_names(selection, state, limits)
    swapped: set[int] = set()
    compared: list[RivalOdds] = []
    for swaps_left in reversed(range(_SWAPS + 1)):
        compared = []
        for place in range(len(state.effects)):
            effect = state.effects[place]
            moves = abs(size_of(effect)) >= FAULT or _rms_of_effect(selection, state, place).is_material(limits)
            is_reported = state.may_be_fault(place) and moves
            odds = cautious_odds(selection, state, place, faults_only=not is_reported)
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


def without_needless_names(selection: Selection, state: SelectionState, limits: Array) -> SelectionState:
    """Remove the faults that are no longer justified after all other terms are refitted.

    An effect added before a large fault was fitted closely may have absorbed the residual of that fault. Not tried:
    changes below the limits (b,) µm, and the largest fault, because the others are compared in its presence.
    """
    state = selection.settled(state)
    tried: set[str] = set()
    while True:
        of = {k: _rms_of_effect(selection, state, k) for k in range(len(state.effects)) if state.may_be_fault(k)}
        names = {k: label_of(state.effects[k]) for k in sorted(of, key=lambda k: of[k].um.max())[:-1]}
        place = next((k for k, name in names.items() if name not in tried and of[k].is_material(limits)), None)
        if place is None:
            return state
        tried.add(names[place])
        whole = selection.evidence(state)
        if LeaveOut(selection, state).without([place]).evidence < whole - RECOVERED:
            continue
        without = selection.renewed(selection.without(state, place))
        if selection.evidence(without) < whole - _NEEDED:
            continue
        without = selection.settled(without, least=whole)
        if selection.evidence(without) > whole:
            state = selection.refusing(without, state.effects[place], state.origins[place])


def _rms_of_effect(selection: Selection, state: SelectionState, place: int) -> RmsByBlock:
    change = selection.linear.residual(state.refined.without(place).effects) - state.refined.residual
    return rms_by_block(selection.linear, change)


def cautious_odds(selection: Selection, state: SelectionState, place: int, *, faults_only: bool = False) -> RivalOdds:
    """`rival_odds`, for a quiet arm averaged with those at a usual level.

    The level is estimated from the dominant part of the readings, mostly waves of gears. Constants that a set-up
    absorbs may be usual in the same arm, and a rival may then explain as much.
    """
    odds = rival_odds(selection, state, place, faults_only=faults_only)
    if state.level.values.min() >= _CAUTIOUS:
        return odds
    usual = rival_odds(selection, replace(state, level=state.level.at_least(_CAUTIOUS)), place, faults_only=faults_only)
    likely: dict[str, tuple[SelectionState, float]] = {}
    for tried, share in (*odds.rivals, *usual.rivals):
        name = name_of(tried.effects[-1])
        first, before = likely.get(name, (tried, 0.0))
        likely[name] = first, before + share / 2
    rivals = tuple(sorted(likely.values(), key=lambda rival: -rival[1]))
    return RivalOdds((odds.odds + usual.odds) / 2, rivals, (odds.healthy_odds + usual.healthy_odds) / 2)


def rival_odds(selection: Selection, state: SelectionState, place: int, *, faults_only: bool = False) -> RivalOdds:
    """Odds of a named effect and of its rivals. A rival explains as much if it replaces the effect, and nothing more if
    it is added to it.

    faults_only: only rivals that would be faults.
    """
    forms, effect, reference = selection.columns.forms, state.effects[place], selection.backgrounds.reference
    without = selection.without(state, place)
    bare, whole = selection.evidence(without), selection.evidence(state)
    gain = whole - bare + selection.usual_gain(effect, state.level)
    now = selection.posterior(state)
    gains = selection.gains(state, now)
    without_name = selection.posterior(without)
    size = without_name.gains(forms, without.level).size
    linear = selection.gains(without, without_name)
    linear += selection.usual_gains([form.effect for form in forms], size, without.level)
    # The linear form of a large effect may lose a third of the evidence gained by the fit, and so may the rivals.
    own_linear = max((linear[k] for k, form in enumerate(forms) if form.name == name_of(effect)), default=gain)
    least = min(gain - _NEAR, _MISSED * min(gain, own_linear))
    score = linear - np.maximum(gains, 0.0)
    if faults_only:
        least_faults = np.array([least_fault(form.effect, reference) for form in forms])
        score[size < _NEARLY * least_faults] = -np.inf
    rivals: list[tuple[SelectionState, float]] = []
    seen: set[str] = set()
    for k in np.argsort(-score).tolist():
        if len(rivals) == _RIVALS or not score[k] > least:
            break
        if forms[k].name in seen or forms[k].name == name_of(effect):
            continue
        tried = selection.with_form(without, without_name, k)
        if name_of(tried.effects[-1]) == name_of(effect):
            continue
        seen.add(name_of(tried.effects[-1]))
        if faults_only and abs(size_of(tried.effects[-1])) <= least_fault(tried.effects[-1], reference):
            continue
        instead = selection.evidence(tried) - bare + selection.usual_gain(tried.effects[-1], without.level)
        gain_over = instead - max(float(gains[k]), 0.0)
        # A wave may already be fitted with the name, and have a different order only if the name is removed.
        is_new = np.isfinite(gains[k])
        if is_new and gain_over > gain - _DOUBT:
            # A rival that explains as much in addition to the name explains a different part of the readings.
            both = selection.with_form(state, now, k)
            gain_over = instead - max(selection.evidence(both) - whole, 0.0)
        rivals.append((tried, gain_over))
    rivals.sort(key=lambda rival: -rival[1])
    # A single large constant determines the width of constants: a healthy constant of that width is equally large.
    healthy = min(0.0, gain - selection.gain_of(state, now, place)) if selection.columns.constants_apart else 0.0
    scores = np.array([gain, healthy, *(score for _, score in rivals)])
    weight = np.exp(scores - scores.max())
    odds = (weight / weight.sum()).tolist()
    rivals_found = tuple((tried, odds_of) for (tried, _), odds_of in zip(rivals, odds[2:], strict=True))
    return RivalOdds(odds[0], rivals_found, odds[1])
