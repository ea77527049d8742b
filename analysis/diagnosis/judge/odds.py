"""Odds of named effects that another cause may imitate: useless, cancelling, small beside an unexplained error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.judge.acts import Doubt
from analysis.diagnosis.judge.result import Gap, Named
from rigs.schema.effect import is_vibration, is_wave, size_field
from rigs.schema.scene import OUTSIDE_ARM

_SURE_ODDS = 0.999
"""Odds above which a named effect is confirmed even if it does not reduce the gap when added alone.

Example: a gear error at odds of 97 % replaced a twist at 96 %.
"""
_MOST_HELPING = 2
"""Number of waves of gears that may increase the gap by themselves. Chosen: see `without_imitating_waves`."""
_MOST_KINDS = 3
"""Number of kinds of faults confirmed together. Chosen: the cells of the trials have at most three faults."""
NO_WORSE = 0.97
"""Ratio below which a gap counts as smaller: 3 % of an rms is more than a refitted set-up gains by chance."""
_MUCH_MORE, _MORE = 4.0, 2.0
"""Smallest ratio of an error visible in a single independent direction, and in several, to the unexplained error.
Source: in 24 cells with causes outside the library, wrong named effects were confirmed in 15; named effects above
three (four) times the unexplained error in 5 (2). Poses held out of the same table are a weak second direction: a
scale of axis 6 that imitated cable drag was as large there as the unexplained error.
"""


def without_useless(named: Sequence[Named], train: Gap) -> list[Named]:
    """Return the named effects with none confirmed if the calibrated model explains the runs used no better than no
    named effects: the cause is then not an effect, but for example exchanged gauges.

    A named effect that increases the gap when added to the others is not confirmed, whatever the odds: it cancels a
    different effect that may also be absent. The exception are errors of instruments shown in several directions. If
    the named effects by themselves do not reduce the gap, only almost certain named effects are confirmed.
    """
    if train.calibrated_um >= train.before_um:
        return [doubted(name, "no_better") if name.is_confirmed else name for name in named]
    named = [_without_use(name, train) if name.is_confirmed else name for name in named]
    if train.after_um < train.before_um:
        return list(named)
    return [
        _cancelling(name, "unsure") if name.is_confirmed and name.probability < _SURE_ODDS else name for name in named
    ]


def _without_use(name: Named, train: Gap) -> Named:
    """Return a named effect, not confirmed if a single direction shows it and the gap is smaller without it.

    In several directions, an error of an instrument does not cancel errors of the arm by chance: a ball form of 65
    usual sizes cancelled usual twists.
    """
    is_shown = name.directions >= 2 and name.effect.STAGE in OUTSIDE_ARM
    return name if is_shown or name.gap_without_um >= NO_WORSE * train.after_um else _cancelling(name, "no_better")


def _cancelling(name: Named, doubt: Doubt) -> Named:
    """Return a named effect that only cancels others: not confirmed, and at most as likely as another cause.

    Constants of the arm keep their odds, because they cancel each other in every arm.
    """
    return replace(name, doubt=doubt) if name.effect.part == "constants" else doubted(name, doubt)


def without_cancelling(named: Sequence[Named], train: Gap) -> list[Named]:
    """Return the named effects. Errors of instruments and waves that only cancel other errors are no longer confirmed.

    The other explanation, in which both are absent, is at least as likely. A vibration has another phase in each run,
    so its model with a common phase increases the gap in any case. Waves of several gears resembled an axis that
    wanders, and one of them increased the gap from 54 to 63 µm.
    """

    def may_imitate(name: Named) -> bool:
        return (name.effect.STAGE in OUTSIDE_ARM or is_wave(name.effect)) and not is_vibration(name.effect)

    return [
        doubted(name, "cancels") if name.is_confirmed and may_imitate(name) and _only_cancels(name, train) else name
        for name in named
    ]


def without_imitating_waves(named: Sequence[Named], train: Gap) -> list[Named]:
    """Return the named effects. If three or more waves of gears each increase the gap, they are not confirmed.

    Together they approximate an error of a different form. Of 131 sound cells none had more than one such wave; of 15
    cells with an axis that wanders, four had three or four.
    """

    def only_helps_others(name: Named) -> bool:
        is_gear = is_wave(name.effect) and name.effect.STAGE == "joint"
        return is_gear and NO_WORSE * name.alone_um > train.before_um

    imitating = [name for name in named if only_helps_others(name)]
    if len(imitating) <= _MOST_HELPING:
        return list(named)
    return [doubted(name, "series") if only_helps_others(name) else name for name in named]


def without_many(named: Sequence[Named]) -> list[Named]:
    """Return the named effects. If the faults are of more than three kinds, no fault is confirmed.

    So many independent faults are less likely than one unknown cause that all of them imitate. If an axis wandered,
    circles confirmed four faults, and the correction increased the error elsewhere from 157 to 713 µm.
    """
    kinds = {type(name.effect) for name in named if name.is_confirmed}
    return [doubted(name, "many") if name.is_confirmed and len(kinds) > _MOST_KINDS else name for name in named]


def within_use(named: Sequence[Named], train: Gap) -> list[Named]:
    """Return the named effects. If the gap is larger with all of them, the odds of effects that only cancel others are
    at most one half.

    For a coupling that rig does not know, a spike of axis 3 and its strain-wave gear, both of usual size, had odds of
    100 %. They increase the gap from 21 to 25 and 33 µm, and to 35 µm together.
    """
    if train.after_um < train.before_um:
        return list(named)
    return [_with_odds_at_most(0.5, name) if _only_cancels(name, train) else name for name in named]


def _only_cancels(name: Named, train: Gap) -> bool:
    """Return whether an effect shown by one direction increases the initial gap by itself, clearly or if it is below
    the noise. Constants of the arm cancel each other in every arm.
    """
    least = 1.0 if name.contribution_um < train.noise_floor_um else NO_WORSE
    return name.directions < 2 and name.effect.part != "constants" and least * name.alone_um > train.before_um


def within_unexplained(named: Sequence[Named], unexplained_um: float, noise_um: float) -> list[Named]:
    """Return the named effects, with those that an unexplained error may imitate no longer confirmed.

    A named effect shown by a single direction must be much larger than the unexplained error; a named effect shown by
    several directions must be twice as large. The odds of the others are those of readings whose noise includes the
    unexplained error, and at most the share of the effect in the energy of both.
    """
    weight = noise_um**2 / max(noise_um**2 + unexplained_um**2, 1e-12)

    def weakened(name: Named) -> Named:
        most = name.contribution_um**2 / (name.contribution_um**2 + unexplained_um**2)
        doubt = "unexplained" if name.is_confirmed else name.doubt
        return replace(_with_odds_at_most(most, _with_odds_to_the(weight, name)), doubt=doubt)

    return [
        weakened(name)
        if name.contribution_um < (_MUCH_MORE if name.directions < 2 else _MORE) * unexplained_um
        else name
        for name in named
    ]


def within_chance(named: Sequence[Named], tried: int) -> list[Named]:
    """Return the named effects, with lower odds for sizes that noise alone may reach.

    In at least one of `tried` forms, noise reaches z standard uncertainties with a probability of at most
    tried · erfc(z/√2) (Bonferroni). The odds of an effect shown by a single direction are at most one minus this
    probability, but this limit is not below one half. Example: for an axis that wanders by 9 µm, the odds of a form of
    the ball of 0.016 ± 0.0045 mm, one of 403 forms, were 99.9 % and are now 89 %.
    """

    def limited(name: Named) -> Named:
        size = size_field(name.effect)
        u = name.sd.get(size, 0.0)
        if name.directions > 1 or u <= 0:
            return name
        by_chance = tried * math.erfc(abs(getattr(name.effect, size)) / u / math.sqrt(2))
        return _with_odds_at_most(max(0.5, 1 - by_chance), name)

    return [limited(name) for name in named]


def within_commanded(named: Sequence[Named]) -> list[Named]:
    """Return the named effects, with no fault of the arm confirmed.

    Only commanded angles are known, and an angle that the arm did not reach has the same effect as such a fault.
    """
    return [
        replace(name, doubt="commanded") if name.is_confirmed and name.effect.STAGE not in OUTSIDE_ARM else name
        for name in named
    ]


def _with_odds_to_the(power: float, name: Named) -> Named:
    """Return a named effect with the odds of the effect, of each rival and of any other cause raised to a power and
    normalised: the likelihood of readings with a larger variance, by the inverse of the power.
    """
    odds = np.array([name.probability, *(rival.probability for rival in name.rivals)])
    other = max(1.0 - float(odds.sum()), float(np.finfo(float).eps))
    raised = np.append(odds, other) ** power
    first, *rest = (raised[:-1] / raised.sum()).tolist()
    rivals = tuple(replace(rival, probability=share) for rival, share in zip(name.rivals, rest, strict=True))
    return replace(name, probability=first, rivals=rivals)


def doubted(name: Named, doubt: Doubt | None) -> Named:
    """Return a named effect that is not confirmed: a cause outside its rivals is at least as likely."""
    return replace(_with_odds_at_most(0.5, name), doubt=doubt)


def _with_odds_at_most(most: float, name: Named) -> Named:
    """Return a named effect whose odds, together with those of the rivals, are at most `most`."""
    factor = most / max(most, name.probability + sum(rival.probability for rival in name.rivals))
    rivals = tuple(replace(rival, probability=factor * rival.probability) for rival in name.rivals)
    return replace(name, probability=factor * name.probability, rivals=rivals)
