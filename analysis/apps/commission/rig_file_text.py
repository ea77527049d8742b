"""The text of a new rig file, with comments: what was found, what is nominal, and what is still to be measured.

Its arm is one of the library by its name, or the `robot` section of a file.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from analysis.apps.commission.init_answers import Answers
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
    """An arm. repeatability_mm: RP of its data sheet, None if it is not known; source: of its numbers."""

    robot: Robot
    repeatability_mm: float | None
    source: str
    in_library: bool = False


class _ArmFile(Part):
    """The section that is read of a file."""

    robot: Robot


def chosen_arm(name: str, measured_by: MeasuredBy = "gauges") -> ChosenArm:
    """Return an arm of the library by its name, or from a file with a section `robot`. Raises FileError, also for an
    arm that cannot drive the circles of gauges where these measure it."""
    arm = _arm_of(name)
    if measured_by == "gauges" and (axes := len(arm.robot.axes)) != DRIVEN_AXES:
        problem = f"has {axes} axes, and the ball link's programs are of six"
        raise FileError(name, problem, "give --measured-by sockets or --measured-by tracker (docs/any-arm.md)")
    return arm


def _arm_of(name: str) -> ChosenArm:
    if the_same(name, arm_names()):
        return _of_library(name)
    try:
        text = read_text(Path(name), _MAX_BYTES)
    except FileNotFoundError:
        return _of_library(name)  # which reports the names that are near
    except OSError as error:
        raise FileError(name, error.strerror or str(error), "give a file with a section robot") from None
    if "<robot" in text:
        made = as_argument(Path(name).with_suffix(".yaml"))
        remedy = f"make that of it, and give --arm {made}: rig import-urdf {as_argument(name)} -o {made}"
        raise FileError(name, "is a URDF and no file with a section robot", remedy)
    root, data = read_yaml(text, name)
    if not isinstance(data, dict) or "robot" not in data:
        raise FileError(name, "lacks the section robot", "see rig arms for one, or choose an arm by its name")
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
# No circle yet. Put the ball link on, lead the robot around the ball with the tool's z axis towards it, and let
# `rig circle fit --live --rig FILE --write` write the circle here; or write it by hand:
# tests:
#   circle: {centre_mm: [x, y, z], normal: [0, 0, 1], radius_mm: 70, posture_deg: [q1, q2, q3, q4, q5, q6]}"""
_CIRCLE = "from where the robot stood at its start, with the nominal arm: within some mm"


def rig_text(answers: Answers, arm: ChosenArm, name: str, today: dt.date, measured_by: MeasuredBy = "gauges") -> str:
    """Return the rig file that the answers make, a line each; effects and certificates are left to later."""
    lines = [
        f"# Written by rig init on {today}. Lengths are mm, angles degrees; after each edit run rig check.",
        f"name: {name}",
        "",
        *_ARM_LINES[measured_by](answers, arm),
    ]
    return "\n".join(lines) + "\n"


def placed(answers: Answers) -> dict[str, Gauge]:
    """Return the gauges by name, at their places on the baseline: half of it to each side."""
    half_mm = (answers.baseline_mm or _BASELINE_MM) / 2
    signed = zip(("g1", "g2"), (half_mm, -half_mm), answers.gauges or (), strict=False)
    return {name: gauge.model_copy(update={"offset_mm": at_mm}) for name, at_mm, gauge in signed}


def _arm_section(arm: ChosenArm, answers: Answers, tool: Pose) -> str:
    """Return the section `robot` with this tool, and with the build that was answered."""
    build = answers.build or arm.robot.build
    return robot_text(arm.robot.model_copy(update={"tool": tool, "build": build})).rstrip()


def _of_gauges(answers: Answers, arm: ChosenArm) -> Iterator[str]:
    yield f"# Nominal arm, from {plain(arm.source)}; tool is the ball's place on the flange."
    yield _arm_section(arm, answers, answers.tool or arm.robot.tool)
    yield ""
    yield "gauges:"
    for gauge_name, gauge in placed(answers).items():
        yield f"  {gauge_name}: # {gauge.origin.instruments}"
        shared = ("channel",) if gauge.shares else ()
        seen = ("counts",) if "counts" in gauge.model_fields_set else ()
        yield from _indented(_part(gauge, ("interface", "port", "line", *shared, "offset_mm", *seen)), 4)
        if gauge.origin.doubts:
            yield f"    # not confirmed: {gauge.origin.doubts}"
    yield ""
    yield from _feedback(answers)
    if answers.circle is not None:
        yield "tests:"
        yield f"  circle: # {_CIRCLE}"
        yield from _indented(_part(answers.circle, ("centre_mm", "normal", "zero", "radius_mm")), 4)
    else:
        yield _NO_CIRCLE
    yield from _limits(answers, arm.repeatability_mm)


