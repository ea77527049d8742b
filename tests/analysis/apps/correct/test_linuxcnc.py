"""The arm of a LinuxCNC configuration, and the values of a correction in the form of its files."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.apps.correct.controller_entries import Constant, ControllerChange, controller_entries, project
from analysis.apps.correct.correction_report import entries_table
from analysis.apps.correct.stated_frames import Frames
from analysis.apps.correct.work_area import WorkArea
from analysis.apps.makers.linuxcnc.values import value_files
from analysis.apps.makers.motion_plan import demand_of
from analysis.apps.makers.writing import programs_of
from analysis.apps.programs.planned import plans_of
from analysis.correction.foreign_constants import refuse_constants_of_another
from analysis.correction.support import supports
from analysis.correction.work import spread_angles
from analysis.robot.description.linuxcnc_configuration import configured_robot, narrow_limits
from analysis.robot.kinematics.arm import arm_of, forward, transform, without_setup
from rigs.effects import Effect, JointOffset, LinkGeometry
from rigs.errors import FileError
from rigs.load import parse
from rigs.problems import RigFileError
from rigs.rig import Rig
from rigs.schema.robot import LinkConstants, Pose
from tests.support.changed_rigs import rig_with, with_robot
from tests.support.command_line import succeeded
from tests.support.refusals import refused
from tests.worlds.arms.faulty_arm import found
from tests.worlds.linuxcnc.arm import TOOL, TOOL_MM, tool_at
from tests.worlds.linuxcnc.machine import write_configuration

CIRCLE = {
    "centre_mm": [500, 150, 450],
    "normal": [0, 0, 1],
    "zero": [1, 0, 0],
    "radius_mm": 70,
    "posture_deg": [2, 45, -3, 180, 42.1, 2],
}


def configuration(tmp_path: Path, unit: str = "mm") -> Path:
    """Write the configuration of the cell in a unit."""
    ini = write_configuration(tmp_path)
    if unit == "inch":
        ini.write_text(ini.read_text().replace("LINEAR_UNITS = mm", "LINEAR_UNITS = inch"))
        hal = tmp_path / "arm.hal"
        inches = re.sub(r"(\.[AD]-\d) (\S+)", lambda pin: f"{pin[1]} {float(pin[2]) / 25.4!r}", hal.read_text())
        hal.write_text(inches)
    return ini


def rig_at(tmp_path: Path, unit: str = "mm", effects: tuple[Effect, ...] = ()) -> Rig:
    """Return a rig with the arm of the configuration of the cell, with a horizontal circle."""
    robot = configured_robot(configuration(tmp_path, unit)).model_dump(mode="json", exclude_defaults=True)
    tool = {"xyz_mm": TOOL_MM.tolist(), "rpy_deg": [0, 90, 0]}
    feedback = {"interface": "linuxcnc", "port": "tcp://127.0.0.1:5480"}
    rig = rig_with(robot=robot | {"tool": tool}, feedback=feedback, tests={"circle": CIRCLE})
    return rig.model_copy(update={"effects": effects})


def test_configuration_gives_the_arm_with_its_limits(tmp_path):
    robot = rig_at(tmp_path).robot
    q = np.array([[2, 45, -3, 180, 42, 2], [-60, 20, 30, -40, 50, 60]], dtype=float)
    T, (R, p) = forward(without_setup(arm_of(robot)), np.radians(q)), tool_at(q)
    assert T[:, :3, :3] @ TOOL == pytest.approx(R, abs=1e-9)
    assert T[:, :3, 3] + R @ TOOL.T @ TOOL_MM == pytest.approx(p, abs=1e-6)
    assert [axis.limits_deg for axis in robot.axes][4:] == [(-300, 300), (-800, 800)]


def test_configuration_in_inches_gives_millimetres(tmp_path):
    robot = configured_robot(configuration(tmp_path, "inch"))
    assert robot.axes[2].a_mm == pytest.approx(431.8) and robot.axes[0].d_mm == pytest.approx(671.8)
    assert robot.linear_units == "inch" and robot.controller_source.pins.A[2] == pytest.approx(17.0)


def init(tmp_path: Path, *options: object) -> Path:
    words = ("init", tmp_path / "cell.yaml", "--measured-by", "sockets", "--robot", "none", "--tool", "0,0,50")
    succeeded(*words, "--arm", tmp_path / "cell.ini", *options)
    return tmp_path / "cell.yaml"


def entered(text: str) -> dict[str, float]:
    return {pin: float(value) for pin, value in re.findall(r"^setp genserkins\.(\S+) (\S+)", text, re.M)}


@pytest.mark.parametrize("unit", ["mm", "inch"])
def test_values_leave_in_the_unit_of_the_configuration_that_init_read(tmp_path, unit):
    configuration(tmp_path, unit)
    cell = init(tmp_path)
    rig = parse(cell.read_text(), "cell")
    assert rig.length_unit == unit
    files = value_files(rig, {(3, "a_mm"): 0.5})
    read, now = entered((tmp_path / "arm.hal").read_text()), entered(files["rig-arm.hal"])
    assert now.pop("A-2") - read.pop("A-2") == pytest.approx(0.5 if unit == "mm" else 0.5 / 25.4, rel=1e-3)
    assert now == pytest.approx(read, abs=1e-6)


@pytest.mark.parametrize(("unit", "value"), [("mm", "+0.500"), ("inch", "+0.01969")])
def test_table_of_values_has_the_unit_of_the_hal_file(tmp_path, unit, value):
    length = ControllerChange(3, "a_mm", "genserkins.A-2", 0.5, 0.012, "mm", None, 0.0, 400.0, 10.0)
    turn = ControllerChange(3, "q_deg", "HOME_OFFSET", 0.05, 0.002, "deg", None, 0.05, 400.0, 10.0)
    table = entries_table([length, turn], rig_at(tmp_path, unit))
    assert [row[1:4:2] for row in table.rows] == [(value, unit), ("+0.0500", "deg")]


def test_calibration_with_the_same_configuration_changes_nothing(tmp_path):
    configuration(tmp_path, "inch")
    cell = init(tmp_path, "--calibration", tmp_path / "cell.ini")
    once = cell.read_text()
    cell.unlink()
    assert init(tmp_path).read_text() == once


def test_values_are_refused_without_a_stated_unit(tmp_path):
    rig = with_robot(rig_at(tmp_path), linear_units=None)
    with refused("controller.invalid", "state the unit of the machine"):
        value_files(rig, {})


@pytest.mark.parametrize(("change", "value"), [("linear_units", "mm"), ("linear_units", "inch")])
def test_values_far_from_the_pins_that_were_read_are_refused(tmp_path, change, value):
    rig = rig_at(tmp_path, "mm" if value == "inch" else "inch")
    with refused("controller.invalid", "unit or arm differ"):
        value_files(with_robot(rig, **{change: value}), {})


def test_two_units_in_a_rig_file_are_refused(tmp_path):
    robot = configured_robot(configuration(tmp_path, "inch")).model_dump(mode="json", exclude_defaults=True)
    feedback = {"interface": "linuxcnc", "port": "tcp://127.0.0.1:5480", "linear_units": "mm"}
    with pytest.raises(RigFileError, match="linear_units"):
        rig_with(robot=robot, feedback=feedback, tests={})


def test_narrow_cartesian_limits_are_named(tmp_path):
    ini = configuration(tmp_path)
    assert narrow_limits(ini) == []
    text = ini.read_text().replace(
        "[AXIS_C]\nMAX_VELOCITY = 120\nMAX_ACCELERATION = 2000\nMIN_LIMIT = -3000", "[AXIS_C]\nMIN_LIMIT = -360"
    )
    ini.write_text(text)
    (narrow,) = narrow_limits(ini)
    assert narrow.startswith("[AXIS_C] -360 to 3000")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("KINEMATICS = genserkins", "KINEMATICS = trivkins coordinates=XYZABC"),
        ("LINEAR_UNITS = mm", "LINEAR_UNITS = cubit"),
        ("ANGULAR_UNITS = deg", "ANGULAR_UNITS = rad"),
        ("HALFILE = arm.hal", "HALFILE = other.hal"),
        ("MIN_LIMIT = -800", ""),
        ("HALFILE = arm.hal", "HALFILE = arm.hal\nHALCMD = setp genserkins.unrotate-2 1"),
        ("HALFILE = arm.hal", "HALFILE = arm.hal\nHALCMD = setp genserkins.A-2 [ARM](A2)"),
    ],
)
def test_configuration_that_rig_cannot_read_as_an_arm_is_refused(tmp_path, old, new):
    ini = write_configuration(tmp_path)
    assert old in ini.read_text()
    ini.write_text(ini.read_text().replace(old, new))
    with pytest.raises(FileError):
        configured_robot(ini)


@pytest.mark.parametrize(("unit", "per_mm"), [("mm", 1.0), ("inch", 1 / 25.4)])
def test_values_set_all_pins_with_the_change_and_count_joints_from_zero(tmp_path, unit, per_mm):
    effects = (
        JointOffset(axis=3, offset_deg=0.2, found=found(offset_deg=0.001)),
        LinkGeometry(axis=3, field="a", delta=1.5, found=found(delta=0.01)),
    )
    rig = rig_at(tmp_path, unit, effects)
    entries = controller_entries(WorkArea(rig, supports(rig)), "linuxcnc")
    files = value_files(rig, {(entry.axis, entry.key): entry.add for entry in entries.entries})
    pins = dict(re.findall(r"^setp genserkins\.(\S+) (\S+)", files["rig-arm.hal"], re.M))
    assert len(pins) == 18
    added = {(entry.axis, entry.key): entry.add for entry in entries.entries}
    assert {(3, "a_mm"), (3, "q_deg")} <= set(added)
    assert float(pins["A-2"]) == pytest.approx((431.8 + added[3, "a_mm"]) * per_mm)
    assert float(pins["D-3"]) == pytest.approx((433.0 + added.get((4, "d_mm"), 0.0)) * per_mm)
    assert float(pins["ALPHA-1"]) == pytest.approx(np.pi / 2 + added.get((2, "alpha_deg"), 0.0))
    before = dict(re.findall(r"^setp genserkins\.(\S+) \S+  # before: (\S+)", files["rig-arm.hal"], re.M))
    assert len(before) == sum(key != "q_deg" for _, key in added)
    assert float(before["A-2"]) == pytest.approx(431.8 * per_mm)
    offsets = dict(re.findall(r"\[JOINT_(\d)\]\n# HOME_OFFSET = (\S+)", files["home-offsets.ini"]))
    zeros = {str(axis - 1): change for (axis, key), change in added.items() if key == "q_deg"}
    assert {joint: float(change) for joint, change in offsets.items()} == pytest.approx(zeros, abs=1e-6)


def test_arm_with_joint_offsets_has_no_hal_file(tmp_path):
    rig = rig_at(tmp_path, effects=(JointOffset(axis=3, offset_deg=0.2, found=found(offset_deg=0.001)),))
    axes = (*rig.robot.axes[:5], rig.robot.axes[5].model_copy(update={"offset_deg": 90.0}))
    assert set(value_files(with_robot(rig, axes=axes), {})) == {"no-rig-arm.txt"}


def test_horizontal_circle_is_arcs_and_inch_machine_gets_joints_in_its_unit(tmp_path):
    for unit in ("mm", "inch"):
        rig = rig_at(tmp_path, unit)
        plan = plans_of(rig, "yaw", 3.0)[0]
        (text,) = programs_of("linuxcnc", [(plan, demand_of(plan))]).values()
        assert len(re.findall(r"^G17 G3 .* C\S+ I\S+ J\S+ F\S+$", text, re.M)) >= 5
        joint_move = re.search(r"M68 E3 Q1\nM66 E0 L0\n(G20\n)?G1 [^\n]*\nM68 E3 Q0\nM66 E0 L0\n(G21\n)?", text)
        assert joint_move and [bool(code) for code in joint_move.groups()] == [unit == "inch"] * 2


@pytest.mark.parametrize("change_mm", [2.5, -1.0])
def test_pins_of_another_arm_are_refused_and_entered_values_are_not(tmp_path, change_mm):
    rig = rig_at(tmp_path, "inch", effects=(LinkGeometry(axis=3, field="a", delta=0.6, found=found(delta=0.02)),))
    axes = rig.robot.axes

    def given(delta_mm: float) -> Rig:
        constants = [{key: getattr(axis, key) for key in LinkConstants.model_fields} for axis in axes]
        constants[2]["a_mm"] += delta_mm
        return with_robot(rig, controller_axes=tuple(LinkConstants(**one) for one in constants))

    with refused("robot.other", "those of another robot"):
        refuse_constants_of_another(given(change_mm), "second.ini", anyway=False)
    for fine_mm in (0.0, 0.6):
        refuse_constants_of_another(given(fine_mm), "cell.ini", anyway=False)


def test_constants_that_nearly_cancel_are_not_entered_alone(tmp_path):
    rig = rig_at(tmp_path, effects=(JointOffset(axis=2, offset_deg=0.06, found=found(offset_deg=0.002)),))
    work = spread_angles(rig, None)
    constants = (Constant(2, "q_deg"), Constant(3, "q_deg"))
    projection = project(rig, rig.effects, constants, work, work)
    impossible = replace(projection, values=np.array([0.06, -17.4]))
    assert projection.is_possible and not impossible.is_possible
    assert projection.gains(impossible, rig, rig.effects, work, np.zeros((1, len(work), 6)))


def test_frame_is_repeated_in_inches_at_a_controller_in_inches():
    stated = Frames(frames={"g54": transform(Pose(xyz_mm=(20, -4, 1)))})
    (doubt,) = stated.doubts({("frame", "g54")}, "inch")
    assert "20, -4, 1 mm" in doubt and "0.7874, -0.1575, 0.03937 inch" in doubt
    assert stated.doubts({("frame", "g54")}, "mm") == stated.doubts({("frame", "g54")}, None) == []
