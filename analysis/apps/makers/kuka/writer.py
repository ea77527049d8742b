"""Writer of KRL: a .src file with the motion and a .dat file with the points.

Source: KUKA System Software 8.x, Operating and Programming Instructions for System Integrators, and Expert Programming.
A FRAME has no Status and Turn: lines and arcs keep the posture of the arm. $BASE is $ROBROOT, because $WORLD differs
from the robot's base if the arm hangs or is elsewhere.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from analysis.apps.makers.motion_plan import (
    ZONE_MM,
    Arc,
    Demand,
    JointMove,
    MotionPlan,
    Move,
    StraightMove,
    ToolRotation,
    percent_of_axes,
    start_of,
    turns_with_path,
)
from analysis.apps.makers.program_text import (
    DEG_DECIMALS,
    MM_DECIMALS,
    Words,
    fixed,
    fixed_xyz_deg,
    heading,
    identifier,
    labelled,
    shown_pose,
)
from analysis.apps.makers.program_writer import ProgramWriter
from analysis.robot.geometry.driven_programs import ACCELERATION_MM_S2
from analysis.robot.kinematics.arm import Arm, Array
from rigs.schema.feedback import KUKARSI

_NAME_LENGTH = 24
_WORDS = Words("WAIT SEC {}", 3, "$OUT[{}] = TRUE", "$OUT[{}] = FALSE", "; {}", 100, "HALT")
_FIRST_MM_S = 100.0
"""Speed of the tool before the first move with a speed. A turn about the tool's origin has no path speed."""
RSI_CONTEXT = "rig_rsi"
"""The RSI context that the operator creates on the controller; it sends the axis angles."""


def write(plan: MotionPlan, demand: Demand) -> dict[str, str]:
    name = identifier(plan.name, _NAME_LENGTH)
    points: dict[str, str] = {}
    begin = shown_pose(start_of(plan).T, "ABC", yaw_first=True)
    comments = _WORDS.remarks(*heading(plan, demand, f"(base $ROBROOT) {begin}"))
    moves = [line for step in plan.steps for line in _WORDS.lines(plan, step, partial(_move, plan.arm, points))]
    sensor = isinstance(plan.feedback, KUKARSI)
    declared = ["DECL INT rsi_state", "DECL INT rsi_context"] if sensor else []
    calls = [f'RSI_CREATE("{RSI_CONTEXT}", rsi_context, TRUE)', "RSI_ON(#RELATIVE)"] if sensor else []
    on = [line for call in calls for line in (f"rsi_state = {call}", "IF (rsi_state <> RSIOK) THEN", "HALT", "ENDIF")]
    settings = [
        "BAS(#INITMOV,0)",
        f"$TOOL = {_frame(plan.arm.T_flange_tool)}",
        "$BASE = $ROBROOT",
        _speed(_FIRST_MM_S),
        f"$ACC.CP = {fixed(ACCELERATION_MM_S2 / 1e3, 4)}",
        f"$APO.CDIS = {fixed(ZONE_MM, 2)}",
        "$ORI_TYPE = #VAR",
        f"$CIRC_TYPE = {'#PATH' if turns_with_path(plan) else '#BASE'}",
    ]
    # System variables are only written if they change. Outputs are always written.
    steps, assigned_values = list[str](), dict[str, str]()
    for instruction in [*settings, *on, *moves]:
        variable, assigned, value = instruction.partition(" = ")
        if assigned and variable.startswith("$") and not variable.startswith("$OUT"):
            if assigned_values.get(variable) == value:
                continue
            assigned_values[variable] = value
        steps.append(instruction)
    body = [*comments, *declared, *steps]
    source = ["&ACCESS RVP", f"DEF {name}()", *body, *(["rsi_state = RSI_OFF()"] if sensor else []), "END", ""]
    data = [f"DECL {text.replace('@', point)}" for text, point in points.items()]
    listing = ["&ACCESS RVP", f"DEFDAT {name}", *data, "ENDDAT", ""]
    return {f"{name}.src": "\n".join(source), f"{name}.dat": "\n".join(listing)}


def _move(arm: Arm, points: dict[str, str], step: Move) -> list[str]:
    match step:
        case JointMove(target, speed_rad_s):
            percent = percent_of_axes(arm, speed_rad_s)
            angles = labelled("A{} {}", "123456", np.degrees(target.q), DEG_DECIMALS)
            none = [f"E{axis} 0.0" for axis in range(1, 7)]
            point = points.setdefault(f"E6AXIS @ = {{{', '.join(angles + none)}}}", f"A{len(points) + 1:04d}")
            return [*(f"$VEL_AXIS[{axis}] = {percent}" for axis in range(1, 7)), f"PTP {point}"]
        case StraightMove(target, speed_mm_s, stops):
            return [_speed(speed_mm_s), f"LIN {_point(target.T, points)}{'' if stops else ' C_DIS'}"]
        case ToolRotation(target, _, speed_rad_s):
            speed = fixed(float(np.degrees(speed_rad_s)), 1)
            return [f"$VEL.ORI1 = {speed}", f"$VEL.ORI2 = {speed}", f"LIN {_point(target.T, points)}"]
        case Arc(via, end, speed_mm_s, stops):
            ends = f"{_point(via.T, points)}, {_point(end.T, points)}"
            return [_speed(speed_mm_s), f"CIRC {ends}{'' if stops else ' C_DIS'}"]


def _speed(speed_mm_s: float) -> str:
    return f"$VEL.CP = {fixed(speed_mm_s / 1e3, 6)}"


def _point(T: Array, points: dict[str, str]) -> str:
    return points.setdefault(f"FRAME @ = {_frame(T)}", f"P{len(points) + 1:04d}")


def _frame(T: Array) -> str:
    places = labelled("{} {}", "XYZ", T[:3, 3], MM_DECIMALS)
    return f"{{{', '.join(places + labelled('{} {}', 'ABC', fixed_xyz_deg(T)[::-1], DEG_DECIMALS))}}}"


WRITER = ProgramWriter(
    write, {KUKARSI: f"the program starts the RSI context {RSI_CONTEXT}, which must be created first"}
)
