"""Poses left out by neighbourhoods of joint space (k-means of the joint angles).

Neighbours share what a model cannot express, so single poses would flatter it; a neighbourhood is a place that it has
not seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.observed import Seen
from analysis.fitting.split import GROUPS, neighbourhoods, part
from analysis.kinematics.arm import Array, Integers
from analysis.traces.tables import PoseTable

_FEWEST = 3
"""Poses that a neighbourhood must have on the mean, or none is left out."""


def folds_of(q: Array, folds: int) -> Integers:
    """The fold of each pose (n,): neighbourhoods dealt whole, the largest first to the smallest fold."""
    group = neighbourhoods(q, np.random.default_rng(0))
    fold, filled = np.zeros(len(q), dtype=np.int64), np.zeros(folds)
    for number in np.argsort(-np.bincount(group, minlength=GROUPS)):
        k = int(np.argmin(filled))
        fold[group == number] = k
        filled[k] += np.count_nonzero(group == number)
    return fold


def without_a_fold(runs: Sequence[Seen], folds: int = 5, fold: int = 0) -> tuple[list[Seen], list[Seen]]:
    """Runs of poses without one fold of their neighbourhoods, and that fold; other runs, and short ones, whole."""
    used, left_out = [], []
    for run in runs:
        if not isinstance(run.one.table, PoseTable) or len(run.one.rows) < _FEWEST * GROUPS:
            used.append(run)
            continue
        out = folds_of(run.one.table.q[run.one.rows], folds) == fold
        used.append(replace(run, one=part(run.one, ~out)))
        left_out.append(replace(run, one=part(run.one, out)))
    return used, left_out
