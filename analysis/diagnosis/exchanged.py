"""Circles whose two gauges are exchanged against those of their repeats: a cable swapped, columns taken for each other.

The mean of the gauges does not see it, and their difference turns its sign. A ball that was moved changes both.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.diagnosis.observed import Seen
from analysis.kinematics.arm import Array

_LEAST_MM = 0.05
"""Of a difference from the repeats that is worth a look: joints of real cells, which come back to 0.005°, turn gauges
50 mm apart by 0.01 mm."""
_CLEAR = 4.0
"""So many times better the difference must fit with its sign turned, and the mean must fit as it is."""


def exchanged(runs: Sequence[Seen]) -> list[int]:
    """Which runs have their gauges exchanged; of two halves that contradict each other, the one that contradicts the
    circles of the other direction."""
    groups: dict[str, list[int]] = {}
    for k, run in enumerate(runs):
        if run.sampling:
            groups.setdefault(run.name, []).append(k)
    found = []
    for name, own in groups.items():
        others = [k for k in range(len(runs)) if runs[k].sampling and runs[k].one.setup == runs[own[0]].one.setup]
        reverse = [k for k in others if runs[k].name != name]
        found += [own[place] for place in _turned([runs[k] for k in own], [runs[k] for k in reverse])]
    return found


def _turned(runs: Sequence[Seen], reverse: Sequence[Seen]) -> list[int]:
    """Which of some repeats read the other way round than most of them."""
    mean, apart = _channels(runs)
    sign = np.where(np.linalg.eigh(apart @ apart.T)[1][:, -1] < 0, -1.0, 1.0)
    if abs(sign.sum()) > 0:
        sign *= np.sign(sign.sum())
    elif reverse:
        sign *= np.sign(float((sign @ apart) @ _channels(reverse)[1].sum(axis=0))) or 1.0
    else:
        return []
    most = sign > 0
    usual, usual_apart = mean[most].mean(axis=0), apart[most].mean(axis=0)
    return [
        int(k)
        for k in np.flatnonzero(~most)
        if _rms(apart[k] - usual_apart)
        > max(_LEAST_MM, _CLEAR * _rms(apart[k] + usual_apart), _CLEAR * _rms(mean[k] - usual))
    ]


def _channels(runs: Sequence[Seen]) -> tuple[Array, Array]:
    """Mean and difference of the gauges of each run along the circle (n, GRID) mm, less their own means."""
    grids = np.array([run.sampling.gridded(run.one.values) for run in runs if run.sampling])
    grids -= grids.mean(axis=1, keepdims=True)
    return grids.mean(axis=2), grids[:, :, 1] - grids[:, :, 0]


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
