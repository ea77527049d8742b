"""Backlash compensation in a program.

A link lags behind its joint by half the backlash, so the command must lead by the same amount. For a single target the
approach direction is unknown. In a program the side of each link is known at each target, as in the reversal
compensation of machine tools (ISO 230-1). If a joint reverses between two targets, the link crosses the backlash
gradually on the way; this part of the error remains.
"""

from __future__ import annotations

from analysis.correction.support import CERTAIN_U, supports, supports_of_usual_size
from rigs.effects import Effect
from rigs.rig import Rig
from rigs.schema.effect import is_play


def known_plays(rig: Rig) -> tuple[Effect, ...]:
    """Return the backlash effects of a rig file and the calibrated model that are known well enough for a program.

    Certain backlash is corrected whether or not it is larger than usual.
    """
    unsure = {id(support.effect) for support in supports(rig) if support.value < CERTAIN_U * support.u}
    plays = [
        effect for effect in rig.effects if effect.STAGE == "joint" and is_play(effect) and id(effect) not in unsure
    ]
    plays += [
        support.effect
        for support in supports_of_usual_size(rig)
        if support.effect.STAGE == "joint" and is_play(support.effect) and support.value >= CERTAIN_U * support.u
    ]
    return tuple(plays)
