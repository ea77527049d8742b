"""Common parts of all program writers: numbers, names, rotations, and the comments that the operator checks first.

Comments contain neither semicolons nor quotation marks, which end a line or a text in some languages.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.apps.makers.motion_plan import (
    Comment,
    Demand,
    Dwell,
    Hold,
    MotionPlan,
    Move,
    Signal,
    Step,
    start_of,
)
from analysis.robot.kinematics.arm import Array, roll_pitch_yaw
from rigs.errors import FileError

MM_DECIMALS = 7
DEG_DECIMALS = 9
"""Decimals for an agreement with the simulator within 1e-6 mm. Controllers round excess decimals."""


def fixed(value: float, decimals: int) -> str:
    """Format a number, never as `-0` or with an exponent. Raises FileError for NaN and infinity."""
    if not math.isfinite(value):
        remedy = "check the numbers in the rig file"
        raise FileError("the program", f"a number is {value}", remedy, code="rig_file.invalid")
    text = f"{value:.{decimals}f}"
    return text.removeprefix("-") if float(text) == 0 else text


def listed(values: Iterable[float], decimals: int) -> str:
    return ",".join(fixed(value, decimals) for value in values)


def identifier(name: str, most: int) -> str:
    """Make a name valid in all languages, cut at the end, so that test and direction remain."""
    return re.sub(r"[^A-Za-z0-9]+", "_", name)[:most].strip("_")


def wrapped(text: str, width: int) -> list[str]:
    plain = text.replace("°", " deg").replace("…", "to").encode("ascii", "replace").decode()
    return textwrap.wrap(plain, width)


@dataclass(frozen=True)
class Words:
    """Formats of a language for steps other than moves, with {} for the number or text."""

    wait: str
    decimals: int
    on: str
    """Switching of an output; also `off`."""
    off: str
    remark: str
    """A remark of at most `width` characters."""
    width: int
    hold: str

    def remarks(self, *texts: str) -> list[str]:
        return [self.remark.format(line) for text in texts for line in wrapped(text, self.width)]

    def lines(self, plan: MotionPlan, step: Step, move: Callable[[Move], list[str]]) -> list[str]:
        match step:
            case Dwell(seconds):
                return [self.wait.format(fixed(seconds, self.decimals))]
            case Signal(value):
                return [(self.on if on else self.off).format(number) for number, on in plan.signal_place.bits(value)]
            case Hold(request):
                return [*self.remarks(request), self.hold]
            case Comment(text):
                return self.remarks(text)
        return move(step)


def fixed_xyz_deg(T: Array) -> Array:
    """Roll, pitch and yaw (3,) in degrees: W, P, R or Rx, Ry, Rz of the makers, and A, B, C in reverse order."""
    return np.degrees(roll_pitch_yaw(T))


def labelled(form: str, names: Sequence[str], values: Iterable[float], decimals: int) -> list[str]:
    """Format each value with its name, as "{} = {} mm"."""
    return [form.format(name, fixed(value, decimals)) for name, value in zip(names, values, strict=True)]


def shown_pose(T: Array, names: Sequence[str], *, yaw_first: bool = False) -> str:
    """Format a pose (4, 4) as a pendant shows it. names: of its angles."""
    places = " ".join(f"{axis} {value:z.1f}" for axis, value in zip("XYZ", T[:3, 3], strict=True))
    angles = fixed_xyz_deg(T)[:: -1 if yaw_first else 1]
    return f"{places} mm {' '.join(f'{name} {angle:z.2f}' for name, angle in zip(names, angles, strict=True))} deg"


_CLEARANCE_MM = 100.0
"""Clearance around the tool positions. The operator judges the space needed by the rest of the arm."""


def heading(plan: MotionPlan, demand: Demand, shown: str) -> list[str]:
    """Comments at the head of a program. shown: the pose at the start as the pendant displays it."""
    low, high = demand.box_mm + np.array([[-_CLEARANCE_MM], [_CLEARANCE_MM]])
    space = ", ".join(f"{axis} {a:z.0f} to {b:z.0f}" for axis, a, b in zip("XYZ", low, high, strict=True))
    joints = " ".join(f"{angle:z.2f}" for angle in np.degrees(start_of(plan).q))
    tool = "tool and link" if plan.has_link else "the tool"
    link = "link off until" if plan.has_link else "keep away until"
    return [
        f"CHECK: override 10 % in the first run, 100 % to measure. Keep {space} mm (base frame) clear for "
        f"{tool}, and the path of the arm clear",
        f"{plan.name}: written by rig program, not run on any robot before",
        f"{link} the robot stands at the start: joints {joints} deg",
        f"the pendant then shows {shown}. Otherwise stop: base, tool or arm differ from the rig file",
        f"payload {plan.payload_kg:g} kg: set it on the controller",
    ]
