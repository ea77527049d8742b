"""Poses left out by neighbourhoods of joint space (k-means of the joint angles).

Neighbours share what a model cannot express, so single poses would flatter it; a neighbourhood is a place that it has
not seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from analysis.diagnose.observed import Seen
from analysis.kinematics.arm import Array
from analysis.reading.tables import Integers, PoseTable

GROUPS = 20
_FEWEST = 3
"""Poses that a neighbourhood must have on the mean, or none is left out."""


def folds_of(q: Array, folds: int) -> Integers:
    """The fold of each pose (n,): neighbourhoods dealt whole, the largest first to the smallest fold."""
    from scipy.cluster.vq import kmeans2  # noqa: PLC0415 - slow to import, needed here only

    places, place = np.unique(np.round(q, 3), axis=0, return_inverse=True)
    _, group = kmeans2(places, min(GROUPS, max(1, len(places) // _FEWEST)), minit="++", rng=np.random.default_rng(0))
    group = group[place.ravel()]
    fold, filled = np.zeros(len(q), dtype=np.int64), np.zeros(folds)
    for number in np.argsort(-np.bincount(group, minlength=GROUPS)):
        k = int(np.argmin(filled))
        fold[group == number] = k
        filled[k] += np.count_nonzero(group == number)
    return fold


def part(run: Seen, keep: NDArray[np.bool_]) -> Seen:
    """Some of a run's readings; the path, so where each pose was approached from, stays whole."""
    return replace(run, one=replace(run.one, rows=run.one.rows[keep], values=run.one.values[keep]))


def parted(runs: Sequence[Seen], folds: int = 5, fold: int = 0) -> tuple[list[Seen], list[Seen]]:
    """Runs of poses without one fold of their neighbourhoods, and that fold; other runs, and short ones, whole."""
    used, left_out = [], []
    for run in runs:
        if not isinstance(run.one.table, PoseTable) or len(run.one.rows) < _FEWEST * GROUPS:
            used.append(run)
            continue
        out = folds_of(run.one.table.q[run.one.rows], folds) == fold
        used.append(part(run, ~out))
        left_out.append(part(run, out))
    return used, left_out
