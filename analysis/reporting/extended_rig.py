"""The extended rig file: the old text, and the effects that were found with where they came from."""

from __future__ import annotations

import datetime as dt
import hashlib
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from pydantic import ValidationError

from analysis.files.write import Writer, holding, refuse_existing, write_all_new
from rigs.calibration import CalibratedModel, CalibrationFile
from rigs.edit import extended
from rigs.effects import Effect, Found
from rigs.errors import FileError


def with_origin(effect: Effect, runs: Sequence[str], sd: Mapping[str, float], gap_um: tuple[float, float]) -> Effect:
    """An effect that says when and from which runs it was found, how sure, and which gap (before, after) it closed.

    Numbers are cut to nine digits, uncertainties to three, gaps to the nanometre: a person reads this file.
    """
    before, after = gap_um
    origin = Found(
        date=dt.datetime.now(dt.UTC).date(),
        runs=tuple(runs),
        sd={field: float(f"{value:.3g}") for field, value in sd.items() if math.isfinite(value)},
        gap_um=(round(before, 3), round(after, 3)),
    )
    numbers = {field: value for field, value in effect if isinstance(value, float)}
    rounded = {field: float(f"{value:.9g}") for field, value in numbers.items()}
    return effect.model_copy(update={"found": origin, **rounded})


def beside(effect: Effect, **more: object) -> Effect:
    """An effect whose origin says more: `rivals`, `together`, `correlation` or `joints_deg` of `Found`."""
    origin = effect.found
    return effect if origin is None else effect.model_copy(update={"found": origin.model_copy(update=more)})


def extended_files(
    text: str, effects: Sequence[Effect], output: Path, calibrated: CalibratedModel | None
) -> dict[str, Writer]:
    """The files of a rig file's text with effects added by name, and before it that of its calibrated model, as
    NAME.calibration.json. Raises RigFileError where an effect is beyond its bounds."""
    files, named = {}, None
    if calibrated:
        path, content = calibration_path(output), calibrated.content
        named, files[path.name] = calibration_file(path.name, content), holding(content)
    return files | {output.name: holding(extended(text, effects, str(output), named).encode())}


def write_extended(
    text: str, effects: Sequence[Effect], output: Path, calibrated: CalibratedModel | None = None
) -> list[Path]:
    """Write these files, both or none, and return their paths, the rig file's last. Raises FileError where one exists
    or cannot be written, RigFileError where an effect is beyond its bounds."""
    return write_all_new(output.parent, extended_files(text, effects, output, calibrated))


def hold_new(output: Path) -> None:
    """Raise FileError where a rig file or its calibration exists already, before anything is computed."""
    for path in (output, calibration_path(output)):
        refuse_existing(path)


def calibration_path(output: Path) -> Path:
    """The calibration that lies beside a rig file."""
    return output.with_name(f"{output.stem}.calibration.json")


def calibration_file(name: str, content: bytes) -> CalibrationFile:
    """Return what a rig file says of a calibration file. Raises FileError for a name that a rig file cannot have."""
    try:
        return CalibrationFile(file=name, sha256=hashlib.sha256(content).hexdigest())
    except ValidationError:
        what = "is no name that a rig file can give to its calibration"
        raise FileError(name, what, "use letters, digits, -, _ and . in the name of --output") from None
