import numpy as np
import pytest

from analysis.runs.robot_condition import condition_of, friction_of
from rigs.schema.condition import CURRENTS
from tests.worlds.arms import soft_arm

COULOMB_A = np.array([0.61, 0.83, 0.55, 0.21, 0.17, 0.24])
NM_A = np.array([11.0, 13.0, 9.0, 7.0, 7.5, 6.8])
TURNS = np.array([3.0, 2.0, 4.0, 1.0, 2.0, 0.0])
"""Number of reversals of each joint; the last joint does not reverse."""


def robot(rng: np.random.Generator, *, ripple_a: float = 0.015) -> dict[str, np.ndarray]:
    """Columns of 120 s at 40 Hz: sines of several joints, Stribeck's friction, gravity and gear ripple."""
    t_s = np.arange(0, 120, 1 / 40)
    phase = rng.uniform(0, 2 * np.pi, 6)
    q_deg = np.array([-40, -70, 80, 10, 70, 5]) + 12 * np.sin(2 * np.pi * TURNS * t_s[:, None] / 120 + phase)
    q_deg[:, 5] = 3 * t_s
    speed = np.gradient(np.radians(q_deg), t_s, axis=0)
    friction = np.sign(speed) * COULOMB_A * (1 + 0.15 * np.exp(-np.abs(speed) / 0.001)) + 0.9 * speed
    gravity = soft_arm.nominal("ur10")._torques(np.radians(q_deg)) / NM_A  # private: torques link by link
    waves = ripple_a * np.sin(200 * np.radians(q_deg) + phase)
    current = friction - gravity + waves + rng.normal(0, 0.05, q_deg.shape)
    return (
        {"last_byte_ns": (t_s * 1e9).astype(np.int64)}
        | {f"q{axis}_deg": q_deg[:, axis - 1] for axis in range(1, 7)}
        | {name: current[:, axis] for axis, name in enumerate(CURRENTS)}
    )


@pytest.mark.parametrize("seed", range(4))
def test_friction_is_half_the_jump_at_a_reversal(seed):
    columns = robot(np.random.default_rng(seed))
    found = condition_of(columns).friction
    assert sorted(found) == [1, 2, 3, 4, 5]  # the sixth never turns back
    for axis, one in found.items():
        assert abs(one.current_a - COULOMB_A[axis - 1]) < 4 * one.u_a + 0.01 * COULOMB_A[axis - 1], (axis, one)
        assert one.u_a < 0.2 * COULOMB_A[axis - 1]
        assert one.turns >= 2


def test_joint_that_waits_at_its_reversal_has_no_friction():
    columns = robot(np.random.default_rng(1))
    t_s = np.arange(0, 60, 1 / 40)
    q_deg = np.interp(t_s, [0, 20, 24, 44], [0, 20, 20, 0])
    columns = {name: values[: len(t_s)] for name, values in columns.items()} | {"q1_deg": q_deg}
    assert 1 not in friction_of(columns, t_s)


@pytest.mark.parametrize("value", [0.0, np.nan])
def test_motors_that_show_nothing_have_no_friction(value):
    columns = robot(np.random.default_rng(1))
    columns |= {name: np.full(len(columns["last_byte_ns"]), value) for name in CURRENTS}
    assert condition_of(columns).friction == {}


@pytest.mark.parametrize("broken", [np.inf, np.nan])
def test_a_damaged_angle_hides_nothing_but_itself(broken):
    columns = robot(np.random.default_rng(1))
    whole = condition_of(columns)
    for row in (0, 700, -1):
        columns["q2_deg"][row] = broken
    damaged = condition_of(columns)
    assert damaged.doubts == whole.doubts and damaged.friction and set(damaged.friction) >= {1, 3}
