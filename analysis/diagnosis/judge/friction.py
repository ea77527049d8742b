"""Friction in the ball joint of the link as an alternative to the backlash of an axis."""

from __future__ import annotations

import numpy as np

from analysis.diagnosis.fit.search import SearchResult
from rigs.schema.effect import is_play

_ONE_WAY = 0.99
"""Least ratio of the net to the total motion of an axis that turns one way. Chosen: noise of the joint angles."""
_ALONE = 0.9
"""Share of the energy of an effect in such circles from which other readings hardly show the effect. Chosen."""


def may_be_friction(result: SearchResult, k: int) -> bool:
    """Return whether friction in the ball joint may have the same effect on the readings as the named effect `k`.

    Backlash of an axis that turns one way in each circle, and hardly affects other readings, is a constant difference
    between cw and acw, as friction is. Simulated friction of 20 to 50 µm was reported as certain backlash of axis 6.
    """
    effect, energy = result.effects[k], result.contributions[k] ** 2
    axis = int(getattr(effect, "axis", 0)) - 1
    if not is_play(effect) or axis < 0:
        return False
    of_circles = 0.0
    for block, rows in zip(result.linear.blocks, result.linear.rows, strict=True):
        move = np.diff(block.path.q[:, axis])
        turns_one_way = abs(float(move.sum())) > _ONE_WAY * float(np.abs(move).sum())
        of_circles += float(energy[rows].sum()) * (block.sampling is not None and turns_one_way)
    return of_circles > _ALONE * float(energy.sum())
