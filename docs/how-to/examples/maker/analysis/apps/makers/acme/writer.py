"""Acme's programs: TOOL first; then a line an instruction, in mm and degrees, a turn as roll, pitch and yaw."""

from __future__ import annotations

from functools import partial

import numpy as np

from analysis.apps.makers.motion_plan import (
    Arc,
    Demand,
    JointMove,
    MotionPlan,
    Move,
    StraightMove,
    ToolRotation,
    start_of,
)
from analysis.apps.makers.program_text import (
    DEG_DECIMALS,
    MM_DECIMALS,
    Words,
    fixed,
    fixed_xyz_deg,
    heading,
    identifier,
    listed,
)
from analysis.apps.makers.program_writer import ProgramWriter
from analysis.robot.kinematics.arm import Array

_WORDS = Words("WAIT {}", 3, "OUTPUT {} ON", "OUTPUT {} OFF", "; {}", 80, "PAUSE")
_NAME_LENGTH = 30


def write(plan: MotionPlan, demand: Demand) -> dict[str, str]:
    """The program."""
    T = start_of(plan).T
    shown = f"X, Y, Z {listed(T[:3, 3], 1)} mm, roll, pitch, yaw {listed(fixed_xyz_deg(T), 2)} deg"
    head = [*_WORDS.remarks(*heading(plan, demand, shown)), f"TOOL {_pose(plan.arm.T_flange_tool)}"]
    lines = [line for step in plan.steps for line in _WORDS.lines(plan, step, _move)]
    return {f"{identifier(plan.name, _NAME_LENGTH)}.acm": "\n".join([*head, *lines, ""])}


def _move(step: Move) -> list[str]:
    speed = partial(fixed, decimals=4)
    match step:
        case JointMove(target, speed_rad_s):
            return [f"JOINTS {listed(np.degrees(target.q), DEG_DECIMALS)} SPEED {speed(np.degrees(speed_rad_s))}"]
        case StraightMove(target, speed_mm_s, stops):
            return [f"LINE {_pose(target.T)} SPEED {speed(speed_mm_s)}{'' if stops else ' BLEND'}"]
        case ToolRotation(target, _, speed_rad_s):
            return [f"TURN {_pose(target.T)} SPEED {speed(np.degrees(speed_rad_s))}"]
        case Arc(via, end, speed_mm_s, stops):
            words = f"{' PATH' * step.with_path}{'' if stops else ' BLEND'}"
            return [f"VIA {_pose(via.T)}", f"ARC {_pose(end.T)} SPEED {speed(speed_mm_s)}{words}"]


def _pose(T: Array) -> str:
    return f"{listed(T[:3, 3], MM_DECIMALS)},{listed(fixed_xyz_deg(T), DEG_DECIMALS)}"


WRITER = ProgramWriter(write)
