"""Settling: the effects and the noise of a state fitted in turn, until its evidence hardly rises.

Strengths estimated before a large effect was found leave its shape open, and a wrong shape keeps them large; the
residual then supports wrong names. So after such an effect the fits start twice, from these strengths and, where they
differ, from those of the noise alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.selection_state import SelectionState

_ROUNDS = 6
"""Largest number of fits after an update of the noise. Chosen: most states need three."""
_ENOUGH = 5.0
"""Log evidence that a round must gain for the next one. Chosen: odds of 150 to 1."""
_Change = Callable[[SelectionState], SelectionState]


def beginnings(state: SelectionState) -> list[SelectionState]:
    """Return a state, and the same with the strengths (b,) of the noise alone, if they differ."""
    return [state, replace(state, strength=np.ones_like(state.strength))] if (state.strength != 1).any() else [state]


def settled(
    begins: Sequence[SelectionState],
    fitted: _Change,
    with_noise: _Change,
    evidence: Callable[[SelectionState], float],
    least: float = -np.inf,
) -> SelectionState:
    """Return the likeliest of the states reached from some states.

    `fitted` fits all effects, `with_noise` estimates the noise, and `evidence` is the log evidence of a state. Fits end
    early where gains fall, and the rounds left, each with the gain of the last one, would not reach the log evidence
    `least`.
    """
    found = []
    for begin in begins:
        now, gain = fitted(begin), np.inf
        for left in reversed(range(_ROUNDS)):
            best, now, before = now, fitted(with_noise(now)), gain
            gain = evidence(now) - evidence(best)
            if gain < _ENOUGH or (gain < before < np.inf and evidence(now) + left * gain < least):
                break
        found += [best, now]
    return max(found, key=evidence)
