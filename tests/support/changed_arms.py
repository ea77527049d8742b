"""Rigs with library arms, random bases and tools, and random found constants."""

from __future__ import annotations

from typing import get_args

import numpy as np

from rigs.arms import load_arm
from rigs.effects.joint_offset import JointOffset
from rigs.effects.link_geometry import Constant, LinkGeometry
from rigs.load import load
from rigs.rig import Rig
from rigs.schema.robot import Pose, Rail


def changed(name: str, seed: int = 0, *, rail: bool = False) -> Rig:
    """A rig with a library arm, a random base and tool, and an optional rail in a random direction.

    Each zero and each link constant is changed by two effects.
    """
    rng = np.random.default_rng(seed)

    def pose() -> Pose:
        return Pose(xyz_mm=tuple(rng.uniform(-500, 500, 3)), rpy_deg=tuple(rng.uniform(-170, 170, 3)))

    update = {"base": pose(), "tool": pose(), "payload_kg": 2.5}
    if rail:
        update["rail"] = Rail(direction=tuple(rng.normal(size=3)), limits_mm=(-700, 2300))
    robot = load_arm(name).robot.model_copy(update=update)
    effects = [
        effect
        for _ in range(2)
        for axis in range(1, len(robot.axes) + 1)
        for effect in (
            JointOffset(axis=axis, offset_deg=rng.normal(0, 0.2)),
            *(LinkGeometry(axis=axis, field=field, delta=rng.normal(0, 0.3)) for field in get_args(Constant)),
        )
    ]
    return load("ur10e-cell")[0].model_copy(update={"robot": robot, "effects": tuple(effects)})


def within_limits(rig: Rig, n: int = 20) -> np.ndarray:
    """Return n random joint angles (n, axes) rad within the limits; with a rail, its position in m is an additional
    column.
    """
    limits = np.radians([axis.limits_deg for axis in rig.robot.axes])
    if rig.robot.rail:
        limits = np.vstack([limits, np.array(rig.robot.rail.limits_mm) / 1000])
    low, high = limits.T
    return np.random.default_rng(5).uniform(low, high, (n, len(low)))


def require_equal(found: np.ndarray, expected: np.ndarray) -> None:
    """Compare poses (n, 4, 4) to 1 pm and 1e-12 rad."""
    np.testing.assert_allclose(found[:, :3, 3], expected[:, :3, 3], atol=1e-9, rtol=0)
    np.testing.assert_allclose(found[:, :3, :3], expected[:, :3, :3], atol=1e-12, rtol=0)
