"""Targets of `rig postures`: poses or joint angles in a table, in the units and limits of the arm."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from analysis.apps.postures.result import Postures
from analysis.apps.programs.target_path import TargetPath, read_path
from analysis.correction.reasons import WHY
from analysis.correction.work import posture_limits
from analysis.robot.kinematics.arm import RAIL_MM, Array, arm_of, forward
from analysis.runs.tables import PLACE, RAIL
from rigs.errors import FileError
from rigs.rig import Rig

MOST_TARGETS = 20_000
"""Maximum number of targets. Each has dozens of postures, and ten thousand targets take a minute."""
_LARGEST_IN_M = 10.0
"""Bound in mm: if no coordinate of a table exceeds it, the positions are taken to be in metres. No arm reaches a
tool position that close to its base.
"""
_SLACK = 1e-6
"""Tolerance of a joint limit in rad or m, for postures taught at the limit and rounded."""


def read_targets(path: Path, rig: Rig) -> tuple[TargetPath, Array, Array | None]:
    """Targets of a table, their poses (n, 4, 4) in the world and, if given, their joint angles (n, axes) rad."""
    read = read_path(path, len(rig.robot.axes), rail=rig.robot.rail is not None)
    if len(read.lines) > MOST_TARGETS:
        problem = f"has {len(read.lines)} targets, and at most {MOST_TARGETS} are compared"
        raise FileError(str(path), problem, "split the table", code="targets.too_many")
    _check_units(read, str(path))
    if not read.joints:
        return read, read.poses(), None
    q = read.angles()
    _check_limits(read, q, rig, str(path))
    return read, forward(arm_of(rig.robot), q), q


def _check_units(read: TargetPath, where: str) -> None:
    if not read.joints:
        places = np.abs(read.values[:, : len(PLACE)]).max()
        if 0 < places < _LARGEST_IN_M:
            problem = f"has no coordinate above {places:.4g} mm: the positions look like metres"
            raise FileError(where, problem, "multiply x_mm, y_mm and z_mm by 1000", code="targets.units")
        return
    joints = np.abs(read.values[:, [name != RAIL for name in read.names]]).max()
    if 0 < joints <= 2 * np.pi:
        problem = f"has no joint angle above {joints:.3g}°: the angles look like radians"
        raise FileError(where, problem, "multiply the joint angles by 57.29578", code="targets.units")


def _check_limits(read: TargetPath, q: Array, rig: Rig, where: str) -> None:
    limits = posture_limits(rig)
    beyond = np.argwhere((q < limits[:, 0] - _SLACK) | (q > limits[:, 1] + _SLACK))
    if len(beyond):
        row, column = beyond[0].tolist()
        name, units = read.names[column], RAIL_MM if read.names[column] == RAIL else float(np.degrees(1.0))
        low, high = limits[column] * units
        problem = f"{name} {q[row, column] * units:.6g} is beyond the limits {low:.6g} to {high:.6g}"
        remedy = "correct the angle, or limits_deg in the rig file"
        raise FileError(f"{where}, line {read.lines[row]}", problem, remedy, code="targets.limits")


def target_errors(path: Path, read: TargetPath, postures: Postures) -> list[FileError]:
    reasons, remedy = sorted(postures.candidates.reasons.items()), "move the target or turn the tool"
    return [
        FileError(f"{path}, line {read.lines[k]}", f"the target {WHY[reason]}", remedy, code="targets.no_posture")
        for k, reason in reasons
    ]


def labels_of(read: TargetPath) -> list[str]:
    return [f"line {line}" for line in read.lines]
