"""Corrections for controllers with constants of their own: known from the beginning, added later, or unknown."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.apps.correct.correct_rig import correct_rig
from analysis.robot.kinematics.arm import Array, controller_arm, forward
from rigs.arms import rig_text_of
from rigs.edit import extended
from rigs.schema.robot import Pose
from tests.support.command_line import ran, succeeded
from tests.support.written_files import JOINTS, PLACES, TURNS, numbers_in, write_columns
from tests.worlds.languages.arms import Cell, cell, chain, choose_controller, solved
from tests.worlds.languages.own_constants import write_ur_calibration

POSTURES = np.radians([[20, -80, 100, -40, 80, 20], [25, -75, 90, -50, 75, 10], [10, -90, 105, -35, 85, 30]])
POSES = (*PLACES, *TURNS)


@pytest.fixture
def here(request):
    """A UR10e with constants of its own in the controller, known to the rig file as the test asks."""
    choose_controller(request.param)
    yield cell("ur")
    choose_controller("data_sheet")


def _file(here: Cell, folder: Path) -> Path:
    """Write the rig file of a library arm, whose controller is not stated, with the effects of a cell."""
    path = folder / "cell.yaml"
    path.write_text(extended(rig_text_of("ur10e"), list(here.rig.effects), "cell"))
    return path


def _off_mm(here: Cell, q: Array, wanted: Array) -> Array:
    return np.asarray(np.linalg.norm((here.flanges(q) - wanted)[:, :3, 3], axis=1))


@pytest.mark.parametrize("here", ["unknown"], indirect=True)
def test_poses_are_corrected_only_with_the_constants_of_the_controller(here, tmp_path):
    rig_file, wanted = _file(here, tmp_path), np.array([chain(here, q)[0] for q in POSTURES])
    turns = Rotation.from_matrix(wanted[:, :3, :3]).as_euler("xyz", degrees=True)
    table = write_columns(tmp_path / "path.csv", POSES, wanted[:, :3, 3], turns)
    refused = ran(f"correct {rig_file} --path {table} -o {tmp_path}/refused --anyway")
    assert (refused.returncode, len(refused.stderr.strip().splitlines())) == (3, 1)
    assert not (tmp_path / "refused").exists()
    constants = tmp_path / "my_robot_calibration.yaml"
    write_ur_calibration(constants)
    near = ",".join(map(str, np.degrees(POSTURES[0]).round(3)))
    succeeded(f"correct {rig_file} --path {table} --near {near} --calibration {constants} -o {tmp_path}/out")
    q = []
    for row, near in zip(numbers_in(tmp_path / "out" / "corrected-path.csv", *POSES), POSTURES, strict=True):
        sent = np.eye(4)
        sent[:3, :3], sent[:3, 3] = Rotation.from_euler("xyz", row[3:], degrees=True).as_matrix(), row[:3]
        q.append(solved(here, sent, near))
    assert _off_mm(here, np.array(q), wanted).max() < 0.02
    assert _off_mm(here, POSTURES, wanted).min() > 0.5


@pytest.mark.parametrize("here", ["unknown"], indirect=True)
def test_joint_targets_are_corrected_without_the_constants_and_get_no_poses(here, tmp_path):
    table = write_columns(tmp_path / "path.csv", JOINTS, np.degrees(POSTURES))
    succeeded("correct", _file(here, tmp_path), "--path", table, "-o", tmp_path / "out")
    corrected = tmp_path / "out" / "corrected-path.csv"
    wanted = np.array([chain(here.sheet, q)[0] for q in POSTURES])
    assert _off_mm(here, np.radians(numbers_in(corrected, *JOINTS)), wanted).max() < 0.02
    assert not {*POSES} & {*corrected.read_text().splitlines()[0].split(",")}


@pytest.mark.parametrize("here", ["unknown"], indirect=True)
def test_no_values_are_computed_for_a_controller_with_unknown_constants(here, tmp_path):
    done = ran("correct", _file(here, tmp_path), "--for", "ur", "-o", tmp_path / "out", "--json")
    answer = json.loads(done.stdout)
    assert (done.returncode, answer["controller_arm"], answer["controller"]) == (3, "unknown", None)
    assert not answer["joint_zeros"] and not answer["link_constants"]


@pytest.mark.parametrize("here", ["added"], indirect=True)
def test_values_are_differences_from_the_constants_in_the_controller(here):
    """The small errors of the real arm are to be entered, not the differences of the controller from the data sheet."""
    found = correct_rig(here.rig, None, "ur")
    assert found.at_controller.after_um < found.at_controller.before_um
    large = {(each.axis, each.key): each.delta for each in found.constants if abs(each.delta) > 1e-3}
    assert large == {(3, "a_mm"): pytest.approx(0.4, abs=1e-3)}


@pytest.mark.parametrize("here", ["stated", "added"], indirect=True)
def test_arm_in_the_controller_is_the_chain_of_the_maker(here):
    bare = here.rig.robot.model_copy(update={"tool": Pose(), "base": Pose()})
    of_maker = np.array([chain(here, q)[0] for q in POSTURES])
    np.testing.assert_allclose(forward(controller_arm(bare), POSTURES), of_maker, atol=1e-5)
    assert np.abs(of_maker - [chain(here.sheet, q)[0] for q in POSTURES]).max() > 0.3
