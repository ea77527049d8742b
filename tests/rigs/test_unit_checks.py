"""Values of a rig file in metres or radians, and constants in the classic notation, are named with their remedy."""

import re

import pytest

from rigs.arms import load_arm
from rigs.load import SHIPPED, load, parse
from rigs.named_arm import named_arm_doubts
from tests.support.refusals import refused

TEXT = (SHIPPED / "paper-fanuc.yaml").read_text()


def _in_radians(match):
    return f"{match[1]}: {float(match[2]) * 0.0174533:.4f}"


@pytest.mark.parametrize(
    ("pattern", "change", "remedy"),
    [
        (r"(offset_mm): (-?25)$", lambda m: f"{m[1]}: {float(m[2]) / 1000}", "write 25 and -25"),
        (r"(alpha_deg): (-90)", _in_radians, "-90° in radians"),
        (r"(alpha_deg): (-?90)", lambda m: f"{m[1]}: {float(m[2]) / 90 * 1.57}", "in radians"),
        (r"(offset_deg): (-90)", _in_radians, "-90° in radians"),
        (r"(limits_deg): \[-(\d+), \d+\]", lambda m: f"{m[1]}: [-{int(m[2]) / 57.3}, {int(m[2]) / 57.3}]", "radians"),
        (r"(tool): \{", lambda m: f"{m[1]}: {{rpy_deg: [0, 3.1416, 0], ", "180° in radians"),
        (r"930.766, -87.820, 273.2", lambda _: "0.930766, -0.087820, 0.2732", "write [930.766, -87.82, 273.2]"),
        (r"(speed_mm_s): 25", lambda m: f"{m[1]}: 0.025", "write 25"),
    ],
)
def test_value_in_another_unit_names_the_unit(pattern, change, remedy):
    wrong = re.sub(pattern, change, TEXT, flags=re.MULTILINE)
    assert wrong != TEXT
    with refused("rig_file.invalid", remedy):
        parse(wrong, "cell.yaml")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("alpha_deg: -90, offset_deg: -90", "alpha_deg: -90.0123, offset_deg: -1.6"),
        ("offset_mm: 25\n", "offset_mm: 2\n"),
        ("tool: {", "tool: {rpy_deg: [0, 1.6, 0], "),
        ("centre_mm: [930.766, -87.820, 273.2]", "centre_mm: [30.5, 0, 0]"),
        ("limits_deg: [-150, 150]", "limits_deg: [-3, 3]"),
    ],
)
def test_small_value_of_a_real_cell_is_accepted(old, new):
    assert old in TEXT
    parse(TEXT.replace(old, new, 1), "cell.yaml")


def _arm_file(folder, robot):
    lines = [
        f"    - {{name: {axis.name}, a_mm: {axis.a_mm}, alpha_deg: {axis.alpha_deg}, d_mm: {axis.d_mm}, "
        f"limits_deg: {list(axis.limits_deg)}, speed_deg_s: {axis.speed_deg_s}}}"
        for axis in robot.axes
    ]
    file = folder / "cell.yaml"
    file.write_text("\n".join(["name: cell", "robot:", "  name: UR10e", "  arm: ur10e", "  axes:", *lines, ""]))
    return file


def test_classic_constants_of_the_named_arm_are_refused(tmp_path):
    robot = load_arm("ur10e").robot
    following = [*robot.axes[1:], None]
    classic = [
        axis.model_copy(update={"a_mm": its.a_mm if its else 0.0, "alpha_deg": its.alpha_deg if its else 0.0})
        for axis, its in zip(robot.axes, following, strict=True)
    ]
    with refused("rig_file.invalid", "rig arms ur10e"):
        load(_arm_file(tmp_path, robot.model_copy(update={"axes": tuple(classic)})))
    rig, _ = load(_arm_file(tmp_path, robot))
    assert not list(named_arm_doubts(rig.robot))


@pytest.mark.parametrize(
    ("arm", "axis", "more_mm", "count"), [("ur10e", 3, 16.0, 0), ("ur10e", 3, 19.0, 1), ("so-101", 3, 6.0, 1)]
)
def test_another_length_than_the_named_arm_is_a_doubt_by_its_reach(arm, axis, more_mm, count):
    robot = load_arm(arm).robot
    axes = list(robot.axes)
    axes[axis - 1] = axes[axis - 1].model_copy(update={"a_mm": axes[axis - 1].a_mm + more_mm})
    named = robot.model_copy(update={"axes": tuple(axes), "arm": arm})
    assert len([*named_arm_doubts(named)]) == count
