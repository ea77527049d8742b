import numpy as np
import pytest

from analysis import calibrate, calibrated_arm
from analysis.apps.programs.compensated import ahead_of_plays, targets_of
from analysis.apps.programs.planned import plans_of
from analysis.correction.corrected_targets import corrected
from analysis.correction.pose_uncertainty import places_u_mm
from analysis.correction.support import known_plays, supports
from analysis.correction.work import spread_angles, tool_poses
from analysis.robot.kinematics.arm import arm_of, forward
from analysis.robot.predict import model_of
from rigs.calibration import TIMES, CovarianceParameter, ModelAssessment, PlacedSetUp, Term, packed_factor
from rigs.effects import Backlash, Compliance, Effect, size_field
from rigs.errors import FileError
from rigs.load import load
from rigs.rig import Rig
from tests.support.changed_arms import changed, within_limits
from tests.support.handmade_calibration import NAMED, calibrated_model, written
from tests.support.pose_runs import pose_run
from tests.worlds.arms.independent_arm import cell, healthy

SOFT = Compliance(axis=2, deg_per_Nm=5e-4)


@pytest.mark.parametrize("name", ["ur10e", "franka-fr3", "so-101"])
def test_angles_of_poses_lead_back_to_the_poses(name):
    rig = changed(name)
    rig = rig.model_copy(update={"effects": (*rig.effects, SOFT)})
    arm, q_deg = calibrated_arm(rig), np.degrees(within_limits(rig, 6))
    poses = arm.forward(q_deg)
    np.testing.assert_array_equal(poses.T, tool_poses(model_of(rig), np.radians(q_deg)))
    found = arm.inverse(poses.T, near_deg=q_deg[0])
    assert found.reached.all()
    np.testing.assert_allclose(arm.forward(found.q_deg).T, poses.T, atol=2e-6)
    nearest = 1e-6 if len(rig.robot.axes) == 6 else 0.01  # of seven axes no posture is the only one of a pose
    np.testing.assert_allclose(found.q_deg[0], q_deg[0], atol=nearest)
    limits = np.array([axis.limits_deg for axis in rig.robot.axes])
    assert ((found.q_deg >= limits[:, 0] - 1e-6) & (found.q_deg <= limits[:, 1] + 1e-6)).all()


def test_a_pose_beyond_the_reach_has_no_angles():
    arm = calibrated_arm("ur10e")
    far = np.eye(4)
    far[:3, 3] = [5000.0, 0.0, 0.0]
    found = arm.inverse(far[None])
    assert not found.reached.any()
    assert np.isnan(found.q_deg).all()
    assert np.isnan(found.u_mm).all()


def test_the_uncertainty_is_that_of_the_calibration_and_of_the_play(tmp_path):
    rig, _ = load(written(tmp_path, calibrated_model())[0])
    q_deg = np.array([[0.0, 0, 0, 0, -30, 0], [30.0, 0, 0, 0, -30, 0]])
    found = calibrated_arm(rig).forward(q_deg)
    assert found.covered.tolist() == [True, True]
    without_play = calibrated_arm(rig.model_copy(update={"effects": ()})).forward(q_deg)
    play = calibrated_arm(rig.model_copy(update={"effects": (Backlash(axis=1, width_deg=0.2),)})).forward(q_deg)
    assert (without_play.u_mm > 0).all()
    assert (without_play.u_mm < found.u_mm).all()
    assert (found.u_mm < play.u_mm).all()


