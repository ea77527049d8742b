"""Questions about the robot: address, feedback, arm, tool, and the circle.

A single pose at the start determines the entire circle through the nominal arm.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from textwrap import fill
from typing import Any, get_args

import numpy as np

from analysis.apps.commission.init_answers import Answers, Options, checked, has_keys, with_keys
from analysis.apps.commission.rig_file_text import chosen_arm
from analysis.cli.dialogue import Dialogue
from analysis.robot.kinematics.arm import Array, arm_of, forward
from analysis.runs.written_files import holding, write_all_over
from daq.apps.commission.attempts import RobotReport
from daq.apps.commission.linuxcnc_files import linuxcnc_files
from daq.apps.commission.robots import ADDRESSES, joints_of, linuxcnc_port, search_robot
from rigs.arms import arm_names
from rigs.errors import CellError, FileError, UseError
from rigs.rig import Rig
from rigs.schema.declared_tests import Circle
from rigs.schema.feedback import Feedback
from rigs.schema.limits import TOLERANCE_BY_RP, USUAL_RP_MM, WATCH_SHARE, offered_tolerance_mm
from rigs.schema.links import tcp_address
from rigs.schema.part import Vector
from rigs.schema.robot import Pose, Robot
from rigs.schema.vocabulary import DRIVEN_AXES, Build, maker_of
from rigs.text import numbers_in


def circle_from_start(robot: Robot, joints_deg: Sequence[float], radius_mm: float) -> Circle:
    """Return the circle that starts at these joint angles.

    On a circle the z axis of the tool points at the centre and the x axis along the normal (docs/conventions.md).
    """
    T = forward(arm_of(robot), np.radians([joints_deg]))[0]
    towards, normal = T[:3, 2], T[:3, 0]
    return Circle(
        centre_mm=_vector(T[:3, 3] + radius_mm * towards, 3),
        normal=_vector(normal, 6),
        zero=_vector(-towards, 6),
        radius_mm=radius_mm,
        posture_deg=tuple(round(float(angle), 3) for angle in joints_deg),
    )


def _vector(values: Array, decimals: int) -> Vector:
    """Round three numbers (3,) to the known accuracy."""
    x, y, z = (round(float(value), decimals) + 0.0 for value in values)
    return x, y, z


_COLUMNS = 79
_BUILDS: tuple[Build, ...] = get_args(Build)
_BUILD_QUESTION = """\
The build determines the usual plays, zeros and lengths of the arm:
  industrial: reducers of large machines; light: strain-wave gears, as of cobots;
  torque_sensing: with torque sensors in the joints; servo: hobby servos
