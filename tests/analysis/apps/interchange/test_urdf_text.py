"""URDF of an arm, checked with an independent reader, and the file for the UR driver, checked with its own xacro."""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from pytransform3d.urdf import UrdfTransformManager
from scipy.spatial.transform import Rotation

from analysis.apps.interchange.driver_kinematics import LINKS, ur_driver_text
from analysis.apps.interchange.urdf import import_urdf
from analysis.apps.interchange.urdf_text import urdf_text
from analysis.correction.work import tool_poses
from analysis.robot.description.rig_section import flange_poses
from analysis.robot.description.ur_calibration import NOT_THE_CONTROLLERS
from analysis.robot.kinematics.arm import arm_of
from analysis.robot.predict import geometric_arm, model_of
from rigs.arms import arm_names, load_arm
from rigs.rig import Rig
from tests.support.changed_arms import changed, require_equal, within_limits
from tests.support.refusals import refused

COUPLED = [
    name for name in arm_names() if np.count_nonzero(load_arm(name).robot.coupling) > len(load_arm(name).robot.axes)
]
PLAIN = [name for name in arm_names() if name not in COUPLED]
STANDING = [(name, False) for name in PLAIN]
URS = [name for name in PLAIN if name.startswith("ur")]


def origin(xyz: list[float], rpy: list[float]) -> np.ndarray:
    """Frame (4, 4) of a URDF origin."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_euler("xyz", rpy).as_matrix(), xyz
    return T


def written(rig: Rig) -> str:
    return urdf_text(rig.robot, geometric_arm(model_of(rig)), "cell.yaml")


def test_library_contains_coupled_and_uncoupled_arms():
    assert len(PLAIN) >= 12
    assert COUPLED


@pytest.mark.parametrize(("name", "rail"), [*STANDING, ("ur10e", True)])
def test_an_independent_reader_gives_the_poses_of_the_model(name, rail):
    rig = changed(name, rail=rail)
    q = within_limits(rig)
    expected = tool_poses(model_of(rig), q)
    moved = np.linalg.norm(expected[:, :3, 3] - tool_poses(model_of(rig, ()), q)[:, :3, 3], axis=1)
    assert moved.min() > 0.1  # the effects do something
    library = UrdfTransformManager()
    library.load_urdf(written(rig))
    poses = []
    for angles in q:
        for joint, angle in zip([*(axis.name for axis in rig.robot.axes), *["rail"] * rail], angles, strict=True):
            library.set_joint(joint, angle)
        poses.append(library.get_transform("tool", "world"))
    found = np.array(poses)
    found[:, :3, 3] *= 1000
    require_equal(found, expected)


@pytest.mark.parametrize(("name", "rail"), [*STANDING, ("ur10e", True)])
def test_reimported_arm_has_the_same_poses_limits_and_masses(name, rail, tmp_path):
    rig = changed(name, seed=1, rail=rail)
    file = tmp_path / "arm.urdf"
    file.write_text(written(rig))
    again = import_urdf(file).section.robot
    assert (again.rail and again.rail.limits_mm) == (rig.robot.rail and rig.robot.rail.limits_mm)
    q = within_limits(rig)
    found = flange_poses(again, q)
    np.testing.assert_allclose(found, tool_poses(model_of(rig), q), atol=1e-9, rtol=0)
    for axis, own in zip(again.axes, rig.robot.axes, strict=True):
        assert axis.name == own.name
        assert axis.limits_deg == pytest.approx(own.limits_deg, abs=1e-9)
        assert axis.speed_deg_s == pytest.approx(own.speed_deg_s, abs=1e-9)
    masses = [axis.mass_kg for axis in rig.robot.axes]
    assert [axis.mass_kg for axis in again.axes] == pytest.approx([*masses[:-1], masses[-1] + rig.robot.payload_kg])


@pytest.mark.parametrize("name", COUPLED)
def test_coupled_arm_is_rejected(name):
    rig = changed(name)
    with refused("output.invalid", "different ratio, which a URDF cannot"):
        written(rig)


def test_unequal_joint_ratio_is_rejected():
    arm = arm_of(load_arm("ur5e").robot)
    with refused("output.invalid", "different ratio, which a URDF cannot"):
        urdf_text(load_arm("ur5e").robot, replace(arm, coupling=np.diag([1, 1, 1, 1, 2.0, 1])), "cell.yaml")


def named(name: str, robot_name: str = "arm") -> str:
    robot = load_arm("ur5e").robot
    axes = (robot.axes[0].model_copy(update={"name": name}), *robot.axes[1:])
    robot = robot.model_copy(update={"axes": axes, "name": robot_name})
    return urdf_text(robot, arm_of(robot), "cell.yaml", ["a -- b --- c"])


def test_names_are_escaped():
    name = """<a & "b'>"""
    root = ElementTree.fromstring(named(name, name).encode())  # noqa: S314
    assert root.get("name") == name
    assert root.findall("joint")[1].get("name") == name


