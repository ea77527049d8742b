"""A UR's calibration.conf, against a product of classic Denavit-Hartenberg steps with its differences added.

The lists of tests/support/calibrations are of real arms, a UR3 and a UR5 of the first series, as their owners published
them in questions (MyRobotLab/pyrobotlab issue 145, ros-industrial-attic/ur_modern_driver issue 179). They are put on a
UR3e and a UR5e here: the arithmetic is the same.
"""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from analysis.robot.description.rig_section import flange_poses
from analysis.robot.description.ur_calibration import factory_constants
from rigs.arms import load_arm
from rigs.errors import FileError
from tests.support.second_sources import Numbers, classic

FILES = Path(__file__).parents[3] / "support" / "calibrations"
GOOD = (FILES / "ur3.conf").read_text()
PUBLISHED = {
    "ur3e": ("ur3.conf", (0, -243.55, -213.2, 0, 0, 0), (151.85, 0, 0, 131.05, 85.35, 92.1)),
    "ur5e": ("ur5.conf", (0, -425, -392.2, 0, 0, 0), (162.5, 0, 0, 133.3, 99.7, 99.6)),
}
"""By arm: the file that is put on it, and its classic a and d as published, in mm."""


def classic_rows(file: Path, a: Numbers, d: Numbers) -> list[Numbers]:
    """theta (degrees), d, a (mm), alpha (degrees) with the differences of a file (rad, m)."""

    def differences(name: str) -> list[float]:
        found = re.search(rf"delta_{name} = \[(.*)\]", file.read_text())
        assert found
        return [float(word) for word in found.group(1).split(",")]

    alpha = np.degrees(np.array([np.pi / 2, 0, 0, np.pi / 2, -np.pi / 2, 0]) + differences("alpha"))
    own_a, own_d = np.array(a) + 1000 * np.array(differences("a")), np.array(d) + 1000 * np.array(differences("d"))
    return list(zip(np.degrees(differences("theta")), own_d, own_a, alpha, strict=True))


def conf(folder: Path, text: str) -> Path:
    file = folder / "calibration.conf"
    file.write_text(text)
    return file


@pytest.mark.parametrize("name", PUBLISHED)
def test_the_section_is_the_calibrated_arm(name):
    file, a, d = PUBLISHED[name]
    found = factory_constants(load_arm(name).robot, FILES / file)
    own = load_arm(name).robot.model_copy(update={"axes": found.axes})
    assert all(abs(axis.d_mm) < 1000 and abs(axis.a_mm) < 1000 for axis in found.axes)
    q = np.random.default_rng(7).uniform(-2 * np.pi, 2 * np.pi, (1000, 6))
    # The rounding of radians to degrees and back, and of lengths of 278 m, is part of the reference here.
    np.testing.assert_allclose(flange_poses(own, q), classic(classic_rows(FILES / file, a, d))(q), atol=2e-9, rtol=0)
    assert 0.1 < found.moved_mm < 50
    assert found.notes == ()


def test_no_differences_are_the_published_arm(tmp_path):
    lists = "\n".join(f"delta_{name} = [0, 0, 0, 0, 0, 0]" for name in ("theta", "a", "d", "alpha"))
    found = factory_constants(load_arm("ur10e").robot, conf(tmp_path, f"[mounting]\n{lists}\ncalibration_status = 0\n"))
    assert found.moved_mm < 1e-9
    assert len(found.notes) == 1 and found.notes[0].startswith("calibration_status is 0")
    for own, nominal in zip(found.axes, load_arm("ur10e").robot.axes, strict=True):
        assert abs(own.a_mm) == pytest.approx(abs(nominal.a_mm), abs=1e-9)
        assert own.beta_deg == 0


FRAMES = """\
kinematics:
  shoulder: {x: 0.0, y: 0.0, z: 0.1625, roll: 0.0, pitch: 0.0, yaw: 0.0}
  upper_arm: {x: 0.0, y: 0.0, z: 0.0, roll: 1.570796327, pitch: 0.0, yaw: 0.0}
  forearm: {x: -0.425, y: 0.0, z: 0.0, roll: 0.0, pitch: 0.0, yaw: 0.0}
  wrist_1: {x: -0.3922, y: 0.0, z: 0.1333, roll: 0.0, pitch: 0.0, yaw: 0.0}
  wrist_2: {x: 0.0, y: -0.0997, z: 0.0, roll: 1.570796327, pitch: 0.0, yaw: 0.0}
  wrist_3: {x: 0.0, y: 0.0996, z: 0.0, roll: 1.570796326589793, pitch: 3.141592653589793, yaw: 3.141592653589793}
  hash: calib_1
"""
"""The data sheet of a UR5e as the driver's default YAML has it: each frame relative to the one before."""


def ros_yaml(folder: Path, frames: object) -> Path:
    file = folder / "my_robot_calibration.yaml"
    file.write_text(yaml.safe_dump(frames, sort_keys=False))
    return file


def test_default_yaml_of_the_driver_is_the_data_sheet(tmp_path):
    assert factory_constants(load_arm("ur5e").robot, ros_yaml(tmp_path, yaml.safe_load(FRAMES))).is_data_sheet


