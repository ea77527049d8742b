import re
import sys
from pathlib import Path

import numpy as np
import pytest

from analysis.apps.interchange.urdf import UrdfArm, import_urdf
from analysis.robot.description.rig_section import flange_poses, parsed
from rigs.arms import load_arm
from rigs.distribution import to_install
from rigs.errors import CellError, FileError
from tests.support.nightly import cases
from tests.support.refusals import refused
from tests.support.second_sources import SOURCES, Chain

CHAINS = {
    f"{name}, {key}": source
    for name, found in SOURCES.items()
    for key, source in found.items()
    if isinstance(source, Chain)
}
KUKA = SOURCES["kuka-kr-6-r900-2"]["geometry"]
GOOD = KUKA.urdf()
LIMIT = 'lower="-3" upper="2.5" velocity="3.5"'
AXIS = "<axis [^>]*>"
FIFTH = re.search(r'<joint name="joint_5".*?</joint>', GOOD)
assert FIFTH


def with_more(*parts: str, text: str = GOOD) -> str:
    return text.replace("</robot>", "".join([*parts, "</robot>"]))


def imported(folder: Path, text: str = GOOD, **ends: str | None) -> UrdfArm:
    file = folder / "arm.urdf"
    file.write_text(text)
    return import_urdf(file, **ends)


@pytest.mark.parametrize("name", cases(CHAINS, list(CHAINS)[::3]))
def test_the_section_is_the_chain_in_its_own_terms(name, tmp_path):
    chain = CHAINS[name]
    arm = imported(tmp_path, chain.urdf())
    assert parsed(arm.section.text) == arm.section.robot
    assert (arm.base, arm.tip) == ("base_link", "tool0")
    q = np.random.default_rng(3).uniform(-2.5, 2.5, (200, len(chain.joints)))
    controller = q.copy()
    if chain.j3_counts_j2:
        controller[:, 2] -= controller[:, 1]
    expected = chain(controller)
    expected[:, 2, 3] += 1000 * chain.base_m
    np.testing.assert_allclose(flange_poses(arm.section.robot, q), expected, atol=1e-9, rtol=0)
    assert arm.section.largest_mm < 1e-9
    assert arm.section.largest_rad < 1e-9


@pytest.mark.parametrize("name", ["abb-irb-120", "abb-irb-1600"])
def test_the_constants_are_those_of_the_library(name, tmp_path):
    """Not only the same poses: the same lengths and angles, as a person would write them."""
    chain = SOURCES[name]["geometry"]
    found, ours = imported(tmp_path, chain.urdf()).section.robot, load_arm(name).robot
    for its, axis in zip(found.axes, ours.axes, strict=True):
        constants = (its.a_mm, its.alpha_deg, its.beta_deg, its.offset_deg)
        assert constants == pytest.approx((axis.a_mm, axis.alpha_deg, 0, axis.offset_deg), abs=1e-9)
        assert its.limits_deg == pytest.approx(np.degrees([-3, 2.5]))
        assert its.speed_deg_s == pytest.approx(np.degrees(3.5))
    assert sum(axis.d_mm for axis in found.axes) == pytest.approx(
        sum(axis.d_mm for axis in ours.axes) + 1000 * chain.base_m
    )
    assert (found.base, found.tool, found.coupling) == (ours.base, ours.tool, ours.coupling)


def test_axes_that_are_nearly_parallel_are_named_and_kept(tmp_path):
    text = GOOD.replace('<axis xyz="0.0 1.0 0.0"/>', '<axis xyz="0.001 1.0 0.0"/>', 1)
    arm = imported(tmp_path, text)
    assert any("joint_2 and joint_3 0.0573 degrees" in doubt for doubt in arm.doubts)
    assert max(abs(axis.a_mm) for axis in arm.section.robot.axes) < 1000
    assert any(axis.beta_deg for axis in arm.section.robot.axes)
    assert imported(tmp_path).doubts == ()


