"""A look at runs: set-ups fitted, noise measured, names found; once more where these move what was looked at.

A large effect moves the ball that a fit without it had found, and bends what was taken for straight.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.diagnose.background import Posterior
from analysis.diagnose.blocks import blocks_of
from analysis.diagnose.candidates import candidates_for
from analysis.diagnose.columns import Columns
from analysis.diagnose.linear import Linear
from analysis.diagnose.naming import Naming, Rivalry, State
from analysis.diagnose.observed import Seen
from analysis.diagnose.settle import grown, settled
from rigs.effects import Effect

_LOOKS = 4
_FAR_MM = 0.3
"""A ball that moves further than this when names are added makes the first look a rough one."""


@dataclass(frozen=True)
class Look:
    """Runs about set-ups and names found before; what is taken to be there; each name beside its rivals."""

    linear: Linear
    naming: Naming
    state: State
    posterior: Posterior
    rivalries: tuple[Rivalry, ...]


def looked(runs: Sequence[Seen], progress: Callable[[str], None]) -> Look:
    """Names found in runs, about set-ups fitted with them."""
    known: tuple[Effect, ...] = ()
    setups = settled(_first_of_each(runs))[0]
    for turn in range(_LOOKS):
        linear = Linear(blocks_of(runs, setups, known), setups, known)
        progress("what each effect would show" + " (once more)" * (turn > 0))
        naming = Naming(linear, Columns(linear, candidates_for(linear)))
        progress("searching for names")
        state, posterior = naming.explained(known)
        known = state.refined.effects
        before, setups = setups, settled(grown(_first_of_each(runs), known), setups)[0]
        moved = [float(np.abs(setups[name].ball - one.ball).max()) for name, one in before.items()]
        if max(moved) < _FAR_MM:
            break
    progress("holding names against their rivals")
    state, posterior, rivalries = naming.defended(state, posterior)
    return Look(linear, naming, state, posterior, rivalries)


def _first_of_each(runs: Sequence[Seen]) -> list[Seen]:
    """The first run of each kind: near enough to begin at."""
    return list({run.name: run for run in reversed(runs)}.values())
