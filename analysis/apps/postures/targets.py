"""Targets of `rig postures`: their names, and an error for each without a posture."""

from __future__ import annotations

from pathlib import Path

from analysis.apps.postures.result import Postures
from analysis.apps.programs.target_path import TargetPath
from analysis.correction.reasons import WHY
from rigs.errors import FileError


def target_errors(path: Path, read: TargetPath, postures: Postures) -> list[FileError]:
    reasons, remedy = sorted(postures.candidates.reasons.items()), "move the target or turn the tool"
    return [
        FileError(f"{path}, line {read.lines[k]}", f"the target {WHY[reason]}", remedy, code="targets.no_posture")
        for k, reason in reasons
    ]


def labels_of(read: TargetPath) -> list[str]:
    return [f"line {line}" for line in read.lines]
