"""What a diagnosis leaves in its directory: the answer, the picture, and the rig file with what was missing and where
that came from."""

from __future__ import annotations

import datetime as dt
import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from pydantic import ValidationError

from analysis.diagnosis.judge.acts import acts_with
from analysis.diagnosis.judge.result import Diagnosis
from analysis.report.diagnosis_words import rival_names
from analysis.runs.written_files import Writer, holding, refuse_existing, write_all_new
from rigs.calibration import CalibratedModel, CalibrationFile
from rigs.edit import extended
from rigs.effects import Effect, Found
from rigs.errors import FileError
from rigs.schema.effect import name_of
from rigs.text import as_argument


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


def beside(effect: Effect, **additions: object) -> Effect:
    """An effect whose origin says more: `rivals`, `together`, `correlation` or `joints_deg` of `Found`."""
    origin = effect.found
    return effect if origin is None else effect.model_copy(update={"found": origin.model_copy(update=additions)})


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
        problem = "is not a valid name for the calibration of a rig file"
        raise FileError(name, problem, "use letters, digits, -, _ and . in the name of --output") from None


def hold_empty(directory: Path) -> None:
    """Raises FileError unless a directory is empty or does not exist."""
    try:
        if directory.exists() and (not directory.is_dir() or any(directory.iterdir())):
            raise FileError(
                str(directory),
                "exists already and is not empty",
                "choose a different --output, or remove it first",
            )
    except OSError as error:
        raise FileError(str(directory), error.strerror or str(error), "choose a different --output") from None


def write(diagnosis: Diagnosis, text: str, directory: Path, *, in_session: bool = False) -> list[Path]:
    """The files of a diagnosis in an empty directory; their paths, the rig file's last.

    text: of the rig file begun with. It is written with the faults added, of rivals the likeliest, and with the
    calibrated model beside it, unless the runs can show nothing. in_session: as of `picture`. Raises FileError.
    """
    from analysis.report.diagnosis_picture import picture  # noqa: PLC0415 - slow to import, needed here only
    from analysis.runs.written_files import holding, write_all_new  # noqa: PLC0415 - slow to import

    rig_file = directory / f"{diagnosis.rig.name}.yaml"
    pictured = replace(diagnosis, acts=acts_with(diagnosis.acts, as_argument(rig_file)))
    files = {
        "diagnosis.json": holding((json.dumps(diagnosis.to_dict(), indent=2) + "\n").encode()),
        "diagnosis.png": lambda file: picture(pictured, in_session=in_session).savefig(file, format="png", dpi=130),
    }
    if diagnosis.is_modelled:
        files |= extended_files(text, _origins(diagnosis), rig_file, diagnosis.calibrated)
    return write_all_new(directory, files)


def write_model(diagnosis: Diagnosis, text: str, output: Path) -> list[Path]:
    """The calibrated model as a rig file, the text with the faults added, of rivals the likeliest, and its calibration
    beside it; their paths, the rig file's last. Raises FileError if one exists or a parameter is out of range."""
    if diagnosis.condition == "out_of_range":
        (named,) = diagnosis.effects
        problem = f"is not written: {name_of(named.effect)} is further off than rig corrects"
        raise FileError(str(output), problem, "check the rig file, the variant of the arm and its mastering")
    return write_extended(text, _origins(diagnosis), output, diagnosis.calibrated)


def _origins(diagnosis: Diagnosis) -> list[Effect]:
    """The faults, each with where it came from."""
    return [
        beside(
            with_origin(named.effect, diagnosis.runs, named.sd, (named.gap_without_um, diagnosis.train.after_um)),
            rivals=tuple(rival_names(named)),
            together=tuple(name_of(twin) for twin in named.twins),
            joints_deg=diagnosis.calibrated.joints_deg if diagnosis.calibrated else None,
        )
        for named in diagnosis.written
    ]