def test_uncertainty_is_unknown_in_unmeasured_regions(tmp_path):
    """Outside the joint angles of the runs, farther from the socket than was judged, and of a model to correct nothing
    by."""
    ball = forward(arm_of(load("paper-fanuc")[0].robot), np.radians([[0.0, 0, 0, 0, -30, 0]]))[0, :3, 3]
    there = np.eye(4)
    there[:3, 3] = -ball
    frames = [tuple(map(tuple, T.tolist())) for T in (there, np.eye(4))]
    touched = {"touch at a, socket A": PlacedSetUp(T_instrument_world=frames[0], T_tool_target=frames[1])}
    nothing = ModelAssessment(
        condition="outside_library", place="used", before_um=9, names_um=9, whole_um=9, handed_um=9, noise_um=1,
        unexplained_um=8,
    )  # fmt: skip
    q_deg = np.array([[0.0, 0, 0, 0, -30, 0], [20.0, 0, 0, 0, -30, 0], [0.0, 0, 0, 0, -60, 0]])
    for k, (changes, known) in enumerate([
        ({}, [True, True, False]),
        ({"setups": touched, "reach_mm": 100.0}, [True, False, False]),
        ({"setups": touched, "reach_mm": 2000.0}, [True, True, False]),
        ({"judged": nothing}, [False, False, False]),
        ({"setups": touched, "reach_mm": 2000.0, "judged": nothing}, [False, False, False]),
    ]):  # fmt: skip
        rig, _ = load(written(tmp_path / str(k), calibrated_model(**changes))[0])
        found = calibrated_arm(rig).forward(q_deg)
        assert found.covered.tolist() == np.isfinite(found.u_mm).tolist() == known
        assert calibrated_arm(rig).inverse(found.T, near_deg=q_deg[0]).covered.tolist() == known
        far = [words for words in corrected(rig, supports(rig), np.radians(q_deg)).doubts if "touched socket" in words]
        assert [words.split(": ")[1].split()[0] for words in far] == (["2"] if changes.get("reach_mm") == 100 else [])


def test_invalid_frame_or_posture_is_refused():
    arm = calibrated_arm("ur10e")
    for T in (np.zeros((1, 4, 4)), np.diag([1.0, 1, -1, 1])[None], np.eye(3)[None], np.full((1, 4, 4), np.nan)):
        with pytest.raises(FileError, match=r"^T: "):
            arm.inverse(T)
    for q_deg in (np.zeros((2, 5)), np.zeros(5), np.full((1, 6), np.inf)):
        with pytest.raises(FileError, match="q_deg"):
            arm.forward(q_deg)