def test_yaml_with_own_frames_gives_their_chain(tmp_path):
    rng, frames = np.random.default_rng(3), yaml.safe_load(FRAMES)
    for row in frames["kinematics"].values():
        if isinstance(row, dict):
            row.update({key: row[key] + rng.normal(0, 0.0005 if key in "xyz" else 0.003) for key in row})
    frames["kinematics"]["shoulder"] |= {"x": 0.0, "y": 0.0, "roll": 0.0, "pitch": 0.0}
    found = factory_constants(load_arm("ur5e").robot, ros_yaml(tmp_path, frames))
    q = rng.uniform(-np.pi, np.pi, (200, 6))
    expected = np.broadcast_to(np.eye(4), (200, 4, 4))
    for row, angle in zip(list(frames["kinematics"].values())[:6], q.T, strict=True):
        link = np.eye(4)
        link[:3, :3] = Rotation.from_euler("xyz", [row["roll"], row["pitch"], row["yaw"]]).as_matrix()
        link[:3, 3] = 1000 * np.array([row["x"], row["y"], row["z"]])
        turn = np.zeros((200, 4, 4))
        turn[:, 3, 3] = 1
        turn[:, :3, :3] = Rotation.from_euler("z", angle[:, None]).as_matrix()
        expected = expected @ link @ turn
    own = load_arm("ur5e").robot.model_copy(update={"axes": found.axes})
    np.testing.assert_allclose(flange_poses(own, q), expected, atol=1e-8, rtol=0)
    assert not found.is_data_sheet


@pytest.mark.parametrize(
    "damage",
    [
        lambda frames: frames["kinematics"].pop("hash"),
        lambda frames: frames["kinematics"].pop("wrist_3"),
        lambda frames: frames["kinematics"]["forearm"].pop("yaw"),
        lambda frames: frames["kinematics"]["forearm"].update(x="long"),
        lambda frames: frames["kinematics"].update(hash="rig_not_of_the_controller"),
        lambda frames: frames.update(kinematics=[1, 2]),
        lambda frames: frames["kinematics"]["upper_arm"].update(x=0.02),
    ],
)
def test_damaged_yaml_is_refused_in_one_line(damage, tmp_path):
    frames = yaml.safe_load(FRAMES)
    damage(frames)
    with pytest.raises(FileError) as refused:
        factory_constants(load_arm("ur5e").robot, ros_yaml(tmp_path, frames))
    assert len(refused.value.lines()) == 1


@pytest.mark.parametrize("name", ["ur5", "ur3e"])
def test_file_of_another_type_of_arm_is_refused(name, tmp_path):
    with pytest.raises(FileError) as refused:
        factory_constants(load_arm(name).robot, ros_yaml(tmp_path, yaml.safe_load(FRAMES)))
    assert "ur5e" in refused.value.what


BAD = {
    "no section": (GOOD.replace("[mounting]", "[base]"), "has no section [mounting]"),
    "no list": (GOOD.replace("delta_alpha", "alpha"), "has no delta_alpha"),
    "five": (re.sub(r"delta_a = \[[^,]*,", "delta_a = [", GOOD), "delta_a is not a list of six numbers"),
    "nan": (re.sub(r"delta_a = \[[^,]*,", "delta_a = [NaN,", GOOD), "delta_a is not a list of six numbers"),
    "huge": (re.sub(r"delta_a = \[[^,]*,", "delta_a = [1" + "0" * 400 + ",", GOOD), "delta_a is not a list of six"),
    "1e308": (re.sub(r"delta_a = \[[^,]*,", "delta_a = [1e308,", GOOD), "delta_a is not a list of six numbers"),
    "100 km": (re.sub(r"delta_a = \[[^,]*,", "delta_a = [1e5,", GOOD), "correct it: the units are metres and radians"),
    "words": (re.sub(r"delta_a = .*", "delta_a = small", GOOD), "delta_a is not a list of six numbers"),
    "nested": (re.sub(r"delta_a = .*", "delta_a = " + "[" * 50_000, GOOD), "delta_a is not a list of six numbers"),
    "no header": (GOOD.replace("[mounting]\n", ""), "contains no section headers"),
    "twice": (GOOD + "calibration_status = 0\n", "already exists"),
    "large": (GOOD + "#" * 200_000, "is larger than"),
}


@pytest.mark.parametrize("kind", BAD)
def test_a_bad_file_is_refused_in_one_line_with_a_remedy(kind, tmp_path):
    text, what = BAD[kind]
    with pytest.raises(FileError) as refused:
        factory_constants(load_arm("ur3e").robot, conf(tmp_path, text))
    assert what in str(refused.value)
    assert len(refused.value.lines()) == 1


def test_binary_file_is_refused(tmp_path):
    (tmp_path / "calibration.conf").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FileError):
        factory_constants(load_arm("ur3e").robot, tmp_path / "calibration.conf")


def test_an_arm_of_another_maker_has_no_such_file(tmp_path):
    with pytest.raises(FileError):
        factory_constants(load_arm("abb-irb-120").robot, conf(tmp_path, GOOD))
