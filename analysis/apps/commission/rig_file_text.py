"""Text of a new rig file, with comments on devices, nominal values and open measurements."""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from analysis.apps.commission.init_answers import (
    Answers,
)
from analysis.robot.description.linuxcnc_configuration import configured_robot
from analysis.robot.description.rig_section import robot_text
from rigs.arms import arm_names, load_arm
from rigs.errors import FileError
from rigs.files import read_text
from rigs.problems import RigFileError, problems_of
from rigs.schema.declared_tests import Circle, Touch
from rigs.schema.limits import (
    limits_of_tolerance,
    shared_limit,
)
from rigs.schema.part import Part
from rigs.schema.robot import Pose, Robot
from rigs.schema.vocabulary import DRIVEN_AXES, TEST_WITHOUT_GAUGES, MeasuredBy
from rigs.text import as_argument, escape_text, the_same
from rigs.yaml_text import flow, read_yaml

_MAX_BYTES = 1_000_000


@dataclass(frozen=True)
class ChosenArm:
    robot: Robot
    repeatability_mm: float | None
    """RP from the data sheet; None if unknown."""
    source: str
    """Origin of the constants."""
    in_library: bool = False


class _ArmFile(Part):
    robot: Robot


def chosen_arm(name: str, measured_by: MeasuredBy = "gauges") -> ChosenArm:
    """Arm from the library or from a file with a `robot` section; for gauges one that can drive circles."""
    arm = _of_library(name) if the_same(name, arm_names()) else _of_file(name)
    if measured_by == "gauges" and (axes := len(arm.robot.axes)) != DRIVEN_AXES:
        problem = f"has {axes} axes, but the ball link's programs need six"
        remedy = "give --measured-by sockets or --measured-by tracker (docs/any-arm.md)"
        raise FileError(name, problem, remedy, code="arm.invalid")
    return arm


def _of_file(name: str) -> ChosenArm:
    if Path(name).suffix.lower() == ".ini":
        return ChosenArm(configured_robot(Path(name)), None, f"the LinuxCNC configuration {Path(name).name}")
    try:
        text = read_text(Path(name), _MAX_BYTES)
    except FileNotFoundError:
        return _of_library(name)  # reports similar names
    except OSError as error:
        raise FileError.of_os(name, error, "give a file with a section robot", code="file.unreadable") from None
    if "<robot" in text:
        made = as_argument(Path(name).with_suffix(".yaml"))
        remedy = f"convert the file, and give --arm {made}: rig import-urdf {as_argument(name)} -o {made}"
        raise FileError(name, "is a URDF, not a file with a section robot", remedy, code="arm.invalid")
    root, data = read_yaml(text, name)
    if not isinstance(data, dict) or "robot" not in data:
        remedy = "see rig arms for an example, or choose an arm by name"
        raise FileError(name, "lacks the section robot", remedy, code="arm.invalid")
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


def rig_text(answers: Answers, arm: ChosenArm, name: str, today: dt.date, measured_by: MeasuredBy = "gauges") -> str:
    half_mm, circle = (answers.baseline_mm or _BASELINE_MM) / 2, answers.circle
    placed = zip(answers.gauges or (), (half_mm, -half_mm), strict=False)
    tool = Pose() if measured_by in ("sockets", "arm") else answers.tool or arm.robot.tool
    radius_mm: float = circle.radius_mm if circle else Circle.model_fields["radius_mm"].default
    limits, rp_mm = dict[str, Any](), arm.repeatability_mm
    if answers.tolerance_mm and (test := TEST_WITHOUT_GAUGES.get(measured_by)):
        limits = {test: {"rms_mm": shared_limit(answers.tolerance_mm).model_dump()}}
    elif answers.tolerance_mm:
        own = limits_of_tolerance(answers.tolerance_mm, radius_mm, rp_mm)
        limits = own.model_dump(exclude_none=True, exclude={"data_sheet_rp_mm"})
    return rendered(
        "rig_file",
        by=measured_by, today=today, name=name, source=escape_text(arm.source), keys=_keys, flow=flow,
        robot=robot_text(
            arm.robot.model_copy(update={"tool": tool, "build": answers.build or arm.robot.build})
        ).rstrip(),
        gauges=[gauge.model_copy(update={"offset_mm": at_mm}) for gauge, at_mm in placed], feedback=answers.feedback,
        circle=circle, touches=Touch.model_fields["touches"].default,
        ball_mm=list(answers.tool.xyz_mm if answers.tool else Touch.model_fields["ball_mm"].default),
        limits=limits, rp_mm=rp_mm, tolerance_mm=f"{answers.tolerance_mm or 0:g}", radius_mm=f"{radius_mm:g}",
    )  # fmt: skip


def _keys(part: Part, first: Sequence[str], indent: int) -> str:
    """Keys of a part: the most important first, then all others that differ from the default."""
    whole = part.model_dump(mode="json")
    fields = {key: whole[key] for key in first if key in whole} | part.model_dump(mode="json", exclude_defaults=True)
    return "\n".join(f"{' ' * indent}{key}: {flow(value)}" for key, value in fields.items())


def rendered(template: str, /, **values: Any) -> str:
    """A plain text from a template, without escapes."""
    from jinja2 import Environment, PackageLoader, StrictUndefined  # noqa: PLC0415 - slow to import, needed here only

    loader = PackageLoader("analysis")
    environment = Environment(loader=loader, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)  # noqa: S701 - no HTML
    return environment.get_template(f"{template}.jinja").render(values).rstrip() + "\n"
