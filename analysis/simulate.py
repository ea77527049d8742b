"""What robot and gauges do on a circle: motion as a program drives it, then effects, then readings.

The controller moves along the nominal path, so the reported joint angles follow it; the effects make the
link side differ, and that is what the gauges see.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from analysis.ball_link import readings
from analysis.circle import SENSE, CircleFrame, frame_of
from analysis.effects import link_side
from analysis.kinematics.arm import Arm, Array, arm_of, forward
from analysis.kinematics.follow import follow
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.tests import Circle
from rigs.vocabulary import Direction

_ACCELERATION_MM_S2 = 200.0
"""Of a controller that moves a calibration circle: gentle."""
_CONTROL_PERIOD_S = 0.004


@dataclass(frozen=True)
class Trace:
    """One program run. t_s (n,), phi (n,) rad, q (n, 6) rad as reported, g_mm (n, k) as the gauges read."""

    t_s: Array
    phi: Array
    q: Array
    g_mm: Array


def circle_of(rig: Rig) -> Circle:
    """The circle of a rig. Raises FileError for a rig without one."""
    if rig.tests.circle is None:
        raise FileError(rig.name, "the rig file has no tests.circle", "add it: centre, posture, radius")
    return rig.tests.circle


def simulate_circle(rig: Rig, test: Literal["yaw", "roll"], direction: Direction) -> Trace:
    """A noise-free lap with its lead-in and lead-out, sampled at the controller's period."""
    circle = circle_of(rig)
    arm, frame = arm_of(rig.robot), frame_of(circle)
    t_s, phi = lap(circle, direction)
    where = f"{rig.name}, tests.circle"
    q = drive(arm, frame, phi, np.radians(circle.posture_deg), where)
    hold_speeds(arm, t_s, q, where)
    return Trace(t_s, phi, q, gauge_readings(rig, arm, frame, q, test))


def drive(arm: Arm, frame: CircleFrame, phi: Array, posture: Array, where: str) -> Array:
    """Reported angles (n, 6) rad along monotone circle angles phi (n,), of either direction.

    The posture is that of the acw start. A cw program drives the same joint angles back: a joint that
    makes the full turn begins where the acw lap ends, since most have no second turn to give.
    """
    order = slice(None) if phi[-1] > phi[0] else slice(None, None, -1)
    return follow(arm, frame.poses(phi[order]), posture, where)[order]


def gauge_readings(rig: Rig, arm: Arm, frame: CircleFrame, q: Array, test: Literal["yaw", "roll"]) -> Array:
    """Readings (n, k) mm of the rig's gauges for reported angles q (n, 6) in order of time, effects included."""
    ball = frame.centre + np.array(circle_of(rig).eccentricity_mm)
    offsets = np.array([gauge.offset_mm for _, gauge in rig.gauges])
    return readings(forward(arm, link_side(rig.effects, q)), ball, offsets, test, frame.radius)


def lap(circle: Circle, direction: Direction) -> tuple[Array, Array]:
    """Time (n,) s and circle angle (n,) rad: lead-in, one lap at constant speed, lead-out, from rest to rest."""
    arc = np.radians(360.0 + 2 * circle.lead_deg)
    speed = circle.speed_mm_s / circle.radius_mm
    acceleration = _ACCELERATION_MM_S2 / circle.radius_mm
    ramp_s = min(speed / acceleration, np.sqrt(arc / acceleration))
    cruise_s = max(0.0, arc / speed - ramp_s)
    t = np.arange(0.0, cruise_s + 2 * ramp_s + _CONTROL_PERIOD_S, _CONTROL_PERIOD_S)
    # Distance of a trapezoid: the integral of a ramp up less that of a ramp down begun at its time.
    driven = acceleration / 2 * (_ramp(t, 0, ramp_s) - _ramp(t, ramp_s + cruise_s, 2 * ramp_s + cruise_s))
    start = np.radians(circle.start_deg) - SENSE[direction] * np.radians(circle.lead_deg)
    return t, start + SENSE[direction] * np.minimum(driven, arc)


def _ramp(t: Array, begin: float, end: float) -> Array:
    """Twice the distance of a unit acceleration from begin to end, the speed held afterwards."""
    inside = np.clip(t, begin, end) - begin
    distance: Array = inside**2 + 2 * (end - begin) * np.maximum(t - end, 0.0)
    return distance


def hold_speeds(arm: Arm, t_s: Array, q: Array, where: str) -> None:
    """Raises FileError where a joint would have to move faster than it can."""
    fastest = np.abs(np.diff(q, axis=0) / np.diff(t_s)[:, None]).max(axis=0)
    for axis in np.flatnonzero(fastest > arm.speed):
        raise FileError(
            where,
            f"axis {axis + 1} would move at {np.degrees(fastest[axis]):.0f}°/s, it can do "
            f"{np.degrees(arm.speed[axis]):.0f}°/s",
            "lower speed_mm_s, or move the circle away from the singularity",
        )
