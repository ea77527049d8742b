"""The arm of a new rig file: one by name, or the `robot` section of a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from rigs.errors import FileError
from rigs.files import read_bytes
from rigs.load import load, shipped
from rigs.problems import RigFileError, problems_of
from rigs.schema.part import Part
from rigs.schema.robot import Robot
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


def arm_names() -> tuple[str, ...]:
    """Return the names of the arms that are known."""
    return tuple(shipped())


def chosen_arm(name: str) -> ChosenArm:
    """Return an arm by its name, or from a file with a section `robot`. Raises FileError."""
    if name in arm_names():
        rig, _ = load(name)
        return ChosenArm(rig.robot, rig.limits.data_sheet_rp_mm, f"the shipped rig {name}")
    path = Path(name)
    try:
        text = read_bytes(path, _MAX_BYTES).decode()
    except UnicodeDecodeError as error:
        raise FileError(name, f"not UTF-8 at byte {error.start}", "save it as UTF-8") from None
    except OSError:
        known = ", ".join(arm_names())
        raise FileError(name, "no such arm or file", f"give a file with a section robot, or one of {known}") from None
    root, data = read_yaml(text, name)
    if not isinstance(data, dict) or "robot" not in data:
        raise FileError(name, "lacks the section robot", "write it as in rig example, or choose an arm by its name")
    section = {"robot": data["robot"]}
    try:
        return ChosenArm(_ArmFile.model_validate(section).robot, None, f"the file {path.name}")
    except ValidationError as error:
        raise RigFileError(name, problems_of(error, section, root, _ArmFile)) from None
