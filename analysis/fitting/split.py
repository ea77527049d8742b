"""Leaving readings out of a fit, to judge it by: single ones at random, or whole neighbourhoods of joint space.

Neighbours share what a model cannot express, so single readings flatter it; a neighbourhood is a place it has not seen.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from analysis.fitting.observation import Observation
from analysis.kinematics.arm import Array, Integers
from rigs.errors import FileError

GROUPS = 20
"""Neighbourhoods of joint space."""
_FEWEST = 5
"""Places that a neighbourhood has on the mean, at the least."""


def split(one: Observation, share: float, groups: bool, seed: int) -> tuple[Observation, Observation]:
    """An observation in two: what is used, and a `share` of its readings that is left out."""
    rng = np.random.default_rng(seed)
    left_out = _left_out(one, share, rng) if groups else rng.permutation(len(one.rows)) < share * len(one.rows)
    return part(one, ~left_out), part(one, left_out)


def part(one: Observation, keep: NDArray[np.bool_]) -> Observation:
    """Some of the readings; the path, so where each pose was approached from, stays whole."""
    return replace(one, rows=one.rows[keep], values=one.values[keep])


def neighbourhoods(q: Array, rng: np.random.Generator) -> Integers:
    """The neighbourhood of each reading (n,), by its joints q (n, 6): k-means, visits of one place together."""
    from scipy.cluster.vq import kmeans2  # noqa: PLC0415 - slow to import, needed here only

    places, place = np.unique(np.round(q, 3), axis=0, return_inverse=True)
    _, group = kmeans2(places, min(GROUPS, max(1, len(places) // _FEWEST)), minit="++", rng=rng)
    return np.asarray(group[place.ravel()], dtype=np.int64)


def _left_out(one: Observation, share: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    q = one.table.q[one.rows]
    if len(q) < 2 * GROUPS:
        raise FileError(
            "--groups", f"{len(q)} readings make no neighbourhoods", "leave out single ones: without --groups"
        )
    group = neighbourhoods(q, rng)
    left_out = np.zeros(len(q), dtype=bool)
    for number in rng.permutation(group.max() + 1):
        if left_out.sum() >= share * len(q):
            break
        left_out |= group == number
    return left_out
