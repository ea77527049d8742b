"""The joint angles that runs covered, and warnings where a model is used beyond them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.fitting.observation import Observation
from analysis.kinematics.arm import Array
from rigs.effects import Effect

JointRange = tuple[float, float]
"""Lowest and highest angle of a joint, in degrees."""
BEYOND_DEG = 3.0
"""Distance outside the measured range up to which a model is taken to be valid. Chosen: link constants and gear errors
change little over 3 degrees."""


def joints_covered(observations: Sequence[Observation]) -> tuple[JointRange, ...]:
    """Return the range in degrees of each joint in the readings of some runs, whose joint angles are (n, 6) rad."""
    q_deg = np.degrees(np.concatenate([one.table.q[one.rows] for one in observations]))
    return tuple(zip(q_deg.min(axis=0).tolist(), q_deg.max(axis=0).tolist(), strict=True))


def outside_coverage(covered: Sequence[JointRange], q_rad: Array, what: str) -> list[str]:
    """Return a message for each joint whose angles (n, 6) rad leave the ranges in which `what` was determined, which
    begins it."""
    lines = []
    for axis, ((low, high), angle) in enumerate(zip(covered, np.degrees(q_rad).T, strict=True), start=1):
        outside = int(((angle < low - BEYOND_DEG) | (angle > high + BEYOND_DEG)).sum())
        if outside:
            there = f"axis {axis} stands at {angle.min():z.1f}° to {angle.max():z.1f}°"
            lines.append(
                f"{what}: {there}, {outside} of {len(angle)} outside {low:z.1f}° to {high:z.1f}°, where it was found"
            )
    return lines


def outside_effect_coverage(effects: Sequence[Effect], q_rad: Array, what: str) -> list[str]:
    """Return the same messages for the effects of a rig file, each valid in the range in which it was found; angles are
    (n, 6) rad."""
    known = [effect.found.joints_deg for effect in effects if effect.found and effect.found.joints_deg]
    if not known:
        return []
    ranges = [(max(low for low, _ in axis), min(high for _, high in axis)) for axis in zip(*known, strict=True)]
    return outside_coverage(ranges, q_rad, what)
