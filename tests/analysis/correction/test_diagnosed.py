import json
from dataclasses import replace

import numpy as np
import pytest

import analysis
from analysis.correction.diagnosed import Diagnosis
from rigs.effects import JointOffset
from rigs.load import load
from rigs.schema.robot import identity
from tests.support.changed_rigs import with_robot
from tests.support.handmade_calibration import calibrated_model
from tests.support.handmade_diagnosis import diagnosis
from tests.support.refusals import refused
from tests.worlds.arms.faulty_arm import found as found_by

RIG = "paper-fanuc"
Q_DEG = np.array([[-2.8, 35.8, 7.6, 171.0, 136.6, -5.7], [5.0, 30.0, 10.0, 160.0, 120.0, 10.0]])


@pytest.fixture(scope="module")
def found():
    rig, text = load(RIG)
    return Diagnosis.of(replace(diagnosis(), rig=rig, calibrated=calibrated_model()), text)


def test_saved_model_corrects_as_the_diagnosis_does(found, tmp_path):
    rig_file = found.save(tmp_path / "found")
    saved, arm = analysis.calibrated_arm(rig_file), found.calibrated_arm()
    by_both = [one.correct(Q_DEG).q_deg for one in (arm, saved, analysis.calibrated_arm(found.extended_rig))]
    assert np.abs(by_both[0] - Q_DEG).max() > 1e-3
    for other in by_both[1:]:
        np.testing.assert_allclose(other, by_both[0], atol=1e-6)
    assert json.loads((tmp_path / "found" / "diagnosis.json").read_text())["condition"] == found.condition


def test_poses_and_joints_of_the_same_targets_have_the_same_correction(found):
    arm = found.calibrated_arm()
    T = analysis.calibrated_arm(RIG).forward(Q_DEG).T
    np.testing.assert_allclose(arm.correct(T, near=Q_DEG).q_deg, arm.correct(Q_DEG).q_deg, atol=1e-6)


def test_poses_near_their_own_postures_have_the_uncertainty_of_a_common_frame(found):
    arm = found.calibrated_arm()
    q_deg = np.array([0, 0, 0, 0, -30, 0]) + np.random.default_rng(0).uniform(-2, 2, (14, 6))
    T = analysis.calibrated_arm(RIG).forward(q_deg).T
    by_pose, by_joints = arm.correct(T, near=q_deg), arm.correct(q_deg)
    np.testing.assert_allclose(by_pose.u_frame_mm, by_joints.u_frame_mm, rtol=1e-5)
    assert by_pose.covered.all()
    np.testing.assert_allclose(by_pose.near_deg, q_deg, atol=1e-12)


def test_four_targets_of_an_arm_with_four_axes_are_joint_angles():
    rig = load("so-101")[0]
    rig = with_robot(rig, axes=rig.robot.axes[:4], coupling=identity(4))
    zero = JointOffset(axis=2, offset_deg=0.1, found=found_by(offset_deg=0.01))
    arm = analysis.calibrated_arm(rig.model_copy(update={"effects": (zero,)}))
    corrected = arm.correct(np.tile([10.0, 20, 30, 10], (4, 1))).q_deg
    np.testing.assert_allclose(corrected, np.tile([10.0, 19.9, 30, 10], (4, 1)), atol=1e-6)


def test_what_would_change_nothing_is_refused(found, tmp_path):
    with refused("calibration.missing", "has neither a calibration nor effects,"):
        analysis.calibrated_arm(RIG).correct(Q_DEG)
    for call in (
        replace(found, calibrated=None).calibrated_arm,
        lambda: replace(found, calibrated=None).save(tmp_path),
    ):
        with refused("calibration.missing", "the diagnosis has no calibrated model"):
            call()
    with refused("argument.invalid", "object, so its text is unknown"):
        replace(found, rig_text="").save(tmp_path)
    with refused("argument.invalid", "in degrees or poses"):
        found.calibrated_arm().correct(Q_DEG[:, :3])
    with refused("argument.invalid", "poses, and the targets are joint"):
        found.calibrated_arm().correct(Q_DEG, near=Q_DEG[0])


def test_a_table_given_as_a_run_points_at_read_table(tmp_path):
    (tmp_path / "poses.csv").write_text("q1_deg\n1\n")
    with refused("argument.invalid", "and a run is a directory") as error:
        analysis.diagnose(tmp_path / "poses.csv")
    assert "read_table" in error.value.remedy


def test_results_print_in_a_line(found):
    for one in (found, found.calibrated_arm()):
        assert len(repr(one)) < 150 and RIG in repr(one)
