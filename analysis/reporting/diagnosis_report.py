"""What a diagnosis leaves in its directory: the answer, the picture, and the rig file with what was missing."""

from __future__ import annotations

import json
from pathlib import Path

from analysis.diagnosis.diagnosis import Diagnosis
from analysis.reporting.diagnosis_words import rival_names
from analysis.reporting.extended_rig import beside, with_origin, write_extended
from rigs.errors import FileError
from rigs.schema.effect import name_of


def hold_empty(directory: Path) -> None:
    """Raises FileError unless a directory is empty or does not exist."""
    try:
        if directory.exists() and (not directory.is_dir() or any(directory.iterdir())):
            raise FileError(
                str(directory), "exists already and is not empty", "give another --output, or empty it first"
            )
    except OSError as error:
        raise FileError(str(directory), error.strerror or str(error), "give another --output") from None


def write(found: Diagnosis, text: str, directory: Path) -> list[Path]:
    """The files of a diagnosis in an empty directory; their paths, the rig file's last.

    text: of the rig file begun with. It is written with the faults added, of rivals the likeliest, and with the
    calibrated model beside it, unless the runs can show nothing. Raises FileError.
    """
    from analysis.reporting.diagnosis_picture import picture  # noqa: PLC0415 - slow to import, needed here only

    answer, sheet = directory / "diagnosis.json", directory / "diagnosis.png"
    try:
        directory.mkdir(parents=True, exist_ok=True)
        answer.write_text(json.dumps(found.to_dict(), indent=2) + "\n", encoding="utf-8")
        picture(found).savefig(sheet, dpi=130)
    except OSError as error:
        raise FileError(str(directory), error.strerror or str(error), "give another --output") from None
    if found.condition == "not_testable_here":
        return [answer, sheet]
    return [answer, sheet, *write_model(found, text, directory / f"{found.rig.name}.yaml")]


def write_model(found: Diagnosis, text: str, output: Path) -> list[Path]:
    """The calibrated model as a rig file, the text with the faults added, of rivals the likeliest, and its calibration
    beside it; their paths, the rig file's last. Raises FileError where one exists."""
    effects = [
        beside(
            with_origin(one.effect, found.runs, one.sd, (one.gap_without_um, found.train.after_um)),
            rivals=tuple(rival_names(one)),
            together=tuple(name_of(twin) for twin in one.twins),
            joints_deg=found.calibrated.joints_deg if found.calibrated else None,
        )
        for one in found.standing
    ]
    return write_extended(text, effects, output, found.calibrated)
