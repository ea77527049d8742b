"""FANUC's teach pendant language (.LS), which moves the robot on every controller, and KAREL for the feedback.

Sources: FANUC, R-30iB Operator's Manual (Basic Operation) B-83284EN, chapter 4 (motion, registers, WAIT, I/O; CONFIG,
which counts the turns of J4, J5 and J6), and programs as controllers print them (public backups in .LS). Circular
motion C turns the tool evenly from where it stands to the end of the arc. Joint moves have joint positions, so that no
posture can be mistaken; lines and arcs have Cartesian ones, since an arc's points need micrometres. KAREL has had no
motion statements since the R-30iB.
"""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Arm
from analysis.robot_programs.examine import Demand
from analysis.robot_programs.fanuc_feed import feed
from analysis.robot_programs.heading import heading
from analysis.robot_programs.plan import (
    Arc,
    Comment,
    Dwell,
    Hold,
    JointMove,
    Line,
    Move,
    Plan,
    Signal,
    Step,
    Target,
    Turn,
    percent_of_axes,
    start_of,
)
from analysis.robot_programs.posture import posture_of, turns
from analysis.robot_programs.text import DEG_DECIMALS, MM_DECIMALS, fixed, fixed_xyz_deg, identifier, wrapped

NEWLINE = "\r\n"
_NAME_LENGTH = 36
_REMARK_LENGTH = 32
TOOL_NUMBER = 9
"""The last tool frame that every controller has."""
_REGISTER = 99
"""The last position register of a controller's 100; UTOOL takes its frame from one."""


def write(plan: Plan, demand: Demand) -> dict[str, str]:
    """The program, and the feed of its joint angles where the rig file reads lines."""
    name = identifier(plan.name, _NAME_LENGTH).upper()
    positions: dict[str, int] = {}
    remarks = [f"  !{line}" for text in heading(plan, demand, _shown(plan)) for line in wrapped(text, _REMARK_LENGTH)]
    moves = [line for step in plan.steps for line in _lines(plan, step, positions)]
    return {f"{name}.LS": _program(name, [*remarks, *_frames(plan.arm), *moves], positions), **feed(plan)}


def _program(name: str, lines: list[str], positions: dict[str, int]) -> str:
    numbered = [_numbered(number, line) for number, line in enumerate(lines, start=1)]
    points = [f"P[{number}]{{\n   GP1:\n{text}\n}};" for text, number in positions.items()]
    head = [f"/PROG  {name}", "/ATTR", 'COMMENT\t\t= "RIG PROGRAM";', "DEFAULT_GROUP\t= 1,*,*,*,*;", "/MN"]
    return "\n".join([*head, *numbered, "/POS", *points, "/END", ""])


def _numbered(number: int, line: str) -> str:
    """An instruction with its number; a second line of it (the end of an arc) has none."""
    first, *continued = line.split("\n")
    return "\n".join([f"{number:4d}:{first}", *(f"    :{text}" for text in continued)]) + " ;"


def _frames(arm: Arm) -> list[str]:
    """The world frame, and the tool's frame from the rig file by way of a position register."""
    values = [*arm.T_flange_tool[:3, 3], *fixed_xyz_deg(arm.T_flange_tool)]
    elements = [f"  PR[{_REGISTER},{place}]={_constant(value)}" for place, value in enumerate(values, start=1)]
    set_tool = [f"  UTOOL[{TOOL_NUMBER}]=PR[{_REGISTER}]", f"  UTOOL_NUM={TOOL_NUMBER}"]
    return ["  UFRAME_NUM=0", f"  PR[{_REGISTER}]=LPOS", *elements, *set_tool]


def _constant(value: float) -> str:
    text = fixed(value, 6)
    return f"({text})" if text.startswith("-") else text


def _shown(plan: Plan) -> str:
    T = start_of(plan).T
    x, y, z = T[:3, 3]
    w, p, r = fixed_xyz_deg(T)
    return f"(world) X {x:.1f} Y {y:.1f} Z {z:.1f} mm W {w:.2f} P {p:.2f} R {r:.2f} deg"


def _lines(plan: Plan, step: Step, positions: dict[str, int]) -> list[str]:
    match step:
        case JointMove() | Line() | Turn() | Arc():
            return [_move(plan.arm, step, positions)]
        case Dwell(seconds):
            return [f"  WAIT {fixed(seconds, 2)}(sec)"]
        case Signal(value):
            return [f"  DO[{number}]={'ON' if on else 'OFF'}" for number, on in plan.signal_place.bits(value)]
        case Hold(request):
            return [*(f"  !{line}" for line in wrapped(request, _REMARK_LENGTH)), "  PAUSE"]
        case Comment(text):
            return [f"  !{line}" for line in wrapped(text, _REMARK_LENGTH)]


def _move(arm: Arm, step: Move, positions: dict[str, int]) -> str:
    match step:
        case JointMove(target, speed_rad_s):
            angles = [
                f"J{axis}= {fixed(angle, DEG_DECIMALS)} deg" for axis, angle in enumerate(np.degrees(target.q), start=1)
            ]
            number = _number(f"\tUF : 0, UT : {TOOL_NUMBER},\n{_two_rows(angles)}", positions)
            return f"J P[{number}] {percent_of_axes(arm, speed_rad_s)}% FINE"
        case Line(target, speed_mm_s, stops):
            number = _number(_cartesian(arm, target), positions)
            return f"L P[{number}] {_plain(speed_mm_s)}mm/sec {'FINE' if stops else 'CNT0'}"
        case Turn(target, _, speed_rad_s):
            number = _number(_cartesian(arm, target), positions)
            return f"L P[{number}] {_plain(np.degrees(speed_rad_s))}deg/sec FINE"
        case Arc(via, end, speed_mm_s, stops):
            middle, last = (_number(_cartesian(arm, target), positions) for target in (via, end))
            return f"C P[{middle}]\n  P[{last}] {_plain(speed_mm_s)}mm/sec {'FINE' if stops else 'CNT100'}"


def _number(text: str, positions: dict[str, int]) -> int:
    """The number of a position, which is listed once however often it is used."""
    return positions.setdefault(text, len(positions) + 1)


def _plain(value: float) -> str:
    return fixed(value, 1).removesuffix(".0")


def _cartesian(arm: Arm, target: Target) -> str:
    stands = posture_of(arm, target.q)
    letters = f"{'F' if stands.flip else 'N'} {'U' if stands.up else 'D'} {'T' if stands.front else 'B'}"
    counts = ", ".join(str(turns(float(angle))) for angle in target.q[3:])
    places = [f"{axis} = {fixed(value, MM_DECIMALS)} mm" for axis, value in zip("XYZ", target.T[:3, 3], strict=True)]
    angles = fixed_xyz_deg(target.T)
    turned = [f"{axis} = {fixed(value, DEG_DECIMALS)} deg" for axis, value in zip("WPR", angles, strict=True)]
    return f"\tUF : 0, UT : {TOOL_NUMBER},\t\tCONFIG : '{letters}, {counts}',\n{_two_rows(places + turned)}"


def _two_rows(six: list[str]) -> str:
    return ",\n".join("\t" + ",\t".join(three) for three in (six[:3], six[3:]))
