"""A look at runs: set-ups fitted, noise measured, names found; once more where these move what was looked at.

A large effect moves the ball that a fit without it had found, and bends what was taken for straight.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from analysis.diagnosis.background import Posterior
from analysis.diagnosis.blocks import blocks_of
from analysis.diagnosis.candidates import candidates_for
from analysis.diagnosis.columns import Columns
from analysis.diagnosis.linear import Linear
from analysis.diagnosis.naming import Naming
from analysis.diagnosis.observed import Seen
from analysis.diagnosis.rivalry import Rivalry, defended
from analysis.diagnosis.settle import settled
from analysis.diagnosis.state import State
from analysis.kinematics.arm import Array
from rigs.effects import Effect

_LOOKS = 2
_BENT = 3.0
"""Standard deviations by which set-ups that move with the names may leave the straight line, before one looks again."""


@dataclass(frozen=True)
class Look:
    """Runs about set-ups and names found before; what is taken to be there; each name beside its rivals."""

    linear: Linear
    naming: Naming
    state: State
    posterior: Posterior
    rivalries: tuple[Rivalry, ...]

    @cached_property
    def changes(self) -> list[Array]:
        """What each name adds to the readings beside the others (N,), in standard deviations."""
        effects, left = self.state.refined.effects, self.state.refined.left
        return [self.linear.left([*effects[:k], *effects[k + 1 :]]) - left for k in range(len(effects))]

    @cached_property
    def first(self) -> Array:
        """What the model leaves without the names (N,), in standard deviations, set-ups fitted."""
        return self.linear.set_up(self.linear.left(()))

    @property
    def left(self) -> Array:
        """What it leaves with them, set-ups fitted (N,)."""
        return self.linear.set_up(self.state.refined.left)


def looked(runs: Sequence[Seen], progress: Callable[[str], None]) -> Look:
    """Names found in runs, about set-ups fitted with them."""
    known: tuple[Effect, ...] = ()
    setups = settled(_first_of_each(runs))[0]
    for turn in range(_LOOKS):
        linear = Linear(blocks_of(runs, setups, known), setups, known)
        progress("what each effect would show" + " (once more)" * (turn > 0))
        naming = Naming(linear, Columns(linear, candidates_for(linear)))
        progress("searching for names")
        state = naming.explained(naming.begun(known))
        known = state.refined.effects
        moved = naming.posterior(state).mean[naming.columns.set_ups]
        setups = linear.placed(moved)
        bent = linear.left(known, setups) - (state.refined.left - linear.U @ moved)
        if float(np.sqrt(np.mean(bent**2))) < _BENT:
            break
    progress("holding names against their rivals")
    state, rivalries = defended(naming, state)
    return Look(linear, naming, state, naming.posterior(state), rivalries)


def _first_of_each(runs: Sequence[Seen]) -> list[Seen]:
    """The first run of each kind: near enough to begin at."""
    return list({run.name: run for run in reversed(runs)}.values())
