"""Joint angles during the moves of a program, by a Newton iteration independent of rig."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from analysis.apps.makers.emulated import (
    Array,
    ConfigurationFlags,
    Event,
    LinearMove,
    PointToPointMove,
    Round,
    ToolPose,
)
from rigs.rig import Rig
from tests.worlds.interpreters.arms import flange_of, pose_of

_SAMPLES = np.linspace(0, 1, 13)[1:]
"""Samples along a move of up to 90°, so that joints change by less than 10° between samples."""
_STEP_RAD = 1e-6
_ARM_MM = 500.0
"""Lever arm that makes rotations comparable with translations."""


def postures(rig: Rig, events: list[Event], q: Array) -> list[tuple[Array, ConfigurationFlags]]:
    """Joint angles (6,) rad at the end of each move, with the posture flags of its position; q (6,):
    start angles.
    """
    found = []
    flange, tool = flange_of(rig), pose_of(rig.robot.tool)

    def missing(q: Array, pose: ToolPose) -> Array:
        """Pose error (6,) of the tool: translation in units of the lever arm, and rotation in rad."""
        matrix, place = flange(q)
        turn = Rotation.from_matrix(matrix)
        away = place + turn.apply(tool.place) - pose.place
        return np.concatenate([away / _ARM_MM, (turn * tool.turn * pose.turn.inv()).as_rotvec()])

    for event in events:
        if isinstance(event, LinearMove | Round):
            for place, turn in zip(*event.at(_SAMPLES), strict=True):
                q = _reached(missing, q, ToolPose(place, turn))
            end = event.end
        elif isinstance(event, PointToPointMove):
            q = q if event.q is None else event.q
            end = event.pose
        else:
            continue
        if end.configuration:
            found.append((q, end.configuration))
    return found


def _reached(missing: Callable[[Array, ToolPose], Array], q: Array, pose: ToolPose) -> Array:
    for _ in range(3):
        error = missing(q, pose)
        columns = [(missing(q + step, pose) - error) / _STEP_RAD for step in _STEP_RAD * np.eye(6)]
        q = q - np.linalg.solve(np.stack(columns, axis=1), error)
    assert np.abs(missing(q, pose)).max() < 1e-5
    return q
