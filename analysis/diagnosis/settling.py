"""Settling: the effects and the noise of a state fitted in turn, after a large effect was found.

Strengths estimated before a large effect was found leave its shape open, and a wrong shape keeps them large; the
residual then supports wrong names. So the fits start twice, from these strengths and from those of the noise alone.
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
    state: SelectionState, fitted: _Change, with_noise: _Change, evidence: Callable[[SelectionState], float]
) -> SelectionState:
    """Return the likeliest of the states reached from the present strengths (b,) and from those of the noise alone.

    `fitted` fits all effects, `with_noise` estimates the noise, and `evidence` is the log evidence of a state.
    """
    found = []
    for begin in (state, replace(state, strength=np.ones_like(state.strength))):
        now = fitted(begin)
        for _ in range(_ROUNDS):
            best, now = now, fitted(with_noise(now))
            if evidence(now) < evidence(best) + _ENOUGH:
                break
        found += [best, now]
    return max(found, key=evidence)
