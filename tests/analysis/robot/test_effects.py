import sys
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest
from pydantic import create_model

import rigs.effects
from analysis.robot.kinematics.arm import forward_and_jacobian
from analysis.robot.predict import ModelScene, Motion, apply, model_of, turns
from rigs.effects import (
    Backlash,
    Compliance,
    Effect,
    JointOffset,
    ReversalSpike,
    ServoLag,
    TimeLag,
    TransmissionError,
    WristCoupling,
)
from rigs.load import load, load_hidden
from rigs.schema.scene import play

RIG = load_hidden("paper-fanuc").apply_to(load("paper-fanuc")[0])
UP_AND_DOWN = np.radians(np.concatenate([np.linspace(0, 2, 200), np.linspace(2, 0, 201)]))


def _link_side_deg(effect: Effect, q: np.ndarray | None = None, t: np.ndarray | None = None) -> np.ndarray:
    """Change of axis 2 by a joint effect while the axis moves up and down."""
    q = np.zeros((len(UP_AND_DOWN), 6)) if q is None else q
    q[:, 1] = UP_AND_DOWN if q[:, 1].max() == 0 else q[:, 1]
    model = model_of(RIG, [effect])
    scene = _scene(model, q, np.arange(len(q)) * 0.01 if t is None else t)
    return np.degrees(apply([effect], "joint", scene).link_q - scene.q)[:, 1]


def _scene(model, q, t):
    empty = np.empty(0)
    return ModelScene(model.arm, model.load, Motion(t, q), q, empty, empty, np.zeros(len(q)), empty, empty)


def test_backlash_lags_half_its_width_and_crosses_it_at_a_reversal():
    lag = _link_side_deg(Backlash(axis=2, width_deg=0.1))
    np.testing.assert_allclose(lag[20:200], -0.05, atol=1e-12)
    np.testing.assert_allclose(lag[220:], +0.05, atol=1e-12)
    assert (np.diff(lag[200:220]) >= -1e-12).all()
    gradual = _link_side_deg(Backlash(axis=2, width_deg=0.1, transit=1.0))
    np.testing.assert_allclose(gradual[30:199], -0.05, atol=1e-12)
    assert np.abs(np.diff(gradual)).max() < np.abs(np.diff(lag)).max() * 1.01
    assert np.count_nonzero(np.diff(gradual[199:])) > np.count_nonzero(np.diff(lag[199:]))


def test_gravity_holds_a_flank_and_no_reversal_shows():
    q = np.zeros((len(UP_AND_DOWN), 6))
    q[:, 1] = UP_AND_DOWN + 0.8
    held = _link_side_deg(Backlash(axis=2, width_deg=0.1, preload=1.0), q)
    np.testing.assert_allclose(np.abs(held), 0.05, atol=1e-3)
    assert np.ptp(held) < 1e-3


def test_play_is_the_operator_sample_by_sample():
    x = np.cumsum(np.random.default_rng(3).normal(0, 1e-3, 3000))
    y = [x[0]]
    for now in x[1:]:
        y.append(min(max(y[-1], now - 0.002), now + 0.002))
    np.testing.assert_allclose(play(x, 0.002), y, atol=1e-15)


def test_turns_are_reversals_and_not_noise():
    t = np.arange(len(UP_AND_DOWN)) * 0.01
    noisy = UP_AND_DOWN + np.radians(0.0003) * np.random.default_rng(4).normal(size=len(t))
    ((when, direction),) = turns(t, noisy)
    assert when == pytest.approx(2.0, abs=0.1) and direction == -1


@pytest.mark.parametrize("stand_s", [0.2, 1.0])
@pytest.mark.parametrize("step_s", [0.004, 0.02, 0.05, 0.1])
@pytest.mark.parametrize("offset_s", [0.0, 0.013, 7.1, 12.9])
def test_a_joint_turns_back_as_the_robot_leaves_its_stand(step_s, offset_s, stand_s):
    t_s = offset_s + np.arange(0.0, 5.0, step_s)
    q = np.zeros((len(t_s), 6))
    q[:, 1] = np.interp(t_s - offset_s, [0.0, 3.0 - stand_s, 3.0, 5.0], [0.0, 0.4, 0.4, 0.0])
    noisy = q + np.radians(0.0003) * np.random.default_rng(5).normal(size=q.shape)
    for motion in (q, noisy):
        ((when, direction),) = Motion(t_s, motion).reversals(2)
        assert when - offset_s == pytest.approx(3.0, abs=0.5 * step_s) and direction == -1


