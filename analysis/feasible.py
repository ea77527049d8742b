"""Whether a rig's robot can do the tests that its file names, in words."""

from __future__ import annotations

import numpy as np

from analysis.circle import frame_of, reversals
from analysis.kinematics.arm import arm_of
from analysis.simulate import drive, hold_speeds, lap
from rigs.rig import Rig


def feasible_tests(rig: Rig) -> list[str]:
    """A line for each test. Raises FileError for a circle that the robot cannot drive."""
    circle = rig.tests.circle
    if circle is None:
        return ["no circle test"]
    arm, frame, posture = arm_of(rig.robot), frame_of(circle), np.radians(circle.posture_deg)
    where = f"{rig.name}, tests.circle"
    t_s, phi = lap(circle, "acw")
    hold_speeds(arm, t_s, drive(arm, frame, phi, posture, where), where)
    turns = reversals(frame, arm, posture, where)
    by_axis: dict[int, list[str]] = {}
    for turn in turns:
        by_axis.setdefault(turn.axis, []).append(f"{np.degrees(turn.phi):.0f}°")
    listed = "; ".join(f"{rig.robot.axes[axis - 1].name} {' '.join(marks)}" for axis, marks in by_axis.items())
    return [f"circle of {circle.radius_mm:g} mm: reachable, {t_s[-1]:.0f} s a lap", f"joint reversals: {listed}"]
