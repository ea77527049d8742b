"""An independently simulated arm of six axes on a rail: the arm of `seven_axes`, carried by a rail with errors.

It shares no code with the model of rig. The scale of the rail's screw or rack is wrong, its line is tilted, and its
straightness error is some hundredths of a millimetre.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.runs.tables import PoseTable
from rigs.schema.robot import Robot
from tests.worlds.arms.seven_axes import Array, Truth, draw_postures


@dataclass(frozen=True)
class RailTruth:
    """Errors of a rail, in mm per metre of travel.

    waves: periodic errors, each with its direction (0 to 2), number of waves per metre, amplitude in mm, and phase.
    """

    along: float
    sideways: float
    height: float
    waves: tuple[tuple[int, float, float, float], ...]

    def base_mm(self, e1_mm: Array) -> Array:
        """Base positions (n, 3) mm on a rail along x."""
        there = np.outer(e1_mm / 1000.0, [1000.0 + self.along, self.sideways, self.height])
        for way, per_m, amplitude, phase in self.waves:
            there[:, way] += amplitude * np.sin(2 * np.pi * per_m * e1_mm / 1000.0 + phase)
        return there


def draw_rail(rng: np.random.Generator, along: float, sideways: float, height: float) -> RailTruth:
    """A rail with two straightness waves of 0.01 to 0.03 mm in each direction."""
    waves = tuple(
        (way, rng.uniform(0.3, 1.5), rng.uniform(0.01, 0.03), rng.uniform(0, 2 * np.pi)) for way in (0, 1, 2, 0, 1, 2)
    )
    return RailTruth(along, sideways, height, waves)


def railed_places(arm: Truth, rail: RailTruth, q: Array, came: Array, e1_mm: Array, ball_mm: Array) -> Array:
    """Positions (n, 3) mm of a ball at ball_mm on the tool."""
    return np.asarray(arm.places(q, came, ball_mm) + rail.base_mm(e1_mm))


def railed_poses(
    robot: Robot, arm: Truth, rail: RailTruth, rng: np.random.Generator, ball_mm: Array, poses: int
) -> PoseTable:
    """Simulate ball positions measured by a tracker with an unknown frame, at random rail positions."""
    q, e1_mm = draw_postures(robot, rng, poses), rng.uniform(*robot.rail.limits_mm, poses)
    seen = railed_places(arm, rail, q, np.vstack([q[:1], q[:-1]]), e1_mm, ball_mm)
    seen += rng.normal(0, arm.scatter_mm, (poses, 3))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    places = seen @ (turn * np.linalg.det(turn)).T + rng.normal(0, 1000, 3)
    return PoseTable(np.column_stack([q, e1_mm / 1000.0]), places, None, rail=True)