def test_a_spike_hangs_back_against_the_new_direction_and_relaxes():
    spike = _link_side_deg(ReversalSpike(axis=2, amplitude_deg=0.01, decay_s=0.1))
    assert np.abs(spike[:198]).max() == 0
    assert 0.009 < spike.max() < 0.01001 and abs(spike[-1]) < 1e-6


def test_spikes_of_a_long_motion_are_the_sum_of_all_of_them():
    """A spike is dropped after its decay. Some of these hundred last until the next reversal."""
    t = np.arange(0.0, 400.0, 0.02)
    q = np.zeros((len(t), 6))
    q[:, 1] = np.sin(2 * np.pi * t / 8.0)
    effect = ReversalSpike(axis=2, amplitude_deg=0.1, decay_s=0.5, slow=0.4, rise=0.3)
    whole = np.zeros(len(t))
    for when, direction in Motion(t, q).reversals(2):
        since = np.maximum(t - when, 0.0) / 0.5
        relaxing = (0.6 * np.exp(-since) + 0.4 * np.exp(-since / 4)) * -np.expm1(-since / 0.3)
        whole -= direction * np.where(t >= when, relaxing, 0.0)
    np.testing.assert_allclose(_link_side_deg(effect, q, t), 0.1 * whole, rtol=0, atol=1e-12)


def test_joint_effects_add_to_the_reported_angle():
    both = np.degrees(
        apply(
            (
                JointOffset(axis=2, offset_deg=0.3),
                TransmissionError(axis=2, order=100, amplitude_deg=0.01, phase_deg=30, third=0.5),
                WristCoupling(from_axis=4, to_axis=2, ratio=0.01),
            ),
            "joint",
            _scene(model_of(RIG), np.full((3, 6), 0.1), np.arange(3.0)),
        ).link_q
        - 0.1
    )[:, 1]
    turn = 100 * 0.1 + np.radians(30)
    expected = 0.3 + 0.01 * (np.sin(turn) + 0.5 * np.sin(3 * turn)) + np.degrees(0.001)
    np.testing.assert_allclose(both, expected, atol=1e-12)


def test_lags_look_back():
    q = np.zeros((100, 6))
    q[:, 1] = np.linspace(0, 0.99, 100)
    t = np.linspace(0, 0.99, 100)
    late = _link_side_deg(ServoLag(axis=2, lag_s=0.05), q, t)
    np.testing.assert_allclose(late[10:], -np.degrees(0.05), atol=1e-9)
    scene = apply([TimeLag(lag_s=0.05)], "time", _scene(model_of(RIG), q, t))
    np.testing.assert_allclose(scene.q[10:, 1], q[10:, 1] - 0.05, atol=1e-9)


def test_compliance_gives_way_to_gravity_by_torque_times_softness():
    """A payload of m at the flange, the arm stretched out level: torque m g times its reach."""
    q = np.radians([[0.0, 60.0, 20.0, 0.0, 30.0, 0.0]])
    model = model_of(RIG.model_copy(update={"robot": _weightless(RIG.robot)}))
    soft = Compliance(axis=2, deg_per_Nm=1e-3, payload_kg=10)
    scene = _scene(model, q, np.zeros(1))
    sag = np.degrees(apply([soft], "joint", scene).link_q - q)[0, 1]
    arm = replace(model.arm, T_flange_tool=np.eye(4))
    _, J = forward_and_jacobian(arm, q)
    torque = 10 * 9.80665 * -J[0, 2, 1] / 1000
    assert abs(torque) > 30
    assert sag == pytest.approx(1e-3 * torque)


def _weightless(robot):
    axes = tuple(axis.model_copy(update={"mass_kg": 0.0}) for axis in robot.axes)
    return robot.model_copy(update={"axes": axes, "payload_kg": 0.0})


@pytest.mark.parametrize(
    ("held", "message"),
    [
        ({}, "rigs/effects/half.py: .*'half'"),
        ({"Half": create_model("Half", __base__=Effect, effect=(str, "half"))}, "Half .* apply, STAGE, .*REMEDY"),
    ],
)
def test_a_file_without_a_whole_effect_is_refused(held, message, monkeypatch):
    module = ModuleType("rigs.effects.half")
    vars(module).update(held)
    monkeypatch.setitem(sys.modules, "rigs.effects.half", module)
    with pytest.raises(ImportError, match=message):
        # private: it is called for the files of the folder, when that is imported
        rigs.effects._class_in("half")
