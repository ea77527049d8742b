r"""Writer of RAPID: a module with the targets and one procedure.

Source: ABB, Technical reference manual, RAPID Instructions, Functions and Data types (3HAC050917). By default MoveC
rotates the tool relative to the path, so a tool pointing to the centre keeps pointing there. After ConfL\Off lines and
arcs keep the posture of the arm, regardless of the confdata of a target. Joint moves have joint targets.
"""

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
    turns_with_path,
)
from analysis.apps.makers.program_text import (
    DEG_DECIMALS,
    MM_DECIMALS,
    Words,
    fixed,
    heading,
    identifier,
    listed,
)
from analysis.apps.makers.program_writer import ProgramWriter
from analysis.robot.geometry.driven_programs import ACCELERATION_MM_S2
from analysis.robot.kinematics.arm import Array
from rigs.schema.feedback import ABBEGM

_NAME_LENGTH = 30
"""Maximum length of a procedure name. RAPID allows 32 characters, and the name of the module has two more."""
_WORDS = Words("WaitTime\\InPos,{};", 3, "SetDO rig_do{},1;", "SetDO rig_do{},0;", "! {}", 76, "Stop;")
"""The editor of the FlexPendant shows 80 characters per line."""
_QUATERNION_DECIMALS = 12
_NO_EXTERNAL = "[9E9,9E9,9E9,9E9,9E9,9E9]"
_TURN_DEG_S, _OTHER_AXES = 500, "5000,1000"
_LIGHTEST_KG = 0.001
"""Mass of tool0. RAPID rejects a tool without a mass."""
_JOINT_MOVE_MM_S = 250.0
"""Maximum speed of the tool in joint moves: the limit of manual mode at reduced speed (ISO 10218-1)."""


def write(plan: MotionPlan, demand: Demand) -> dict[str, str]:
    """Write the module. All data are LOCAL, so several modules can be loaded together."""
    name = identifier(plan.name, _NAME_LENGTH)
    data: dict[str, str] = {}
    T = start_of(plan).T
    x, y, z = T[:3, 3]
    quaternion = " ".join(f"{value:z.4f}" for value in _quaternion(T))
    begin = f"(world) X {x:z.1f} Y {y:z.1f} Z {z:z.1f} mm, q1..q4 {quaternion}"
    comments = [f"  {line}" for line in _WORDS.remarks(*heading(plan, demand, begin))]
    moves = [f"    {line}" for step in plan.steps for line in _WORDS.lines(plan, step, partial(_move, data))]
    declared = [f"  LOCAL CONST {text.replace('@', item)};" for text, item in data.items()]
    identity: list[str] = []
    if isinstance(plan.feedback, ABBEGM):
        identity = ["  LOCAL VAR egmident rig_stream;"]
        setup = '    EGMSetupUC ROB_1,rig_stream,"default","rig"\\Joint;'
        start = ["    EGMGetId rig_stream;", setup, "    EGMStreamStart rig_stream\\SampleRate:=4;"]
        moves = [*start, *moves, "    EGMStreamStop rig_stream;", "    EGMReset rig_stream;"]
    # Frame and load of the tool. The rig file does not contain the centre of mass: half the distance to the ball is
    # used.
    T_tool = plan.arm.T_flange_tool
    mass = max(plan.payload_kg, _LIGHTEST_KG)
    centre = T_tool[:3, 3] / 2 if np.linalg.norm(T_tool[:3, 3]) > 1 else np.array([0.0, 0.0, 1.0])
    load = f"[{fixed(mass, 3)},[{listed(centre, 1)}],[1,0,0,0],0,0,0]"
    tool = f"  LOCAL PERS tooldata rig_tool:=[TRUE,{_pose(T_tool)},{load}];"
    head = [f"MODULE {name}_m", *comments, tool, _BASE, *identity, *declared, f"  PROC {name}()"]
    limit = fixed(ACCELERATION_MM_S2 / 1e3, 3)
    settings = [
        "    ConfL\\Off;",
        f"    CirPathMode\\{'PathFrame' if turns_with_path(plan) else 'ObjectFrame'};",
        f"    PathAccLim TRUE\\AccMax:={limit},TRUE\\DecelMax:={limit};",
    ]
    module = [*head, *settings, *moves]
    return {f"{name}_m.mod": "\n".join([*module, "  ENDPROC", "ENDMODULE", ""])}


_BASE = '  LOCAL PERS wobjdata rig_base:=[FALSE,TRUE,"",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];'


def _move(data: dict[str, str], step: Move) -> list[str]:
    frames = "rig_tool\\WObj:=rig_base"
    match step:
        case JointMove(target, speed_rad_s):
            joints = f"jointtarget @:=[[{listed(np.degrees(target.q), DEG_DECIMALS)}],{_NO_EXTERNAL}]"
            speed = _speed(_JOINT_MOVE_MM_S, float(np.degrees(speed_rad_s)), data)
            return [f"MoveAbsJ {_declare_data(joints, 'j', data)}\\NoEOffs,{speed},fine,{frames};"]
        case StraightMove(target, speed_mm_s, stops):
            speed, zone = _speed(speed_mm_s, _TURN_DEG_S, data), "fine" if stops else "z0"
            return [f"MoveL {_point(target.T, data)},{speed},{zone},{frames};"]
        case ToolRotation(target, _, speed_rad_s):
            speed = _speed(_JOINT_MOVE_MM_S, float(np.degrees(speed_rad_s)), data)
            return [f"MoveL {_point(target.T, data)},{speed},fine,{frames};"]
        case Arc(via, end, speed_mm_s, stops):
            points = f"{_point(via.T, data)},{_point(end.T, data)}"
            zone = "fine" if stops else "z0"
            return [f"MoveC {points},{_speed(speed_mm_s, _TURN_DEG_S, data)},{zone},{frames};"]


def _point(T: Array, data: dict[str, str]) -> str:
    return _declare_data(f"robtarget @:=[{_pose(T)[1:-1]},[0,0,0,0],{_NO_EXTERNAL}]", "p", data)


def _speed(speed_mm_s: float, turn_deg_s: float, data: dict[str, str]) -> str:
    return _declare_data(f"speeddata @:=[{fixed(speed_mm_s, 3)},{fixed(turn_deg_s, 1)},{_OTHER_AXES}]", "v", data)


def _declare_data(text: str, letter: str, data: dict[str, str]) -> str:
    return data.setdefault(text, f"{letter}_{len(data) + 1}")


def _pose(T: Array) -> str:
    return f"[[{listed(T[:3, 3], MM_DECIMALS)}],[{listed(_quaternion(T), _QUATERNION_DECIMALS)}]]"


def _quaternion(T: Array) -> Array:
    """Quaternion q1 … q4 (4,) of a frame: scalar first and not negative."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

    values: Array = Rotation.from_matrix(T[:3, :3]).as_quat(canonical=True, scalar_first=True)
    return values


WRITER = ProgramWriter(
    write, {ABBEGM: "the program starts the stream to the UdpUc device rig, which must be set up first"}
)
