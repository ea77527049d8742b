"""Reported angles without the steps of their last digit.

A controller rounds what it reports, to 1e-4 degrees, say: at a metre's reach that is as much as the noise of a gauge,
and a model that follows the steps would have gauges that read too much explain them. An arm on a circle moves
smoothly, so along its lap a local parabola over a fifth of a second to both sides stands for it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.fitting.observation import Observation
from analysis.kinematics.arm import Array
from analysis.model.hysteresis import Motion
from analysis.traces.tables import CircleTable

_HALF_S = 0.2


def smooth(one: Observation) -> Observation:
    """A circle with its path smoothed; anything else as it is."""
    if not isinstance(one.table, CircleTable):
        return one
    # Where the robot starts and stops a parabola would swing over, and turn joints back that do not: laps alone.
    laps = one.path.rows[one.rows]
    q = one.path.q.copy()
    q[laps] = _parabolas(one.path.t_s, one.path.q)[laps]
    return replace(one, path=replace(one.path, motion=Motion(one.path.t_s, q)))


def _parabolas(t_s: Array, q: Array) -> Array:
    """Values (n, 6) of local parabolas, weighted as Epanechnikov's kernel has it."""
    step = float(np.median(np.diff(t_s)))
    reach = max(2, int(np.ceil(_HALF_S / step)))
    index = np.arange(len(t_s))[:, None] + np.arange(-reach, reach + 1)
    inside = (index >= 0) & (index < len(t_s))
    index = np.clip(index, 0, len(t_s) - 1)
    x = (t_s[index] - t_s[:, None]) / _HALF_S
    weight = np.where(inside & (np.abs(x) < 1), 1 - x**2, 0.0)
    powers = np.stack([np.ones_like(x), x, x**2], axis=2)
    normal = np.einsum("nw,nwi,nwj->nij", weight, powers, powers) + 1e-12 * np.eye(3)
    # Only the value in the middle is wanted: one row of the inverse, as weights on the samples.
    row = np.linalg.solve(normal, np.broadcast_to(np.eye(3)[:, :1], (len(t_s), 3, 1)))[:, :, 0]
    share = weight * np.einsum("ni,nwi->nw", row, powers)
    value: Array = np.einsum("nw,nwj->nj", share, q[index] - q[:, None]) + q
    return value
