from dataclasses import replace

import numpy as np
import pytest

from analysis.apps.planning import possible_readings as candidates
from analysis.apps.planning.next_reading import decide, next_step, next_touch
from analysis.apps.planning.possible_readings import Reading, possible_readings
from analysis.apps.planning.reading_pool import ReadingPool, as_readings
from analysis.procedures.simulate import planned_touches
from analysis.robot.kinematics.arm import arm_of, forward
from analysis.runs.tables import TouchTable
from rigs.arms import load_arm
from rigs.calibration import packed_factor
from rigs.effects import JointOffset, LinkGeometry
from rigs.load import load, parse
from tests.support.changed_rigs import with_tests
from tests.support.command_line import failure_of, json_of
from tests.support.handmade_calibration import calibrated_model, written

ERRORS = (
    (JointOffset(axis=3, offset_deg=0.2), 1.0),
    (JointOffset(axis=5, offset_deg=0.2), 1.0),
    (LinkGeometry(axis=3, field="a", delta=1.0), 1.0),
)


@pytest.fixture(autouse=True)
def _fewer_candidates(monkeypatch):
    monkeypatch.setattr(candidates, "_POSES", 30)
    monkeypatch.setattr(candidates, "_TOUCHES", 16)


def pool(sizes: tuple[float, ...], minutes: tuple[float, ...]) -> ReadingPool:
    """Poses of which each shows an unknown of its own; the target has the second unknown only."""
    readings = np.zeros((len(sizes), 3, len(sizes)))
    for k, size in enumerate(sizes):
        readings[k, 0, k] = size
    target = np.zeros((3, len(sizes)))
    target[0, 1] = 3.0
    return ReadingPool(readings, target, np.array(minutes))


def test_choice_is_for_the_targets_and_by_the_minute():
    three = pool((9.0, 3.0, 1.0), (1.0, 1.0, 1.0))
    assert three.choose(1).tolist() == [1]
    assert three.choose(2, first=[2]).tolist() == [2, 1]
    assert three.u_mm(np.array([0])) == pytest.approx(3.0)
    assert three.u_mm(np.array([1])) == pytest.approx(np.sqrt(9 / (1 + 9)))
    assert three.gains() == pytest.approx([0.0, 9 * 9 / (1 + 9), 0.0])
    assert three.after(three.readings[1]).u_mm(np.array([], dtype=int)) == pytest.approx(three.u_mm(np.array([1])))
    both = replace(three, targets=np.eye(3))  # the first reading informs most, but takes an hour
    assert both.choose(1).tolist() == [0]
    assert replace(both, minutes=np.array([60.0, 1.0, 1.0])).choose(1).tolist() == [1]


def test_entries_of_zeros_are_no_readings():
    readings = as_readings([np.ones((1, 2)), np.ones((3, 2))])
    assert readings.shape == (2, 3, 2) and readings[0, 1:].tolist() == [[0.0, 0.0], [0.0, 0.0]]


def test_readings_end_when_they_are_not_worth_their_minutes():
    readings = [Reading("pose", minutes, np.zeros(6)) for minutes in (1.5, 1.5)]
    cheap, dear = (decide(pool((3.0, 3.0), (minutes, minutes)), readings, taken=1) for minutes in (1.5, 500.0))
    assert (cheap.act, cheap.worthwhile, cheap.minutes, cheap.taken) == ("measure", 1, 1.5, 1)
    assert (dear.act, dear.worthwhile, dear.minutes) == ("nothing", 0, 0.0)
    assert "decide" in dear.words and "would change" in dear.words


@pytest.mark.parametrize(("known", "act"), [(1e-3, "correct"), (0.2, "measure")])
def test_readings_end_when_they_change_less_than_a_tenth_of_the_error(tmp_path, known, act):
    model = calibrated_model(ERRORS, factor=packed_factor(known * np.diag([1e-3, 1, 1, 1])))
    rig = load(written(tmp_path, model)[0])[0]
    q = np.radians(np.random.default_rng(0).uniform(-25, 25, (20, 6)))
    tracked = with_tests(rig, circle=None).calibrated_as(rig)
    step = next_step(tracked, (q, forward(arm_of(rig.robot), q)))
    assert (step.act, step.reading.kind, step.is_validated) == (act, "pose", True)
    assert step.many_mm <= step.next_mm <= step.corrected_mm < step.now_mm
    assert 0 <= step.of_family < 1


def test_work_area_outside_the_measured_region_is_measured_with_circles(tmp_path):
    model = calibrated_model(ERRORS, factor=packed_factor(0.2 * np.diag([1e-3, 1, 1, 1])))
    step = next_step(load(written(tmp_path, model)[0])[0], None)
    assert (step.act, step.now_mm, step.reading.kind, step.reading.q) == ("measure", None, "circle", None)
    assert step.to_dict()["circle"] in ("100 mm nearer to axis 1", "100 mm lower")
    assert step.many_mm <= step.next_mm <= step.corrected_mm


def test_arm_without_readings_is_measured_first_for_the_given_targets(tmp_path):
    (tmp_path / "targets.csv").write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n20,-80,90,-100,-90,0\n")
    found = json_of("plan ur10e-cell --next --targets targets.csv --tracker 2500,0,800", cwd=tmp_path)
    assert (found["act"], found["now_mm"], found["of_family"]) == ("measure", None, 1.0)
    assert len(found["q_deg"]) == 6
    assert (found["reading"], found["socket"], found["circle"]) == ("pose", None, None)
    assert found["many_mm"] < found["next_mm"] < found["corrected_mm"]
    assert 1 <= found["worthwhile"] <= found["many"] == 20
    assert failure_of("plan ur10e-cell --targets targets.csv", cwd=tmp_path)[1] == "usage"


TOUCHED = parse(f"name: cell\n{load_arm('ur5').text}tests: {{touch: {{sockets: [A, B]}}}}\n", "cell.yaml")


def test_sockets_in_the_rig_file_are_touched():
    readings = possible_readings(TOUCHED)
    assert {(reading.kind, reading.socket) for reading in readings} == {("touch", "A"), ("touch", "B")}
    assert np.abs([reading.q for reading in readings]).max() <= np.pi
    step = next_step(TOUCHED, None)
    assert (step.act, step.reading.kind, step.now_mm) == ("measure", "touch", None)
    assert step.many_mm < step.next_mm < step.corrected_mm


def test_each_touch_leaves_fewer_that_are_worth_their_time():
    touches = planned_touches(TOUCHED)
    steps = [
        next_touch(TOUCHED, TouchTable(touches.socket[:count], touches.q[:count]), "A") for count in (2, len(touches.q))
    ]
    assert (steps[0].act, steps[0].reading.socket) == ("measure", "A")
    assert [step.taken for step in steps if step] == [2, len(touches.q)]
    assert steps[1].worthwhile < steps[0].worthwhile
    assert steps[1].corrected_mm < steps[0].next_mm
