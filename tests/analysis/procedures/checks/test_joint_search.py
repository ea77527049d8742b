import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.procedures.checks import joint_search
from analysis.procedures.checks.joint_search import search_joint_readings
from analysis.robot.kinematics.arm import arm_of, forward, without_setup
from rigs.arms import load_arm


@pytest.mark.cpu_limit(120)
@pytest.mark.parametrize(
    ("arm", "signs", "zeros_deg"),
    [
        ("ur10e", (1, 1, 1, 1, 1, 1), (0, 0, 0, 10, -8, 0)),
        ("abb-irb-1600", (1, -1, 1, 1, 1, 1), (0, -90, 14.4, 0, 17, 0)),
        ("so-101", (1, -1, 1, 1, 1), (0, 0, -90, 12, 0)),
    ],
)
def test_several_zeros_and_directions_are_found_from_the_nominal_arm(arm, signs, zeros_deg):
    bare, rng = without_setup(arm_of(load_arm(arm).robot)), np.random.default_rng(5)
    q = rng.uniform(-2, 2, (40, bare.axes))
    T = forward(bare, q)
    places = T[:, :3, 3] + T[:, :3, :3] @ [30.0, -20.0, 90.0] + rng.normal(0, 0.1, (40, 3))
    places = Rotation.random(rng=rng).apply(places) + np.array([900.0, -200.0, 50.0])
    readings = search_joint_readings(bare, (q - np.radians(zeros_deg)) * signs, places, right_mm=1.0)
    assert readings[0].signs.tolist() == list(signs) and readings[0].left_mm < 0.3
    assert np.degrees(readings[0].zeros) == pytest.approx(zeros_deg, abs=0.3)


def test_readings_worse_than_the_best_ones_are_not_all_refined(monkeypatch):
    count, close, arm = 60, 6, without_setup(arm_of(load_arm("ur10e").robot))
    zeros = np.zeros((count, arm.axes))
    zeros[:, 2] = np.linspace(0.1, 3.0, count)
    left = np.where(np.arange(count) < close, 1e-9, 1e-6)
    refined = []
    monkeypatch.setattr(joint_search._Free, "best", lambda _: (np.ones_like(zeros), zeros, left))
    monkeypatch.setattr(joint_search._Rigid, "refined", lambda _, reading: refined.append(reading) or reading)
    monkeypatch.setattr(joint_search._Rigid, "with_needed_zeros", lambda _, reading, right_mm: reading)
    search_joint_readings(arm, np.zeros((40, arm.axes)), np.eye(40, 3) * 500, right_mm=1.0)
    assert len(refined) == close
