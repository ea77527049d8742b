"""Questionnaire of `rig init`: each question is answered by an option, an earlier answer or the operator."""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from textwrap import fill
from typing import Annotated, Any, get_args

import numpy as np

from analysis.apps.commission.gauge_questions import ask_baseline, ask_gauges, check_baseline_mm, describe_gauge
from analysis.apps.commission.init_answers import (
    Answers,
    Changes,
    Options,
    checked,
    forget_answers,
    has_keys,
    keep_answers,
    kept_in,
    load_answers,
    read_number,
    with_keys,
)
from analysis.apps.commission.rig_file_text import chosen_arm, rig_text
from analysis.apps.report.texts import texts_of
from analysis.cli.dialogue import Dialogue
from analysis.robot.description.linuxcnc_configuration import narrow_limits
from analysis.robot.kinematics.arm import arm_of, forward
from analysis.runs.written_files import holding, write_all_over
from daq.discovery.attempts import RobotReport
from daq.discovery.linuxcnc_files import linuxcnc_files
from daq.discovery.robots import joints_of, linuxcnc_port, search_robot
from daq.store import durable
from rigs.arms import arm_names
from rigs.errors import CellError, FileError, UseError
from rigs.load import parse
from rigs.makers import maker_of
from rigs.rig import Rig
from rigs.schema.declared_tests import Circle
from rigs.schema.feedback import Feedback
from rigs.schema.gauges import Gauge
from rigs.schema.limits import (
    TOLERANCE_BY_RP,
    USUAL_RP_MM,
    WATCH_SHARE,
    offered_tolerance_mm,
)
from rigs.schema.links import tcp_address
from rigs.schema.robot import Pose, Robot
from rigs.schema.vocabulary import DRIVEN_AXES, Build, MeasuredBy
from rigs.text import as_argument, numbers_in

_COLUMNS = 79
_BUILDS: tuple[Build, ...] = get_args(Build)
_TEXTS = texts_of("en")
NO_ROBOT = "none"
_MOST_TOLERANCE_MM = 1000.0
_LEAST_TOOL_MM = 1.0
"""Lower bound of the largest coordinate of a ball on the flange: the longest tools have 1 m."""


def make_rig_file(options: Options, dialogue: Dialogue) -> None:
    _check_options(options)
    path, stored = options.path, load_answers(options.path)
    if stored.model_fields_set:
        dialogue.say(f"Continuing with the answers in {kept_in(path)}; remove the file to restart")
    answers = _with_options(stored, options)
    for key, answer in _QUESTIONS[options.measured_by].items():
        if key not in answers.model_fields_set:
            answers = answers.model_copy(update=answer(answers, options, dialogue))
            keep_answers(path, answers)
        if key == "gauges":
            for name, gauge in zip(("g1", "g2"), answers.gauges or (), strict=False):
                dialogue.say(describe_gauge(name, gauge))
    _say_narrow_limits(answers.arm or "", dialogue)
    arm, today = chosen_arm(answers.arm or "", options.measured_by), dt.datetime.now(dt.UTC).date()
    text = rig_text(answers, arm, options.name, today, options.measured_by)
    parse(text, str(path))
    _check_new(path)
    try:
        durable.replace(path, text.encode())  # atomic, even after a power failure
    except OSError as error:
        problem = f"cannot be written: {error.strerror or error}"
        remedy = "free some space; then repeat the command here"
        raise CellError(str(path), problem, remedy, code="output.not_writable") from None
    forget_answers(path)


