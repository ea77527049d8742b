"""Versions of a robot's calibration: rig files with a calibration, as written by diagnoses.

Effects and calibration of a file are valid together only. No file is deleted: the replaced one is kept under a name
with the date.
"""

from __future__ import annotations

import datetime as dt
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from analysis.apps.report.blocks import Block, Cell, Sentence, Table
from analysis.runs.written_files import holding, write_all_new, write_all_over
from rigs.calibration import CalibratedModel, CalibrationFile, verdict_of
from rigs.edit import extended
from rigs.errors import FileError, RigError
from rigs.load import load
from rigs.rig import Rig
from rigs.text import escape_text

_MOST = 10_000
"""More YAML files below a folder indicate the wrong folder."""


@dataclass(frozen=True)
class Version:
    path: Path
    calibrated: CalibratedModel
    sha256: str
    in_use: bool

    def to_dict(self) -> dict[str, Any]:
        model = self.calibrated
        return {
            "path": str(self.path),
            "sha256": self.sha256,
            "in_use": self.in_use,
            "date": str(model.date),
            "version": model.version,
            "runs": [run.name for run in model.runs],
            "before_um": model.before_um,
            "calibrated_um": model.calibrated_um,
            "held_out_um": model.held_out_um,
            "verdict": verdict_of(model),
        }


def versions(rig_file: Path, folder: Path) -> list[Version]:
    """Newest first; other files are skipped."""
    rig, _ = load(rig_file)
    files = list(islice(folder.rglob("*.y*ml"), _MOST + 1))
    if len(files) > _MOST:
        problem = f"contains more than {_MOST} YAML files"
        raise FileError(str(folder), problem, "give the folder of this robot: --in FOLDER", code="usage")
    versions = []
    for path in files:
        try:
            listed, _ = load(path)
        except RigError:
            continue
        if listed.calibration and listed.calibrated and _identity(listed) == _identity(rig):
            digest = listed.calibration.sha256
            in_use = rig.calibration is not None and rig.calibration.sha256 == digest
            versions.append(Version(path, listed.calibrated, digest, in_use))
    return sorted(versions, key=lambda version: (version.calibrated.date, str(version.path)), reverse=True)


def versions_answer(versions: Sequence[Version]) -> list[Block]:
    if not versions:
        return [
            Sentence("This directory has no calibration of this robot. To write one: rig diagnose RUN… -o DIRECTORY")
        ]
    rows = []
    for version in versions:
        model = version.calibrated
        left_out = "" if model.held_out_um is None else f"{model.held_out_um:.1f}"
        figures = (f"{len(model.runs)}", f"{model.before_um:.1f}", f"{model.calibrated_um:.1f}", left_out)
        verdict = "yes" if verdict_of(model) == "correct" else "no"
        file = Cell(escape_text(str(version.path)), below=("in use",) if version.in_use else ())
        rows.append((file, f"{model.date}", *figures, verdict))
    columns = ("rig file", "date", "runs", "before µm", "calibrated µm", "left out µm", "to correct by")
    return [Table(columns, tuple(rows), frozenset(range(1, len(columns))))]


def _identity(rig: Rig) -> tuple[str, str]:
    return rig.robot.name, rig.robot.serial


def roll_back(rig_file: Path, version: Path, now: dt.datetime) -> tuple[Path, list[str]]:
    """Replace a rig file by a version, and keep the previous file under a name with the time.

    The kept file, and the other keys with changed contents. Refuses a version without a calibration, of another robot,
    or the file itself.
    """
    rig, text = load(rig_file)
    former, former_text = load(version)
    remedy = "name a version that rig versions lists"
    if rig_file.resolve() == version.resolve():
        raise FileError(str(version), "is the rig file itself", remedy, code="usage")
    if former.calibration is None or former.calibrated is None:
        raise FileError(str(version), "has no calibration", remedy, code="calibration.missing")
    if _identity(former) != _identity(rig):
        problem = f"belongs to a different robot: {former.robot.name} {former.robot.serial}".rstrip()
        raise FileError(str(version), problem, "name a version of this robot", code="robot.other")
    content = former.calibrated.content
    digest = hashlib.sha256(content).hexdigest()
    named = CalibrationFile(file=f"version-{digest[:12]}.calibration.json", sha256=digest)
    new = extended(former_text, (), str(version), named)
    kept = rig_file.with_name(f"{rig_file.stem}-until-{now:%Y%m%d-%H%M%S.%f}{rig_file.suffix}")
    write_all_new(rig_file.parent, {kept.name: holding(text.encode())})
    write_all_over(rig_file.parent, {named.file: holding(content)})
    write_all_over(rig_file.parent, {rig_file.name: holding(new.encode())})
    fields = [name for name in type(rig).model_fields if name not in ("effects", "calibration", "name")]
    return kept, [name for name in fields if getattr(rig, name) != getattr(former, name)]