def test_masses_that_are_fixed_together_are_one(tmp_path):
    def inertial(kg: float, x: float) -> str:
        return f'<inertial><origin xyz="{x} 0 0.1"/><mass value="{kg}"/></inertial>'

    text = GOOD.replace('<link name="link_6"/>', f'<link name="link_6">{inertial(3, 0.1)}</link>')
    text = text.replace('<link name="tool0"/>', f'<link name="tool0">{inertial(1, 0.0)}</link>')
    arm = imported(tmp_path, text)
    assert [axis.mass_kg for axis in arm.section.robot.axes] == [0, 0, 0, 0, 0, 4]
    # At zero, link 6 stands as the base, with its centre 100 mm ahead and up; tool0's z is ahead, as that of axis 6.
    x, y, z = arm.section.robot.axes[5].centre_mm
    assert z == pytest.approx((3 * 100 + 1 * 100) / 4)
    assert np.hypot(x, y) == pytest.approx((3 * 100 + 1 * 0) / 4)


def test_meshes_are_not_needed_and_a_gripper_is_left_out(tmp_path):
    mesh = '<visual><geometry><mesh filename="package://nowhere/link.stl"/></geometry></visual>'
    finger = (
        '<link name="finger"/><joint name="grip" type="prismatic"><parent link="tool0"/><child link="finger"/></joint>'
    )
    text = with_more(finger).replace('<link name="link_1"/>', f'<link name="link_1">{mesh}</link>')
    arm = imported(tmp_path, text)
    assert arm.section.robot == imported(tmp_path).section.robot
    assert len(arm.doubts) == 1 and arm.doubts[0].endswith(": grip")


@pytest.mark.parametrize(
    "part",
    ["<a>" * 20_000 + "</a>" * 20_000, "<!-- <xacro:arm prefix='${prefix}'/> -->"],
    ids=["deeply nested", "comment"],
)
def test_other_parts_of_a_joint_are_ignored(part, tmp_path):
    text = GOOD.replace('<parent link="link_1"/>', f'<parent link="link_1"/>{part}')
    assert imported(tmp_path, text).section.robot == imported(tmp_path).section.robot


def test_ends_that_are_not_on_their_axes_are_named(tmp_path):
    arm = imported(tmp_path, tip="link_6")
    assert arm.section.robot.tool.rpy_deg != (0, 0, 0)
    assert ["axis 6" in doubt for doubt in arm.doubts] == [True]
    aside = re.sub(r'xyz="0.0 0.0 0.4"', 'xyz="0.1 0.0 0.4"', GOOD)
    arm = imported(tmp_path, aside)
    assert arm.section.robot.base.xyz_mm == (100, 0, 0)
    assert ["axis 1" in doubt for doubt in arm.doubts] == [True]


def test_base_on_a_separate_branch_is_the_base_frame(tmp_path):
    branch = (
        '<link name="base"/><joint name="turned" type="fixed"><parent link="base_link"/><child link="base"/>'
        '<origin xyz="0 0 0.1" rpy="0 0 3.141592653589793"/></joint>'
    )
    text = with_more(branch)
    arm = imported(tmp_path, text)
    assert arm.base == "base"
    root = imported(tmp_path, text, base="base_link")
    q = np.random.default_rng(3).uniform(-2.5, 2.5, (50, 6))
    T = np.diag([-1.0, -1.0, 1.0, 1.0])
    T[2, 3] = 100.0
    np.testing.assert_allclose(T @ flange_poses(arm.section.robot, q), flange_poses(root.section.robot, q), atol=1e-9)


