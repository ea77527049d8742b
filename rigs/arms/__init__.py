"""The arm library: what makers publish of their arms, one YAML file an arm, named as the arm.

A file holds the `robot:` section of a rig file, the repeatability of the data sheet, and where each of its numbers
comes from. What no source has is left out of the file. `robot:` is the last key, so that the rest of the text from
there is the section with its comments, ready to be pasted.
"""

from __future__ import annotations

from dataclasses import dataclass
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
    """Where the numbers of an arm come from. second, third: what its geometry is held against."""

    geometry: str
    second: str
    third: str = ""
    limits: str
    masses: str = ""
    repeatability: str = ""


class ArmFile(Part):
    """A file of the library."""

    maker: str
    model: str
    note: str = ""
    """What a person should know of this arm: siblings that it may be taken for, numbers that were derived."""
    repeatability_mm: float | None = Field(default=None, gt=0, le=10)
    """Pose repeatability RP (ISO 9283) of the data sheet."""
    sources: Sources
    frames: str
    """Where the base frame and the flange frame stand."""
    robot: Robot

    @model_validator(mode="after")
    def _sourced(self) -> ArmFile:
        if (self.repeatability_mm is not None) != bool(self.sources.repeatability):
            raise ValueError("repeatability_mm and sources.repeatability belong together: give both or neither")
        if any(axis.mass_kg for axis in self.robot.axes) != bool(self.sources.masses):
            raise ValueError("mass_kg and sources.masses belong together: give both or neither")
        return self


@dataclass(frozen=True)
class Arm:
    """An arm of the library. text: the `robot:` section of a rig file, with its comments."""

    name: str
    maker: str
    model: str
    note: str
    repeatability_mm: float | None
    sources: Sources
    frames: str
    robot: Robot
    text: str


def arm_names() -> tuple[str, ...]:
    """Return the names of all arms, in alphabetical order."""
    return tuple(sorted(file.stem for file in _FOLDER.glob("*.yaml")))


def arm_files() -> dict[str, Path]:
    """Return the file of each arm by its name."""
    return {name: _FOLDER / f"{name}.yaml" for name in arm_names()}


def rig_text_of(name: str) -> str:
    """Return the text of a rig file that has this arm, and nothing else."""
    return f"name: {name}\n{load_arm(name).text}"


def load_arm(name: str) -> Arm:
    """Return an arm by its name, as people write it. Raises FileError with the names that are near."""
    names = arm_names()
    library_name = the_same(name, names)
    if library_name is None:
        meant = f"did you mean {' or '.join(near)}?" if (near := nearest(name, names)) else "rig arms lists all;"
        remedy = f"{meant} rig import-urdf ARM.urdf -o ARM.yaml makes a file of any other, to be given by its name"
        raise FileError(name, "no arm of this name is in the library", remedy)
    file = _FOLDER / f"{library_name}.yaml"
    return _parsed(library_name, file.read_text(encoding="utf-8"), str(file))


@cache
def _parsed(name: str, text: str, where: str) -> Arm:
    """The arm of a file's text. Raises RigFileError."""
    root, data = read_yaml(text, where)
    try:
        file = ArmFile.model_validate(data)
    except ValidationError as error:
        raise RigFileError(where, problems_of(error, data, root, ArmFile)) from None
    section = text[text.index(_SECTION) + 1 :]
    return Arm(name=name, text=section, **{key: getattr(file, key) for key in ArmFile.model_fields})
