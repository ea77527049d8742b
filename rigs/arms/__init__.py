"""Arm library: published data of robot arms, with a YAML file per arm, named after the arm.

A file contains the repeatability from the data sheet, the sources of all numbers, and at the end the `robot:` section
of a rig file, commented and ready for pasting.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

from pydantic import Field, ValidationError, model_validator

from rigs.errors import FileError
from rigs.problems import RigFileError, problems_of
from rigs.schema.part import Part
from rigs.schema.robot import Robot
from rigs.text import nearest, the_same
from rigs.yaml_text import read_yaml

_FOLDER = Path(__file__).parent
_SECTION = "\nrobot:\n"


class Sources(Part):
    geometry: str
    second: str
    third: str = ""
    limits: str
    masses: str = ""
    repeatability: str = ""


class ArmFile(Part):
    maker: str
    model: str
    note: str = ""
    repeatability_mm: float | None = Field(default=None, gt=0, le=10)
    """Pose repeatability RP (ISO 9283) from the data sheet."""
    sources: Sources
    frames: str
    """Location of base frame and flange frame."""
    robot: Robot

    @model_validator(mode="after")
    def _sourced(self) -> ArmFile:
        if (self.repeatability_mm is not None) != bool(self.sources.repeatability):
            raise ValueError("repeatability_mm and sources.repeatability belong together: give both or neither")
        if any(axis.mass_kg for axis in self.robot.axes) != bool(self.sources.masses):
            raise ValueError("mass_kg and sources.masses belong together: give both or neither")
        return self


class LibraryArm(ArmFile):
    name: str
    text: str
    """Commented `robot:` section of a rig file."""


def arm_names() -> tuple[str, ...]:
    return tuple(sorted(file.stem for file in _FOLDER.glob("*.yaml")))


def arm_files() -> dict[str, Path]:
    return {name: _FOLDER / f"{name}.yaml" for name in arm_names()}


def rig_text_of(name: str) -> str:
    return f"name: {name}\n{load_arm(name).text}"


def load_arm(name: str) -> LibraryArm:
    names = arm_names()
    library_name = the_same(name, names)
    if library_name is None:
        meant = (
            f"did you mean {' or '.join(near)}?" if (near := nearest(name, names)) else "rig arms lists all of them."
        )
        remedy = f"{meant} For an arm outside the library, run rig import-urdf ARM.urdf -o ARM.yaml and give that file"
        raise FileError(name, "is not an arm of the library", remedy, code="arm.unknown")
    file = _FOLDER / f"{library_name}.yaml"
    return _parsed(library_name, file.read_text(encoding="utf-8"), str(file))


@cache
def _parsed(name: str, text: str, where: str) -> LibraryArm:
    root, data = read_yaml(text, where)
    data |= {"name": name, "text": text[text.index(_SECTION) + 1 :]}
    try:
        return LibraryArm.model_validate(data)
    except ValidationError as error:
        raise RigFileError(where, problems_of(error, data, root, LibraryArm)) from None
