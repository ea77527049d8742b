from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from pydantic import create_model

import rigs.effects
from analysis.procedures.shared.test_kind import nominal_setup, path_of, predict
from analysis.procedures.simulate import simulate
from analysis.robot.kinematics.arm import forward_and_jacobian
from analysis.robot.model.predict import ModelScene, Motion, apply, model_of, turns
from rigs.effects import (
    VOCABULARY,
    Backlash,
    Compliance,
    Effect,
    GaugeDrift,
    JointOffset,
    LinkGeometry,
    ReversalSpike,
    ServoLag,
    TimeLag,
    TransmissionError,
    WristCoupling,
    healthy_size,
    size_field,
)
from rigs.load import load, load_hidden
from rigs.schema.effect import identity, is_play, is_wave
from rigs.schema.scene import STAGES, play

RIG = load_hidden("paper-fanuc").apply_to(load("paper-fanuc")[0])
UP_AND_DOWN = np.radians(np.concatenate([np.linspace(0, 2, 200), np.linspace(2, 0, 201)]))

EXAMPLES: list[Effect] = [
    VOCABULARY[name].model_validate(fields)
    for name, fields in {
        "joint_offset": {"axis": 2},
        "joint_scale": {"axis": 2},
        "strain_wave": {"axis": 2, "loss": 0.3},
        "link_geometry": {"axis": 3, "field": "beta"},
        "backlash": {"axis": 1, "preload": 0.5, "transit": 0.5},
        "transmission_error": {"axis": 4, "order": 2},
        "compliance": {"axis": 2, "payload_kg": 10},
        "link_bending": {"axis": 2},
        "reversal_spike": {"axis": 1},
        "wrist_coupling": {"from_axis": 4, "to_axis": 5},
        "servo_lag": {"axis": 1},
        "thermal_growth": {},
        "ball_form": {"lobes": 3},
        "gauge_scale": {"gauge": "g1"},
        "gauge_baseline": {},
        "gauge_inclination": {"gauge": "g2"},
        "gauge_dead_band": {"gauge": "g1"},
        "gauge_drift": {"gauge": "g2"},
        "gauge_cyclic": {"gauge": "g1", "period_mm": 0.5},
        "link_growth": {},
        "base_yields": {"way": "evenly"},
        "base_sags": {"way": "x"},
        "time_lag": {},
        "clock_rate": {},
        "vibration": {"frequency_hz": 3},
    }.items()
]  # type: ignore[misc]


def _readings(*effects: Effect, test: str = "yaw") -> np.ndarray:
    return simulate(RIG, test, "acw" if test in ("yaw", "roll") else None, None, effects).g_mm  # type: ignore[arg-type, union-attr]


@pytest.mark.parametrize("effect", EXAMPLES, ids=lambda effect: effect.effect)
def test_a_size_of_zero_is_the_identity_and_the_healthy_size_shows(effect: Effect) -> None:
    nothing = _readings()
    assert np.abs(_readings(effect) - nothing).max() < 1e-12
    healthy = effect.model_copy(update={size_field(effect): healthy_size(effect)})
    shown = np.abs(_readings(healthy) - nothing).max()
    assert 1e-6 < shown < 5  # a healthy arm's share is seen by the gauges and stays small


@pytest.mark.parametrize("effect", EXAMPLES, ids=lambda effect: effect.effect)
def test_every_effect_declares_a_stage_and_is_small_for_small_sizes(effect: Effect) -> None:
    assert effect.STAGE in STAGES
    nothing = _readings()
    small, smaller = (
        np.abs(_readings(effect.model_copy(update={size_field(effect): share * healthy_size(effect)})) - nothing).max()
        for share in (0.1, 0.01)
    )
    assert smaller < 0.5 * small


def test_every_name_of_the_vocabulary_has_its_file_and_the_other_way_round() -> None:
    files = {path.stem for path in Path(rigs.effects.__file__).parent.glob("*.py")} - {"__init__"}
    of_a_rail = {"rail_line"}  # which no gauge sees: test_rail.py
    assert set(VOCABULARY) == files == {effect.effect for effect in EXAMPLES} | of_a_rail


def _link_side_deg(effect: Effect, q: np.ndarray | None = None, t: np.ndarray | None = None) -> np.ndarray:
    """What a joint effect adds to axis 2 when that axis moves up and down."""
    q = np.zeros((len(UP_AND_DOWN), 6)) if q is None else q
    q[:, 1] = UP_AND_DOWN if q[:, 1].max() == 0 else q[:, 1]
    table = simulate(RIG, "yaw", "acw", None)
    model = model_of(RIG, [effect])
    scene = _scene(model, q, np.arange(len(q)) * 0.01 if t is None else t)
    assert table is not None
    return np.degrees(apply([effect], "joint", scene).link_q - scene.q)[:, 1]


def _scene(model, q, t):  # type: ignore[no-untyped-def]
    empty = np.empty(0)
    return ModelScene(model.arm, model.load, Motion(t, q), q, empty, empty, np.zeros(len(q)), empty, empty)


