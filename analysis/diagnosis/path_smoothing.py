"""Smoothing of reported angles, which removes the steps of their last digit.

A controller rounds the angles that it reports, to 1e-4 degrees for example. At a reach of one metre that equals the
noise of a gauge, and a model that follows the steps would explain them by gauge errors. An arm on a circle moves
smoothly, so a local parabola over a fifth of a second to either side replaces the angles of the lap.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.fitting.observation import Observation
from analysis.kinematics.arm import Array
from analysis.model.hysteresis import Motion
from analysis.traces.tables import CircleTable

_HALF_S = 0.2
"""Half the width of the local parabola in seconds. Chosen: longer than several samples at 50 Hz, and shorter than the
reversal of a joint."""


def smooth_path(one: Observation) -> Observation:
    """Return a circle with its path (n, 6) rad smoothed, and any other observation unchanged."""
    if not isinstance(one.table, CircleTable):
        return one
    # A parabola overshoots where the robot starts and stops, and would create reversals, so only laps are smoothed.
    laps = one.samples
    q = one.path.q.copy()
    q[laps] = _parabolas(one.path.t_s, one.path.q)[laps]
    return replace(one, path=replace(one.path, motion=Motion(one.path.t_s, q)))


def _parabolas(t_s: Array, q: Array) -> Array:
    """Return the values (n, 6) of local parabolas with weights of Epanechnikov's kernel."""
    step = float(np.median(np.diff(t_s)))
    reach = max(2, int(np.ceil(_HALF_S / step)))
    index = np.arange(len(t_s))[:, None] + np.arange(-reach, reach + 1)
    inside = (index >= 0) & (index < len(t_s))
    index = np.clip(index, 0, len(t_s) - 1)
    x = (t_s[index] - t_s[:, None]) / _HALF_S
    weight = np.where(inside & (np.abs(x) < 1), 1 - x**2, 0.0)
    powers = np.stack([np.ones_like(x), x, x**2], axis=2)
    normal = np.einsum("nw,nwi,nwj->nij", weight, powers, powers) + 1e-12 * np.eye(3)
    # Only the value at the centre is needed, so one row of the inverse gives the weights of the samples.
    row = np.linalg.solve(normal, np.broadcast_to(np.eye(3)[:, :1], (len(t_s), 3, 1)))[:, :, 0]
    share = weight * np.einsum("ni,nwi->nw", row, powers)
    value: Array = np.einsum("nw,nwj->nj", share, q[index] - q[:, None]) + q
    return value
