"""Names held against their rivals: what could stand in a name's place, fitted there, with the odds between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.diagnose.background import Posterior, fault_sizes
from analysis.diagnose.columns import LARGEST
from analysis.diagnose.naming import Naming, State, is_alike, is_same, started
from rigs.effects import Effect, healthy_size, size_field

_NEAR = 10.0
"""Log evidence behind a name within which its rivals are fitted on the simulator."""
_MISSED = 0.9
"""Share of a name's evidence at which a rival's linear form, not fitted yet, is tried."""
_SWAPS = 4
_RIVALS = 4


@dataclass(frozen=True)
class Rivalry:
    """A name beside its rivals. odds: of the name; rivals, best first: each in the name's place, with its odds."""

    odds: float
    rivals: tuple[tuple[State, float], ...]


def defended(naming: Naming, state: State, posterior: Posterior) -> tuple[State, Posterior, tuple[Rivalry, ...]]:
    """Each name held against its rivals; one that does better takes its place, and names are looked for again."""
    for _ in range(_SWAPS):
        rivalries = []
        for place in range(len(state.refined.effects)):
            one = rivalry(naming, state, posterior, place)
            rivalries.append(one)
            if one.rivals and one.rivals[0][1] > one.odds:
                state, posterior = naming.explained(one.rivals[0][0].refined.effects)
                break
        else:
            return state, posterior, tuple(rivalries)
    every = range(len(state.refined.effects))
    return state, posterior, tuple(rivalry(naming, state, posterior, place) for place in every)


def rivalry(naming: Naming, state: State, posterior: Posterior, place: int) -> Rivalry:
    """A name against what could stand in its place: what explains no less without it, and nothing beside it."""
    forms, effect = naming.columns.forms, state.refined.effects[place]
    beside = np.maximum(naming.gains(state, posterior)[0], 0.0)
    rest = naming.without(state, place)
    bare = evidence(naming, rest)
    gain = evidence(naming, state) - bare
    alone = naming.background(rest).posterior(rest.refined.known)
    score = naming.gains(rest, alone)[0] - beside
    rivals: list[tuple[State, float]] = []
    seen: set[str] = set()
    for k in np.argsort(-score):
        if len(rivals) == _RIVALS or not score[k] > min(gain - _NEAR, _MISSED * gain):
            break
        if forms[k].name in seen or is_same(forms[k], effect):
            continue
        tried = naming.fitted(rest, [*rest.refined.effects, started(forms[k], alone.size(forms[k]))])
        if is_alike(tried.refined.effects[-1], effect):
            continue
        seen.add(forms[k].name)
        rivals.append((tried, evidence(naming, tried) - bare - float(beside[k])))
    rivals.sort(key=lambda one: -one[1])
    scores = np.array([gain, 0.0, *(own for _, own in rivals)])
    weight = np.exp(scores - scores.max())
    odds = (weight / weight.sum()).tolist()
    return Rivalry(odds[0], tuple((tried, own) for (tried, _), own in zip(rivals, odds[2:], strict=True)))


def evidence(naming: Naming, state: State) -> float:
    """Log evidence of what is taken to be there, prices of the names paid, but for a constant."""
    background, known = naming.background(state), state.refined.known
    T, r = known.T, known.r
    weighted = background.solved(T)
    normal = T.T @ weighted + known.precision
    right = weighted.T @ r + known.precision @ known.mean
    cost = float(r @ background.solved(r)) + float(known.mean @ known.precision @ known.mean)
    cost -= float(right @ np.linalg.solve(normal, right))
    occam = np.linalg.slogdet(normal)[1] - np.linalg.slogdet(known.precision)[1] + background.logdet
    prices = [naming.price(effect) + _size_price(effect, state.level) for effect in state.refined.effects]
    return -0.5 * (cost + float(occam)) + sum(prices)


def _size_price(effect: Effect, level: float) -> float:
    """Log odds of a size among those that faults have, over the fit's wide prior."""
    size = float(getattr(effect, size_field(effect))) / healthy_size(effect)
    sizes = fault_sizes(level)
    likely = np.exp(-0.5 * (size / sizes) ** 2) / sizes
    wide = -0.5 * (size / LARGEST) ** 2 - np.log(LARGEST)
    return float(np.log(likely.mean() + 1e-300)) - float(wide)
