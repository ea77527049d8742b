"""What a set of data can tell apart: free parameters that cannot be seen, and those that look like others.

From the signatures (derivatives per plausible size, set-up terms projected out): columns are taken in the order of what
they still add (QR with column pivoting); one that adds less than a small share of itself looks like those before it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.fitting.estimate import Free, signatures
from analysis.fitting.observation import Observation
from analysis.kinematics.arm import Array
from analysis.model.predict import Model, SetUp
from rigs.effect import label_of
from rigs.effects import Effect, size_field

_SEEN = 0.1
"""Of the noise's standard deviation over all readings together: less is not to be seen at a plausible size."""
_OWN_SHARE = 0.02
"""Of a signature that must be its own; less, and its size would be what is left of large numbers."""


@dataclass(frozen=True)
class Held:
    """A parameter that is not fitted. like: the parameters that do the same to these data; empty: not to be seen."""

    what: str
    like: tuple[str, ...]

    def __str__(self) -> str:
        return (
            f"{self.what} looks like {' and '.join(self.like)} here" if self.like else f"{self.what} is not seen here"
        )


def separate(
    model: Model,
    observations: Sequence[Observation],
    free: Sequence[Free],
    setups: Mapping[str, SetUp],
    noise_mm: float,
) -> tuple[list[Free], list[Held]]:
    """The free parameters that these data can tell apart, and those that are held, each with the reason."""
    from scipy.linalg import qr  # noqa: PLC0415 - slow to import, needed here only

    S = signatures(model, observations, free, setups) / noise_mm
    size = np.linalg.norm(S, axis=0)
    names = [name_of(model.effects[one.effect], one.field) for one in free]
    seen = np.flatnonzero(size > _SEEN)
    held = [Held(names[k], ()) for k in range(len(free)) if k not in seen]
    if not len(seen):
        return [], held
    unit = S[:, seen] / size[seen]
    _, R, order = qr(unit, mode="economic", pivoting=True)
    own = np.abs(np.diag(R))
    rank = int(np.count_nonzero(own > _OWN_SHARE))
    taken = [int(seen[k]) for k in order[:rank]]
    mix = np.linalg.lstsq(R[:rank, :rank], R[:rank, rank:], rcond=None)[0]
    for column, k in enumerate(order[rank:]):
        held.append(Held(names[seen[k]], tuple(_largest(mix[:, column], [names[t] for t in taken]))))
    return [free[k] for k in sorted(taken)], held


def _largest(share: Array, names: list[str]) -> list[str]:
    """Those that make up most of a mix, at most three."""
    order = np.argsort(-np.abs(share))[:3]
    return [names[k] for k in order if abs(share[k]) > 0.2 * np.abs(share).max()]


def name_of(effect: Effect, field: str) -> str:
    """The label of an effect, and, beside its size, which of its shapes is meant."""
    return label_of(effect) if field == size_field(effect) else f"{label_of(effect)} {field}"
