import numpy as np
import pyarrow as pa
import pytest

from analysis.intake.read import check_sequence, parse_csv
from analysis.procedures.checks.units import unit_findings
from analysis.procedures.simulate import planned_touches, simulated_touches
from analysis.procedures.touch import evaluate
from analysis.robot.kinematics.arm import forward
from analysis.robot.predict import model_of
from analysis.runs.joint_turns import without_whole_turns
from analysis.runs.tables import TouchTable, columns_of
from rigs.arms import load_arm
from rigs.errors import FileError
from rigs.load import parse
from rigs.rig import Rig
from tests.support.refusals import refused

TOUCH = "tests: {touch: {sockets: [A, B], ball_mm: [5, 3, 90], touches: 30, distances: [DISTANCE]}}"


def rig_with(distance_mm: float, arm: str = "kuka-lbr-iiwa-14") -> Rig:
    known = f"{{between: [A, B], distance_mm: {distance_mm}, u_mm: 0.05}}"
    return parse(f"name: cell\n{load_arm(arm).text}{TOUCH.replace('DISTANCE', known)}\n", "cell.yaml")


RIG = rig_with(50.0)
MODEL = model_of(RIG)


@pytest.fixture(scope="module")
def touches():
    return planned_touches(RIG)


def test_an_arm_without_errors_has_its_ball_in_the_sockets(touches):
    found = evaluate(touches, MODEL)
    assert found.figures["rms_mm"].value < 1e-5
    np.testing.assert_allclose(found.ball_mm, (5, 3, 90), atol=1e-4)


def test_the_figures_are_those_by_hand(touches):
    off_deg = np.random.default_rng(1).normal(0, 0.05, touches.q.shape)
    table = TouchTable(touches.socket, touches.q + np.radians(off_deg))
    found = evaluate(table, MODEL)
    T = forward(MODEL.arm, table.q)
    ball = T[:, :3, 3] + T[:, :3, :3] @ found.ball_mm
    away = np.concatenate([
        np.linalg.norm(ball[table.socket == one] - ball[table.socket == one].mean(axis=0), axis=1) for one in "AB"
    ])  # fmt: skip
    assert found.figures["rms_mm"].value == pytest.approx(np.sqrt(np.mean(away**2)), rel=1e-6)
    assert found.figures["max_mm"].value == pytest.approx(away.max(), rel=1e-6)
    worst = max(2 * np.sqrt(np.sum(own**2) / (len(own) - 1)) for own in (away[:15], away[15:]))
    assert found.figures["spat_mm"].value == pytest.approx(worst, rel=1e-6)
    places = [ball[table.socket == one].mean(axis=0) for one in "AB"]
    assert found.figures["socket_distance_mm"].value == pytest.approx(np.linalg.norm(places[0] - places[1]), abs=1e-4)


def test_distance_known_otherwise_is_reported(touches):
    found = evaluate(touches, model_of(rig_with(51.0)))
    assert any("sockets A and B are 51.000 ± 0.050 mm apart, but 50.0" in note for note in found.notes)
    assert not any("apart" in note for note in evaluate(touches, MODEL).notes)


@pytest.mark.parametrize(
    ("rows", "code"), [(slice(0, 4), "readings.too_few"), (np.zeros(12, dtype=int), "readings.unsuitable")]
)
def test_touches_that_show_nothing_are_refused(touches, rows, code):
    with refused(code):
        evaluate(TouchTable(touches.socket[rows], touches.q[rows]), MODEL)


@pytest.mark.parametrize(
    ("header", "row", "what"),
    [
        ("socket,q1_deg", "A,1", "q7_deg"),
        ("socket," + ",".join(f"q{k}_deg" for k in range(1, 8)) + ",q1_from_deg", "A" + ",1" * 8, "q1_from_deg only"),
        ("socket," + ",".join(f"q{k}_deg" for k in range(1, 8)), "" + ",1" * 7, "socket: is empty"),
        ("socket," + ",".join(f"q{k}_deg" for k in range(1, 8)), "A" * 41 + ",1" * 7, "not a name of a socket"),
    ],
)
def test_bad_touch_table_names_the_mistake(header, row, what):
    with pytest.raises(FileError) as caught:
        parse_csv(f"{header}\n{row}\n".encode(), "t.csv", "touch", RIG)
    assert what in "\n".join(caught.value.lines())


def test_simulated_sockets_have_the_distances_that_are_known():
    known = (
        "[{between: [A, B], distance_mm: 50}, {between: [A, C], distance_mm: 80}, {between: [B, C], distance_mm: 60}]"
    )
    text = f"name: cell\n{load_arm('ur5').text}tests: {{touch: {{sockets: [A, B, C], distances: {known}}}}}\n"
    rig = parse(text, "cell.yaml")
    found = evaluate(planned_touches(rig), model_of(rig))
    assert [one.distance.value for one in found.distances] == pytest.approx([50, 80, 60], abs=1e-3)
    with refused("rig_file.invalid", "for a socket with enough postures"):
        planned_touches(rig_with(9000.0, "ur5"))


@pytest.mark.parametrize("arm", ["ur10e", "kuka-kr-6-r900-2"])
def test_simulated_touches_stay_within_a_turn_of_each_joint(arm):
    rig = rig_with(50.0, arm)
    table = simulated_touches(rig, 3)
    assert np.ptp(table.q, axis=0).max() < 2 * np.pi
    assert without_whole_turns(table, rig) == (table, ())


def test_touches_in_radians_and_joints_that_the_arm_has_not_are_refused(touches):
    assert not list(unit_findings(touches, RIG))
    (finding,) = unit_findings(TouchTable(touches.socket, np.radians(touches.q)), RIG)
    assert finding.strength == "impossible" and "radians" in finding.what
    six = parse(f"name: cell\n{load_arm('ur5').text}{TOUCH.replace('DISTANCE', '')}\n", "cell.yaml")
    columns = columns_of(touches)
    lines = np.arange(2, 2 + columns.num_rows)
    named = dict(zip(columns.column_names, columns.columns, strict=True))
    (problem,) = check_sequence(named, lines, "touch", six, None)
    assert "7 joints" in str(problem)
    renamed = named | {"socket": pa.chunked_array([["Z", *columns["socket"].to_pylist()[1:]]])}
    (problem,) = check_sequence(renamed, lines, "touch", RIG, None)
    assert "'Z'" in str(problem)
