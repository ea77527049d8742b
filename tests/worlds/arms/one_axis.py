"""Independently simulated arms that move one axis at a time in front of a tracker, and the true joint errors."""

from __future__ import annotations

import numpy as np

from analysis.apps.planning.pose_pool import axes_in_turn
from analysis.procedures.shared.axis_curves import AxisCurve
from analysis.robot.kinematics.arm import arm_of
from analysis.runs.tables import PoseTable
from rigs.arms import load_arm
from rigs.load import parse
from rigs.rig import Rig
from tests.worlds.arms.seven_axes import Array, Fault, Truth, draw_truth

ARMS = ("ur10e", "abb-irb-1600", "kuka-kr-6-r900-2", "fanuc-lr-mate-200id", "doosan-m1013")
BALL_MM = np.array([40.0, 0.0, 120.0])


def driven(name: str, number: int, poses: int = 150) -> tuple[Rig, Truth, PoseTable]:
    """An arm with backlash of a joint, its true errors, and its poses with one moving axis, measured by a
    tracker.
    """
    rig, rng = parse(f"name: x\n{load_arm(name).text}", "x"), np.random.default_rng(100 + number)
    q = axes_in_turn(arm_of(rig.robot), poses, None, np.random.default_rng(0))
    truth = draw_truth(rig.robot, rng, (Fault("play", int(rng.integers(2, 6)), rng.uniform(0.03, 0.1)),))
    came_from = np.vstack([q[:1], q[:-1]])
    seen = truth.places(q, came_from, BALL_MM) + rng.normal(0, truth.scatter_mm, (len(q), 3))
    return rig, truth, PoseTable(q, seen, None, came_from=came_from)


def true_curve(truth: Truth, table: PoseTable, curve: AxisCurve) -> tuple[Array, Array, Array, Array]:
    """True joint errors (k,) deg by direction at the angles of a curve, the error (m,) of the curve, and its
    u (m,).

    A constant and a wave of one per turn are removed from all, because the fitted circle absorbs them.
    """
    joint, q, came = curve.axis - 1, table.q, table.came_from
    alone = (np.delete(np.abs(q - came), joint, axis=1) < 1e-4).all(axis=1)
    off = np.degrees(truth.link_q(q, came) - q)[:, joint]
    ways = []
    for sign in (1, -1):
        there = alone & (np.sign(np.round(q[:, joint] - came[:, joint], 6)) == sign)
        near = np.abs(np.degrees(q[there, joint]) - curve.angle_deg[:, None]) < 0.05
        with np.errstate(invalid="ignore"):
            ways.append((near * off[there]).sum(axis=1) / near.sum(axis=1))
    both, seen = np.concatenate(ways), np.concatenate([curve.up_deg, curve.down_deg])
    angle, there = np.radians(np.tile(curve.angle_deg, 2)), np.isfinite(both + seen)
    wave = np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=1)[there]
    takes = wave @ np.linalg.pinv(wave)
    plain = both[there] - takes @ both[there]
    whole = np.full(len(both), np.nan)
    whole[there] = plain
    up, down = np.split(whole, 2)
    missed = seen[there] - takes @ seen[there] - plain
    return up, down, missed, np.tile(curve.u_deg, 2)[there]
