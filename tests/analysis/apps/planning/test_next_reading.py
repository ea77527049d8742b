from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from analysis.apps.planning.next_reading import next_step
from analysis.apps.planning.pose_plan import Pool
from analysis.robot.kinematics.arm import arm_of, forward
from rigs.calibration import packed_factor
from rigs.effects import Effect, JointOffset, LinkGeometry
from rigs.load import load
from tests.support.command_line import ran
from tests.support.handmade_calibration import calibrated_model, written

ERRORS: tuple[tuple[Effect, float], ...] = (
    (JointOffset(axis=3, offset_deg=0.2), 1.0),
    (JointOffset(axis=5, offset_deg=0.2), 1.0),
    (LinkGeometry(axis=3, field="a", delta=1.0), 1.0),
)


def test_choice_is_for_the_targets_and_among_the_possible_poses() -> None:
    moves = np.zeros((3, 4, 3))  # the unknowns of poses 0, 1 and 2; the target 3 shares the second
    moves[0, 0], moves[1, 1], moves[2, 2], moves[1, 3] = 9.0, 3.0, 1.0, 3.0
    flat = moves.reshape(3, 12)
    pool, target = Pool(np.zeros((4, 6)), flat.T @ flat, np.ones(12)), np.array([3])
    assert pool.choose(1).tolist() == [0]
    assert pool.choose(1, target, np.arange(3)).tolist() == [1]
    assert pool.choose(2, target, np.arange(3), first=[2]).tolist() == [2, 1]
    assert pool.u_mm(np.array([1]), target) < pool.u_mm(np.array([0]), target) == pytest.approx(np.sqrt(27))


@pytest.mark.parametrize(("known", "act"), [(1e-3, "correct"), (0.2, "measure")])
def test_readings_end_when_they_change_less_than_a_tenth_of_the_error(tmp_path: Path, known: float, act: str) -> None:
    model = calibrated_model(ERRORS, factor=packed_factor(known * np.diag([1e-3, 1, 1, 1])))
    rig = load(written(tmp_path, model)[0])[0]
    q = np.radians(np.random.default_rng(0).uniform(-25, 25, (20, 6)))
    step = next_step(rig, (q, forward(arm_of(rig.robot), q)))
    assert step.act == act
    assert step.now_mm is not None
    assert step.many_mm <= step.next_mm <= step.corrected_mm < step.now_mm
    assert 0 <= step.of_family < 1
    assert next_step(rig, None).act == "measure"  # the work area is outside the measured region


def test_arm_without_readings_is_measured_first_for_the_given_targets(tmp_path: Path) -> None:
    (tmp_path / "targets.csv").write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n20,-80,90,-100,-90,0\n")
    done = ran("plan", "ur10e", "--next", "--targets", "targets.csv", "--json", cwd=tmp_path)
    found = json.loads(done.stdout)
    assert (found["act"], found["now_mm"], found["of_family"]) == ("measure", None, 1.0)
    assert len(found["q_deg"]) == 6
    assert found["many_mm"] < found["next_mm"] < found["corrected_mm"]
    wrong = ran("plan", "ur10e", "--targets", "targets.csv", "--json", cwd=tmp_path)
    assert json.loads(wrong.stderr)["error"]["code"] == "plan.option"
