"""Calibrated models as files: the rig file with added effects and their provenance, and the calibration beside it."""

from __future__ import annotations

import datetime as dt
import hashlib
import math
from collections.abc import Sequence
from pathlib import Path

from pydantic import ValidationError

from analysis.diagnosis.judge.certainty import likely_rivals
from analysis.diagnosis.judge.result import Diagnosis
from analysis.runs.written_files import Writer, holding, refuse_existing, write_all_new
from rigs.calibration import CalibratedModel, CalibrationFile
from rigs.edit import extended
from rigs.effects import Effect, EffectProvenance
from rigs.errors import FileError
from rigs.schema.effect import name_of


def extended_files(
    text: str, effects: Sequence[Effect], output: Path, calibrated: CalibratedModel | None
) -> dict[str, Writer]:
    """The calibrated model as NAME.calibration.json, then the rig file with effects added by name."""
    files, named, name = {}, None, calibration_path(output).name
    if calibrated:
        named, files[name] = calibration_file(name, calibrated.content), holding(calibrated.content)
    return files | {output.name: holding(extended(text, effects, str(output), named).encode())}


def write_extended(
    text: str, effects: Sequence[Effect], output: Path, calibrated: CalibratedModel | None = None
) -> list[Path]:
    """Write the files of `extended_files`, all or none; the path of the rig file is last."""
    return write_all_new(output.parent, extended_files(text, effects, output, calibrated))


def refuse_existing_rig(output: Path) -> None:
    for path in (output, calibration_path(output)):
        refuse_existing(path)


def calibration_path(output: Path) -> Path:
    return output.with_name(f"{output.stem}.calibration.json")


def calibration_file(name: str, content: bytes) -> CalibrationFile:
    """Raises FileError for a name that a rig file cannot contain."""
    try:
        return CalibrationFile(file=name, sha256=hashlib.sha256(content).hexdigest())
    except ValidationError:
        problem = "is not a valid name for the calibration of a rig file"
        raise FileError(
            name, problem, "use letters, digits, -, _ and . in the name of --output", code="output.invalid"
        ) from None


def write_model(diagnosis: Diagnosis, text: str, output: Path) -> list[Path]:
    """Write the calibrated model as a rig file and a calibration file, and return the paths, that of the rig file last.

    text: the initial rig file, to which the faults (of rivals the likeliest) are added. Raises FileError if a file
    exists or a parameter is out of range.
    """
    if diagnosis.condition == "out_of_range":
        (named,) = diagnosis.effects
        problem = f"was not written: {name_of(named.effect)} is beyond the range that rig corrects"
        remedy = "check the rig file, the variant of the arm and the mastering"
        raise FileError(str(output), problem, remedy, code="correction.impossible")
    return write_extended(text, with_provenance(diagnosis), output, diagnosis.calibrated)


def with_provenance(diagnosis: Diagnosis) -> list[Effect]:
    """The faults of a diagnosis with their provenance, rounded for a reader of the file."""
    joints_deg = diagnosis.calibrated.joints_deg if diagnosis.calibrated else None
    effects = []
    for named in diagnosis.written:
        provenance = EffectProvenance(
            date=dt.datetime.now(dt.UTC).date(),
            runs=tuple(diagnosis.runs),
            sd={field: float(f"{value:.3g}") for field, value in named.sd.items() if math.isfinite(value)},
            gap_um=(round(named.gap_without_um, 3), round(diagnosis.train.after_um, 3)),
            rivals=tuple(name_of(rival.effect) for rival in likely_rivals(named)),
            together=tuple(map(name_of, named.twins)),
            joints_deg=joints_deg,
        )
        rounded = {field: float(f"{value:.9g}") for field, value in named.effect if isinstance(value, float)}
        effects.append(named.effect.model_copy(update={"found": provenance, **rounded}))
    return effects