def test_backlash_lags_half_its_width_and_crosses_it_at_a_reversal() -> None:
    lag = _link_side_deg(Backlash(axis=2, width_deg=0.1))
    np.testing.assert_allclose(lag[20:200], -0.05, atol=1e-12)
    np.testing.assert_allclose(lag[220:], +0.05, atol=1e-12)
    assert (np.diff(lag[200:220]) >= -1e-12).all()
    gradual = _link_side_deg(Backlash(axis=2, width_deg=0.1, transit=1.0))
    np.testing.assert_allclose(gradual[30:199], -0.05, atol=1e-12)
    assert np.abs(np.diff(gradual)).max() < np.abs(np.diff(lag)).max() * 1.01
    assert np.count_nonzero(np.diff(gradual[199:])) > np.count_nonzero(np.diff(lag[199:]))


def test_gravity_holds_a_flank_and_no_reversal_shows() -> None:
    q = np.zeros((len(UP_AND_DOWN), 6))
    q[:, 1] = UP_AND_DOWN + 0.8
    held = _link_side_deg(Backlash(axis=2, width_deg=0.1, preload=1.0), q)
    np.testing.assert_allclose(np.abs(held), 0.05, atol=1e-3)
    assert np.ptp(held) < 1e-3


def test_a_vertical_joint_shows_its_whole_play() -> None:
    q = np.zeros((len(UP_AND_DOWN), 6))
    q[:, 0] = UP_AND_DOWN
    scene = _scene(model_of(RIG, []), q, np.arange(len(q)) * 0.01)
    plays = [Backlash(axis=1, width_deg=0.1, preload=share) for share in (0.0, 0.5)]
    free, held = (np.degrees(apply([one], "joint", scene).link_q - q)[:, 0] for one in plays)
    np.testing.assert_allclose(held, free, atol=1e-6)
    assert np.ptp(free) == pytest.approx(0.1)


def test_play_is_the_operator_sample_by_sample() -> None:
    x = np.cumsum(np.random.default_rng(3).normal(0, 1e-3, 3000))
    y = [x[0]]
    for now in x[1:]:
        y.append(min(max(y[-1], now - 0.002), now + 0.002))
    np.testing.assert_allclose(play(x, 0.002), y, atol=1e-15)


def test_turns_are_reversals_and_not_noise() -> None:
    t = np.arange(len(UP_AND_DOWN)) * 0.01
    noisy = UP_AND_DOWN + np.radians(0.0003) * np.random.default_rng(4).normal(size=len(t))
    ((when, direction),) = turns(t, noisy)
    assert when == pytest.approx(2.0, abs=0.1) and direction == -1


def test_a_joint_that_stands_turns_back_as_it_leaves() -> None:
    t_s, x = np.arange(9.0), np.array([0.0, 1, 2, 2, 2, 2, 1, 0, 0])
    assert turns(t_s, x) == [(5.0, -1.0)]
    assert turns(t_s, -x) == [(5.0, 1.0)]
    # Rounded angles of a lap stand as well, about their turn.
    t_s = np.arange(0.0, 20.0, 0.02)
    ((when, _),) = turns(t_s, np.radians(np.round(2 * np.cos(2 * np.pi * (t_s - 10) / 60), 2)))
    assert when == pytest.approx(10.0, abs=0.3)


@pytest.mark.parametrize("stand_s", [0.2, 1.0])
@pytest.mark.parametrize("step_s", [0.004, 0.02, 0.05, 0.1])
@pytest.mark.parametrize("offset_s", [0.0, 0.013, 7.1, 12.9])
def test_a_joint_turns_back_as_the_robot_leaves_its_stand(step_s: float, offset_s: float, stand_s: float) -> None:
    t_s = offset_s + np.arange(0.0, 5.0, step_s)
    q = np.zeros((len(t_s), 6))
    q[:, 1] = np.interp(t_s - offset_s, [0.0, 3.0 - stand_s, 3.0, 5.0], [0.0, 0.4, 0.4, 0.0])
    noisy = q + np.radians(0.0003) * np.random.default_rng(5).normal(size=q.shape)
    for motion in (q, noisy):
        ((when, direction),) = Motion(t_s, motion).reversals(2)
        assert when - offset_s == pytest.approx(3.0, abs=0.5 * step_s) and direction == -1


def test_a_joint_that_turns_back_without_a_stand_does_so_at_its_vertex() -> None:
    t_s = np.arange(0.0, 5.0, 0.02)
    q = np.radians(0.0003) * np.random.default_rng(5).normal(size=(len(t_s), 6))
    q[:, 0] += 0.1 * t_s
    q[:, 1] = -0.003 * (t_s - 2.5) ** 2
    ((when, _),) = Motion(t_s, q).reversals(2)
    assert when == pytest.approx(2.5, abs=0.02)  # joint 2 hardly turns while the robot drives on
    q[:, 0] = -np.abs(t_s - 2.52)
    q[:, 1] = -0.1 * np.abs(t_s - 2.52)
    ((when, _),) = Motion(t_s, q).reversals(2)
    assert when == pytest.approx(2.52, abs=0.02)  # no stop


