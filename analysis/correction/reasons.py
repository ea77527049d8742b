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
    "shared_variable",
    "offset",
    "displaced",
    "tracked",
    "external_tcp",
    "coordinated",
    "switched",
    "selected",
    "not_understood",
    "unused",
    "reference",
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
    "other_posture",
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

WHY: dict[Reason, str] = {
    "relative": "is a relative move",
    "computed": "is computed by the program",
    "not_literal": "is not a point with numbers in this program",
    "handed": "is an argument of a routine, which may use a different tool, frame or posture",
    "array": "is in an array, which rig does not trace",
    "arc": "belongs to an arc with an angle in degrees, which does not end at the target",
    "arc_centre": "is the end of an arc with a centre relative to the start (I, J, K), which would have to move too",
    "arc_turns": "is on an arc along which the tool turns with the tangent: the orientation there is not as written, "
    "or is unknown",
    "changed": "is also used, or assigned, elsewhere in the program",
    "shared_variable": "is a variable that all jobs of the controller share: give the directory with all its jobs",
    "offset": "is reached with an offset that is unknown, or for which the correction of the point is wrong",
    "displaced": "is moved by a displacement that is or may be active there",
    "tracked": "is, or may be, followed on a conveyor, or moved by a sensor or a force, there",
    "external_tcp": "is, or may be, reached with a tool fixed outside of the robot",
    "coordinated": "is, or may be, coordinated with a different axis or robot there",
    "switched": "may have a different meaning there, after a switch of the language",
    "selected": "belongs to a frame or a tool that may not be selected there, which some controllers do not check: "
    "select both before the move (UFRAME_NUM=, UTOOL_NUM=)",
    "not_understood": "is reached after something that is not understood, which may move or change anything",
    "unused": "is not the target of any move that was understood",
    "reference": "is a reference position of the arm: its name says so, or all its joint angles are zero",
    "external_axes": "has external axes that carry the arm, or such an axis may not be at zero there",
    "other_robot": "belongs to a different robot of the controller than the first group or the first job of the file",
    "incomplete": "does not have all six numbers",
    "no_scale": "is in pulses: give --scale with the counts per degree of each axis",
    "several_frames": "is used with several tools or frames",
    "unknown_tool": "is in a tool that is unknown: give --tool",
    "unknown_frame": "is in a frame that is unknown: give --frame",
    "no_posture": "has an uncertain posture: some paths to this point do not define the posture",
    "ambiguous": "can be reached in several postures, and the program does not select one",
    "other_posture": "is reached in another posture than that of --near, so --near is not used for this program",
    "other_flags": "has flags of posture that no solution of the nominal arm has",
    "two_postures": "is reached in two postures, which need two corrections",
    "past_singularity": "is reached past a singularity, where the controller chooses the wrist posture",
    "unreachable": "is out of the nominal arm's reach",
    "beyond_limits": "is, or would be, beyond a joint's limits",
    "singular": "is at a singularity or at a limit, where a correction is impossible",
    "too_large": "would move by more than is plausible for a correction",
    "changes_flags": "would get a posture or turn that differs from the flags: touch the point up by hand",
    "controller_unknown": POSE_OF_UNKNOWN_CONTROLLER,
}
"""Predicates that complete a sentence with the target as the subject."""


def how_to_state_controller(rig: Rig) -> str:
    practice = practice_of(rig.maker or rig.robot.name)
    of_maker = f"{practice.get}; " if practice else ""
    return (
        f"give --calibration FILE ({of_maker}one row of joints and flange pose from the pendant is enough if it agrees "
        "with the data sheet), or state `controller: data_sheet` under robot in the rig file"
    )