def _check_options(options: Options) -> None:
    path, by, given = options.path, options.measured_by, options.given
    if not path.parent.is_dir():
        remedy = "create the directory, or choose a different name"
        raise FileError(str(path.parent), "is not a directory", remedy, code="output.not_writable")
    _check_new(path)
    _check_robot(options.robot, by)
    of_gauges = {
        "--port": options.ports, "--g1, --g2": options.places, "--baseline-mm": given.get("baseline_mm"),
        "--key": options.keys["g1"] or options.keys["g2"], "--circle-here": options.circle_here,
        "--radius-mm": options.radius_mm,
    }  # fmt: skip
    for option in (name for name, value in of_gauges.items() if value and by != "gauges"):
        problem = f"applies only to gauges, and --measured-by {by} uses none"
        raise UseError(option, problem, "remove it")
    if "baseline_mm" in given:
        check_baseline_mm(given["baseline_mm"], "--baseline-mm")
    checked(Annotated[str, *Rig.model_fields["name"].metadata], options.name, "--name")
    if "arm" in given:
        chosen_arm(given["arm"], by)


def _check_robot(address: str | None, by: MeasuredBy) -> None:
    if by in ("tracker", "arm") and address not in (None, NO_ROBOT):
        problem = f"is not used with --measured-by {by}: the table contains the joints"
        raise UseError("--robot", problem, "remove it")
    if by == "gauges" and address == NO_ROBOT:
        problem = "cannot be none with gauges: the joints are read while the gauges measure"
        remedy = "give the address of the robot, or --measured-by sockets"
        raise UseError("--robot", problem, remedy)


def _check_new(path: Path) -> None:
    if path.exists() or path.is_symlink():
        remedy = f"choose a different name, or edit the file and run rig check {as_argument(path)}"
        raise FileError(str(path), "exists already", remedy, code="output.exists")


def _with_options(stored: Answers, options: Options) -> Answers:
    """Stored answers, replaced by options. A question is open again if its answer contradicts an option, or did not
    apply to the previous arm or gauges."""
    given, keys, dropped = dict(options.given), options.keys, set[str]()
    if "tool" in given:
        given["tool"] = _read_pose(given["tool"])
    robot, gauges = stored.feedback, stored.gauges
    if options.robot not in (None, stored.robot_address) or (robot and not has_keys(Feedback, robot, keys["feedback"])):
        dropped |= {"robot_address", "feedback"}
    pairs = zip(("g1", "g2"), gauges or (), strict=False)
    if options.places or not all(has_keys(Gauge, gauge, keys[name]) for name, gauge in pairs):
        dropped.add("gauges")
    if options.circle_here is not None:
        dropped.add("circle")
    empty = {name for name in stored.model_fields_set if getattr(stored, name) is None}
    if given.get("arm", stored.arm) != stored.arm:
        dropped |= empty & {"build", "robot_address", "feedback"}
    if "gauges" in dropped:
        dropped |= empty & {"baseline_mm"}
    kept = {name: getattr(stored, name) for name in stored.model_fields_set - dropped}
    return Answers.model_construct(**kept | given)


# Robot.


def _ask_robot(answers: Answers, options: Options, dialogue: Dialogue) -> Changes:
    """Find the robot, read the joint angles and have the user confirm their unit. With sockets it only guides
    touches."""
    address = options.robot
    if options.measured_by == "sockets":
        axes = len(chosen_arm(answers.arm or "", "sockets").robot.axes)
        if axes != DRIVEN_AXES and address not in (None, NO_ROBOT):
            problem = f"is supported only for arms of {DRIVEN_AXES} axes, and {answers.arm} has {axes}"
            remedy = "remove the option: the joints are typed into a table"
            raise UseError("--robot", problem, remedy)
        if axes == DRIVEN_AXES:
            address = address or dialogue.ask(_TEXTS("ask_robot_or_none"), "--robot", str, NO_ROBOT)
        if address in (None, NO_ROBOT):
            return {"robot_address": address, "feedback": None}
    read = partial(_find_robot, options, dialogue)
    report = read(address) if address is not None else dialogue.ask(_TEXTS("ask_robot"), "--robot", read)
    feedback = report.feedback
    assert feedback is not None  # noqa: S101 - of a robot that was found
    dialogue.say(f"  {feedback.interface} at {feedback.port}, {report.rate_hz:.0f} readings a second")
    dialogue.say(f"      joints now: {' '.join(f'{angle:z.3f}' for angle in report.joints_deg)} deg")
    if report.reported:
        dialogue.say(f"      the controller reports: {report.reported}")
    if not report.units_sure and not options.keys["feedback"]:
        unit = dialogue.ask(_TEXTS("ask_unit"), "--key feedback.fields", partial(_read_choice, ("deg", "rad")), "deg")
        fields = tuple(name.replace("_deg", f"_{unit}") for name in getattr(feedback, "fields", ()))
        feedback = feedback.model_copy(update={"fields": fields})
    return {"robot_address": report.address, "feedback": feedback}


