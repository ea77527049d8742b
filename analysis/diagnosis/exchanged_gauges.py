"""Detection of circles whose two gauges are exchanged relative to their repeats, because of swapped cables or columns.

An exchange does not change the mean of the gauges, and it reverses the sign of their difference. A ball that was moved
changes both.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.diagnosis.observed_run import ObservedRun
from analysis.kinematics.arm import Array

_LEAST_MM = 0.05
"""Smallest difference from the repeats that is examined: joints of real cells repeat to 0.005°, which moves gauges 50
mm apart by 0.01 mm, and the limit is five times that."""
_CLEAR = 4.0
"""Factor by which the difference must fit better with its sign reversed, and by which the mean must fit better
unchanged. Chosen: far from the factor of 1 that noise gives."""


def exchanged_runs(runs: Sequence[ObservedRun]) -> list[int]:
    """Return the indices of runs whose gauges are exchanged. Where two equal halves of the repeats contradict each
    other, the half that contradicts the circles of the other direction is returned. Gauge readings of a run are (m, 2)
    mm."""
    groups: dict[str, list[int]] = {}
    for k, run in enumerate(runs):
        if run.sampling:
            groups.setdefault(run.name, []).append(k)
    found = []
    for name, own in groups.items():
        others = [k for k in range(len(runs)) if runs[k].sampling and runs[k].one.setup == runs[own[0]].one.setup]
        reverse = [k for k in others if runs[k].name != name]
        found += [own[place] for place in _reversed([runs[k] for k in own], [runs[k] for k in reverse])]
    return found


def _reversed(runs: Sequence[ObservedRun], reverse: Sequence[ObservedRun]) -> list[int]:
    """Return the indices of the repeats whose difference has the opposite sign to that of most of them."""
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


def _channels(runs: Sequence[ObservedRun]) -> tuple[Array, Array]:
    """Return the mean and the difference of the gauges of each run along the circle, (n, GRID) mm, with their own means
    removed."""
    grids = np.array([run.sampling.gridded(run.one.values) for run in runs if run.sampling])
    grids -= grids.mean(axis=1, keepdims=True)
    return grids.mean(axis=2), grids[:, :, 1] - grids[:, :, 0]


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