@pytest.mark.parametrize("name", ["", " ", "a\nb", "a\x1bb", "a\ud800b", "shoulder", "flange-tool"])
def test_invalid_names_are_rejected(name):
    with refused("output.invalid"):
        named(name)


def driver_poses(text: str, q: np.ndarray) -> np.ndarray:
    """Poses (n, 4, 4) in mm of tool0 in the frame `base`, as the xacro of ur_description computes them."""
    kinematics = yaml.safe_load(text)["kinematics"]
    poses = []
    for angles in q:
        half = origin([0, 0, 0], [0, 0, np.pi])
        T = half  # base_link to base_link_inertia
        for link, angle in zip(LINKS, angles, strict=True):
            one = kinematics[link]
            T = T @ origin([one[key] for key in "xyz"], [one[key] for key in ("roll", "pitch", "yaw")])
            T = T @ origin([0, 0, 0], [0, 0, angle])
        flange = origin([0, 0, 0], [0, -np.pi / 2, -np.pi / 2])
        tool0 = origin([0, 0, 0], [np.pi / 2, 0, np.pi / 2])
        T = np.linalg.inv(half) @ T @ flange @ tool0  # base_link to base
        T[:3, 3] *= 1000
        poses.append(T)
    return np.array(poses)


@pytest.mark.parametrize("name", URS)
def test_driver_file_gives_the_poses_of_the_model_without_base_and_tool(name):
    assert set(URS) >= {"ur3e", "ur5e", "ur10e"}
    rig = changed(name)
    arm = geometric_arm(model_of(rig))
    q = within_limits(rig)
    outer, inner = np.linalg.inv(arm.T_world_base), np.linalg.inv(arm.T_flange_tool)
    expected = outer @ tool_poses(model_of(rig), q) @ inner
    require_equal(driver_poses(ur_driver_text(arm, "cell.yaml"), q), expected)


PUBLISHED = """
kinematics:
  shoulder: {x: 0, y: 0, z: 0.1625, roll: 0, pitch: 0, yaw: 0}
  upper_arm: {x: 0, y: 0, z: 0, roll: 1.570796327, pitch: 0, yaw: 0}
  forearm: {x: -0.425, y: 0, z: 0, roll: 0, pitch: 0, yaw: 0}
  wrist_1: {x: -0.3922, y: 0, z: 0.1333, roll: 0, pitch: 0, yaw: 0}
  wrist_2: {x: 0, y: -0.0997, z: 0, roll: 1.570796327, pitch: 0, yaw: 0}
  wrist_3: {x: 0, y: 0.0996, z: 0, roll: 1.570796327, pitch: 3.141592653589793, yaw: 3.141592653589793}
"""
"""From ros-industrial/universal_robot, ur_description/config/ur5e/default_kinematics.yaml, commit 6485dfa."""


def test_file_of_a_published_arm_gives_the_published_poses():
    text = ur_driver_text(arm_of(load_arm("ur5e").robot), "cell.yaml")
    q = within_limits(changed("ur5e"))
    np.testing.assert_allclose(driver_poses(text, q), driver_poses(PUBLISHED, q), atol=1e-5, rtol=0)
    assert list(yaml.safe_load(text)["kinematics"]) == [*LINKS, "hash"]
    assert yaml.safe_load(text)["kinematics"]["hash"] == NOT_THE_CONTROLLERS


def test_hash_is_the_one_given_by_the_user():
    arm = arm_of(load_arm("ur5e").robot)
    text = ur_driver_text(arm, "cell.yaml", "calib_12788084448423163542")
    assert yaml.safe_load(text)["kinematics"]["hash"] == "calib_12788084448423163542"
    with refused("output.invalid", "a valid hash of the driver"):
        ur_driver_text(arm, "cell.yaml", "calib_1\nshoulder: 0")


@pytest.mark.parametrize("name", ["abb-irb-120", "kuka-kr-6-r900-2", "staubli-tx2-60"])
def test_arms_of_other_makers_are_rejected(name):
    with refused("output.invalid", "the arm do not match calibration"):
        ur_driver_text(arm_of(load_arm(name).robot), "cell.yaml")
