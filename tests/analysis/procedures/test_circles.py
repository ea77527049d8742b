import dataclasses
import re

import numpy as np
import pytest

from analysis.procedures import direction_pair
from analysis.procedures.checks.places import place_findings, stamp_findings
from analysis.procedures.circle import CircleResult, Circularity, Roll, Yaw, evaluate_distance
from analysis.procedures.direction_pair import lag_of
from analysis.procedures.shared.joint_reversals import MeasuredReversal, angle_difference, turns
from analysis.procedures.shared.lap_curve import LapCurve, curve_of, reduced
from analysis.procedures.shared.test_kind import evaluate
from analysis.procedures.simulate import simulate
from analysis.robot.geometry.circle import CircleFrame, Reversal, frame_of, link_readings, reversals
from analysis.robot.geometry.driven_programs import circle_of, circle_program
from analysis.robot.kinematics.arm import arm_of, forward
from analysis.runs.laps import Laps, laps_of
from analysis.runs.tables import CircleTable
from rigs.effects import Effect, TimeLag
from rigs.load import load, load_hidden, parse
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction
from tests.support.refusals import refused

PHI = np.linspace(0, 2 * np.pi, 720, endpoint=False)
FRAME = CircleFrame(np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), np.array([0, 0, 1.0]), 70.0)
BALL = np.array([0.8, -0.5, 0.3])
OFFSETS = np.array([25.0, -25.0])


def _lap(g_mm: np.ndarray, q: np.ndarray | None = None, direction: str = "acw") -> Laps:
    sense = 1 if direction == "acw" else -1
    q = np.zeros((720, 6)) if q is None else q
    return Laps(direction, FRAME, PHI / 0.35, sense * PHI, q, g_mm, 2 * np.pi / 0.35, 2 * np.pi / 0.35)


def _distance(g_mm: np.ndarray) -> Circularity:
    return evaluate_distance(reduced(lap := _lap(g_mm)), lap.frame.radius, 1e-3)


def _said(result: CircleResult) -> tuple[str, ...]:
    return tuple(note for note in result.notes if not note.startswith("a single lap cannot show slow noise"))


def _ball(test: str, ball: tuple[float, float, float]) -> np.ndarray:
    return link_readings(FRAME.poses(PHI), np.array(ball), OFFSETS, test, 70.0)


def test_roll_shows_ball_height_and_no_sine_of_eccentricity():
    result = Roll().evaluate_laps(_lap(_ball("roll", (0.5, -0.4, 1.2))), 50.0, 0.02, 1e-3)
    assert result.figures["offset_deg"].value == pytest.approx(np.degrees(1.2 / 70), rel=1e-3)
    # Of second order: h e / R².
    assert result.figures["amplitude_deg"].value < np.degrees(1.3 * 1.2 * 0.65 / 70**2)
    assert " 1.200 mm off " in _said(result)[0]


def test_an_eccentricity_alone_is_no_circular_deviation():
    result = _distance(_ball("yaw", (1.5, -1.5, 0.0)))
    assert result.figures["eccentricity_u_mm"].value == pytest.approx(1.5, abs=2e-3)
    assert result.figures["eccentricity_v_mm"].value == pytest.approx(-1.5, abs=2e-3)
    assert np.ptp(result.deviation_mm) < 1e-3


def test_circular_deviation_is_the_planted_range():
    g = _ball("yaw", (0.3, 0.2, 0.0)) + 0.02 * np.sin(3 * PHI)[:, None]
    assert _distance(g).figures["circular_deviation_mm"].value == pytest.approx(0.04, abs=2e-4)


def test_hysteresis_is_the_difference_between_directions():
    g = _ball("yaw", (0.3, 0.2, 0.0))
    back = np.stack([np.interp(-PHI % (2 * np.pi), PHI, column, period=2 * np.pi) for column in g.T], axis=1)
    turned = np.tan(np.radians(0.1)) * 25
    one = Yaw().evaluate_laps(_lap(g + np.array([-turned, turned])), 50.0, 0.02, 1e-6)
    other = Yaw().evaluate_laps(_lap(back + 0.004, direction="cw"), 50.0, 0.02, 1e-6)
    figures = direction_pair.pair(one, other).figures
    assert figures["hysteresis_mean_deg"].value == pytest.approx(0.1, abs=1e-4)
    # Of single laps the slow noise is assumed, and a maximum is lowered by what it adds.
    assert figures["hysteresis_max_deg"].value == pytest.approx(0.1, abs=2e-3)
    assert figures["hysteresis_max_mm"].value == pytest.approx(0.004, abs=5e-4)
    assert figures["hysteresis_mean_mm"].value == pytest.approx(-0.004, abs=2e-4)
    with refused("readings.unsuitable", "are cw and acw"):
        direction_pair.pair(other, one)


