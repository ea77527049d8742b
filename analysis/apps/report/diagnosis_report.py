"""Output files of a diagnosis: the answer, the picture, and the rig file with added effects and their provenance."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

from analysis.correction.model_files import extended_files, with_provenance
from analysis.diagnosis.judge.acts import acts_with
from analysis.diagnosis.judge.result import Diagnosis
from analysis.runs.written_files import holding, write_all_new
from rigs.errors import FileError
from rigs.text import as_argument


def require_empty(directory: Path) -> None:
    """Raise FileError unless a directory is empty, or can be created."""
    if directory.is_file():
        problem, remedy = "is a file, but the files of a diagnosis need a directory", "give --output DIR, or FILE.html"
        raise FileError(str(directory), problem, remedy, code="output.exists")
    above = next(path for path in (directory, *directory.absolute().parents) if os.path.lexists(path))
    if not above.is_dir() or not os.access(above, os.R_OK | os.W_OK | os.X_OK):
        problem = f"cannot be written: {above} is not a writable directory"
        raise FileError(str(directory), problem, "choose a different --output", code="output.not_writable")
    if above == directory and any(directory.iterdir()):
        problem, remedy = "exists already and is not empty", "choose a different --output, or remove it first"
        raise FileError(str(directory), problem, remedy, code="output.exists")


def write(diagnosis: Diagnosis, text: str, directory: Path, *, in_session: bool = False) -> list[Path]:
    """Write the files of a diagnosis to an empty directory; the path of the rig file is last.

    The rig file adds the faults (of rivals the likeliest) and refers to the calibrated model, unless the runs are
    inconclusive. in_session: see `picture`.
    """
    from analysis.apps.report.diagnosis_answer import plain_object  # noqa: PLC0415 - slow to import
    from analysis.apps.report.diagnosis_picture import picture  # noqa: PLC0415 - slow to import, needed here only

    rig_file = directory / f"{diagnosis.rig.name}.yaml"
    pictured = replace(diagnosis, acts=acts_with(diagnosis.acts, as_argument(rig_file)))
    files = {
        "diagnosis.json": holding((json.dumps(plain_object(diagnosis), indent=2) + "\n").encode()),
        "diagnosis.png": lambda file: picture(pictured, in_session=in_session).savefig(file, format="png", dpi=130),
    }
    if diagnosis.is_modelled:
        files |= extended_files(text, with_provenance(diagnosis), rig_file, diagnosis.calibrated)
    return write_all_new(directory, files)
