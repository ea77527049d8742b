"""Identifiability: parameters that a fit does not determine, and those that it determines only in combination with
others.

The basis is the response of the fitted values to the true ones (the resolution matrix of ridge regression, in plausible
sizes). Its diagonal is the share of a parameter that the readings and not the prior determine, and its rows show with
which others a parameter is confounded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.kinematics.arm import Array
from rigs.effects import Effect, size_field
from rigs.schema.effect import label_of

UNIDENTIFIED = 0.05
"""Share of the response below which a parameter is not fitted, because the readings barely change its prior. Of
72 parameters in ten calibrations of two simulated arms, any value from 0.03 to 0.08 leaves out the same eleven."""
_IDENTIFIED = 0.9
"""Share of the response at and above which a parameter is determined by itself: its uncertainty is then that of the
readings alone to within 5 %. Five of those 72 parameters lie between 0.8 and 0.95."""
_CONFOUNDED = 0.1
"""Smallest share of a parameter's response that another must have to be listed with it. Any value from 0.09
to 0.2 lists the same of those 72 parameters; 0.05 lists five more."""
_HALF = 0.5
"""Share above which a combination of parameters counts as identified: the readings then determine more of it than the
prior."""


@dataclass(frozen=True)
class WeakParameter:
    """A parameter that the readings do not determine by themselves. `like` lists those it is confounded with; it is
    empty for one that is determined only roughly. `share` is the share of its response, 0 to 1."""

    what: str
    like: tuple[str, ...]
    share: float

    def __str__(self) -> str:
        if not self.share:
            return f"{self.what} is not determined by these readings and was not fitted"
        if not self.like:
            return f"{self.what} is known only roughly: the readings determine {self.share:.0%} of it"
        return f"{self.what} is determined only together with {' and '.join(self.like)}"


def identified_combinations(answer: Array) -> int:
    """Return how many combinations of parameters the readings determine, from the response (p, p), a share each."""
    return int((np.linalg.eigvals(answer).real > _HALF).sum()) if len(answer) else 0


def identified(answer: Array) -> list[int]:
    """Return the indices of the parameters that the readings determine well enough to fit, from the response (p, p), a
    share each."""
    return [k for k, share in enumerate(np.diag(answer)) if share >= UNIDENTIFIED]


def weak_parameters(answer: Array, names: Sequence[str]) -> list[WeakParameter]:
    """Return the parameters that the readings do not determine by themselves, from the response (p, p), a share
    each."""
    found = []
    for k, row in enumerate(answer):
        if row[k] < UNIDENTIFIED:
            found.append(WeakParameter(names[k], (), 0.0))
        elif row[k] < _IDENTIFIED:
            others = np.where(np.arange(len(row)) == k, 0.0, np.abs(row))
            order = np.argsort(-others)[:3]
            like = tuple(names[j] for j in order if others[j] > max(_CONFOUNDED, 0.2 * others.max()))
            found.append(WeakParameter(names[k], like, float(row[k])))
    return found


def parameter_label(effect: Effect, field: str) -> str:
    """Return the label of an effect, with the field where it is not its size."""
    return label_of(effect) if field == size_field(effect) else f"{label_of(effect)} {field}"
