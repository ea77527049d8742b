"""The paper's tests on a simulated robot, with the usual simulation and evaluation.

All are noise-free except the repeatability test, whose uni-directional figure consists of noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.procedures.circle import roll, yaw
from analysis.procedures.circle.evaluate import fit_sine
from analysis.procedures.radial import evaluate as radial
from analysis.procedures.repeatability import evaluate as repeatability
from analysis.procedures.shared.simulated_gauges import Noise
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
"""Scatter of a reading at a target between approaches: 0.087 mm fitted to the paper's 0.261 mm.

It is the simulator's wander, with half a second being short compared with the 4 s between readings. It moves both
gauges equally, so yaw and roll angles are unaffected.
"""
SEEDS = 100
"""Number of repeatability tests averaged: the range of three readings varies strongly."""


@dataclass(frozen=True)
class SimulatedLap:
    """Lap in order of phi. phi (n,) rad, 0 … 2 pi; angle, residual (n,) rad: before and after removing the
    least-squares sine;
    figures: of its test."""

    phi: Array
    angle: Array
    residual: Array
    figures: dict[str, float]


@dataclass(frozen=True)
class FittedSphere:
    """Least-squares sphere. radius, band mm; centre (3,) mm from the base-ball, in the hemisphere's frame."""

    radius_mm: float
    band_mm: float
    centre_mm: Array

    @property
    def shift_mm(self) -> float:
        """Horizontal displacement of the sphere."""
        return float(np.linalg.norm(self.centre_mm))


def circle(rig: Rig, test: str, direction: Direction, effects: Sequence[Effect]) -> SimulatedLap:
    """Return one lap of yaw or roll. Raises FileError if the robot cannot drive it."""
    table = simulate(rig, "yaw" if test == "yaw" else "roll", direction, None, effects)
    assert isinstance(table, CircleTable)  # noqa: S101 - by the test's name
    return curve_of(table, rig)


def joint_lap(rig: Rig) -> tuple[Array, Array]:
    """Return circle angles (n,) rad in order, 0 … 2 pi, and the reported joint angles (n, 6) rad."""
    table = simulate(rig, "yaw", "acw", None, ())
    assert isinstance(table, CircleTable)  # noqa: S101 - by the test's name
    lap = laps_of(table, rig, rig.name).first
    phi = lap.phi % (2 * np.pi)
    order = np.argsort(phi)
    return phi[order], np.unwrap(lap.q[order], axis=0)


def curve_of(table: CircleTable, rig: Rig) -> SimulatedLap:
    """Return the curve of a circle table."""
    lap = laps_of(table, rig, rig.name).first
    phi = lap.phi % (2 * np.pi)
    order = np.argsort(phi)
    y = link_angle(lap.g_mm[:, 0], lap.g_mm[:, 1], rig.gauges.baseline_mm)[order]
    phi = phi[order]
    plain = yaw.plain_figures if table.test == "yaw" else roll.plain_figures
    return SimulatedLap(phi, y, y - fit_sine(phi, y)(phi), plain(phi, y, lap.frame.radius))


def step(curve: SimulatedLap, at_deg: float, span_deg: float) -> float:
    """Return the change of the residual, degrees, from circle angle `at_deg` over `span_deg` (negative for cw)."""
    ends = np.radians([at_deg, at_deg + span_deg]) % (2 * np.pi)
    before, after = np.interp(ends, curve.phi, curve.residual, period=2 * np.pi)
    return float(np.degrees(after - before))


def sphere(rig: Rig, effects: Sequence[Effect]) -> FittedSphere:
    """Return the radial test. Raises FileError if a target is out of reach."""
    table = simulate(rig, "radial", None, None, effects)
    assert isinstance(table, RadialTable)  # noqa: S101 - by the test's name
    result = radial.evaluate(table, hemisphere_of(rig).radius_mm, 0.0, rig.name)
    return FittedSphere(result.free.radius, float(np.ptp(result.free.residual)), result.free.centre)


def repeats(rig: Rig, effects: Sequence[Effect], seeds: int = SEEDS) -> dict[str, Array]:
    """Return uni_mm and bi_mm, (seeds,) each, of simulated repeatability tests."""
    readings = []
    for seed in range(seeds):
        table = simulate(rig, "repeatability", None, noise_seed(seed, None), effects, SCATTER)
        assert isinstance(table, RepeatabilityTable)  # noqa: S101 - by the test's name
        # Readings (targets, 2, rounds) mm of the sides out and in; the simulated table is complete and in order.
        targets = len(np.unique(table.target))
        sides = [table.g_mm[table.approach == side].reshape(targets, -1) for side in repeatability.SIDES]
        readings.append(np.stack(sides, axis=1))
    figures = repeatability.plain_figures(np.array(readings))
    return {name: figures[name] for name in ("uni_mm", "bi_mm")}


def typical_seed(figures: dict[str, Array]) -> int:
    """Return the index of the test, among figures (seeds,) in mm, closest to the mean, each relative to its spread."""
    off = [(values - values.mean()) / (values.std() or 1.0) for values in figures.values()]
    return int(np.argmin(np.sum(np.square(off), axis=0)))
