"""Text of a new rig file with comments on detected devices, nominal values and open measurements."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from analysis.apps.commission.init_answers import Answers
from analysis.robot.description.linuxcnc_configuration import configured_robot
from analysis.robot.description.rig_section import robot_text
from rigs.arms import arm_names, load_arm
from rigs.errors import FileError
from rigs.files import read_text
from rigs.problems import RigFileError, problems_of
from rigs.schema.declared_tests import Circle, Touch
from rigs.schema.feedback import Feedback
from rigs.schema.gauges import Gauge
from rigs.schema.limits import limits_of_tolerance, shared_limit
from rigs.schema.part import Part
from rigs.schema.robot import Pose, Robot
from rigs.schema.vocabulary import DRIVEN_AXES, TEST_WITHOUT_GAUGES, MeasuredBy
from rigs.text import as_argument, plain, the_same
from rigs.yaml_text import flow, read_yaml

_MAX_BYTES = 1_000_000


@dataclass(frozen=True)
class ChosenArm:
    """An arm. repeatability_mm: RP from the data sheet; None if unknown. source: origin of the constants."""

    robot: Robot
    repeatability_mm: float | None
    source: str
    in_library: bool = False


class _ArmFile(Part):
    robot: Robot


def chosen_arm(name: str, measured_by: MeasuredBy = "gauges") -> ChosenArm:
    """Arm from the library or from a file with a `robot` section.

    Raises FileError if there is none, and for an arm that cannot drive the circles required by gauges.
    """
    arm = _of_library(name) if the_same(name, arm_names()) else _of_file(name)
    if measured_by == "gauges" and (axes := len(arm.robot.axes)) != DRIVEN_AXES:
        problem = f"has {axes} axes, but the ball link's programs need six"
        remedy = "give --measured-by sockets or --measured-by tracker (docs/any-arm.md)"
        raise FileError(name, problem, remedy, code="arm.axes")
    return arm


def _of_file(name: str) -> ChosenArm:
    if Path(name).suffix.lower() == ".ini":
        return ChosenArm(configured_robot(Path(name)), None, f"the LinuxCNC configuration {Path(name).name}")
    try:
        text = read_text(Path(name), _MAX_BYTES)
    except FileNotFoundError:
        return _of_library(name)  # reports similar names
    except OSError as error:
        problem = error.strerror or str(error)
        raise FileError(name, problem, "give a file with a section robot", code="arm.file") from None
    if "<robot" in text:
        made = as_argument(Path(name).with_suffix(".yaml"))
        remedy = f"convert the file, and give --arm {made}: rig import-urdf {as_argument(name)} -o {made}"
        raise FileError(name, "is a URDF, not a file with a section robot", remedy, code="arm.urdf")
    root, data = read_yaml(text, name)
    if not isinstance(data, dict) or "robot" not in data:
        remedy = "see rig arms for an example, or choose an arm by name"
        raise FileError(name, "lacks the section robot", remedy, code="arm.no_section")
    section = {"robot": data["robot"]}
    try:
        robot = _ArmFile.model_validate(section).robot
    except ValidationError as error:
        raise RigFileError(name, problems_of(error, section, root, _ArmFile)) from None
    return ChosenArm(robot, None, f"the file {Path(name).name}")


def _of_library(name: str) -> ChosenArm:
    arm = load_arm(name)
    return ChosenArm(arm.robot, arm.repeatability_mm, f"the arm library: {arm.maker} {arm.model}", in_library=True)


_BASELINE_MM = 50.0
_SOCKETS = ("A", "B")
_NO_CIRCLE = """\
# No circle yet. Mount the ball link, guide the robot around the ball with the z axis of the tool towards the ball,
# and run `rig circle fit --live --rig FILE --write`; or write the circle by hand:
# tests:
#   circle: {centre_mm: [x, y, z], normal: [0, 0, 1], radius_mm: 70, posture_deg: [q1, q2, q3, q4, q5, q6]}"""
_CIRCLE = "computed from the start position with the nominal arm, accurate to some mm"


def rig_text(answers: Answers, arm: ChosenArm, name: str, today: dt.date, measured_by: MeasuredBy = "gauges") -> str:
    """Text of a rig file for the answers. Effects and certificates are added later."""
    tool = Pose() if measured_by in ("sockets", "arm") else answers.tool or arm.robot.tool
    lines = [
        f"# Written by rig init on {today}. Lengths are in mm, angles in degrees; run rig check after each edit.",
        f"name: {name}",
        "",
        f"# Nominal arm, from {plain(arm.source)}{_ABOUT[measured_by]}",
        robot_text(arm.robot.model_copy(update={"tool": tool, "build": answers.build or arm.robot.build})).rstrip(),
    ]
    match measured_by:
        case "gauges":
            lines += ["", *_gauges(answers), "", *_feedback(answers), *_circle(answers)]
        case "sockets" | "arm":
            lines += ["", *_feedback(answers), *_touch(answers, measured_by)]
    return "\n".join([*lines, *_limits(answers, arm.repeatability_mm, measured_by)]) + "\n"