def test_disagreeing_eccentricities_are_doubted():
    good = _ball("yaw", (0.6, -0.4, 0.0))
    assert _said(Yaw().evaluate_laps(_lap(good), 50.0, 0.02, 1e-3)) == ()
    for wrong in (good[:, ::-1], good * [1, -1], good * [1, 0.2], 1.0 + _ball("roll", (0.6, -0.4, 0.3))):
        (note,) = _said(Yaw().evaluate_laps(_lap(wrong), 50.0, 0.02, 1e-3))
        assert "the gauges" in note


def test_yaw_run_labelled_roll_is_doubted():
    notes = Roll().evaluate_laps(_lap(_ball("yaw", (0.6, -0.4, 0.0))), 50.0, 0.02, 1e-3).notes
    assert "a yaw run" in notes[-1]
    assert len(_said(Roll().evaluate_laps(_lap(_ball("roll", (0.6, -0.4, 0.3))), 50.0, 0.02, 1e-3))) == 1


@pytest.mark.parametrize("test", ["yaw", "roll", "radial", "repeatability"])
def test_a_good_run_is_not_doubted(test):
    rig, _ = load("paper-errors")
    table = simulate(rig, test, "acw" if test in ("yaw", "roll") else None, 1)
    notes = evaluate(table, rig, 0.0, "run").notes
    assert not [note for note in notes if "may be wrong" in note or "looks" in note]
    assert [*place_findings(table, rig), *stamp_findings(table, rig)] == []


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        ({"g_mm": np.zeros((720, 2))}, "readings.unsuitable"),
        ({"g_mm": np.where(np.arange(1440).reshape(720, 2) == 9, np.nan, _ball("yaw", (1, 0, 0)))}, "table.invalid"),
        ({"g_mm": _ball("yaw", (1, 0, 0))[:, :1]}, "table.invalid"),
        ({"frame": dataclasses.replace(FRAME, radius=0.0)}, "rig_file.invalid"),
    ],
)
def test_invalid_circle_runs_are_refused(wrong, code):
    lap = dataclasses.replace(_lap(_ball("yaw", (0.6, -0.4, 0.0))), **wrong)
    with refused(code):
        Yaw().evaluate_laps(lap, 50.0, 0.02, 1e-3)


def _table() -> tuple[CircleTable, Rig]:
    """The acw program of the paper's rig, and what the gauges read of a robot without errors."""
    rig, _ = load("paper-fanuc")
    program = circle_program(rig, "acw")
    poses = forward(arm_of(rig.robot), program.q)
    ball = frame_of(circle_of(rig)).centre + BALL
    return CircleTable("yaw", "acw", program.t_s, program.q, link_readings(poses, ball, OFFSETS, "yaw", 70.0)), rig


def test_a_lap_under_the_wrong_label_is_refused_however_the_robot_drove_back():
    table, rig = _table()
    with refused("readings.unsuitable", "labelled cw, but the robot moved"):
        laps_of(dataclasses.replace(table, direction="cw"), rig, "t")


def test_remounted_ball_is_no_pair_but_a_play_is():
    def back(g: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(-PHI % (2 * np.pi), PHI, column, period=2 * np.pi) for column in g.T], axis=1)

    acw = Yaw().evaluate_laps(_lap(_ball("yaw", (0.3, 0.2, 0.0))), 50.0, 0.02, 1e-6)
    elsewhere = Yaw().evaluate_laps(_lap(back(_ball("yaw", (0.6, -0.05, 0.0))), direction="cw"), 50.0, 0.02, 1e-6)
    with refused("readings.unsuitable", "cw does not show the hysteresis"):
        direction_pair.pair(acw, elsewhere)
    play = np.where(np.sin(PHI - np.radians(105)) > 0, 0.4, -0.4)[:, None]
    played = Yaw().evaluate_laps(_lap(back(_ball("yaw", (0.3, 0.2, 0.0)) + play), direction="cw"), 50.0, 0.02, 1e-6)
    assert direction_pair.pair(acw, played).figures["hysteresis_max_mm"].value > 0.35


