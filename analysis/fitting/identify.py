"""What a fit can tell apart: parameters that it does not see, and those that it tells only together with others.

From how the fitted values answer to the true ones (the resolution matrix of ridge regression, in plausible sizes): its
diagonal is how far a parameter is told by the readings and not by what was known beforehand, its rows say with what it
is mixed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.kinematics.arm import Array
from rigs.effects import Effect, size_field
from rigs.schema.effect import label_of

UNSEEN = 0.05
"""Told by less than this share, a parameter is not fitted: its value is the one known beforehand."""
_TOLD = 0.9
"""Told by this share and more, a parameter stands by itself."""
_MIXED = 0.1
"""What another has of a parameter's answer, at the least, to be named with it."""
_HALF = 0.5
"""A combination of parameters counts as told where the readings say more of it than was known beforehand."""


@dataclass(frozen=True)
class Together:
    """A parameter that is not told by itself. like: those it is mixed with; none: told only roughly; share: how far
    the readings tell it by itself, 0 to 1."""

    what: str
    like: tuple[str, ...]
    share: float

    def __str__(self) -> str:
        if not self.share:
            return f"{self.what} is not seen here and not fitted"
        if not self.like:
            return f"{self.what} is known only roughly: the readings tell {self.share:.0%} of it"
        return f"{self.what} is told only together with {' and '.join(self.like)}"


def combinations(answer: Array) -> int:
    """How many combinations of parameters the readings tell, from the fit's answer (p, p)."""
    return int((np.linalg.eigvals(answer).real > _HALF).sum()) if len(answer) else 0


def seen(answer: Array) -> list[int]:
    """The parameters that are worth fitting."""
    return [k for k, share in enumerate(np.diag(answer)) if share >= UNSEEN]


def mixed(answer: Array, names: Sequence[str]) -> list[Together]:
    """The parameters that do not stand by themselves."""
    found = []
    for k, row in enumerate(answer):
        if row[k] < UNSEEN:
            found.append(Together(names[k], (), 0.0))
        elif row[k] < _TOLD:
            others = np.where(np.arange(len(row)) == k, 0.0, np.abs(row))
            order = np.argsort(-others)[:3]
            like = tuple(names[j] for j in order if others[j] > max(_MIXED, 0.2 * others.max()))
            found.append(Together(names[k], like, float(row[k])))
    return found


def name_of(effect: Effect, field: str) -> str:
    """The label of an effect, and, beside its size, which of its shapes is meant."""
    return label_of(effect) if field == size_field(effect) else f"{label_of(effect)} {field}"
