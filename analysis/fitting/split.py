"""Splits of readings into those used by a fit and those held out to judge it: single ones at random, or whole
neighbourhoods of joint space.

Neighbours share what a model cannot express, so single held-out readings overestimate its quality. A neighbourhood is a
place that the model has not seen.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from analysis.fitting.observation import Observation
from analysis.kinematics.arm import Array, Integers
from rigs.errors import FileError

GROUPS = 20
"""Number of neighbourhoods of joint space. Chosen: few enough for several poses in each, and enough for five folds."""
_FEWEST = 5
"""Smallest average number of places in a neighbourhood. Chosen: k-means needs a few for a centre."""


def split(one: Observation, share: float, groups: bool, seed: int) -> tuple[Observation, Observation]:
    """Return an observation, of (m, k) mm, as two: the part used, and a `share` of its readings that is held out."""
    rng = np.random.default_rng(seed)
    left_out = _left_out(one, share, rng) if groups else rng.permutation(len(one.rows)) < share * len(one.rows)
    return part(one, ~left_out), part(one, left_out)


def part(one: Observation, keep: NDArray[np.bool_]) -> Observation:
    """Return an observation with the readings (m, k) of the mask `keep` (m,); the path, and with it the approach to
    each pose, stays complete."""
    return replace(one, rows=one.rows[keep], values=one.values[keep])


def neighbourhoods(q: Array, rng: np.random.Generator) -> Integers:
    """Return the neighbourhood of each reading (n,) by k-means of its joint angles q (n, 6) rad; visits of one place
    stay together."""
    from scipy.cluster.vq import kmeans2  # noqa: PLC0415 - slow to import, needed here only

    places, place = np.unique(np.round(q, 3), axis=0, return_inverse=True)
    _, group = kmeans2(places, min(GROUPS, max(1, len(places) // _FEWEST)), minit="++", rng=rng)
    return np.asarray(group[place.ravel()], dtype=np.int64)


def _left_out(one: Observation, share: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    q = one.table.q[one.rows]
    if len(q) < 2 * GROUPS:
        raise FileError(
            "--groups", f"{len(q)} readings are too few for neighbourhoods", "leave out single ones: without --groups"
        )
    group = neighbourhoods(q, rng)
    left_out = np.zeros(len(q), dtype=bool)
    for number in rng.permutation(group.max() + 1):
        if left_out.sum() >= share * len(q):
            break
        left_out |= group == number
    return left_out