def test_the_way_to_the_circle_and_from_it_is_no_part_of_the_lap():
    """Without a lead-in: from the far side of the circle across it to the start, and back."""
    rig = parse(re.sub(r"lead_deg: \S+", "lead_deg: 0", load("ur10e-cell")[1]), "r")
    table = simulate(rig, "yaw", "acw", 1)
    share, across = np.linspace(0, 1, 200)[:, None], table.q[len(table.q) // 2]
    there, back = across + share * (table.q[0] - across), table.q[-1] + share * (across - table.q[-1])
    t_s = 0.01 * np.arange(200)
    whole = CircleTable(
        "yaw",
        "acw",
        np.concatenate([t_s, 2 + table.t_s, 2 + table.t_s[-1] + 0.01 + t_s]),
        np.concatenate([there, table.q, back]),
        np.concatenate([np.full((200, 2), 9.0), table.g_mm, np.full((200, 2), 9.0)]),
    )
    once, lap = laps_of(table, rig, "t"), laps_of(whole, rig, "t")
    assert lap.notes == () and abs(len(lap.phi) - len(once.phi)) < 20
    assert lap.g_mm[20:-20].max() < 5 and np.ptp(lap.phi) == pytest.approx(4 * np.pi, abs=0.05)


def test_standing_jumping_and_half_a_lap_are_refused():
    table, rig = _table()
    for wrong, code in (
        (dataclasses.replace(table, q=np.tile(table.q[:1], (len(table.q), 1))), "readings.unsuitable"),
        (
            dataclasses.replace(table, q=table.q + np.radians(20) * (np.arange(len(table.q)) == 900)[:, None]),
            "readings.unsuitable",
        ),
        (CircleTable("yaw", "acw", table.t_s[:2000], table.q[:2000], table.g_mm[:2000]), "readings.unsuitable"),
        (CircleTable("yaw", "acw", table.t_s[:1], table.q[:1], table.g_mm[:1]), "readings.too_few"),
    ):
        with refused(code):
            laps_of(wrong, rig, "t")


def test_turning_points_are_found_through_encoder_noise():
    """Planted at 105° and 237° in joint 1, at 2° and 181° in joint 2, none in the full turn of joint 4."""
    q = np.zeros((720, 6))
    q[:, 0] = 0.05 * _between(np.radians(105), np.radians(237))
    q[:, 1] = 0.05 * np.cos(PHI - np.radians(2))
    q[:, 3] = PHI + 0.2 * np.sin(PHI)
    q += np.random.default_rng(5).normal(0, np.radians(0.002), q.shape)
    found = turns(_lap(np.zeros((720, 2)), q))
    assert [(turn.axis, turn.upper) for turn in found] == [(1, True), (1, False), (2, True), (2, False)]
    for turn, true in zip(found, (105, 237, 2, 182), strict=True):
        assert abs(np.degrees(angle_difference(turn.phi, np.radians(true)))) < max(3 * np.degrees(turn.u_rad), 0.6), (
            turn
        )
    cw = turns(_lap(np.zeros((720, 2)), q[::-1], "cw"))
    assert [(turn.axis, turn.upper) for turn in cw] == [(1, True), (1, False), (2, True), (2, False)]
    nominal = [Reversal(1, np.radians(104), True), Reversal(6, 1.0, True)]
    assert [_nearest(found, reversal) is not None for reversal in nominal] == [True, False]


def _nearest(seen: list[MeasuredReversal], nominal: Reversal) -> MeasuredReversal | None:

    def apart(turn: MeasuredReversal) -> float:
        return abs(angle_difference(turn.phi, nominal.phi))

    alike = [turn for turn in seen if (turn.axis, turn.upper) == (nominal.axis, nominal.upper)]
    return min((turn for turn in alike if apart(turn) < np.radians(30)), key=apart, default=None)


def _between(upper: float, lower: float) -> np.ndarray:
    """A smooth closed curve whose top and bottom lie at the two angles: a sine of a warped angle."""
    knots = np.array([upper - 2 * np.pi, lower - 2 * np.pi, upper, lower, upper + 2 * np.pi, lower + 2 * np.pi])
    from scipy.interpolate import PchipInterpolator  # noqa: PLC0415

    return np.asarray(np.cos(PchipInterpolator(knots, np.pi * np.arange(6))(PHI)))


def test_turns_of_the_simulated_lap_are_those_of_the_nominal_path():
    table, rig = _table()
    circle = circle_of(rig)
    nominal = reversals(circle, arm_of(rig.robot), "t")
    found = turns(laps_of(table, rig, "t"))
    assert len(nominal) == 10
    for reversal in nominal:
        turn = _nearest(found, reversal)
        assert turn is not None, reversal
        assert abs(np.degrees(angle_difference(turn.phi, reversal.phi))) < 0.3, (reversal, turn)


def distance(rig: Rig, direction: Direction, seed: int | None, effects: list[Effect]) -> LapCurve:
    laps = laps_of(simulate(rig, "yaw", direction, seed, effects), rig, direction)
    return curve_of(reduced(laps), lambda g_mm: g_mm.mean(axis=-1), 1.0)


@pytest.mark.parametrize("lag_s", [0.005, -0.02, 0.0])
def test_lag_is_found_without_other_reversals(lag_s):
    rig = load_hidden("ur10e-cell").apply_to(load("ur10e-cell")[0])
    effects: list[Effect] = [TimeLag(effect="time_lag", lag_s=lag_s)] if lag_s else []
    acw, cw = (distance(rig, direction, None, effects) for direction in ("acw", "cw"))
    found = lag_of([(acw, cw)], [1.0], 100)
    assert found.value == pytest.approx(1e3 * lag_s, abs=0.2)
    assert 1 < found.u < 60  # a different run never meets the ball at quite the same place
