"""Files of `rig postures`: the chosen postures as tables, program and picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from analysis.apps.makers.motion_plan import Comment, JointMove, MotionPlan, Step, demand_of
from analysis.apps.makers.writing import encoded_programs, programs_of
from analysis.apps.postures.picture import picture
from analysis.apps.postures.report import POSTURE_COLUMNS, all_csv, chosen_csv
from analysis.apps.postures.result import Postures
from analysis.apps.postures.targets import labels_of
from analysis.apps.programs.planned import targets_at, tracker_plan
from analysis.apps.programs.target_path import POSES, TargetPath
from analysis.apps.report.still_chart import as_png
from analysis.robot.kinematics.arm import arm_of
from analysis.runs.written_files import Writer, holding, write_all_new
from rigs.errors import FileError
from rigs.schema.vocabulary import MakerName

_SPEED_RAD_S = float(np.radians(20.0))
"""Speed of the fastest joint between targets, as in the programs of tests: slow enough to be stopped by hand."""


def write_postures(postures: Postures, read: TargetPath, directory: Path, maker: MakerName | None = None) -> list[Path]:
    """Write the tables, the picture, and the program of a maker into a directory: all files or none."""
    replaced = {*read.names, *POSES, *POSTURE_COLUMNS}
    kept = {name: column for name, column in read.columns.items() if name not in replaced}
    files: dict[str, Writer] = {
        "postures.csv": holding(chosen_csv(postures, kept).encode()),
        "all-postures.csv": holding(all_csv(postures, labels_of(read)).encode()),
        "postures.png": as_png(lambda: picture(postures)),
    }
    if maker:
        plan = posture_plan(postures, labels_of(read))
        files |= encoded_programs(maker, programs_of(maker, [(plan, demand_of(plan))]))
    try:
        return write_all_new(directory, files)
    except FileError as error:
        raise FileError(error.where, error.what, "give another --output", code=error.code) from None


def posture_plan(postures: Postures, labels: Sequence[str]) -> MotionPlan:
    """Plan that moves the joints to the chosen posture of each target in turn and stops there."""
    rows = postures.best.rows
    targets = targets_at(arm_of(postures.rig.robot), postures.candidates.q[rows])
    steps: list[Step] = []
    for number, target in zip(postures.candidates.target[rows].tolist(), targets, strict=True):
        steps += [Comment(labels[number]), JointMove(target, _SPEED_RAD_S)]
    return tracker_plan(postures.rig, f"postures {postures.rig.name}", steps)
