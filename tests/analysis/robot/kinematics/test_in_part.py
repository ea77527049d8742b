from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from analysis.robot.kinematics.arm import Arm, Array, arm_of, forward, forward_and_jacobian
from analysis.robot.kinematics.newton import newton_in_part, turned_rad
from rigs.arms import load_arm

WIDOWX = arm_of(load_arm("widowx-250").robot)
"""Five axes; without its last joint four."""


def four_axes() -> Arm:
    short = {key: getattr(WIDOWX, key)[:4] for key in ("a", "alpha", "beta", "d", "offset", "limits", "speed")}
    return replace(WIDOWX, **short, coupling=np.eye(4))


def postures(arm: Arm, count: int) -> Array:
    return np.random.default_rng(4).uniform(0.2, 1.0, (count, arm.axes))


@pytest.mark.parametrize("arm", [WIDOWX, four_axes()], ids=["five", "four"])
def test_a_pose_that_the_arm_has_is_taken_whole(arm):
    q = postures(arm, 20)
    wanted = forward(arm, q)
    found, reached = newton_in_part(arm, wanted, q + np.random.default_rng(1).uniform(-0.05, 0.05, q.shape))
    assert reached.all()
    np.testing.assert_allclose(forward(arm, found), wanted, atol=1e-6)


@pytest.mark.parametrize("arm", [WIDOWX, four_axes()], ids=["five", "four"])
def test_place_is_reached_with_the_nearest_remaining_turn(arm):
    """scipy looks for a nearer turn among the postures that keep the place, and finds none."""
    q = postures(arm, 2)
    wanted = forward(arm, q)
    wanted[:, :3, :3] = wanted[:, :3, :3] @ turned_about([0.06, -0.05, 0.08])
    found, reached = newton_in_part(arm, wanted, q)
    assert reached.all()
    np.testing.assert_allclose(forward(arm, found)[:, :3, 3], wanted[:, :3, 3], atol=1e-6)
    for at, pose in zip(found, wanted, strict=True):

        def turned(x: Array, pose: Array = pose) -> float:
            return float(turned_rad(forward(arm, x[None]), pose[None])[0] ** 2)

        place = {"type": "eq", "fun": lambda x, pose=pose: forward(arm, x[None])[0, :3, 3] - pose[:3, 3]}
        best = minimize(turned, at + 0.002, constraints=[place], method="SLSQP", options={"ftol": 1e-14})
        assert np.sqrt(turned(at)) <= np.sqrt(best.fun) + 1e-5
        assert turned(at) > 1e-6  # there is a turn that it cannot have


def turned_about(vector: list[float]) -> Array:
    angle = float(np.linalg.norm(vector))
    x, y, z = np.array(vector) / angle
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def test_a_place_out_of_reach_is_not_taken():
    far = np.eye(4)[None].copy()
    far[0, :3, 3] = [2000, 0, 0]
    assert not newton_in_part(WIDOWX, far, postures(WIDOWX, 1))[1].any()


def test_where_the_tool_really_is_decides():
    """A tool 3 mm aside of the nominal one: the joints put it where it was wanted."""
    aside = np.array([3.0, -2.0, 1.0])

    def really(q: Array) -> Array:
        T = forward(WIDOWX, q)
        T[:, :3, 3] += aside
        return T

    q = postures(WIDOWX, 5)
    found, reached = newton_in_part(WIDOWX, forward(WIDOWX, q), q, really)
    assert reached.all()
    np.testing.assert_allclose(really(found)[:, :3, 3], forward(WIDOWX, q)[:, :3, 3], atol=1e-6)
    assert forward_and_jacobian(WIDOWX, found)[1].shape[2] == 5
