"""Tables of poses: corrected in the stated posture, and without one only if the posture does not matter.

The real arms are those of `tests.worlds.arms.independent_arm`, with hidden errors that the rig file knows.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from analysis.apps.correct.correct_rig import Corrections, correct_rig
from analysis.correction.table_postures import find_postures, stated_posture
from analysis.robot.kinematics.arm import arm_of, forward, roll_pitch_yaw
from analysis.robot.kinematics.inverse import inverse
from analysis.robot.kinematics.joint_limits import within_limits
from analysis.robot.kinematics.newton import conditioning
from rigs.effects import Effect, JointOffset, LinkGeometry
from rigs.errors import FileError, UseError
from rigs.load import load
from rigs.rig import Rig
from tests.support.nightly import cases
from tests.support.written_files import PLACES, TURNS
from tests.worlds.arms.faulty_arm import flange_at, found, joints_of
from tests.worlds.arms.independent_arm import POSTURE_DEG, Array, Wrong, none

KNOWN_MM = 0.02
"""Twice the uncertainty of the lengths in the rig file. Smaller errors are not corrected."""
ARMS = ("ur10e", "paper-fanuc")


@dataclass(frozen=True)
class Table:
    """A table of poses, and the real arm with hidden errors that drives to them in one posture."""

    rig: Rig
    wrong: Wrong
    q: Array
    """Joint angles (n, 6) rad of the controller at the poses."""
    path: Path

    @property
    def poses(self) -> Array:
        return forward(arm_of(self.rig.robot), self.q)

    def stated(self, option: str) -> Corrections:
        text = ",".join(f"{angle:.3f}" for angle in np.degrees(self.q[0]))
        near, start = (text if option == name else None for name in ("--near", "--start-joints"))
        return correct_rig(self.rig, self.path, posture=stated_posture(self.rig, near, start))

    def error_mm(self, poses: Array) -> Array:
        """Distance (n,) of the real tool from the targets, if the controller is given poses (n, 4, 4) in the world."""
        arm, errors = arm_of(self.rig.robot), []
        for T, wanted, near in zip(poses, self.poses, self.q, strict=True):
            flange = np.linalg.inv(arm.T_world_base) @ T @ np.linalg.inv(arm.T_flange_tool)
            real = arm.T_world_base @ flange_at(self.rig, joints_of(self.rig, flange, near), self.wrong)
            errors.append(np.linalg.norm((real @ arm.T_flange_tool)[:3, 3] - wanted[:3, 3]))
        return np.array(errors)


def known(name: str, effects: tuple[Effect, ...]) -> Rig:
    rig, _ = load(name)
    robot = rig.robot.model_copy(update={"controller": "data_sheet"})
    return rig.model_copy(update={"effects": effects, "robot": robot})


def table(directory: Path, seed: int, count: int = 6) -> Table:
    rng = np.random.default_rng(seed)
    name, wrong = ARMS[seed % 2], none()
    wrong.offset[:], wrong.d[:] = np.radians(rng.normal(0, 0.05, 6)), rng.normal(0, 0.3, 6)
    effects = [JointOffset(axis=k + 1, offset_deg=float(np.degrees(x)), found=found(offset_deg=0.001))
               for k, x in enumerate(wrong.offset)]  # fmt: skip
    effects += [LinkGeometry(axis=k + 1, field="d", delta=float(x), found=found(delta=0.01))
                for k, x in enumerate(wrong.d)]  # fmt: skip
    rig = known(name, tuple(effects))
    arm = arm_of(rig.robot)
    pose = forward(arm, np.radians(POSTURE_DEG[name]) + rng.uniform(-0.2, 0.2, (1, 6)))
    solutions = inverse(arm, pose)
    branches, _ = within_limits(arm, solutions.q[solutions.found])
    branches = branches[(np.abs(branches) < np.pi).all(axis=1)]
    q = branches[rng.integers(len(branches))] + rng.uniform(-0.15, 0.15, (count, 6))
    q = q[(conditioning(arm, q) > 0.05) & (np.abs(q) < arm.limits[:, 1]).all(axis=1)]
    return written(directory, rig, wrong, q)


def written(directory: Path, rig: Rig, wrong: Wrong, q: Array) -> Table:
    T, path = forward(arm_of(rig.robot), q), directory / "poses.csv"
    values = np.hstack([T[:, :3, 3], np.degrees(roll_pitch_yaw(T))])
    np.savetxt(path, values, "%.9f", ",", header=",".join([*PLACES, *TURNS]), comments="")
    return Table(rig, wrong, q, path)


@pytest.mark.parametrize("seed", cases(range(20), {2, 5, 9}))
def test_table_is_right_in_its_real_posture_or_its_targets_are_listed(tmp_path, seed):
    drawn = table(tmp_path, seed)
    before = drawn.error_mm(drawn.poses)
    for option in ("--near", "--start-joints"):
        targets = drawn.stated(option).path[2]
        assert targets.done.all(), option
        assert (drawn.error_mm(targets.T) < KNOWN_MM).all(), option
    try:
        unstated = correct_rig(drawn.rig, drawn.path).path[2]
    except FileError as error:  # no target has the same correction in every posture
        assert error.code == "program.unclear" and "postures" in error.what and "--near" in error.remedy
        return
    after = drawn.error_mm(np.where(unstated.done[:, None, None], unstated.T, drawn.poses))
    assert (after <= before + 2 * np.nan_to_num(unstated.u_frame_mm)).all()
    for left in unstated.left:
        low, high = left.errors_mm
        assert left.reason == "ambiguous" and low - 0.001 <= before[left.place] <= high + 0.001


def test_error_that_is_the_same_in_all_postures_is_corrected_without_a_statement(tmp_path):
    """A wrong zero of axis 1 turns every posture alike about the base."""
    wrong, zero = none(), JointOffset(axis=1, offset_deg=0.05, found=found(offset_deg=0.001))
    wrong.offset[0] = np.radians(zero.offset_deg)
    q = np.radians(POSTURE_DEG["ur10e"]) + np.random.default_rng(0).uniform(-0.2, 0.2, (5, 6))
    drawn = written(tmp_path, known("ur10e", (zero,)), wrong, q)
    made = correct_rig(drawn.rig, drawn.path)
    assert made.path[2].done.all() and len(made.postures.several) == 5
    assert (drawn.error_mm(made.path[2].T) < 1e-3).all() and (drawn.error_mm(drawn.poses) > 0.3).all()


def test_posture_of_the_rig_file_is_used_and_an_option_overrules_it(tmp_path):
    drawn = table(tmp_path, 2)
    degrees = np.degrees(drawn.q[0])
    other = -degrees if degrees[4] > 0 else np.abs(degrees)
    robot = drawn.rig.robot.model_copy(update={"posture_deg": tuple(degrees.tolist())})
    rig = drawn.rig.model_copy(update={"robot": robot})
    assert stated_posture(rig, None, None).source == "rig_file"
    np.testing.assert_allclose(find_postures(rig, drawn.poses, stated_posture(rig, None, None)).q, drawn.q, atol=1e-6)
    text = ",".join(f"{angle:.3f}" for angle in other)
    overruled = stated_posture(rig, text, None)
    assert overruled.source == "--near"
    assert np.abs(find_postures(rig, drawn.poses, overruled).q - drawn.q).max() > 0.5


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ("--near 0,-80,100,-20,80", "must be 6 numbers, one for each joint, but has 5"),
        ("--near here", "must be 6 numbers"),
        ("--near 0,-80,100,-20,80,400", "axis 6 at 400° is beyond the limits -360° and 360°"),
        ("--near 0,-80,100,-20,0,0", "singularity"),
        ("--near 0,-80,100,-20,80,0 --start-joints 0,-80,100,-20,80,0", "both state the posture"),
    ],
)
def test_statement_that_is_no_posture_is_refused(tmp_path, options, problem):
    near, _, start = options.removeprefix("--near ").partition(" --start-joints ")
    with pytest.raises(UseError) as refusal:
        stated_posture(table(tmp_path, 2).rig, near, start or None)
    assert refusal.value.code == "usage"
    assert problem in f"{refusal.value.what}"
