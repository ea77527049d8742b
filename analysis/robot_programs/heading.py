"""The comments at the head of every program: what a person checks before the robot moves.

They hold no semicolon and no quotation mark, which end a line or a text in one language or the other.
"""

from __future__ import annotations

import numpy as np

from analysis.robot_programs.examine import Demand
from analysis.robot_programs.plan import Plan, start_of

_CLEARANCE_MM = 100.0
"""Around the tool's place; a person judges what else of the arm needs."""


def heading(plan: Plan, demand: Demand, shown: str) -> list[str]:
    """Comments, the first of them the speed override and the clearances to check.

    shown: the pose at the start as this controller's pendant shows it.
    """
    low, high = demand.box_mm + np.array([[-_CLEARANCE_MM], [_CLEARANCE_MM]])
    space = ", ".join(f"{axis} {a:.0f} to {b:.0f}" for axis, a, b in zip("XYZ", low, high, strict=True))
    joints = " ".join(f"{angle:.2f}" for angle in np.degrees(start_of(plan).q))
    tool = "tool and link" if plan.has_link else "the tool"
    link = "link off until" if plan.has_link else "keep away until"
    return [
        f"CHECK: override 10 % in the first run, 100 % to measure. Keep {space} mm (base frame) clear for "
        f"{tool}, and the way of the arm free",
        f"{plan.name}: written by rig program, no robot has run it before you",
        f"{link} the robot stands at its start: joints {joints} deg",
        f"the pendant then shows {shown}. If it does not, stop: base, tool or arm differ from the rig file",
        f"payload {plan.payload_kg:g} kg: set it on the controller",
    ]