def _read_choice(offered: Sequence[str], answer: str) -> str:
    if answer.lower() not in offered:
        raise FileError(repr(answer), "is not a choice", f"type {', '.join(offered)}", code="usage")
    return answer.lower()


def robot_at(address: str, keys: Mapping[str, Any]) -> RobotReport:
    named = checked(Feedback, {"port": address, **keys}, "feedback") if "interface" in keys else None
    report = search_robot(address, named)
    if report.feedback is None:
        return report
    return replace(report, feedback=with_keys(Feedback, report.feedback, keys, "feedback"))


def _find_robot(options: Options, dialogue: Dialogue, address: str) -> RobotReport:
    _check_robot(address, options.measured_by)
    if port := linuxcnc_port(address):
        _write_controller_files(options, dialogue, port)
    with dialogue.busy(f"searching for a robot at {address}"):
        report = robot_at(address, options.keys["feedback"])
    if report.feedback is None:
        raise CellError(f"robot {address}", report.problem, report.remedy, code="robot.silent")
    return report


def _write_controller_files(options: Options, dialogue: Dialogue, port: str) -> None:
    directory = options.path.parent / "linuxcnc"
    number = tcp_address(port)
    assert number is not None  # noqa: S101 - formed from an address
    files = linuxcnc_files(number[1])
    if not all((directory / name).exists() for name in files):
        write_all_over(directory, {name: holding(content) for name, content in files.items()})
    copy = f"copy {' and '.join(files)} to the INI file of LinuxCNC, and add to its section [HAL]:"
    dialogue.say(f"  {directory}: {copy}")
    dialogue.say("      HALFILE = rig.hal")


# Arm, tool and limits.


def _ask_arm(answers: Answers, options: Options, dialogue: Dialogue) -> Changes:
    def read(name: str) -> str:
        chosen_arm(name, options.measured_by)
        return name

    maker = maker_of(answers.feedback.interface) if answers.feedback else None
    likely = [name for name in arm_names() if maker and name.startswith(maker)] or arm_names()
    arms = fill(", ".join(likely), _COLUMNS, break_on_hyphens=False, initial_indent="  ", subsequent_indent="  ")
    return {"arm": dialogue.ask(_TEXTS("ask_arm", arms=arms), "--arm", read)}


def _say_narrow_limits(arm: str, dialogue: Dialogue) -> None:
    """Name the Cartesian limits of a LinuxCNC configuration that would stop programs of rig."""
    if Path(arm).suffix.lower() == ".ini":
        for narrow in narrow_limits(Path(arm)):
            dialogue.say(f"  {arm}: limits {narrow}: programs of rig would stop there; widen MIN_LIMIT and MAX_LIMIT")


def _ask_build(answers: Answers, options: Options, dialogue: Dialogue) -> Changes:
    arm = chosen_arm(answers.arm or "", options.measured_by)
    if arm.robot.build is not None or arm.in_library:
        return {"build": None}
    build = dialogue.ask(_TEXTS("ask_build"), "--build", partial(_read_choice, _BUILDS), arm.robot.design)
    if not dialogue.terminal:
        dialogue.say(f"{arm.robot.name} is taken to be {build}; to change: --build {', '.join(_BUILDS)}")
    return {"build": build}


def _ask_tool(answers: Answers, options: Options, dialogue: Dialogue) -> Changes:
    tool = chosen_arm(answers.arm or "", options.measured_by).robot.tool
    usual = None if tool == Pose() else ",".join(f"{value:g}" for value in (*tool.xyz_mm, *tool.rpy_deg))
    thing = "ball or socket" if options.measured_by == "arm" else "ball"
    return {"tool": dialogue.ask(_TEXTS("ask_tool", thing=thing), "--tool", _read_pose, usual)}


