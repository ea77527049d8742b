"""Plays in a program: a link lags behind its joint by half its play, so the joint is commanded further by as much.

A single target says nothing of where a joint comes from; a program does, so the side on which each link lies at each of
its targets is known (as reversal compensation of a machine tool, ISO 230-1). While a joint turns back between two
targets its link crosses the play on the way and not at once: that part stays.
"""

from __future__ import annotations

from analysis.correction.support import CERTAIN_U, supports, supports_beside
from rigs.effects import Effect
from rigs.rig import Rig
from rigs.schema.effect import is_play


def known_plays(rig: Rig) -> tuple[Effect, ...]:
    """Return the plays of a rig file, and of the calibrated model beside it, that are known well enough to be corrected
    in a program: a certain play is corrected whether or not it is larger than usual."""
    unsure = {id(support.effect) for support in supports(rig) if support.value < CERTAIN_U * support.u}
    plays = [
        effect for effect in rig.effects if effect.STAGE == "joint" and is_play(effect) and id(effect) not in unsure
    ]
    plays += [
        support.effect
        for support in supports_beside(rig)
        if support.effect.STAGE == "joint" and is_play(support.effect) and support.value >= CERTAIN_U * support.u
    ]
    return tuple(plays)