def test_five_axis_arm_reaches_the_place_and_reports_the_turn():
    """Upright at a place where its wrist only leans: the tool is there, turned by what the arm has no axis for."""
    rig = changed("widowx-250")
    arm = calibrated_arm(rig)
    wanted = arm.forward(np.array([[20.0, 10, 20, 30, 40]])).T
    assert arm.inverse(wanted).turned_deg[0] == 0.0
    leaning = wanted.copy()
    leaning[0, :3, :3] = leaning[0, :3, :3] @ [[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    found = arm.inverse(leaning)
    assert found.reached[0]
    there = arm.forward(found.q_deg).T
    np.testing.assert_allclose(there[0, :3, 3], leaning[0, :3, 3], atol=1e-5)
    angle = np.arccos((np.trace(there[0, :3, :3].T @ leaning[0, :3, :3]) - 1) / 2)
    assert found.turned_deg[0] == pytest.approx(np.degrees(angle), abs=1e-4)
    assert found.turned_deg[0] > 1


U_DEG = 0.001
USUAL = Backlash(axis=5, width_deg=0.004)
"""Certain, 4 u, and no wider than the gears of a sound arm are."""
UNSURE = Backlash(axis=2, width_deg=0.0015)
SMALL = Backlash(axis=4, width_deg=0.01)
"""One of the many small terms, of which a calibration knows how many times of it the arm shows, and no width."""


def calibrated(*plays: Effect) -> Rig:
    """A rig file that names `NAMED`, and beside it a calibration of other plays with widths and of a small one."""
    terms = (
        Term(effect=NAMED, times=1.0, named=True),
        *(Term(effect=play, times=1.0) for play in plays),
        Term(effect=SMALL, times=1.0),
    )
    fields = [*(size_field(term.effect) for term in terms[:-1]), TIMES]
    parameters = tuple(CovarianceParameter(term=k, field=name) for k, name in enumerate(fields))
    model = calibrated_model(terms=terms, parameters=parameters, factor=packed_factor(U_DEG * np.eye(len(parameters))))
    rig, _ = load("paper-fanuc")
    return rig.model_copy(update={"effects": (NAMED,)}).with_calibration(None, model)


def test_certain_usual_play_is_taken_from_the_calibration():
    assert known_plays(calibrated(USUAL, UNSURE)) == (NAMED, USUAL)  # the named play once, though both files have it


def test_its_joint_is_commanded_further_by_half_its_width():
    rig = calibrated(USUAL)
    plan = plans_of(rig, "yaw", 1.0)[0]
    assert len(ahead_of_plays(rig, plan)) == len(targets_of(plan))
    ahead_deg = np.degrees(ahead_of_plays(rig, plan))
    assert np.abs(ahead_deg[:, 4]).max() == pytest.approx(USUAL.width_deg / 2, rel=1e-6)
    assert not ahead_deg[:, [1, 3]].any()  # the joints of which no play is known stay
    assert not ahead_of_plays(calibrated(), plan)[:, 4].any()


def test_uncertainty_in_a_taught_frame_does_not_depend_on_a_test_that_was_not_driven(tmp_path):
    file, _ = written(tmp_path)
    rig, q_deg = load(str(file))[0], np.full((1, 6), 10.0)
    without = rig.model_copy(update={"tests": rig.tests.model_copy(update={"circle": None, "hemisphere": None})})
    first, second = (calibrated_arm(one.calibrated_as(rig)).forward(q_deg) for one in (rig, without))
    np.testing.assert_allclose(first.u_frame_mm, second.u_frame_mm)
    assert 0 < first.u_frame_mm[0] < first.u_mm[0]


def test_posture_that_selects_a_solution_is_named():
    rig, _ = load("paper-fanuc")
    stated = rig.model_copy(update={"robot": rig.robot.model_copy(update={"posture_deg": (0, 20, 10, 0, 60, 0)})})
    arm = calibrated_arm(stated)
    T = arm.forward([5, 25, 10, 5, 55, 5]).T
    found = arm.inverse(T)
    np.testing.assert_allclose(found.near_deg, [[0, 20, 10, 0, 60, 0]])
    np.testing.assert_allclose(found.q_deg[0], [5, 25, 10, 5, 55, 5], atol=1e-6)
    assert arm.inverse(T, near_deg=[0, 20, 10, 180, -60, 180]).q_deg[0][4] < 0


def test_frame_of_few_poses_is_taught_at_the_measured_postures():
    rng = np.random.default_rng(5)
    arm = cell("ur10e", healthy(rng), rng)
    # Clusters: no pose lies near most corners of the range of the joints.
    middles = np.radians([[-60.0, -100, 100, -90, -60, 0], [0, -70, 70, 0, 60, 90], [70, -120, 130, 90, -90, -120]])
    q = np.concatenate([middle + rng.uniform(-0.35, 0.35, (10, 6)) for middle in middles])
    seen = arm.seen(q, rng)
    calibrated = calibrate(pose_run("ur10e", seen.q, seen.xyz_mm)).calibrated_arm()
    few, many = calibrated.forward(np.degrees(q[::7])), calibrated.forward(np.degrees(q))
    np.testing.assert_allclose(few.u_frame_mm, many.u_frame_mm[::7], rtol=0.5)
    spread = spread_angles(calibrated.rig, np.radians(calibrated.rig.calibrated.joints_deg))
    at_corners = places_u_mm(calibrated.rig, calibrated._pose_uncertainty, q[::7], spread)[1]
    assert (few.u_frame_mm < 0.8 * at_corners).all()
