"""Simulated gauge readings of a robot with effects driving a program, with the noise of a good cell.

White noise of each reading, a slow wander of tool and link, and a small scatter of every joint and the ball between
runs.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import accumulate, islice

import numpy as np

from analysis.procedures.shared.test_kind import Noise, Simulation, path_of, predict
from analysis.robot.kinematics.arm import Array
from analysis.robot.model.predict import SetUp, model_of
from analysis.runs.tables import GaugeTable
from rigs.effects import turned
from rigs.rig import Rig

_DWELL_S = 4.0
"""Time between targets."""


def read_by_gauges(rig: Rig, program: GaugeTable, setup: SetUp, run: Simulation) -> Array:
    """Readings (n, k) mm along a program, given as a table without readings."""
    model = model_of(rig, run.effects)
    if run.seed is None:
        return predict(model, program, path_of(model, program), setup)
    noise = run.noise or Noise()
    rng = np.random.default_rng(run.seed)
    # Joints and ball displaced slightly, differently in each run.
    off = rng.normal(0.0, noise.scatter_deg, 6)
    scatter = tuple(turned(axis, float(deg)) for axis, deg in enumerate(off, start=1))
    ball = setup.ball + rng.normal(0.0, noise.scatter_mm, 3)
    model, setup = replace(model, effects=(*model.effects, *scatter)), replace(setup, ball=ball)
    values = predict(model, program, path_of(model, program), setup)
    white = np.array([gauge.accuracy_mm for _, gauge in rig.gauges])[: values.shape[1]]
    values = values + rng.normal(0.0, 1.0, values.shape) * white
    # Correlated noise (m,) mm common to all gauges, an Ornstein-Uhlenbeck process.
    kept = np.exp(-np.diff(program.t_s, prepend=program.t_s[0] - 1e9) / noise.wander_s)
    kicks = rng.normal(0.0, noise.wander_mm, len(program.t_s)) * np.sqrt(1 - kept**2)
    steps = zip(kept.tolist(), kicks.tolist(), strict=True)
    levels = accumulate(steps, lambda level, step: step[0] * level + step[1], initial=0.0)
    wandering = np.fromiter(islice(levels, 1, None), dtype=float, count=len(program.t_s))
    return np.asarray(values + wandering[:, None])


def visit_times(count: int) -> Array:
    """Times (count,) s of readings at targets."""
    return np.linspace(0.0, _DWELL_S * (count - 1), count)
