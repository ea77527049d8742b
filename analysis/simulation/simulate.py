"""Simulated measurements: a program driven by a robot with effects, read by gauges with noise, as tables.

The noise is what a good cell shows: white in each reading, a slow wander of tool and link, and from run to run a
little scatter of every joint and of the ball.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, islice

import numpy as np

from analysis.geometry.programs import (
    circle_laps,
    circle_of,
    hold_six,
    radial_program,
    repeatability_of,
    repeatability_program,
)
from analysis.kinematics.arm import Array
from analysis.model.predict import SetUp, model_of, nominal_setup, path_of, predict
from analysis.simulation.iso9283 import simulated_cube, simulated_path
from analysis.simulation.touches import simulated_touches
from analysis.traces.tables import CircleTable, RadialTable, RepeatabilityTable, Table
from rigs.effects import Effect, turned
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction, TestName

GAUGE_RATE_HZ = 50.0
"""Readings a second on a circle: what a 4800 baud line gives."""
_DWELL_S = 4.0
"""The time from one target to the next."""


@dataclass(frozen=True)
class Noise:
    """Standard deviations. White noise is the gauges' own, from the rig file."""

    wander_mm: float = 0.001
    wander_s: float = 0.5
    scatter_deg: float = 0.0002
    scatter_mm: float = 0.001


def simulate(
    rig: Rig,
    test: TestName,
    direction: Direction | None,
    seed: int | None,
    effects: Sequence[Effect] | None = None,
    noise: Noise | None = None,
) -> Table:
    """One run of a test, as it would be measured; `seed` None for no noise at all.

    effects: instead of those of the rig file. Poses and paths are those of ISO 9283. Raises FileError where the robot
    cannot do the test.
    """
    if test == "touch":
        return simulated_touches(rig, seed, effects)
    if test in ("pose", "path"):
        return simulated_path(rig, seed, effects) if test == "path" else simulated_cube(rig, seed, effects)
    hold_six(rig)
    if not rig.gauges.recorded:
        what = f"has no gauges, and a {test} test is measured with them"
        raise FileError(f"rig {rig.name}", what, "add gauges and feedback to the rig file")
    program = _program(rig, test, direction)
    model = model_of(rig, effects)
    setup = _planted(rig, program)
    if seed is None:
        return with_values(program, predict(model, program, path_of(model, program), setup))
    noise = noise or Noise()
    rng = np.random.default_rng(seed)
    # Joints and ball a little off, differently in each run.
    off = rng.normal(0.0, noise.scatter_deg, 6)
    scatter = tuple(turned(axis, float(deg)) for axis, deg in enumerate(off, start=1))
    ball = setup.ball + rng.normal(0.0, noise.scatter_mm, 3)
    model, setup = replace(model, effects=(*model.effects, *scatter)), replace(setup, ball=ball)
    values = predict(model, program, path_of(model, program), setup)
    white = np.array([gauge.accuracy_mm for _, gauge in rig.gauges])[: values.shape[1]]
    values = values + rng.normal(0.0, 1.0, values.shape) * white
    # Correlated noise (m,) mm common to all gauges, of an Ornstein-Uhlenbeck process.
    kept = np.exp(-np.diff(program.t_s, prepend=program.t_s[0] - 1e9) / noise.wander_s)
    kicks = rng.normal(0.0, noise.wander_mm, len(program.t_s)) * np.sqrt(1 - kept**2)
    steps = zip(kept.tolist(), kicks.tolist(), strict=True)
    levels = accumulate(steps, lambda level, step: step[0] * level + step[1], initial=0.0)
    return with_values(
        program, values + np.fromiter(islice(levels, 1, None), dtype=float, count=len(program.t_s))[:, None]
    )


def readings_along(rig: Rig, test: TestName, t_s: Array, q: Array) -> Array:
    """Noise-free readings (n, k) mm at every moment t_s (n,) of a motion q (n, 6), for the emulated cell."""
    model = model_of(rig)
    if test in ("yaw", "roll"):
        circle = CircleTable("yaw" if test == "yaw" else "roll", "acw", t_s, q, np.empty((0, 2)))
        return predict(model, circle, path_of(model, circle), _planted(rig, circle))
    nothing, none = np.zeros(len(q)), np.zeros(len(q), dtype=np.int64)
    targets = RadialTable(none, nothing, nothing, none, t_s, q, nothing)
    return predict(model, targets, path_of(model, targets), nominal_setup(rig, targets))


def _planted(rig: Rig, table: Table) -> SetUp:
    """The set-up that simulations and emulated cells have: on a circle the ball is where the rig file plants it."""
    setup = nominal_setup(rig, table)
    if isinstance(table, CircleTable):
        setup = replace(setup, ball=setup.ball + np.array(circle_of(rig).eccentricity_mm))
    return setup


def with_values(table: Table, values: Array) -> Table:
    """A table of gauges with other readings (m, k) mm."""
    if isinstance(table, CircleTable):
        return replace(table, g_mm=values)
    if isinstance(table, RadialTable | RepeatabilityTable):
        return replace(table, g_mm=values[:, 0])
    raise TypeError("a pose table has no gauges")


def _program(rig: Rig, test: TestName, direction: Direction | None) -> CircleTable | RadialTable | RepeatabilityTable:
    """The test's table, its readings still missing."""
    if test in ("yaw", "roll"):
        if direction is None:
            raise FileError(f"{test} test", "needs a direction", "give --direction cw, acw or both")
        laps = circle_laps(rig, direction)
        t_s = np.arange(0.0, laps.end_s, 1.0 / GAUGE_RATE_HZ)
        return CircleTable("yaw" if test == "yaw" else "roll", direction, t_s, laps.at(t_s), np.empty((0, 2)))
    if test == "radial":
        at = radial_program(rig)
        return RadialTable(at.target, at.polar, at.azimuth, at.orientation, _visits(len(at.q)), at.q, np.empty(0))
    return _repeatability_table(rig)


def _repeatability_table(rig: Rig) -> RepeatabilityTable:
    """One reading at each target, then rounds of one approach from outside and one from inside."""
    at, rounds = repeatability_program(rig), repeatability_of(rig).rounds
    approach = np.array(["none", *["out", "in"] * rounds])
    number = np.array([1, *np.repeat(np.arange(1, rounds + 1), 2)])
    k = len(approach)
    return RepeatabilityTable(
        np.repeat(at.target, k),
        np.tile(approach, len(at.q)),
        np.tile(number, len(at.q)),
        _visits(k * len(at.q)),
        np.repeat(at.q, k, axis=0),
        np.empty(0),
    )


def _visits(count: int) -> Array:
    """Times (count,) s of readings at targets."""
    return np.linspace(0.0, _DWELL_S * (count - 1), count)
