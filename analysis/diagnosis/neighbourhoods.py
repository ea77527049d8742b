"""Poses held out by neighbourhoods of joint space (k-means of the joint angles).

Neighbours share what a model cannot express, so that held-out single poses would overestimate its quality. A
neighbourhood is a place that the model has not seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.observed_run import ObservedRun
from analysis.fitting.split import GROUPS, neighbourhoods, part
from analysis.kinematics.arm import Array, Integers
from analysis.traces.tables import PoseTable

_FEWEST = 3
"""Smallest average number of poses in a neighbourhood; with fewer no neighbourhood is held out. Chosen: k-means needs a
few poses for a centre."""


def folds_of(q: Array, folds: int) -> Integers:
    """Return the fold of each pose (n,) with joint angles q (n, 6) rad. Whole neighbourhoods are assigned, the largest
    first, each to the smallest fold."""
    group = neighbourhoods(q, np.random.default_rng(0))
    fold, filled = np.zeros(len(q), dtype=np.int64), np.zeros(folds)
    for number in np.argsort(-np.bincount(group, minlength=GROUPS)):
        k = int(np.argmin(filled))
        fold[group == number] = k
        filled[k] += np.count_nonzero(group == number)
    return fold


def without_a_fold(
    runs: Sequence[ObservedRun], folds: int = 5, fold: int = 0
) -> tuple[list[ObservedRun], list[ObservedRun]]:
    """Return runs of poses without one fold of their neighbourhoods, and the runs of that fold. Other runs, and runs of
    few poses, stay whole."""
    used, left_out = [], []
    for run in runs:
        if not isinstance(run.one.table, PoseTable) or len(run.one.rows) < _FEWEST * GROUPS:
            used.append(run)
            continue
        out = folds_of(run.one.table.q[run.one.rows], folds) == fold
        used.append(replace(run, one=part(run.one, ~out)))
        left_out.append(replace(run, one=part(run.one, out)))
    return used, left_out
