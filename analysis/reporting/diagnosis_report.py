"""What a diagnosis leaves in its directory: the answer, the picture, and the rig file with what was missing."""

from __future__ import annotations

import json
from pathlib import Path

from analysis.diagnosis.diagnosis import Diagnosis
from analysis.reporting.diagnosis_words import rival_names
from analysis.reporting.extended_rig import beside, with_origin
from rigs.errors import FileError
from rigs.extend import extended


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

    text: of the rig file begun with. It is written, with the effects added, only where the diagnosis stands by some;
    where a name has rivals, the likeliest goes in. Raises FileError.
    """
    from analysis.files.write import holding, write_all_new  # noqa: PLC0415 - slow to import
    from analysis.reporting.diagnosis_picture import picture  # noqa: PLC0415 - slow to import, needed here only

    files = {
        "diagnosis.json": holding((json.dumps(found.to_dict(), indent=2) + "\n").encode()),
        "diagnosis.png": lambda file: picture(found).savefig(file, format="png", dpi=130),
    }
    effects = [
        beside(
            with_origin(one.effect, found.runs, one.sd, (one.gap_without_um, found.train.after_um)),
            rivals=tuple(rival_names(one)),
        )
        for one in found.standing
    ]
    if effects:
        name = f"{found.rig.name}.yaml"
        files[name] = holding(extended(text, effects, str(directory / name)).encode())
    return write_all_new(directory, files)
