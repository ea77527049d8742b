"""Which joint angles runs covered, and where a model is used beyond them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.fitting.observation import Observation
from analysis.kinematics.arm import Array
from rigs.effects import Effect

JointRange = tuple[float, float]
"""Lowest and highest angle of a joint, in degrees."""
_BEYOND_DEG = 3.0
"""So far outside what was measured a model is still taken to hold: link constants and gears change that little."""


def joints_covered(observations: Sequence[Observation]) -> tuple[JointRange, ...]:
    """What each joint went through in the readings of some runs."""
    q_deg = np.degrees(np.concatenate([one.table.q[one.rows] for one in observations]))
    return tuple(zip(q_deg.min(axis=0).tolist(), q_deg.max(axis=0).tolist(), strict=True))


def beyond(covered: Sequence[JointRange], q_rad: Array, what: str) -> list[str]:
    """Where joint angles (n, 6) leave the ranges that `what` is known in, a line for each joint."""
    lines = []
    for axis, ((low, high), angle) in enumerate(zip(covered, np.degrees(q_rad).T, strict=True), start=1):
        outside = int(((angle < low - _BEYOND_DEG) | (angle > high + _BEYOND_DEG)).sum())
        if outside:
            there = f"axis {axis} stands at {angle.min():.1f}° to {angle.max():.1f}°"
            lines.append(f"{there}, {outside} of {len(angle)} outside {low:.1f}° to {high:.1f}° where {what} was found")
    return lines


def beyond_effects(effects: Sequence[Effect], q_rad: Array, what: str) -> list[str]:
    """The same for the effects of a rig file, each known where the runs went that it was found in."""
    known = [effect.found.joints_deg for effect in effects if effect.found and effect.found.joints_deg]
    if not known:
        return []
    ranges = [(max(low for low, _ in axis), min(high for _, high in axis)) for axis in zip(*known, strict=True)]
    return beyond(ranges, q_rad, what)