SEVENTH = (
    '<link name="link_7"/><joint name="joint_7" type="revolute"><parent link="tool0"/><child link="link_7"/>'
    f"<limit {LIMIT}/></joint>"
)
BOMB = '<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;">]>' + GOOD.partition("\n")[2]
MOVED_BASE = (
    '<link name="stand"/><joint name="lift" type="prismatic"><parent link="base_link"/><child link="stand"/></joint>'
)
BAD = {
    "three": (GOOD.replace("revolute", "fixed", 3), "an arm needs 4 to 7"),
    "prismatic": (FIFTH.re.sub(lambda fifth: fifth.group().replace("revolute", "prismatic"), GOOD), "is prismatic"),
    "a rail without limits": (
        GOOD.replace("revolute", "prismatic", 1).replace(f'<limit {LIMIT} effort="0"/>', "", 1),
        "lower -inf",
    ),
    "endless without a speed": (
        GOOD.replace("revolute", "continuous", 1).replace('velocity="3.5"', "", 1),
        "velocity inf",
    ),
    "no such type": (GOOD.replace("revolute", "screw", 1), "is screw"),
    "no type": (GOOD.replace('type="revolute"', "", 1), "has no type"),
    "mimic": (GOOD.replace("<limit", '<mimic joint="joint_2"/><limit', 1), "follows joint joint_2"),
    "no limits": (GOOD.replace(f'<limit {LIMIT} effort="0"/>', "", 1), "lower -inf"),
    "limits in disorder": (GOOD.replace('lower="-3"', 'lower="3"', 1), "lower 3, upper 2.5"),
    "velocity 0": (GOOD.replace('velocity="3.5"', 'velocity="0"', 1), "velocity 0"),
    "no axis": (re.sub(AXIS, '<axis xyz="0 0 0"/>', GOOD, count=1), "an axis of zero length"),
    "axis of two": (re.sub(AXIS, '<axis xyz="0 1"/>', GOOD, count=1), "axis xyz='0 1'"),
    "nan": (GOOD.replace('"0.0 0.0 0.4"', '"0 0 nan"', 1), "xyz='0 0 nan'"),
    "a large number": (GOOD.replace('"0.0 0.0 0.4"', '"0 0 1e308"', 1), "1e308"),
    "a speed in words": (GOOD.replace('velocity="3.5"', 'velocity="fast"', 1), "velocity='fast'"),
    "a negative mass": (
        GOOD.replace('<link name="link_1"/>', '<link name="link_1"><inertial><mass value="-1"/></inertial></link>'),
        "the mass -1 kg",
    ),
    "xacro elements": (
        '<robot name="x" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arm prefix=""/></robot>',
        "is xacro",
    ),
    "xacro numbers": (GOOD.replace('"0.0 0.0 0.4"', '"0 0 ${height}"', 1), "is xacro"),
    "entities": (BOMB, "entities"),
    "no XML": ("robot: {axes: []}\n", "not XML"),
    "half a file": (GOOD[: len(GOOD) // 2], "not XML"),
    "a robot of SDF": ("<sdf><model/></sdf>", "<sdf>"),
    "no name": (GOOD.replace('<robot name="chain">', "<robot>"), "<robot> has no name"),
    "no parent": (GOOD.replace('<parent link="link_1"/>', ""), "lacks the parent"),
    "no link": (GOOD.replace('<link name="link_3"/>', ""), "link_3 of a joint is missing"),
    "two links": (GOOD.replace('<link name="link_3"/>', '<link name="link_3"/>' * 2), "two links named link_3"),
    "two parents": (
        with_more(SEVENTH.replace("link_7", "link_1").replace('<link name="link_1"/>', "")),
        "the child of two joints",
    ),
    "a circle": (GOOD.replace('<parent link="base_link"/>', '<parent link="link_6"/>'), "form a circle"),
    "no joints": ('<robot name="x"><link name="a"/></robot>', "no moving joint"),
}


@pytest.mark.parametrize(
    ("given", "wrong", "of"),
    [
        ('upper="2.5"', 'upper="170"', "limits_deg 9740"),
        ('"0.0 0.0 0.4"', '"0 0 400"', "d_mm 400000"),
        ('velocity="3.5"', 'velocity="9999"', "speed_deg_s 572900"),
        ('lower="-3"', 'lower="-200"', "limits_deg -11459"),
    ],
)
def test_out_of_range_value_is_refused_with_joint_and_key(given, wrong, of, tmp_path):
    with pytest.raises(FileError) as refused:
        imported(tmp_path, GOOD.replace(given, wrong, 1))
    error = refused.value
    assert error.code == "urdf.invalid" and all(word in error.what for word in ("joint_", *of.split()))
    assert "Input" not in error.what


@pytest.mark.parametrize("kind", BAD)
def test_bad_file_is_refused(kind, tmp_path):
    text, problem = BAD[kind]
    with refused("urdf.invalid", problem):
        imported(tmp_path, text)


@pytest.mark.parametrize(
    ("base", "tip", "code"),
    [
        ("link_3", None, "urdf.invalid"),
        ("tool0", "base_link", "urdf.invalid"),
        ("stand", None, "urdf.invalid"),
        ("flange", None, "urdf.invalid"),
        (None, "tool1", "urdf.invalid"),
    ],
)
def test_other_ends_have_other_joints(base, tip, code, tmp_path):
    text = with_more(SEVENTH, MOVED_BASE)
    with refused(code):
        imported(tmp_path, text, base=base, tip=tip)


def test_five_axes_and_four_are_arms(tmp_path):
    for axes, base in ((5, "link_1"), (4, "link_2")):
        arm = imported(tmp_path, base=base).section
        assert len(arm.robot.axes) == len(arm.robot.coupling) == axes
        assert arm.robot.design == "light"


def test_a_joint_that_slides_below_all_turns_is_the_rail(tmp_path):
    """The way is in the base's frame, the limits are in mm, and the arm stands where the library has it."""
    rail = (
        '<link name="floor"/><joint name="rail" type="prismatic"><parent link="floor"/><child link="base_link"/>'
        '<origin xyz="0.1 0.2 0.3" rpy="0 0 0.5"/><axis xyz="0 -2 0"/><limit lower="-0.5" upper="2.5" velocity="1"/>'
        "</joint>"
    )
    section = imported(tmp_path, with_more(rail)).section
    assert section.robot.rail.limits_mm == (-500, 2500)
    np.testing.assert_allclose(section.robot.rail.direction, [np.sin(0.5), -np.cos(0.5), 0], atol=1e-9)
    q = np.zeros((2, 7))
    q[1, 6] = 1.0
    there = flange_poses(section.robot, q)[:, :3, 3]
    np.testing.assert_allclose(there[1] - there[0], 1000 * np.array(section.robot.rail.direction), atol=1e-6)
    assert section.largest_mm < 1e-9  # held against the library at random places of the rail


def test_gripper_jaw_is_an_axis_only_if_chosen(tmp_path):
    jaw = '<link name="jaw"/>' + SEVENTH.replace('<link name="link_7"/>', "").replace("link_7", "jaw")
    text = with_more(jaw).replace("tool0", "hand")
    with refused("urdf.invalid", "jaw, belongs to a gripper according"):
        imported(tmp_path, text)
    assert len(imported(tmp_path, text, tip="hand").section.robot.axes) == 6
    assert len(imported(tmp_path, text, tip="jaw").section.robot.axes) == 7


def test_a_joint_without_end_gets_limits_and_is_named(tmp_path):
    arm = imported(tmp_path, GOOD.replace("revolute", "continuous", 1))
    assert arm.section.robot.axes[0].limits_deg == (-360, 360)
    assert [" joint_1;" in doubt for doubt in arm.doubts] == [True]


def test_several_ends_are_asked_for(tmp_path):
    text = with_more(SEVENTH.replace("tool0", "link_6")).replace("tool0", "hand")
    with refused("urdf.invalid", "hand, link"):
        imported(tmp_path, text)
    assert imported(tmp_path, text, tip="hand").tip == "hand"


def test_a_huge_file_is_not_read(tmp_path):
    file = tmp_path / "arm.urdf"
    with file.open("wb") as sparse:
        sparse.truncate(10**12)
    with refused("file.too_large", "MB, the limit for such files"):
        import_urdf(file)


def test_missing_library_names_the_package(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pytransform3d.urdf", None)
    with pytest.raises(CellError) as error:
        imported(tmp_path)
    assert error.value.remedy == to_install("pytransform3d")