def _of_tracker(answers: Answers, arm: ChosenArm) -> Iterator[str]:
    yield f"# Nominal arm, from {plain(arm.source)}. Where tracker and target are is found from the poses."
    yield _arm_section(arm, answers, answers.tool or arm.robot.tool)
    yield from _limits(answers, arm.repeatability_mm, "tracker")


def _of_sockets(answers: Answers, arm: ChosenArm) -> Iterator[str]:
    yield f"# Nominal arm, from {plain(arm.source)}."
    yield _arm_section(arm, answers, Pose())
    yield ""
    yield from _feedback(answers)
    ball_mm = list(answers.tool.xyz_mm if answers.tool else Touch.model_fields["ball_mm"].default)
    yield "tests:"
    yield "  touch:"
    yield f"    sockets: [{', '.join(_SOCKETS)}]"
    yield f"    ball_mm: {flow(ball_mm)} # about where the ball is on the flange; where it is exactly is found"
    yield f"    touches: {Touch.model_fields['touches'].default}"
    yield "    # One known distance says how large the arm is; measure over both balls (rig parts --over-balls-mm):"
    yield f"    # distances: [{{between: [{', '.join(_SOCKETS)}], distance_mm: 100, u_mm: 0.05}}]"
    yield from _limits(answers, arm.repeatability_mm, "sockets")


def _of_arm(answers: Answers, arm: ChosenArm) -> Iterator[str]:
    yield f"# Nominal arm, from {plain(arm.source)}. Another arm measures it: rig pair."
    yield _arm_section(arm, answers, Pose())
    yield ""
    ball_mm = list(answers.tool.xyz_mm if answers.tool else Touch.model_fields["ball_mm"].default)
    yield "tests:"
    yield "  touch:"
    yield f"    sockets: [{', '.join(_SOCKETS)}]"
    yield f"    ball_mm: {flow(ball_mm)} # about where ball or socket is on the flange; the fit finds it"
    yield "    # One known distance fixes the scale: of two sockets on the second arm, or of two fixed in the cell."
    yield f"    # distances: [{{between: [{', '.join(_SOCKETS)}], distance_mm: 300, u_mm: 0.02}}]"
    yield from _limits(answers, arm.repeatability_mm, "arm")


_ARM_LINES: dict[MeasuredBy, Callable[[Answers, ChosenArm], Iterator[str]]] = {
    "gauges": _of_gauges,
    "tracker": _of_tracker,
    "sockets": _of_sockets,
    "arm": _of_arm,
}


def _feedback(answers: Answers) -> Iterator[str]:
    """How the joints are read, where they are."""
    if (feedback := answers.feedback) is None:
        return
    yield f"feedback: # {feedback.origin.instruments}"
    yield from _indented(_part(feedback, ("interface", "port", "rate_hz", "cycle_ms", "fields")), 2)
    yield ""


def _limits(answers: Answers, rp_mm: float | None, measured_by: MeasuredBy = "gauges") -> Iterator[str]:
    """The limits that follow from what the work allows, of gauges or of the test without, and the data sheet's; no
    lines where there are none."""
    tolerance_mm, test = answers.tolerance_mm, TEST_WITHOUT_GAUGES.get(measured_by)
    if not tolerance_mm and rp_mm is None:
        return
    comment, figures_by_test = "", dict[str, Any]()
    if tolerance_mm and test:
        comment = f" # {tolerance_mm:g} mm allowed, rms"
        figures_by_test = {test: {"rms_mm": shared_limit(tolerance_mm).model_dump()}}
    elif tolerance_mm:
        radius_mm = answers.circle.radius_mm if answers.circle else Circle.model_fields["radius_mm"].default
        comment = f" # {tolerance_mm:g} mm allowed at the ball; angles are that over the radius, {radius_mm:g} mm"
        limits = limits_of_tolerance(tolerance_mm, radius_mm, rp_mm)
        figures_by_test = limits.model_dump(exclude_none=True, exclude={"data_sheet_rp_mm"})
    yield from ("", f"limits:{comment}")
    yield from (f"  {name}: {flow(figures)}" for name, figures in figures_by_test.items() if figures)
    if rp_mm is not None:
        yield f"  data_sheet_rp_mm: {flow(rp_mm)} # pose repeatability by ISO 9283, data sheet"


def _part(part: Gauge | Feedback | Circle, first: tuple[str, ...]) -> Iterator[str]:
    """The keys of a part: first those that a person looks for, then what differs from its default."""
    whole = part.model_dump(mode="json")
    differing = part.model_dump(mode="json", exclude_defaults=True)
    fields = {key: whole[key] for key in first if key in whole} | differing
    return (f"{key}: {flow(value)}" for key, value in fields.items())


def _indented(lines: Iterator[str], by: int) -> Iterator[str]:
    return (" " * by + line for line in lines)