Build"""
NO_ROBOT = "none"
_MOST_TOLERANCE_MM = 1000.0
_LEAST_TOOL_MM = 1.0
"""Lower bound of the largest coordinate of a ball on the flange. Chosen: the longest tools have 1 m, 1.0 in metres."""


def ask_robot(answers: Answers, options: Options, dialogue: Dialogue) -> Answers:
    """Find the robot, read the joint angles and have the user confirm the unit."""
    is_same_robot = options.robot in (None, answers.robot_address)
    if (
        answers.feedback is not None
        and is_same_robot
        and has_keys(Feedback, answers.feedback, options.keys["feedback"])
    ):
        return answers
    read = partial(_reported, options, dialogue)
    report = read(options.robot) if options.robot is not None else dialogue.ask(f"{ADDRESSES}\nRobot", "--robot", read)
    for line in describe_robot(report):
        dialogue.say(line)
    feedback = report.feedback
    if feedback and not report.units_sure and not options.keys["feedback"]:
        feedback = dialogue.ask(
            "Are these angles degrees? The pendant shows it: deg or rad",
            "--key feedback.fields",
            partial(_in_unit, feedback),
            "deg",
        )
    return answers.model_copy(update={"robot_address": report.address, "feedback": feedback})


def ask_robot_if_any(answers: Answers, options: Options, dialogue: Dialogue) -> Answers:
    """Find a robot for guided touches. If there is none, the joint angles will be typed into a table."""
    axes = len(chosen_arm(answers.arm or "", options.measured_by).robot.axes)
    address = options.robot or answers.robot_address
    if axes != DRIVEN_AXES and options.robot not in (None, NO_ROBOT):
        problem = f"is supported only for arms of {DRIVEN_AXES} axes, and {answers.arm} has {axes}"
        raise UseError("--robot", problem, "remove the option: the joints are typed into a table")
    if axes != DRIVEN_AXES:
        return answers
    if address is None:
        question = (
            "rigd can read the joints and guide from touch to touch; otherwise type the joints into a table.\n"
            "Address of the robot, or none"
        )
        address = dialogue.ask(question, "--robot", str, NO_ROBOT)
    if address == NO_ROBOT:
        return answers.model_copy(update={"robot_address": NO_ROBOT, "feedback": None})
    return ask_robot(answers, replace(options, robot=address), dialogue)


def describe_robot(report: RobotReport) -> Iterator[str]:
    """Yield a description of the robot found."""
    assert report.feedback is not None  # noqa: S101 - of a robot that was found
    yield f"  {report.feedback.interface} at {report.feedback.port}, {report.rate_hz:.0f} readings a second"
    yield f"      joints now: {' '.join(f'{angle:z.3f}' for angle in report.joints_deg)} deg"
    if report.reported:
        yield f"      the controller reports: {report.reported}"


def robot_at(address: str, keys: Mapping[str, Any]) -> RobotReport:
    """Search for a robot at an address. keys: feedback keys given by the user."""
    named: Feedback | None = None
    if "interface" in keys:
        named = checked(Feedback, {"port": address, **keys}, "feedback")
    report = search_robot(address, named)
    if report.feedback is None:
        return report
    return replace(report, feedback=with_keys(Feedback, report.feedback, keys, "feedback"))


def _write_controller_files(options: Options, dialogue: Dialogue, port: str) -> None:
    """Write the files for a LinuxCNC controller next to the rig file, unless they are there."""
    directory = options.path.parent / "linuxcnc"
    number = tcp_address(port)
    assert number is not None  # noqa: S101 - formed from an address
    files = linuxcnc_files(number[1])
    if not all((directory / name).exists() for name in files):
        write_all_over(directory, {name: holding(content) for name, content in files.items()})
    dialogue.say(
        f"  {directory}: copy {' and '.join(files)} to the INI file of LinuxCNC, and add to its section [HAL]:"
    )
    dialogue.say("      HALFILE = rig.hal")


def _reported(options: Options, dialogue: Dialogue, address: str) -> RobotReport:
    if port := linuxcnc_port(address):
        _write_controller_files(options, dialogue, port)
    with dialogue.busy(f"searching for a robot at {address}"):
        report = robot_at(address, options.keys["feedback"])
    if report.feedback is None:
        raise CellError(f"robot {address}", report.problem, report.remedy)
    return report


def _in_unit(feedback: Feedback, unit: str) -> Feedback:
    if unit not in ("deg", "rad"):
        raise FileError(repr(unit), "is not a unit", "type deg or rad")
    fields: Any = getattr(feedback, "fields", ())
    return feedback.model_copy(update={"fields": tuple(name.replace("_deg", f"_{unit}") for name in fields)})


def ask_arm(answers: Answers, options: Options, dialogue: Dialogue) -> Answers:

    def read(name: str) -> str:
        chosen_arm(name, options.measured_by)
        return name

    arms = fill(
        ", ".join(_likely_arms(answers)), _COLUMNS, break_on_hyphens=False, initial_indent="  ", subsequent_indent="  "
    )
    question = f"Arm: name in the library, or a file with a section robot\n{arms}\nArm"
    arm_given = options.arm or answers.arm
    name = read(arm_given) if arm_given else dialogue.ask(question, "--arm", read)
    return answers.model_copy(update={"arm": name})


def ask_build(answers: Answers, options: Options, dialogue: Dialogue) -> Answers:
    """Ask for the build of an arm if neither the library nor the arm file states it.

    The build matters: by the standards of an industrial arm, the play of a hobby arm would be a fault.
    """
    arm = chosen_arm(answers.arm or "", options.measured_by)
    build = options.build or answers.build
    if build is None and arm.robot.build is None and not arm.in_library:
        build = dialogue.ask(_BUILD_QUESTION, "--build", _build, arm.robot.design)
        if not dialogue.terminal:
            dialogue.say(f"{arm.robot.name} is taken to be {build}; to change: --build {', '.join(_BUILDS)}")
    return answers if build is None else answers.model_copy(update={"build": build})


def _build(text: str) -> Build:
    if text not in _BUILDS:
        raise FileError(repr(text), "is not a known build of arms", f"type {', '.join(_BUILDS)}")
    return text


def _likely_arms(answers: Answers) -> Sequence[str]:
    """Return the arms of the maker whose interface the robot uses, or all arms."""
    maker = maker_of(answers.feedback.interface) if answers.feedback else None
    return [name for name in arm_names() if maker and name.startswith(maker)] or arm_names()


def ask_tool(answers: Answers, options: Options, dialogue: Dialogue) -> Answers:
    """Ask for the position of the ball on the flange. The default is the tool of the arm, if it has one."""
    tool = _pose(options.tool) if options.tool else answers.tool
    if tool is None:
        arm_tool = chosen_arm(answers.arm or "", options.measured_by).robot.tool
        usual = (
            None if arm_tool == Pose() else ",".join(f"{value:g}" for value in (*arm_tool.xyz_mm, *arm_tool.rpy_deg))
        )
        thing = "ball or socket" if options.measured_by == "arm" else "ball"
        question = f"Pose of the {thing} on the flange: x,y,z in mm, then roll,pitch,yaw in degrees"
        tool = dialogue.ask(question, "--tool", _pose, usual)
    return answers.model_copy(update={"tool": tool})


def ask_tolerance(answers: Answers, options: Options, dialogue: Dialogue) -> Answers:
    """Ask for the error allowed by the application, which determines the limits.

    The default follows from the repeatability.
    """
    tolerance_mm = options.tolerance_mm if options.tolerance_mm is not None else answers.tolerance_mm
    if tolerance_mm is None:
        rp_mm = chosen_arm(answers.arm or "").repeatability_mm
        whose = "from the arm's data sheet" if rp_mm else "usual, since this arm's data sheet is unknown"
        question = (
            "Limits: all results are compared with the error that your application allows at the "
            f"ball.\nUp to {WATCH_SHARE:.0%} of the allowed error is a PASS, up to all of it a WATCH, and "
            f"more a FAIL.\nThe default is {TOLERANCE_BY_RP:g} times a repeatability of "
            f"{rp_mm or USUAL_RP_MM:g} mm, {whose}.\nAllowed error in mm, 0 for no limits"
        )
        offered = f"{offered_tolerance_mm(rp_mm):g}"
        tolerance_mm = dialogue.ask(question, "--tolerance-mm", _tolerance_mm, offered)
    return answers.model_copy(update={"tolerance_mm": tolerance_mm})


def take_options(answers: Answers, options: Options, _: Dialogue) -> Answers:
    """Take tool and tolerance from the options. They are optional if there are no gauges."""
    tool = _pose(options.tool) if options.tool else answers.tool
    tolerance_mm = answers.tolerance_mm if options.tolerance_mm is None else options.tolerance_mm
    return answers.model_copy(update={"tool": tool, "tolerance_mm": tolerance_mm})


def _tolerance_mm(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 <= value <= _MOST_TOLERANCE_MM:
        raise FileError(repr(text), "is not an error in mm", "type for example 0.25, or 0 for unlimited")
    return value


def _pose(text: str) -> Pose:
    values = numbers_in(text)
    if len(values) not in (3, 6):
        raise FileError(
            repr(text), "is not x,y,z or x,y,z,roll,pitch,yaw", "write for example 0,0,150 or 0,0,150,0,90,0"
        )
    if 0 < max(map(abs, values[:3])) < _LEAST_TOOL_MM:
        problem = f"has no coordinate of {_LEAST_TOOL_MM:g} mm or more: the position looks like metres"
        raise FileError(repr(text), problem, "give the position in mm")
    fields = {"xyz_mm": values[:3], "rpy_deg": values[3:] or (0.0, 0.0, 0.0)}
    pose: Pose = checked(Pose, fields, "--tool")
    return pose


def ask_circle(answers: Answers, options: Options, dialogue: Dialogue, rig: Rig) -> Answers:
    """Derive the circle from a robot standing at its start. rig: the rig according to the previous answers."""
    if options.circle_here is None and (answers.circle is not None or answers.circle_later):
        return answers
    radius_mm = options.radius_mm or float(Circle.model_fields["radius_mm"].default)

    def read(answer: str) -> Answers:
        if answer.lower() in ("n", "no"):
            return answers.model_copy(update={"circle": None, "circle_later": True})
        if answer.lower() not in ("y", "yes"):
            raise FileError(repr(answer), "is not y or n", "type y or n")
        circle = circle_from_start(rig.robot, joints_of(rig.feedback), radius_mm)
        return answers.model_copy(update={"circle": circle, "circle_later": False})

    if options.circle_here is not None:
        return read("y" if options.circle_here else "n")
    question = f"The circle has a radius of {radius_mm:g} mm; to change: --radius-mm.\n"
    question += "Is the robot at the start of the circle, with the ball link? y or n"
    return dialogue.ask(question, "--circle-here", read, "n")
