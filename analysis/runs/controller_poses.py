"""Poses that a controller computed, next to the joint angles that they belong to. They show its constants, so no
question to the user is necessary.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from analysis.robot.description.controller_constants import constants_from_poses, data_sheet_of, robot_with
from analysis.robot.description.rig_section import largest_difference, random_postures
from analysis.robot.geometry.pose_setup import fit_setup, position_error
from analysis.robot.kinematics.arm import Array, controller_arm, forward, transforms, without_setup
from analysis.runs.noise.readings import evenly
from analysis.runs.tables import CONTROLLER_PLACE, CONTROLLER_TURN, Rows, joint_columns
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.condition import POSE
from rigs.schema.robot import Robot

_MOST = 60
"""Number of poses kept of a run. Chosen: twice the number of constants of an arm, so that a run is loaded quickly."""
_SAME_MM = 20.0
"""Distance of the first pose from the flange in the base up to which it is the flange in the base: more than own
constants move it, less than any tool.
"""
RESOLUTION_MM = 0.02
"""Distance that digits of an interface explain: 0.01 mm and 0.001° at 0.6 m, rounded; doubles agree to 1e-9 mm."""


@dataclass(frozen=True)
class ControllerPoses:
    """Joint angles q (n, 6) rad with the poses T (n, 4, 4) mm that the controller computed for them."""

    q: Array
    T: Array

    def is_flange(self, rig: Rig) -> bool:
        """True if neither a tool nor a frame is part of the poses."""
        bare = without_setup(controller_arm(rig.robot))
        return bool(np.linalg.norm(forward(bare, self.q[:1])[0, :3, 3] - self.T[0, :3, 3]) < _SAME_MM)

    def distance_mm(self, rig: Rig) -> float:
        """Largest distance from the arm that the rig file states, with tool and frame fitted if they are unknown."""
        bare = forward(without_setup(controller_arm(rig.robot)), self.q)
        if self.is_flange(rig):
            return float(np.linalg.norm(bare[:, :3, 3] - self.T[:, :3, 3], axis=1).max())
        errors = position_error(bare, self.T[:, :3, 3], fit_setup(bare, self.T[:, :3, 3]))
        return float(np.linalg.norm(errors, axis=1).max())


def rig_as_recorded(rig: Rig, poses: ControllerPoses | None) -> Rig:
    """A rig that does not state its controller with the constants that the controller's poses show.

    Unchanged if they show own constants without determining them everywhere: the controller then stays unknown.
    """
    if poses is None or rig.controller != "unknown" or not poses.is_flange(rig):
        return rig
    with suppress(FileError):
        data_sheet = data_sheet_of(rig.robot)
        read = constants_from_poses(data_sheet, poses.q, poses.T[:, :3, 3], poses.T[:, :3, :3], "the run")
        return rig.model_copy(update={"robot": robot_with(rig, read)})
    return rig


def are_same_constants(one: Robot, other: Robot) -> bool:
    """True if two controllers compute the same poses within the resolution of the interfaces."""
    postures = random_postures(one)
    T, its_T = (forward(without_setup(controller_arm(robot)), postures) for robot in (one, other))
    return largest_difference(T, its_T)[0] < RESOLUTION_MM


def controller_poses(robot: Mapping[str, np.ndarray[Any, Any]]) -> ControllerPoses | None:
    """Up to 60 poses of a robot stream, evenly spread over its rows; None if it has none."""
    if POSE[0] not in robot:
        return None
    columns = np.stack([np.asarray(robot[name], dtype=float) for name in POSE], axis=1)
    rows = np.flatnonzero(np.isfinite(columns).all(axis=1))
    if not len(rows):
        return None
    rows = rows[evenly(len(rows), _MOST)]
    q = np.radians(np.stack([robot[f"q{axis}_deg"][rows] for axis in range(1, 7)], axis=1))
    return ControllerPoses(q, transforms(columns[rows]))


def controller_doubt(rig: Rig, poses: ControllerPoses | None) -> list[str]:
    if poses is None or (apart_mm := poses.distance_mm(rig)) <= RESOLUTION_MM:
        return []
    problem = f"the controller computes poses with other constants than the rig file: up to {apart_mm:.2f} mm apart"
    return [f"{problem}; give its constants with --calibration"]


@dataclass(frozen=True)
class ControllerPlaces:
    """Joints q (n, axes) rad as reported, with the places and orientations R (n, 3, 3) that the controller computed, in
    its own frame. R is None if the table has only places.
    """

    q: Array
    xyz_mm: Array
    R: Array | None


def controller_places(table: pa.Table | None) -> ControllerPlaces | None:
    """Poses of the controller in a table such as `run.run.table` of an imported run; None if it has none."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

    if table is None or not (rows := Rows(table)).has(CONTROLLER_PLACE):
        return None
    has_turn = rows.has(CONTROLLER_TURN)
    R = Rotation.from_euler("xyz", rows.values(CONTROLLER_TURN)).as_matrix() if has_turn else None
    q = rows.values(joint_columns(rows.axes))
    return ControllerPlaces(q, rows.values(CONTROLLER_PLACE), None if R is None else np.asarray(R))
