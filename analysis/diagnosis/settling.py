"""Settling: the effects and the noise of a state fitted in turn, after a large effect was found.

Strengths estimated before a large effect was found leave its shape open, and a wrong shape keeps them large; the
residual then supports wrong names. So the fits start twice, from these strengths and, where they differ, from those of
the noise alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from analysis.diagnosis.selection_state import SelectionState

_ROUNDS = 6
"""Largest number of fits after an update of the noise. Chosen: most states need three."""
_ENOUGH = 5.0
"""Log evidence that a round must gain for the next one. Chosen: odds of 150 to 1."""
_Change = Callable[[SelectionState], SelectionState]


def settled(
    state: SelectionState,
    fitted: _Change,
    with_noise: _Change,
    evidence: Callable[[SelectionState], float],
    least: float = -np.inf,
) -> SelectionState:
    """Return the likeliest of the states reached from the present strengths (b,) and from those of the noise alone.

    `fitted` fits all effects, `with_noise` estimates the noise, and `evidence` is the log evidence of a state. Fits end
    early where gains fall, and the rounds left, each with the gain of the last one, would not reach the log evidence
    `least`.
    """
    found = []
    quiet = replace(state, strength=np.ones_like(state.strength))
    for begin in [state, quiet] if (state.strength != 1).any() else [state]:
        now, gain = fitted(begin), np.inf
        for left in reversed(range(_ROUNDS)):
            best, now, before = now, fitted(with_noise(now)), gain
            gain = evidence(now) - evidence(best)
            if gain < _ENOUGH or (gain < before < np.inf and evidence(now) + left * gain < least):
                break
        found += [best, now]
    return max(found, key=evidence)
