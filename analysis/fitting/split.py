"""Leaving readings out of a fit, to judge it by: single ones at random, or whole neighbourhoods of joint space.

Neighbours share what a model cannot express, so single readings flatter it; a neighbourhood is a place it has not seen.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from analysis.fitting.observation import Observation
from rigs.errors import FileError

_GROUPS = 20


def split(one: Observation, share: float, groups: bool, seed: int) -> tuple[Observation, Observation]:
    """An observation in two: what is used, and a `share` of its readings that is left out."""
    rng = np.random.default_rng(seed)
    left_out = _neighbourhoods(one, share, rng) if groups else rng.permutation(len(one.rows)) < share * len(one.rows)
    return _part(one, ~left_out), _part(one, left_out)


def _part(one: Observation, keep: NDArray[np.bool_]) -> Observation:
    return replace(one, rows=one.rows[keep], values=one.values[keep])


def _neighbourhoods(one: Observation, share: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    from scipy.cluster.vq import kmeans2  # noqa: PLC0415 - slow to import, needed here only

    q = one.table.q[one.rows]
    if len(q) < 2 * _GROUPS:
        raise FileError(
            "--groups", f"{len(q)} readings make no neighbourhoods", "leave out single ones: without --groups"
        )
    _, group = kmeans2(q, min(_GROUPS, len(q) // 5), minit="++", rng=rng)
    left_out = np.zeros(len(q), dtype=bool)
    for number in rng.permutation(group.max() + 1):
        if left_out.sum() >= share * len(q):
            break
        left_out |= group == number
    return left_out
