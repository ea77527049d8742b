"""Reasons for targets that stay uncorrected."""

from __future__ import annotations

from typing import Literal

from rigs.rig import Rig
from rigs.schema.controllers import practice_of

Reason = Literal[
    "relative",
    "computed",
    "not_literal",
    "handed",
    "array",
    "arc",
    "arc_centre",
    "arc_turns",
    "changed",
    "offset",
    "displaced",
    "tracked",
    "external_tcp",
    "coordinated",
    "switched",
    "selected",
    "not_understood",
    "unused",
    "external_axes",
    "other_robot",
    "incomplete",
    "no_scale",
    "several_frames",
    "unknown_tool",
    "unknown_frame",
    "no_posture",
    "ambiguous",
    "other_flags",
    "two_postures",
    "past_singularity",
    "unreachable",
    "beyond_limits",
    "singular",
    "too_large",
    "changes_flags",
    "controller_unknown",
]
POSE_OF_UNKNOWN_CONTROLLER = "is a pose, which this controller may compute with constants that are unknown"


def how_to_state_controller(rig: Rig) -> str:
    """Return the remedy for an unknown arm in the controller."""
    practice = practice_of(rig.maker or rig.robot.name)
    of_maker = f"{practice.get}; " if practice else ""
    return (
        f"give --calibration FILE ({of_maker}one row of joints and flange pose from the pendant is enough if it agrees "
        "with the data sheet), or state `controller: data_sheet` under robot in the rig file"
    )
