"""Writer of URScript: metres, radians, rotation vectors.

Source: Universal Robots, Script Manual, PolyScript 5 and PolyScope X (movej, movel, movec, set_tcp, popup, outputs).
`movec` in mode 1 keeps the orientation fixed to the tangent of the arc, as required by a circle test.
"""

from __future__ import annotations

import numpy as np

from analysis.apps.makers.motion_plan import (
    ZONE_MM,
    Arc,
    Demand,
    Hold,
    JointMove,
    MotionPlan,
    Move,
    Signal,
    StraightMove,
    ToolRotation,
    start_of,
)
from analysis.apps.makers.program_text import Words, fixed, heading, identifier, listed
from analysis.apps.makers.program_writer import BY_ITSELF, ProgramWriter
from analysis.robot.geometry.driven_programs import ACCELERATION_MM_S2
from analysis.robot.kinematics.arm import Array
from rigs.schema.feedback import URRTDE

_WORDS = Words("sleep({})", 3, "", "", "# {}", 100, "")
"""Outputs and pauses need more than a format, and are written elsewhere."""
_NAME_LENGTH = 60
_DECIMALS = 10
"""Decimals of metres and radians: 1e-7 mm."""
_JOINT_ACCELERATION = 0.5
"""Acceleration in rad/s²: a third of PolyScope's default, because moves between targets are not urgent."""
_FIRST_CONFIGURABLE, _FIRST_OF_TOOL = 8, 16
"""Numbers of outputs in RTDE: 0-7 standard, 8-15 configurable, 16 and 17 of the tool."""


def write(plan: MotionPlan, demand: Demand) -> dict[str, str]:
    name = identifier(plan.name, _NAME_LENGTH)
    values = _values(start_of(plan).T)
    begin = f"X {values[0] * 1e3:.1f} Y {values[1] * 1e3:.1f} Z {values[2] * 1e3:.1f} mm, RX RY RZ " + " ".join(
        f"{value:.3f}" for value in values[3:]
    )
    comments = _WORDS.remarks(*heading(plan, demand, begin))
    lines = [f"set_tcp({_pose(plan.arm.T_flange_tool)})"]
    for step in plan.steps:
        match step:
            case Signal(value) if plan.signal_place.int_register is not None:
                lines.append(f"write_output_integer_register({plan.signal_place.int_register}, {value})")
            case Signal(value):
                lines += [_output(number, on) for number, on in plan.signal_place.bits(value)]
            case Hold(request):
                lines.append(f'popup("{request}", title="rig", blocking=True)')
            case _:
                lines += _WORDS.lines(plan, step, _move)
    body = [f"  {line}" for line in lines]
    return {f"{name}.script": "\n".join([*comments, f"def {name}():", *body, "end", f"{name}()", ""])}


def _move(step: Move) -> list[str]:
    match step:
        case JointMove(target, speed_rad_s):
            joints = listed(target.q, _DECIMALS)
            return [f"movej([{joints}], a={fixed(_JOINT_ACCELERATION, 3)}, v={fixed(speed_rad_s, 6)})"]
        case StraightMove(target, speed_mm_s, stops):
            blend = "" if stops else f", r={fixed(ZONE_MM / 1e3, 5)}"
            return [f"movel({_pose(target.T)}, {_speed(speed_mm_s)}{blend})"]
        case ToolRotation(target, angle, speed_rad_s):
            return [f"movel({_pose(target.T)}, t={fixed(angle / speed_rad_s, 3)})"]
        case Arc(via, end, speed_mm_s, stops):
            blend = fixed(0.0 if stops else ZONE_MM / 1e3, 5)
            return [
                f"movec({_pose(via.T)}, {_pose(end.T)}, {_speed(speed_mm_s)}, r={blend}, mode={int(step.with_path)})"
            ]


def _speed(speed_mm_s: float) -> str:
    return f"a={fixed(ACCELERATION_MM_S2 / 1e3, 4)}, v={fixed(speed_mm_s / 1e3, 6)}"


def _output(number: int, on: bool) -> str:
    if number >= _FIRST_OF_TOOL:
        return f"set_tool_digital_out({number - _FIRST_OF_TOOL}, {on})"
    if number >= _FIRST_CONFIGURABLE:
        return f"set_configurable_digital_out({number - _FIRST_CONFIGURABLE}, {on})"
    return f"set_standard_digital_out({number}, {on})"


def _pose(T: Array) -> str:
    return f"p[{listed(_values(T), _DECIMALS)}]"


def _values(T: Array) -> Array:
    """Position in m and rotation vector in rad (6,) of a frame (4, 4) in mm."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

    return np.concatenate([T[:3, 3] / 1e3, Rotation.from_matrix(T[:3, :3]).as_rotvec()])


WRITER = ProgramWriter(write, {URRTDE: BY_ITSELF}, "\n", range(18))
"""RTDE numbers outputs from 0."""