def test_a_joint_that_rests_on_after_a_stand_does_not_turn_back_there() -> None:
    t_s = np.arange(0.0, 10.0, 0.02)
    q = np.zeros((len(t_s), 6))
    q[:, 0] = np.interp(t_s, [3.0, 8.0], [0.0, 0.5])
    q[:, 1] = np.interp(t_s, [0.0, 2.0, 8.0, 10.0], [0.0, 0.4, 0.4, 0.0])
    ((when, _),) = Motion(t_s, q).reversals(2)
    assert when > 4.0  # the robot left its stand at 3 s, joint 2 at 8 s


def test_a_spike_hangs_back_against_the_new_direction_and_relaxes() -> None:
    spike = _link_side_deg(ReversalSpike(axis=2, amplitude_deg=0.01, decay_s=0.1))
    assert np.abs(spike[:198]).max() == 0
    assert 0.009 < spike.max() < 0.01001 and abs(spike[-1]) < 1e-6


def test_spikes_of_a_long_motion_are_the_sum_of_all_of_them() -> None:
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


def test_joint_effects_add_to_the_reported_angle() -> None:
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


def test_lags_look_back() -> None:
    q = np.zeros((100, 6))
    q[:, 1] = np.linspace(0, 0.99, 100)
    t = np.linspace(0, 0.99, 100)
    late = _link_side_deg(ServoLag(axis=2, lag_s=0.05), q, t)
    np.testing.assert_allclose(late[10:], -np.degrees(0.05), atol=1e-9)
    scene = apply([TimeLag(lag_s=0.05)], "time", _scene(model_of(RIG), q, t))
    np.testing.assert_allclose(scene.q[10:, 1], q[10:, 1] - 0.05, atol=1e-9)


def test_compliance_gives_way_to_gravity_by_torque_times_softness() -> None:
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


def _weightless(robot):  # type: ignore[no-untyped-def]
    axes = tuple(axis.model_copy(update={"mass_kg": 0.0}) for axis in robot.axes)
    return robot.model_copy(update={"axes": axes, "payload_kg": 0.0})


def test_geometry_and_gauges() -> None:
    longer = model_of(RIG, [LinkGeometry(axis=3, field="a", delta=1.5)])
    scene = apply(longer.effects, "arm", _scene(longer, np.zeros((1, 6)), np.zeros(1)))
    assert scene.arm.a[2] - longer.arm.a[2] == pytest.approx(1.5)
    drift = _readings(GaugeDrift(gauge="g2", mm_per_min=0.6)) - _readings()
    assert np.abs(drift[:, 0]).max() == 0
    np.testing.assert_allclose(np.diff(drift[:, 1]), 0.6 / 60 / 50, atol=1e-9)


def test_roll_shows_effects_hidden_in_yaw() -> None:
    """The ball above the circle's plane turns the roll and not the yaw."""
    table = simulate(RIG, "roll", "acw", None, ())
    model = model_of(RIG, ())
    setup = nominal_setup(RIG, table)
    normal = np.array(RIG.tests.circle.normal) / np.linalg.norm(RIG.tests.circle.normal)  # type: ignore[union-attr]
    raised = replace(setup, ball=setup.ball + 2.0 * normal)
    g = predict(model, table, path_of(model, table), raised)
    roll = np.degrees(np.arctan((g[:, 1] - g[:, 0]) / 50.0))
    # Between two samples of the controller the path is a chord, on the quick way back a longer one.
    np.testing.assert_allclose(roll, np.degrees(np.arctan(2.0 / 70.0)), atol=2e-4)


def test_identity_has_required_fields_without_fitted_sizes() -> None:
    three, five = (VOCABULARY["ball_form"].model_validate({"lobes": lobes, "amplitude_mm": 0.01}) for lobes in (3, 5))
    assert identity(three) == identity(three.model_copy(update={"amplitude_mm": 0.02, "phase_deg": 70.0}))
    assert len({identity(three), identity(five), identity(TransmissionError(axis=4, order=3))}) == 3
    assert identity(Backlash(axis=1, width_deg=0.1, transit=0.3)) == Backlash(axis=1)
    assert identity(LinkGeometry(axis=3, field="a")) != identity(LinkGeometry(axis=3, field="d"))


def test_every_play_and_every_wave_is_known_as_one() -> None:
    assert {effect.effect for effect in EXAMPLES if is_play(effect)} == {"backlash", "gauge_dead_band"}
    waves = {effect.effect for effect in EXAMPLES if is_wave(effect)}
    assert waves == {"transmission_error", "ball_form", "gauge_cyclic", "vibration"}


@pytest.mark.parametrize(
    ("held", "message"),
    [
        ({}, "rigs/effects/half.py: .*'half'"),
        (
            {"Half": create_model("Half", __base__=Effect, effect=(str, "half"))},
            "Half .* apply, .*remedy, STAGE",
        ),
    ],
)
def test_a_file_without_a_whole_effect_is_refused(
    held: dict[str, object], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = ModuleType("rigs.effects.half")
    vars(module).update(held)
    monkeypatch.setitem(sys.modules, "rigs.effects.half", module)
    with pytest.raises(ImportError, match=message):
        # private: it is called for the files of the folder, when that is imported
        rigs.effects._class_in("half")
