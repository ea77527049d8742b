"""What a diagnosis leaves in its directory: the answer, the picture, and the rig file with what was missing."""

from __future__ import annotations

import json
from pathlib import Path

from analysis.inference.result import Diagnosis
from analysis.reporting.diagnosis_words import rival_names
from analysis.reporting.extended_rig import beside, extended_files, with_origin, write_extended
from rigs.effects import Effect
from rigs.errors import FileError
from rigs.schema.effect import name_of


def hold_empty(directory: Path) -> None:
    """Raises FileError unless a directory is empty or does not exist."""
    try:
        if directory.exists() and (not directory.is_dir() or any(directory.iterdir())):
            raise FileError(
                str(directory), "exists already and is not empty", "give another --output, or remove it first"
            )
    except OSError as error:
        raise FileError(str(directory), error.strerror or str(error), "give another --output") from None


def write(diagnosis: Diagnosis, text: str, directory: Path) -> list[Path]:
    """The files of a diagnosis in an empty directory; their paths, the rig file's last.

    text: of the rig file begun with. It is written with the faults added, of rivals the likeliest, and with the
    calibrated model beside it, unless the runs can show nothing. Raises FileError.
    """
    from analysis.files.write import holding, write_all_new  # noqa: PLC0415 - slow to import
    from analysis.reporting.diagnosis_picture import picture  # noqa: PLC0415 - slow to import, needed here only

    files = {
        "diagnosis.json": holding((json.dumps(diagnosis.to_dict(), indent=2) + "\n").encode()),
        "diagnosis.png": lambda file: picture(diagnosis).savefig(file, format="png", dpi=130),
    }
    if diagnosis.condition != "not_testable_here":
        rig_file = directory / f"{diagnosis.rig.name}.yaml"
        files |= extended_files(text, _origins(diagnosis), rig_file, diagnosis.calibrated)
    return write_all_new(directory, files)


def write_model(diagnosis: Diagnosis, text: str, output: Path) -> list[Path]:
    """The calibrated model as a rig file, the text with the faults added, of rivals the likeliest, and its calibration
    beside it; their paths, the rig file's last. Raises FileError where one exists."""
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
