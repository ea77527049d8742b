from dataclasses import replace

import numpy as np
import pytest

from analysis.robot.geometry.pose_setup import fit_arm, fit_setup, frame, position_error
from analysis.robot.kinematics.arm import Arm, Array, arm_of, forward, rotation, without_setup
from rigs.arms import load_arm

BASE = frame(rotation(np.array([0.2, 0.1, 2.0])), np.array([500.0, 100.0, -50.0]))
TOOL = frame(np.eye(3), np.array([10.0, 20.0, 130.0]))


def arm_and_angles(name: str, count: int, seed: int) -> tuple[Arm, Array]:
    arm = without_setup(arm_of(load_arm(name).robot))
    return arm, np.random.default_rng(seed).uniform(-2, 2, (count, arm.axes))


def differs(arm: Arm, rng: np.random.Generator) -> Arm:
    """The arm with other constants, in an instrument frame and with a tool."""
    sizes = {"a": 0.5, "d": 0.5, "alpha": 2e-3, "beta": 2e-3, "offset": 5e-3}
    values = {name: getattr(arm, name) + rng.normal(0, size, arm.axes) for name, size in sizes.items()}
    return replace(arm, T_world_base=BASE, T_flange_tool=TOOL, **values)


def test_base_and_tool_of_exact_positions_are_reproduced_to_rounding():
    arm, q = arm_and_angles("ur10e", 40, 1)
    T = forward(arm, q)
    xyz_mm = forward(replace(arm, T_world_base=BASE, T_flange_tool=TOOL), q)[:, :3, 3]
    setup = fit_setup(T, xyz_mm)
    np.testing.assert_allclose(setup.T_world_base, BASE, atol=1e-9)
    np.testing.assert_allclose(setup.T_flange_tool[:3, 3], TOOL[:3, 3], atol=1e-9)
    assert abs(position_error(T, xyz_mm, setup)).max() < 1e-9


def test_slopes_of_the_setup_are_those_of_moved_base_and_tool():
    arm, q = arm_and_angles("ur10e", 12, 2)
    T, reach_mm = forward(arm, q), float(np.linalg.norm(forward(arm, q)[:, :3, 3], axis=1).max())
    xyz_mm = in_world(T, BASE, TOOL[:3, 3]) + np.random.default_rng(3).normal(0, 0.1, (12, 3))
    setup = fit_setup(T, xyz_mm)
    base, tool = setup.T_world_base, setup.T_flange_tool[:3, 3]
    for k, step in enumerate(1e-4 * np.eye(9)):
        moved = frame(rotation(step[:3] / reach_mm) @ base[:3, :3], base[:3, 3] + step[3:6])
        change = in_world(T, base, tool) - in_world(T, moved, tool + step[6:])
        np.testing.assert_allclose(change.ravel() / 1e-4, setup.design[:, k], atol=1e-5)


def in_world(T: Array, base: Array, tool_mm: Array) -> Array:
    local: Array = T[:, :3, 3] + T[:, :3, :3] @ tool_mm
    return local @ base[:3, :3].T + base[:3, 3]


@pytest.mark.parametrize("name", ["ur10e", "kuka-lbr-iiwa-14"])
def test_all_constants_of_an_arm_are_fitted_to_the_noise(name):
    arm, q = arm_and_angles(name, 80, 4)
    rng = np.random.default_rng(5)
    true = differs(arm, rng)
    fitted = fit_arm(arm, q, forward(true, q)[:, :3, 3] + rng.normal(0, 0.05, (80, 3)))
    assert fitted.rms_mm == pytest.approx(0.05 * np.sqrt(3), rel=0.15)
    other = np.random.default_rng(6).uniform(-2, 2, (50, arm.axes))
    off_mm = np.linalg.norm((forward(fitted.arm, other) - forward(true, other))[:, :3, 3], axis=1)
    assert off_mm.max() < 0.3


def test_slopes_of_the_constants_are_those_of_the_forward_model():
    """The fit of exact positions ends where the slopes were computed, so a changed constant moves them as they say."""
    arm, q = arm_and_angles("fanuc-lr-mate-200id", 30, 7)
    fitted = fit_arm(arm, q, forward(differs(arm, np.random.default_rng(8)), q)[:, :3, 3])
    assert abs(fitted.left_mm).max() < 1e-3
    at = forward(fitted.arm, q)[:, :3, 3]
    lengths = {"a": 1.0, "alpha": 500.0, "beta": 500.0, "d": 1.0, "offset": 500.0}
    for k, (field, reach_mm) in enumerate(lengths.items()):
        for axis in range(arm.axes):
            step = 1e-4 / reach_mm * np.eye(arm.axes)[axis]
            changed = replace(fitted.arm, **{field: getattr(fitted.arm, field) + step})
            slope = (at - forward(changed, q)[:, :3, 3]) / 1e-4
            np.testing.assert_allclose(slope.ravel(), fitted.design[:, k * arm.axes + axis], atol=2e-3)
