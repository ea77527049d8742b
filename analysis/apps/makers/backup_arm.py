"""Comparison of the arm in a backup with the arm of a rig file."""

from __future__ import annotations

from collections.abc import Mapping

from rigs.schema.robot import Robot

_SAME_MM = 5.0
"""Largest difference in mm between the lengths of arms of the same type. Chosen: far above the rounding of a data sheet
and the tolerances of a casting, and below the steps between the types of a maker, mostly 20 mm and more."""


def other_lengths(name: str, lengths_mm: Mapping[int, float], robot: Robot) -> str:
    """Explain which lengths `a` of the axes in a file differ from those of a robot; empty if none does."""
    own_mm = {axis: abs(robot.axes[axis - 1].a_mm) for axis in lengths_mm if axis <= len(robot.axes)}
    pairs = {axis: (abs(lengths_mm[axis]), mm) for axis, mm in own_mm.items()}
    differ = {axis: (mm, own) for axis, (mm, own) in pairs.items() if abs(mm - own) >= _SAME_MM}
    if not differ:
        return ""
    words = ", ".join(f"a of axis {axis} {mm:g} mm instead of {own:g} mm" for axis, (mm, own) in differ.items())
    return f"is the backup of another arm than {robot.name}: {name} states {words}"
