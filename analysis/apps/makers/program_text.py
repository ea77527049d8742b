"""Common parts of all program writers: numbers, names, rotations, and the comments at the head of every program.

The operator checks these comments before the robot moves. Comments contain neither semicolons nor quotation marks,
which end a line or a text in some languages.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Callable, Iterable
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
    """Return a number with fixed decimals, never `-0` or with an exponent. Raises FileError for NaN and infinity."""
    if not math.isfinite(value):
        raise FileError(
            "the program", f"a number is {value}", "check the numbers in the rig file", code="program.number"
        )
    text = f"{value:.{decimals}f}"
    return text.removeprefix("-") if float(text) == 0 else text


def listed(values: Iterable[float], decimals: int) -> str:
    """Return numbers separated by commas."""
    return ",".join(fixed(value, decimals) for value in values)


def identifier(name: str, most: int) -> str:
    """Return a valid identifier in all languages, with at most `most` letters, digits and underscores.

    Longer names are cut at the end, so test and direction remain.
    """
    return re.sub(r"[^A-Za-z0-9]+", "_", name)[:most].strip("_")


def wrapped(text: str, width: int) -> list[str]:
    """Wrap a comment into ASCII lines of at most `width` characters."""
    plain = text.replace("°", " deg").replace("…", "to").encode("ascii", "replace").decode()
    return textwrap.wrap(plain, width)


@dataclass(frozen=True)
class Words:
    """Formats of a language for steps other than moves, with {} for the number or text.

    wait: a pause of a number of seconds, with `decimals`. on, off: switching of an output. remark: a remark of at most
    `width` characters. hold: a pause for the operator, below a remark with the request.
    """

    wait: str
    decimals: int
    on: str
    off: str
    remark: str
    width: int
    hold: str

    def remarks(self, *texts: str) -> list[str]:
        """Return texts as lines of remarks."""
        return [self.remark.format(line) for text in texts for line in wrapped(text, self.width)]

    def lines(self, plan: MotionPlan, step: Step, move: Callable[[Move], list[str]]) -> list[str]:
        """Return the lines of a step; `move` writes moves."""
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
    """Return the angles (3,) in degrees about the fixed x, y, z axes, in this order, of a frame (4, 4).

    These are roll, pitch and yaw. Makers call them W, P, R, or Rx, Ry, Rz; A, B, C are the same angles in reverse
    order.
    """
    return np.degrees(roll_pitch_yaw(T))


_CLEARANCE_MM = 100.0
"""Clearance around the tool positions. The operator judges the space needed by the rest of the arm."""


def heading(plan: MotionPlan, demand: Demand, shown: str) -> list[str]:
    """Return the comments at the head of a program, starting with the speed override and the clearances to check.

    shown: the pose at the start as displayed by the pendant of this controller.
    """
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