def _read_pose(text: str) -> Pose:
    values = numbers_in(text)
    if len(values) not in (3, 6):
        remedy = "write for example 0,0,150 or 0,0,150,0,90,0"
        raise FileError(repr(text), "is not x,y,z or x,y,z,roll,pitch,yaw", remedy, code="usage")
    if 0 < max(map(abs, values[:3])) < _LEAST_TOOL_MM:
        problem = f"has no coordinate of {_LEAST_TOOL_MM:g} mm or more: the position looks like metres"
        raise FileError(repr(text), problem, "give the position in mm", code="usage")
    pose: Pose = checked(Pose, {"xyz_mm": values[:3], "rpy_deg": values[3:] or (0.0, 0.0, 0.0)}, "--tool")
    return pose


def _ask_tolerance(answers: Answers, _: Options, dialogue: Dialogue) -> Changes:
    rp_mm = chosen_arm(answers.arm or "").repeatability_mm
    whose = "from the arm's data sheet" if rp_mm else "usual, since this arm's data sheet is unknown"

    def read(text: str) -> float:
        return read_number(text, 0.0, _MOST_TOLERANCE_MM, "an error in mm", "type for example 0.25, or 0 for unlimited")

    rp = rp_mm or USUAL_RP_MM
    question = _TEXTS("ask_tolerance", watch=WATCH_SHARE, times=TOLERANCE_BY_RP, rp=rp, whose=whose)
    return {"tolerance_mm": dialogue.ask(question, "--tolerance-mm", read, f"{offered_tolerance_mm(rp_mm):g}")}


# Circle.


def _ask_circle(answers: Answers, options: Options, dialogue: Dialogue) -> Changes:
    radius_mm = options.radius_mm or float(Circle.model_fields["radius_mm"].default)
    robot, feedback = chosen_arm(answers.arm or "").robot, answers.feedback
    assert feedback is not None  # noqa: S101 - asked before

    def read(answer: str) -> Changes:
        if _read_choice(("y", "n", "yes", "no"), answer).startswith("n"):
            return {"circle": None}
        held = robot.model_copy(update={"tool": answers.tool})
        return {"circle": circle_from_start(held, joints_of(feedback), radius_mm)}

    if options.circle_here is not None:
        return read("y" if options.circle_here else "n")
    return dialogue.ask(_TEXTS("ask_circle", radius=radius_mm), "--circle-here", read, "n")


def circle_from_start(robot: Robot, joints_deg: Sequence[float], radius_mm: float) -> Circle:
    """Circle from a start, where the tool points with z at the centre and with x along the normal
    (docs/conventions.md)."""
    T = forward(arm_of(robot), np.radians([joints_deg]))[0]
    towards, normal = T[:3, 2], T[:3, 0]
    rounded = {"centre_mm": (T[:3, 3] + radius_mm * towards).round(3), "normal": normal.round(6)}
    rounded |= {"zero": (-towards).round(6), "posture_deg": np.round(joints_deg, 3)}
    return Circle(radius_mm=radius_mm, **{key: tuple((values + 0.0).tolist()) for key, values in rounded.items()})


Questions = dict[str, Callable[[Answers, Options, Dialogue], Changes]]
_ARM: Questions = {"arm": _ask_arm, "build": _ask_build}
_QUESTIONS: dict[MeasuredBy, Questions] = {
    "gauges": {
        "feedback": _ask_robot,
        "gauges": ask_gauges,
        "baseline_mm": ask_baseline,
        **_ARM,
        "tool": _ask_tool,
        "tolerance_mm": _ask_tolerance,
        "circle": _ask_circle,
    },
    "sockets": {**_ARM, "feedback": _ask_robot, "tool": _ask_tool},
    "arm": {**_ARM, "tool": _ask_tool},
    "tracker": _ARM,
}
"""Questions in order, by the answer that each gives."""
