"""Loading of a rig file and its calibration, by path or by name. All mistakes are reported together.

The hash of a calibration does not prove it correct: anyone can rewrite both. It is therefore compared with the arm:
name, axes, and the bounds of its effects.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import numpy as np
from pydantic import PrivateAttr, ValidationError

from rigs.arms import arm_files, load_arm, rig_text_of
from rigs.calibration import MOST_CALIBRATION_BYTES, CalibratedModel, CalibrationFile, largest_sd
from rigs.effects import AnyEffect
from rigs.errors import FileError, RigPlace
from rigs.files import of_newer_rig, read_bytes, read_from, read_text
from rigs.named_arm import refuse_classic_constants
from rigs.other_files import refuse_head, refuse_other_data, refuse_other_texts
from rigs.problems import RigFileError, problems_of, truth_values
from rigs.rig import Rig, misplaced
from rigs.schema.effect import bounds, size_field
from rigs.schema.part import Part, Vector
from rigs.schema.robot import LinkConstants
from rigs.text import nearest, the_same
from rigs.yaml_text import read_yaml

_REMEDY = "restore both files of the same diagnosis, or repeat the diagnosis"
_MOST_UM = 1e6
_MOST_WIDENED = 1000.0
"""Largest ratio of real to expected error: 10 mm for an arm calibrated to 10 µm would be no calibration."""
_ROUNDED = 1 + 1e-6
_LEAST_DEG, _MOST_DEG = -1000.0, 1000.0
"""Limits of joint angles: controllers count at most three turns."""


def contradictions(calibrated: CalibratedModel, rig: Rig) -> Iterator[str]:
    """Yield the reasons why a calibration cannot belong to a rig. A diagnosis writes none that has such reasons."""
    axes = len(rig.robot.axes)
    if calibrated.rig != rig.name:
        yield f"is the calibration of {calibrated.rig}, but the rig file describes {rig.name}"
    if len(calibrated.joints_deg) != axes:
        yield f"is for an arm of {len(calibrated.joints_deg)} axes, but the rig file has {axes}"
    if not all(_LEAST_DEG <= low <= high <= _MOST_DEG for low, high in calibrated.joints_deg):
        yield "joints_deg does not contain valid joint ranges"
    errors_um = (calibrated.before_um, calibrated.calibrated_um, calibrated.held_out_um or 0.0)
    if not all(0 <= error <= _MOST_UM for error in errors_um) or calibrated.widened > _MOST_WIDENED:
        yield "contains implausibly large errors"
    for number, term in enumerate(calibrated.terms):
        if (axis := getattr(term.effect, "axis", 1)) > axes:
            yield f"term {number} refers to axis {axis}, but the arm has {axes}"
        name = size_field(term.effect)
        value, bound = abs(term.times * float(getattr(term.effect, name))), bounds(term.effect, name)[1]
        if not value <= bound:
            yield f"term {number} has a total {name} of {value:g}; the maximum for an arm is {bound:g}"
    spread = np.sqrt((calibrated.root**2).sum(axis=1))
    for parameter, sd in zip(calibrated.parameters, spread.tolist(), strict=True):
        if not 0 < sd <= _ROUNDED * largest_sd(calibrated.terms[parameter.term].effect, parameter.field):
            yield f"the uncertainty of {parameter.field} of term {parameter.term} is {sd:.3g}, which is implausible"


C = TypeVar("C", Rig, CalibratedModel)
SHIPPED = Path(__file__).parent
_EFFECTS = ".effects.yaml"
_MAX_BYTES = 1_000_000
_HEAD_BYTES = 400


class Hidden(Part):
    effects: tuple[AnyEffect, ...] | None = None
    eccentricity_mm: Vector | None = None
    """Position of the base-ball relative to the circle centre, in the world frame. None: the value of the rig file."""
    axes: tuple[LinkConstants, ...] | None = None
    """Constants of this single arm, with which its controller computes as well. None: those of the rig file."""

    _where: str = PrivateAttr("effects")

    def apply_to(self, rig: Rig) -> Rig:
        """The rig with these effects. Raises FileError if they are those of an arm with other axes."""
        count = len(rig.robot.axes)
        if self.axes and len(self.axes) != count:
            problem = f"has {len(self.axes)} axes, but the robot has {count}"
            raise FileError(self._where, problem, "give a row for each axis", code="rig_file.invalid")
        if problem := next(misplaced(self.effects or (), count), ""):
            raise FileError(self._where, problem, "correct the axis", code="rig_file.invalid")
        tests = rig.tests
        if tests.circle and self.eccentricity_mm:
            circle = tests.circle.model_copy(update={"eccentricity_mm": self.eccentricity_mm})
            tests = tests.model_copy(update={"circle": circle})
        robot = rig.robot
        if self.axes:
            own = zip(robot.axes, self.axes, strict=True)
            axes = tuple(axis.model_copy(update=dict(constants)) for axis, constants in own)
            robot = robot.model_copy(update={"axes": axes, "controller": "constants", "controller_axes": ()})
        return rig.model_copy(update={"effects": self.effects or (), "tests": tests, "robot": robot})


def shipped() -> dict[str, Path]:
    return {file.stem: file for file in sorted(SHIPPED.glob("*.yaml")) if not file.name.endswith(_EFFECTS)}


def shipped_effects() -> dict[str, Path]:
    return {file.name.removesuffix(_EFFECTS): file for file in sorted(SHIPPED.glob(f"*{_EFFECTS}"))}


def find(name: str | Path) -> Path:
    """A rig file by path, a shipped cell by name (`ur10e-cell`), or an arm of the library (`ur10e`).

    No shipped cell has the name of an arm, so the name of an arm never brings a tool, a payload or gauges. Raises
    FileError that lists the shipped rigs.
    """
    return _find_file(name, {**shipped(), **arm_files()}, "rig file", "rig", shipped())


def names_a_cell(name: str) -> bool:
    """True if a name given as an arm would load a shipped cell, with its tool, payload and gauges."""
    return not Path(name).is_file() and the_same(name, {**shipped(), **arm_files()}) in shipped()


def example_cell(rig: Rig) -> str | None:
    """Shipped cell with this arm if a rig is an arm of the library without gauges, as `load("ur10e")` gives it."""
    cell = f"{rig.name}-cell"
    is_bare = cell in shipped() and not rig.gauges.recorded and rig.robot == load_arm(rig.name).robot
    return cell if is_bare else None


def _find_file(
    name: str | Path, files: Mapping[str, Path], kind: str, short: str, offered: Mapping[str, Path] | None = None
) -> Path:
    path = Path(name)
    try:
        if path.exists() and not path.is_dir():
            return path
    except OSError as error:
        raise _unreadable(path, error) from None
    if file_name := the_same(str(name), files):
        return files[file_name]
    if path.is_dir():
        raise FileError(
            str(name), f"is a directory, not a {kind}", "give a file in that directory", code="file.invalid"
        )
    arms = ", or an arm of the library (rig arms lists them)" if offered else ""
    meant = f"did you mean {' or '.join(near)}? Otherwise " if (near := nearest(str(name), files)) else ""
    remedy = f"{meant}give a path, or the name of a shipped {short}: {', '.join(offered or files)}{arms}"
    raise FileError(str(name), f"no such {kind}", remedy, code="file.missing")


def is_shipped(file: Path) -> bool:
    """True if a rig file is part of the package. The addresses in it belong to no real cell."""
    return file.resolve().is_relative_to(SHIPPED.resolve())


def load(name: str | Path) -> tuple[Rig, str]:
    """Load a rig with the calibration next to the file, and the original text. Raises FileError or RigFileError."""
    path = find(name)
    text = rig_text_of(path.stem) if path in arm_files().values() else _text(path)
    rig = parse(text, str(path))
    refuse_classic_constants(rig.robot, str(path))
    if rig.calibration:
        calibration_path = path.parent / rig.calibration.file
        content = _calibration(calibration_path, rig.calibration)
        for why in contradictions(content, rig):
            raise FileError(str(calibration_path), why, _REMEDY, code="calibration.invalid")
        rig = rig.with_calibration(rig.calibration, content)
    return rig, text


def calibrated_beside(rig: Rig, directory: Path) -> Rig:
    """Rig with its calibration if the calibration file is in a directory, such as the directory of a run."""
    if rig.calibration is None or not (path := directory / rig.calibration.file).is_file():
        return rig
    return rig.with_calibration(rig.calibration, _calibration(path, rig.calibration))


def _calibration(path: Path, named: CalibrationFile) -> CalibratedModel:
    if named.sha256 in _calibrations and path.is_file():
        return _calibrations[named.sha256]
    try:
        data = read_bytes(path, MOST_CALIBRATION_BYTES)
    except OSError as error:
        problem = f"is referenced by the rig file in the same directory, but cannot be read: {error.strerror or error}"
        raise FileError(
            str(path),
            problem,
            "copy the file there, or remove the key calibration from the rig file",
            code="calibration.missing",
        ) from None
    if hashlib.sha256(data).hexdigest() != named.sha256:
        problem = "was changed or replaced: the SHA-256 differs from that in the rig file"
        raise FileError(str(path), problem, _REMEDY, code="calibration.invalid")
    try:
        _keep(_calibrations, named.sha256, CalibratedModel.read(data))
        return _calibrations[named.sha256]
    except ValidationError as error:
        if newer := of_newer_rig(str(path), error, "format"):
            raise newer from None
        first = error.errors(include_url=False, include_input=False)[0]
        place = ".".join(map(str, first["loc"])) or "the file"
        raise FileError(
            str(path), f"is not a calibration: {place}: {first['msg']}", "diagnose again", code="calibration.invalid"
        ) from None


_calibrations: dict[str, CalibratedModel] = {}


def _text(path: Path) -> str:
    try:
        return read_text(path, _MAX_BYTES)
    except FileError:
        if path.is_file():
            refuse_head(str(path), read_from(path, 0, _HEAD_BYTES)[0])
        raise
    except OSError as error:
        raise _unreadable(path, error) from None


def _unreadable(path: Path, error: OSError) -> FileError:
    return FileError(
        str(path), error.strerror or str(error), "check the path and the permissions", code="file.unreadable"
    )


@contextmanager
def named_by(file: str | Path, rig: Rig) -> Iterator[None]:
    """Name the rig file in errors raised in this block, such as `cell.yaml, tests.circle`. Raises FileError."""
    try:
        yield
    except FileError as error:
        if not isinstance(error.where, RigPlace) or error.where.rig_name != rig.name:
            raise
        part = f", {error.where.part}" if error.where.part else ""
        raise FileError(f"{file}{part}", error.what, error.remedy, code=error.code) from None


def parse(text: str, where: str) -> Rig:
    """Parse the text of a rig file. `where` names it in errors. Raises RigFileError."""
    # Cached: the runs of a day contain the same text, and parsing it takes longer than reading their data.
    if text not in _good:
        _keep(_good, text, _parsed(text, where))
    return _good[text]


_good: dict[str, Rig] = {}
_MOST_KEPT = 16


def _keep(kept: dict[str, C], key: str, value: C) -> None:
    while len(kept) >= _MOST_KEPT:
        del kept[next(iter(kept))]
    kept[key] = value


def _parsed(text: str, where: str) -> Rig:
    refuse_other_texts(text, where)
    root, data = read_yaml(text, where)
    refuse_other_data(data, where)
    try:
        rig = Rig.model_validate(data)
    except ValidationError as error:
        raise RigFileError(where, problems_of(error, data, root)) from None
    if mistakes := list(truth_values(data, rig, root)):
        raise RigFileError(where, mistakes)
    return rig


def load_hidden(name: str | Path) -> Hidden:
    """Load the hidden effects of a cell from a file, also a rig file, or of a shipped rig by name (`paper-fanuc`).

    Raises FileError or RigFileError.
    """
    path = _find_file(name, shipped_effects(), "file of effects", "one")
    root, data = read_yaml(_text(path), str(path))
    if isinstance(data, list):
        data = {"effects": data}
    if not isinstance(data, dict) or not {"effects", "eccentricity_mm", "axes", "robot"} & data.keys():
        # A misspelt key would otherwise silently give an ideal robot.
        raise FileError(
            str(path),
            "lacks the key effects",
            "write effects: [{effect: …}], or effects: [] without effects",
            code="rig_file.invalid",
        )
    if "robot" in data:
        data = {"effects": data.get("effects")}
    try:
        hidden = Hidden.model_validate(data)
    except ValidationError as error:
        raise RigFileError(str(path), problems_of(error, data, root, Hidden)) from None
    hidden._where = str(path)
    return hidden