_ABOUT: dict[MeasuredBy, str] = {
    "gauges": "; tool is the ball's position on the flange.",
    "tracker": ". The places of tracker and target are fitted to the poses.",
    "sockets": ".",
    "arm": ". Another arm measures it: rig pair.",
}


def _gauges(answers: Answers) -> Iterator[str]:
    """Yield the gauges, placed symmetrically on the baseline."""
    yield "gauges:"
    half_mm = (answers.baseline_mm or _BASELINE_MM) / 2
    for name, at_mm, gauge in zip(("g1", "g2"), (half_mm, -half_mm), answers.gauges or (), strict=False):
        yield f"  {name}: # {gauge.origin.instruments}"
        shared = ("channel",) if gauge.shares else ()
        seen = ("counts",) if "counts" in gauge.model_fields_set else ()
        placed = gauge.model_copy(update={"offset_mm": at_mm})
        yield from _part(placed, ("interface", "port", "line", *shared, "offset_mm", *seen), 4)
        if gauge.origin.doubts:
            yield f"    # not confirmed: {gauge.origin.doubts}"


def _circle(answers: Answers) -> Iterator[str]:
    if answers.circle is None:
        yield _NO_CIRCLE
        return
    yield "tests:"
    yield f"  circle: # {_CIRCLE}"
    yield from _part(answers.circle, ("centre_mm", "normal", "zero", "radius_mm"), 4)


def _touch(answers: Answers, measured_by: MeasuredBy) -> Iterator[str]:
    defaults, names = Touch.model_fields, ", ".join(_SOCKETS)
    ball_mm = flow(list(answers.tool.xyz_mm if answers.tool else defaults["ball_mm"].default))
    yield "tests:"
    yield "  touch:"
    yield f"    sockets: [{names}]"
    if measured_by == "arm":
        yield f"    ball_mm: {ball_mm} # about where ball or socket is on the flange; the fit finds it"
        yield "    # One known distance fixes the scale: of two sockets on the second arm, or of two fixed in the cell."
        yield f"    # distances: [{{between: [{names}], distance_mm: 300, u_mm: 0.02}}]"
        return
    yield f"    ball_mm: {ball_mm} # approximate ball position on the flange, refined by the diagnosis"
    yield f"    touches: {defaults['touches'].default}"
    yield "    seat: ball # tip for a pointer that is guided into a punch mark by eye"
    yield "    # A known distance sets the scale of the arm; measure over both balls (rig parts --over-balls-mm):"
    yield f"    # distances: [{{between: [{names}], distance_mm: 100, u_mm: 0.05}}]"


def _feedback(answers: Answers) -> Iterator[str]:
    if (feedback := answers.feedback) is None:
        return
    yield f"feedback: # {feedback.origin.instruments}"
    yield from _part(feedback, ("interface", "port", "rate_hz", "cycle_ms", "fields"), 2)
    yield ""


def _limits(answers: Answers, rp_mm: float | None, measured_by: MeasuredBy) -> Iterator[str]:
    tolerance_mm, test = answers.tolerance_mm, TEST_WITHOUT_GAUGES.get(measured_by)
    if not tolerance_mm and rp_mm is None:
        return
    comment, figures_by_test = "", dict[str, Any]()
    if tolerance_mm and test:
        comment = f" # allowed error {tolerance_mm:g} mm, rms"
        figures_by_test = {test: {"rms_mm": shared_limit(tolerance_mm).model_dump()}}
    elif tolerance_mm:
        radius_mm = answers.circle.radius_mm if answers.circle else Circle.model_fields["radius_mm"].default
        comment = (
            f" # allowed error {tolerance_mm:g} mm at the ball; for angles divided by the radius, {radius_mm:g} mm"
        )
        limits = limits_of_tolerance(tolerance_mm, radius_mm, rp_mm)
        figures_by_test = limits.model_dump(exclude_none=True, exclude={"data_sheet_rp_mm"})
    yield from ("", f"limits:{comment}")
    yield from (f"  {name}: {flow(figures)}" for name, figures in figures_by_test.items() if figures)
    if rp_mm is not None:
        yield f"  data_sheet_rp_mm: {flow(rp_mm)} # pose repeatability by ISO 9283, data sheet"


def _part(part: Gauge | Feedback | Circle, first: tuple[str, ...], indent: int) -> Iterator[str]:
    """Keys of a part: first the most important, then all others that differ from the default."""
    whole = part.model_dump(mode="json")
    differing = part.model_dump(mode="json", exclude_defaults=True)
    fields = {key: whole[key] for key in first if key in whole} | differing
    return (f"{' ' * indent}{key}: {flow(value)}" for key, value in fields.items())
