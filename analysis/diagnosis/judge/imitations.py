"""Other causes with the same effect on the readings as a named effect: friction in the ball joint, and errors over a
part of a turn."""

from __future__ import annotations

import numpy as np

from analysis.diagnosis.fit.candidates import order_of
from analysis.diagnosis.fit.refine import ended_at_limit
from analysis.diagnosis.fit.search import SearchResult
from analysis.diagnosis.fit.selection_state import DRIVEN_WAVES
from analysis.diagnosis.judge.acts import Doubt
from analysis.diagnosis.judge.unexplained import gauges_apart_um
from rigs.schema.effect import is_play, is_wave
from rigs.schema.scene import OUTSIDE_ARM

_WHOLE_SIGMA = 3.0
"""Standard uncertainties between an order and the nearest whole number above which a wave is not one of a gear."""
_ONE_WAY = 0.99
"""Least ratio of the net to the total motion of an axis that turns one way. Chosen: noise of the joint angles."""
_ALONE = 0.9
"""Share of the energy of an effect in such circles from which other readings hardly show the effect. Chosen."""


def shows_waves(result: SearchResult, k: int) -> bool:
    """Return whether the named effect `k` is no wave of a joint, or a joint was driven over enough waves.

    A wave over fewer than two driven periods does not identify a gear.
    """
    effect = result.effects[k]
    if not is_wave(effect) or effect.STAGE != "joint":
        return True
    axis = int(getattr(effect, "axis", 1))
    turned = max(float(block.turns[axis - 1]) for block in result.linear.blocks)
    return order_of(effect) * turned >= DRIVEN_WAVES


def imitation_of(result: SearchResult, k: int, directions: int) -> Doubt | None:
    """Return the doubt that another cause may have the effect of the named effect `k`, shown by a number of independent
    directions; None without such a cause.

    For a coupling that rig does not know, the rate of the clock had odds of 100 %, with a size at the limit of the fit.
    """
    if is_no_gear(result, k):
        return "no_gear"
    effect = result.effects[k]
    if directions < 2 and effect.STAGE in OUTSIDE_ARM and ended_at_limit(effect):
        return "at_limit"
    return "friction" if directions < 2 and may_be_friction(result, k) else None


def is_no_gear(result: SearchResult, k: int) -> bool:
    """Return whether the named effect `k` is a piece of a wave whose number per turn is certainly not whole.

    The errors of a gear repeat with its turn. A tilting axis of 0.2 mrad was reported as a certain gear error of
    another axis with 5.27 ± 0.08 waves, of which the axis had turned over one.
    """
    if shows_waves(result, k):
        return False
    order, u = order_of(result.effects[k]), result.fit.sd(k).get("order", 0.0)
    return u > 0 and abs(order - round(order)) > _WHOLE_SIGMA * u


def may_be_friction(result: SearchResult, k: int) -> bool:
    """Return whether friction in the ball joint may have the same effect on the readings as the named effect `k`.

    Backlash of an axis that turns one way in each circle, and hardly affects other readings, is a constant difference
    between cw and acw, as friction is. Simulated friction of 20 to 50 µm was reported as certain backlash of axis 6,
    and that of a ball joint that sticks as a lag of axis 6.
    """
    effect, energy = result.effects[k], result.contributions[k] ** 2
    axis = int(getattr(effect, "axis", 0)) - 1
    is_lag = effect.STAGE == "joint" and effect.part == "clocks"  # at constant speed a constant difference too
    if axis < 0 or not (is_play(effect) or (is_lag and gauges_apart_um(result) is not None)):
        return False
    of_circles = 0.0
    for block, rows in zip(result.linear.blocks, result.linear.rows, strict=True):
        move = np.diff(block.drives.q[:, axis])
        turns_one_way = abs(float(move.sum())) > _ONE_WAY * float(np.abs(move).sum())
        of_circles += float(energy[rows].sum()) * (block.sampling is not None and turns_one_way)
    return of_circles > _ALONE * float(energy.sum())
