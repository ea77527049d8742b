"""The arm of a new rig file: one by name, or the `robot` section of a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from rigs.arms import arm_names, load_arm
from rigs.errors import FileError
from rigs.files import read_text
from rigs.problems import RigFileError, problems_of
from rigs.schema.part import FEWEST_AXES, Part
from rigs.schema.robot import Robot
from rigs.text import the_same
from rigs.yaml_text import read_yaml

_MAX_BYTES = 1_000_000


@dataclass(frozen=True)
class ChosenArm:
    """An arm. repeatability_mm: RP of its data sheet, None where not known; source: where its numbers are from."""

    robot: Robot
    repeatability_mm: float | None
    source: str


class _ArmFile(Part):
    """The section that is read of a file."""

    robot: Robot


def chosen_arm(name: str) -> ChosenArm:
    """Return an arm of the library by its name, or from a file with a section `robot`. Raises FileError."""
    if the_same(name, arm_names()):
        return _of_library(name)
    try:
        text = read_text(Path(name), _MAX_BYTES)
    except FileNotFoundError:
        return _of_library(name)  # which reports the names that are near
    except OSError as error:
        raise FileError(name, error.strerror or str(error), "give a file with a section robot") from None
    root, data = read_yaml(text, name)
    if not isinstance(data, dict) or "robot" not in data:
        raise FileError(name, "lacks the section robot", "see rig arms for one, or choose an arm by its name")
    section = {"robot": data["robot"]}
    try:
        robot = _ArmFile.model_validate(section).robot
    except ValidationError as error:
        raise RigFileError(name, problems_of(error, section, root, _ArmFile)) from None
    _hold_six(robot, name)
    return ChosenArm(robot, None, f"the file {Path(name).name}")


def _hold_six(robot: Robot, where: str) -> None:
    """Raises FileError for an arm that cannot drive the circles of a ball link."""
    if (axes := len(robot.axes)) > FEWEST_AXES:
        what = f"has {axes} axes, and the ball link's programs are of six"
        raise FileError(where, what, "write a rig file of its robot section and tests.touch alone (docs/any-arm.md)")


def _of_library(name: str) -> ChosenArm:
    arm = load_arm(name)
    _hold_six(arm.robot, name)
    return ChosenArm(arm.robot, arm.repeatability_mm, f"the arm library: {arm.maker} {arm.model}")
