"""Writer of INFORM: a job (.JBI) with positions in the base coordinate system.

Sources: Yaskawa, DX100 Options, Instructions for data transmission (156191-1CD), chapter 4 (0.001 mm and 0.0001°), and
the INFORM manual. Positions are not in pulses, which need the unpublished counts per degree: the job is relative (RJ).

Three MOVC in a row are an arc, which further MOVC continue. A MOVL separates the way back from the lap.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from analysis.apps.makers.configuration import configuration_of
from analysis.apps.makers.motion_plan import (
    Arc,
    Demand,
    JointMove,
    MotionPlan,
    Move,
    PlannedTarget,
    StraightMove,
    ToolRotation,
    end_of,
    percent_of_axes,
    start_of,
)
from analysis.apps.makers.program_text import Words, fixed, fixed_xyz_deg, heading, identifier, listed, shown_pose
from analysis.apps.makers.program_writer import ProgramWriter
from analysis.robot.kinematics.arm import Arm

_NAME_LENGTH = 32
_WORDS = Words("TIMER T={}", 2, "DOUT OT#({}) ON", "DOUT OT#({}) OFF", "'{}", 32, "PAUSE")
TOOL_NUMBER = 9
"""The tool file in which the operator enters the frame of the tool."""
_MM_DECIMALS, _DEG_DECIMALS = 3, 4
_UNUSED = ",0" * 18


def write(plan: MotionPlan, demand: Demand) -> dict[str, str]:
    name = identifier(plan.name, _NAME_LENGTH).upper()
    positions: list[str] = []
    tool = plan.arm.T_flange_tool
    entered = f"{listed(tool[:3, 3], 3)} mm {listed(fixed_xyz_deg(tool), 3)} deg".replace(",", " ")
    begin = f"(base) {shown_pose(start_of(plan).T, ('Rx', 'Ry', 'Rz'))} with tool {TOOL_NUMBER} entered as {entered}"
    comments = _WORDS.remarks(*heading(plan, demand, begin))
    moves = _instructions(plan, positions)
    head = ["/JOB", f"//NAME {name}", "//POS", f"///NPOS {len(positions)},0,0,0,0,0", f"///TOOL {TOOL_NUMBER}"]
    form = ["///POSTYPE BASE", "///RECTAN"]
    instructions = ["//INST", "///DATE 2026/01/01 00:00", "///ATTR SC,RW,RJ", "///FRAME BASE", "///GROUP1 RB1", "NOP"]
    # The numbered positions, each given as `RCONF\nvalues`. An RCONF is valid until the next RCONF.
    numbered: list[str] = []
    last = ""
    for number, text in enumerate(positions):
        rconf, values = text.split("\n")
        numbered += [f"C{number:05d}={values}"] if rconf == last else [rconf, f"C{number:05d}={values}"]
        last = rconf
    lines = [*head, *form, *numbered, *instructions, *comments, *moves, "END", ""]
    return {f"{name}.JBI": "\n".join(lines)}


def _instructions(plan: MotionPlan, positions: list[str]) -> list[str]:
    lines: list[str] = []
    at, chained = start_of(plan), False
    for step in plan.steps:
        if isinstance(step, Arc) and not chained:
            speed = _speed(step.speed_mm_s)
            lines += [f"MOVL {_position(plan.arm, at, positions)} {speed} PL=0"]
            lines += [f"MOVC {_position(plan.arm, at, positions)} {speed}"]
        lines += _WORDS.lines(plan, step, partial(_move, plan.arm, positions))
        chained = isinstance(step, Arc) and not step.stops
        at = end_of(step) if isinstance(step, Move) else at
    return lines


def _move(arm: Arm, positions: list[str], step: Move) -> list[str]:
    match step:
        case JointMove(target, speed_rad_s):
            percent = fixed(percent_of_axes(arm, speed_rad_s), 2)
            return [f"MOVJ {_position(arm, target, positions)} VJ={percent} PL=0"]
        case StraightMove(target, speed_mm_s, stops):
            return [f"MOVL {_position(arm, target, positions)} {_speed(speed_mm_s)} PL={0 if stops else 1}"]
        case ToolRotation(target, _, speed_rad_s):
            speed = fixed(float(np.degrees(speed_rad_s)), 1)
            return [f"MOVL {_position(arm, target, positions)} VR={speed} PL=0"]
        case Arc(via, end, speed_mm_s, stops):
            speed = _speed(speed_mm_s)
            middle, last = (_position(arm, target, positions) for target in (via, end))
            return [f"MOVC {middle} {speed}", f"MOVC {last} {speed}{' PL=0' if stops else ''}"]


def _speed(speed_mm_s: float) -> str:
    return f"V={fixed(speed_mm_s, 1)}"


def _position(arm: Arm, target: PlannedTarget, positions: list[str]) -> str:
    """Add a position to the job. Each position belongs to a single instruction."""
    beyond = [int(not -np.pi < target.q[axis] <= np.pi) for axis in (3, 5, 0)]
    form = [*(int(not flag) for flag in configuration_of(arm, target.q)), *beyond]
    places = listed(target.T[:3, 3], _MM_DECIMALS)
    angles = listed(fixed_xyz_deg(target.T), _DEG_DECIMALS)
    positions.append(f"///RCONF {','.join(map(str, form))}{_UNUSED}\n{places},{angles}")
    return f"C{len(positions) - 1:05d}"


WRITER = ProgramWriter(write)
