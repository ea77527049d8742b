"""xacro, MJCF and kinematics.yaml of an arm, read by few lines that know the formats and nothing of ours."""

from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from analysis.apps.interchange.driver_kinematics import driver_kinematics
from analysis.apps.interchange.exported_arm import friction_nm, joint_traits, torques_of
from analysis.apps.interchange.mjcf_text import JointTraits, mjcf_text
from analysis.apps.interchange.urdf_text import urdf_text, xacro_text
from analysis.correction.work import tool_poses
from analysis.robot.kinematics.arm import Array
from analysis.robot.predict import geometric_arm, model_of
from analysis.runs.robot_condition import Friction
from rigs.arms import load_arm
from rigs.effects import Backlash, Compliance
from rigs.rig import Rig
from tests.support.changed_arms import changed, require_equal, within_limits
from tests.support.refusals import refused

ARMS = ["ur10e", "franka-fr3"]
TRAITS = JointTraits({2: 0.04}, {3: 2e-3}, {1: 3.5})


def frame(xyz: Array | list[float], turn: Rotation) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = turn.as_matrix(), xyz
    return T


def mjcf_poses(text: str, rig: Rig, q: Array) -> Array:
    """Poses (n, 4, 4) of the site `tool` in mm, with the hinges beside the joints' own at zero."""
    world = ElementTree.fromstring(text.encode()).find("worldbody")  # noqa: S314 - it is ours
    poses = []
    for angles in q:
        turned = dict(zip((axis.name for axis in rig.robot.axes), angles, strict=False))
        T, body = np.eye(4), world
        while (below := body.find("body")) is not None or (below := body.find("site")) is not None:
            place, quat = (np.array(below.get(key).split(), dtype=float) for key in ("pos", "quat"))
            T = T @ frame(place, Rotation.from_quat(quat, scalar_first=True))
            for hinge in below.findall("joint"):
                axis = np.array(hinge.get("axis").split(), dtype=float)
                if hinge.get("type") == "slide":
                    T = T @ frame(angles[-1] * axis, Rotation.identity())
                else:
                    T = T @ frame([0, 0, 0], Rotation.from_rotvec(turned.get(hinge.get("name"), 0.0) * axis))
            body = below
        T[:3, 3] *= 1000
        poses.append(T)
    return np.array(poses)


@pytest.mark.parametrize(("name", "rail"), [*((name, False) for name in ARMS), ("ur10e", True)])
def test_mjcf_has_the_poses_of_the_model(name, rail):
    rig = changed(name, rail=rail)
    q = within_limits(rig)
    text = mjcf_text(rig.robot, geometric_arm(model_of(rig)), TRAITS, "cell.yaml")
    require_equal(mjcf_poses(text, rig, q), tool_poses(model_of(rig), q))


def test_mjcf_has_play_compliance_and_friction_as_given():
    rig = changed("ur10e")
    text = mjcf_text(rig.robot, geometric_arm(model_of(rig)), TRAITS, "cell.yaml")
    hinges = {hinge.get("name"): hinge for hinge in ElementTree.fromstring(text.encode()).iter("joint")}  # noqa: S314
    names = [axis.name for axis in rig.robot.axes]
    assert set(hinges) == {*names, f"{names[1]}_play", f"{names[2]}_compliance"}
    low, high = map(float, hinges[f"{names[1]}_play"].get("range").split())
    assert np.degrees([low, high]) == pytest.approx([-0.02, 0.02], abs=1e-15)
    assert float(hinges[f"{names[2]}_compliance"].get("stiffness")) == pytest.approx(180 / np.pi / 2e-3)
    assert float(hinges[names[0]].get("frictionloss")) == 3.5


def test_plays_and_compliances_of_the_rig_file_are_taken():
    rig = changed("ur10e").model_copy(
        update={"effects": (Backlash(axis=2, width_deg=0.03), Compliance(axis=3, deg_per_Nm=4e-4))}
    )
    assert joint_traits(rig) == JointTraits({2: 0.03}, {3: 4e-4})


def test_friction_is_current_times_torque_for_an_ampere():
    seen = {1: Friction(0.5, 0.1, 4), 3: Friction(0.2, 0.1, 4)}
    assert friction_nm(seen, torques_of("10, 10, 8, 5, 5, 5")) == {1: 5.0, 3: pytest.approx(1.6)}
    with refused("output.invalid", "numbers, but the run shows the"):
        friction_nm(seen, torques_of("10,10"))
    with refused("output.invalid", "a list of torques above zero"):
        torques_of("10,x")


def test_xacro_macro_is_the_urdf_with_prefix_and_parent():
    rig = changed("ur10e")
    arm = geometric_arm(model_of(rig))
    text = xacro_text(rig.robot, arm, "cell.yaml")
    macro = ElementTree.fromstring(text.encode()).find("{http://www.ros.org/wiki/xacro}macro")  # noqa: S314
    assert macro.get("params") == "prefix:='' parent:=world"
    expanded = ElementTree.tostring(macro, encoding="unicode").replace("${prefix}", "").replace("${parent}", "world")
    plain = ElementTree.fromstring(urdf_text(rig.robot, arm, "cell.yaml").encode())  # noqa: S314
    for tag, count in (("joint", 9), ("link", 9)):
        ours, theirs = (
            [ElementTree.canonicalize(ElementTree.tostring(part), strip_text=True) for part in root.findall(tag)]
            for root in (ElementTree.fromstring(expanded), plain)  # noqa: S314
        )
        assert ours == [part for part in theirs if part != '<link name="world"></link>']
        assert len(ours) == count


def test_a_name_that_xacro_would_compute_is_refused():
    robot = load_arm("ur5e").robot.model_copy(update={"name": "arm ${1 / 0}"})
    with refused("output.invalid", "xacro would evaluate the name"):
        xacro_text(robot, geometric_arm(model_of(changed("ur5e"))), "cell.yaml")


def franka_poses(text: str, q: Array) -> Array:
    """Poses (n, 4, 4) mm of link 8 in link 0, as robots/common/utils.xacro of franka_description makes them."""
    entries = yaml.safe_load(text)
    poses = []
    for angles in q:
        T = np.eye(4)
        for number, angle in enumerate([*angles, 0.0], start=1):
            one = entries[f"joint{number}"]["kinematic"]
            turn = Rotation.from_euler("xyz", [one["roll"], one["pitch"], one["yaw"]])
            T = T @ frame([one[key] for key in "xyz"], turn) @ frame([0, 0, 0], Rotation.from_rotvec([0, 0, angle]))
        T[:3, 3] *= 1000
        poses.append(T)
    return np.array(poses)


def test_frankas_file_has_the_poses_of_the_model():
    rig = changed("franka-fr3")
    arm, q = geometric_arm(model_of(rig)), within_limits(rig)
    outer, inner = np.linalg.inv(arm.T_world_base), np.linalg.inv(arm.T_flange_tool)
    text = driver_kinematics(rig.robot, arm, "franka", "cell.yaml")
    require_equal(franka_poses(text, q), outer @ tool_poses(model_of(rig), q) @ inner)


def test_another_arm_has_no_file_of_franka():
    rig = changed("kuka-lbr-iiwa-14")
    with refused("output.invalid", "the arm do not match kinematics"):
        driver_kinematics(rig.robot, geometric_arm(model_of(rig)), "franka", "cell.yaml")
