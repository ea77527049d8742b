"""Faults held against their rivals: what could stand in a fault's place, fitted there, with the odds between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.naming import Naming
from analysis.diagnosis.state import State
from analysis.diagnosis.worth import LEAST_UM, worth
from rigs.schema.effect import name_of

_NEAR = 6.0
"""Log evidence behind a name within which its rivals are fitted on the simulator: further back they have odds of less
than 1 in 400."""
_MISSED = 0.9
"""Share of a name's evidence at which a rival's linear form, not fitted yet, is tried."""
_SWAPS = 4
_RIVALS = 4
_DOUBT = 5.0
"""Log evidence behind a name within which a rival must show that it is none beside the name too."""


@dataclass(frozen=True)
class Rivalry:
    """A name beside its rivals. odds: of the name; rivals, best first: each in the name's place, with its odds;
    nothing: odds that a healthy arm shows this anyway."""

    odds: float
    rivals: tuple[tuple[State, float], ...] = ()
    nothing: float = 0.0


def defended(naming: Naming, state: State) -> tuple[State, tuple[Rivalry, ...]]:
    """Each fault held against its rivals; one that does better takes its place, and names are looked for again.

    An effect of healthy size, or that moves nothing, has no rivals: it is not reported as a fault.
    """
    swapped: set[int] = set()
    rivalries: list[Rivalry] = []
    for swaps_left in reversed(range(_SWAPS + 1)):
        rivalries = []
        for place in range(len(state.refined.effects)):
            told = state.is_fault(place) and _moves(naming, state, place)
            one = rivalry(naming, state, place) if told else Rivalry(1.0)
            rivalries.append(one)
            if swaps_left and place not in swapped and one.rivals and one.rivals[0][1] > one.odds:
                other = naming.explained(one.rivals[0][0])
                swapped.add(place)
                if naming.evidence(other) > naming.evidence(state):
                    state, swapped = other, set()
                    break
        else:
            break
    return state, tuple(rivalries)


def _moves(naming: Naming, state: State, place: int) -> bool:
    """Whether an effect could be material at all."""
    change = naming.linear.left(state.refined.without(place).effects) - state.refined.left
    return bool((worth(naming.linear, change).um > LEAST_UM).any())


def rivalry(naming: Naming, state: State, place: int) -> Rivalry:
    """A name against what could stand in its place: what explains no less without it, and nothing beside it."""
    forms, effect = naming.columns.forms, state.refined.effects[place]
    rest = naming.without(state, place)
    bare, whole = naming.evidence(rest), naming.evidence(state)
    gain = whole - bare
    here = naming.posterior(state)
    beside = np.maximum(np.maximum(*naming.gains(state, here)), 0.0)
    alone = naming.posterior(rest)
    score = np.maximum(*naming.gains(rest, alone)) - beside
    rivals: list[tuple[State, float]] = []
    seen: set[str] = set()
    for k in np.argsort(-score).tolist():
        if len(rivals) == _RIVALS or not score[k] > min(gain - _NEAR, _MISSED * gain):
            break
        if forms[k].name in seen or forms[k].name == name_of(effect):
            continue
        tried = naming.grown(rest, alone, k)
        if name_of(tried.refined.effects[-1]) == name_of(effect):
            continue
        seen.add(name_of(tried.refined.effects[-1]))
        instead = naming.evidence(tried) - bare
        own = instead - float(beside[k])
        if own > gain - _DOUBT:
            # What explains as much beside the name explains something else.
            both = naming.grown(state, here, k)
            own = instead - max(naming.evidence(both) - whole, 0.0)
        rivals.append((tried, own))
    rivals.sort(key=lambda one: -one[1])
    scores = np.array([gain, 0.0, *(own for _, own in rivals)])
    weight = np.exp(scores - scores.max())
    odds = (weight / weight.sum()).tolist()
    found = tuple((tried, own) for (tried, _), own in zip(rivals, odds[2:], strict=True))
    return Rivalry(odds[0], found, odds[1])
