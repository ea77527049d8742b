"""Tests of the paper on a simulated robot, simulated and evaluated in the usual way.

All tests are noise-free except the repeatability test, because the uni-directional figure consists of noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.procedures import radial, repeatability
from analysis.procedures.circle import Roll, Yaw, fit_sine
from analysis.procedures.shared.lap_curve import nodes_of
from analysis.procedures.shared.test_kind import Noise
from analysis.procedures.simulate import noise_seed, simulate
from analysis.robot.geometry.circle import link_angle
from analysis.robot.geometry.driven_programs import hemisphere_of
from analysis.robot.kinematics.arm import Array
from analysis.runs.laps import laps_of
from analysis.runs.tables import CircleTable, RadialTable, RepeatabilityTable
from rigs.effects import Effect
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction

SCATTER = Noise(wander_mm=0.087, wander_s=0.5)
"""Scatter of readings between approaches to a target: 0.087 mm, fitted to the published 0.261 mm.

This is the simulator's wander. The time constant of 0.5 s is short compared with the 4 s between readings. Both gauges
move equally, so yaw and roll angles are unaffected.
"""
SEEDS = 100
"""Number of repeatability tests to average. The range of three readings varies strongly between tests."""


@dataclass(frozen=True)
class SimulatedLap:
    """A lap in order of phi."""

    phi: Array
    """Circle angle (n,) rad, 0 … 2 pi."""
    angle: Array
    """(n,) rad; also `residual`, after removing the least-squares sine."""
    residual: Array
    figures: dict[str, float]


@dataclass(frozen=True)
class FittedSphere:
    """Least-squares sphere."""

    radius_mm: float
    band_mm: float
    centre_mm: Array
    """(3,), from the base-ball in the hemisphere's frame."""

    @property
    def shift_mm(self) -> float:
        return float(np.linalg.norm(self.centre_mm))


def circle(rig: Rig, test: str, direction: Direction, effects: Sequence[Effect]) -> SimulatedLap:
    """Simulate one lap of yaw or roll. Raises FileError if the robot cannot run it."""
    table = simulate(rig, "yaw" if test == "yaw" else "roll", direction, None, effects)
    assert isinstance(table, CircleTable)  # noqa: S101 - by the test's name
    return curve_of(table, rig)


def joint_lap(rig: Rig) -> tuple[Array, Array]:
    """Simulate a lap of yaw: circle angles (n,) rad in order, 0 … 2 pi, and reported joint angles (n, 6) rad."""
    table = simulate(rig, "yaw", "acw", None, ())
    assert isinstance(table, CircleTable)  # noqa: S101 - by the test's name
    lap = laps_of(table, rig, rig.name).first
    phi = lap.phi % (2 * np.pi)
    order = np.argsort(phi)
    return phi[order], np.unwrap(lap.q[order], axis=0)


def curve_of(table: CircleTable, rig: Rig) -> SimulatedLap:
    """Evaluate the first lap of a circle table."""
    lap = laps_of(table, rig, rig.name).first
    phi = lap.phi % (2 * np.pi)
    order = np.argsort(phi)
    y = link_angle(lap.g_mm[:, 0], lap.g_mm[:, 1], rig.gauges.baseline_mm)[order]
    phi = phi[order]
    plain = (Yaw() if table.test == "yaw" else Roll()).plain_figures
    return SimulatedLap(phi, y, y - fit_sine(nodes_of(phi, y))(phi), plain(phi, y, lap.frame.radius))


def step(curve: SimulatedLap, at_deg: float, span_deg: float) -> float:
    """Change of the residual in degrees from circle angle `at_deg` over `span_deg`, negative for cw."""
    ends = np.radians([at_deg, at_deg + span_deg]) % (2 * np.pi)
    before, after = np.interp(ends, curve.phi, curve.residual, period=2 * np.pi)
    return float(np.degrees(after - before))


def sphere(rig: Rig, effects: Sequence[Effect]) -> FittedSphere:
    """Simulate the radial test and fit a sphere. Raises FileError if a target is out of reach."""
    table = simulate(rig, "radial", None, None, effects)
    assert isinstance(table, RadialTable)  # noqa: S101 - by the test's name
    result = radial.evaluate(table, hemisphere_of(rig).radius_mm, 0.0, rig.name)
    return FittedSphere(result.free.radius, float(np.ptp(result.free.residual)), result.free.centre)


def repeats(rig: Rig, effects: Sequence[Effect], seeds: int = SEEDS) -> dict[str, Array]:
    """Simulate repeatability tests: uni_mm and bi_mm, (seeds,) each."""
    readings = []
    for seed in range(seeds):
        table = simulate(rig, "repeatability", None, noise_seed(seed, None), effects, SCATTER)
        assert isinstance(table, RepeatabilityTable)  # noqa: S101 - by the test's name
        # Readings (targets, 2, rounds) mm for the sides out and in. The simulated table is complete and ordered.
        targets = len(np.unique(table.target))
        sides = [table.g_mm[table.approach == side].reshape(targets, -1) for side in repeatability.SIDES]
        readings.append(np.stack(sides, axis=1))
    figures = repeatability.plain_figures(np.array(readings))
    return {name: figures[name] for name in ("uni_mm", "bi_mm")}


def typical_seed(figures: dict[str, Array]) -> int:
    """Index of the most typical test: the closest to the means of the figures, relative to the spread of each."""
    off = [(values - values.mean()) / (values.std() or 1.0) for values in figures.values()]
    return int(np.argmin(np.sum(np.square(off), axis=0)))
