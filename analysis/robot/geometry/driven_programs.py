"""Robot programs of the tests: nominal poses converted to reported joint angles, and a check of the feasible tests of a
rig.

The controller follows the nominal path, so the reported angles match it exactly; effects are deviations of the link
side.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from analysis.robot.geometry.circle import SENSE, CircleFrame, circle_frame, frame_of, reversals
from analysis.robot.geometry.iso_cube import cube_of
from analysis.robot.kinematics.arm import Arm, Array, Integers, arm_of, forward
from analysis.robot.kinematics.follow import follow
from analysis.robot.kinematics.newton import newton
from rigs.errors import FileError, PathError, RigPlace
from rigs.load import named_by
from rigs.readiness import missing_arm, require_part
from rigs.rig import Rig
from rigs.schema.declared_tests import Circle, Hemisphere, Repeatability
from rigs.schema.vocabulary import Direction
from rigs.text import counted

_TILT_RAD = np.radians(20.0)
"""Angle between neighbouring orientations at a target, within the range of the ball's socket."""
_LEAN = 0.5
"""Tilt of the tool from the axis of the hemisphere, relative to the tilt that points at the ball. Half of it is
within the reach of most arms; pointing at the ball is not.
"""


def hemisphere_frame(hemisphere: Hemisphere) -> CircleFrame:
    """Edge of the hemisphere, with n towards its middle."""
    return circle_frame(
        np.array(hemisphere.centre_mm), np.array(hemisphere.normal), np.array(hemisphere.zero), hemisphere.radius_mm
    )


def target_angles(hemisphere: Hemisphere) -> tuple[Array, Array]:
    """Polar angles and azimuths (k,) rad of the targets, numbered from 1: the pole, then ring by ring."""
    polar, azimuth = [0.0], [0.0]
    for ring in np.arange(hemisphere.step_deg, hemisphere.polar_max_deg + 1e-9, hemisphere.step_deg):
        around = np.arange(0.0, 360.0 - 1e-9, hemisphere.step_deg)
        polar += [float(ring)] * len(around)
        azimuth += around.tolist()
    return np.radians(polar), np.radians(azimuth)


def target_poses(frame: CircleFrame, polar: Array, azimuth: Array, orientation: Integers, count: int) -> Array:
    """T_world_tool (k, 4, 4) at targets, with the tool tilted inwards.

    orientation (k,) from 1 to `count`: tilts about the tool's x axis, evenly around the middle one.
    """
    direction = frame.direction(polar, azimuth)
    lean = _about(np.cross(frame.n, direction), _LEAN * polar)
    pole = np.stack([frame.u, np.cross(-frame.n, frame.u), -frame.n], axis=1)
    R = lean @ pole
    tilt = _TILT_RAD * (orientation - (count + 1) / 2)
    T = np.zeros((len(polar), 4, 4))
    T[:, :3, :3] = R @ _about(np.broadcast_to([1.0, 0.0, 0.0], (len(polar), 3)), tilt)
    T[:, :3, 3] = frame.centre + frame.radius * direction
    T[:, 3, 3] = 1.0
    return T


def _about(axis: Array, angle: Array) -> Array:
    """Rotations (k, 3, 3) about axes (k, 3) by angles (k,) rad; the identity for a zero axis."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

    length = np.linalg.norm(axis, axis=1, keepdims=True)
    unit = np.divide(axis, length, out=np.zeros_like(axis), where=length > 1e-9)
    return np.asarray(Rotation.from_rotvec(unit * angle[:, None]).as_matrix())


ACCELERATION_MM_S2 = 200.0
"""Acceleration of the programs on arcs and lines, a moderate value."""
_CONTROL_PERIOD_S = 0.004
_BACK = 2.0
"""Speed of the return to the next lap, relative to the lap."""
PAUSE_S = 0.5
"""Standstill at the turning points of a program."""
JOINT_SPEED = np.radians(30.0)
"""Speed of the fastest joint between targets, rad/s."""
_SHORTEST_MOVE_S = 0.6


def require_drivable_arm(rig: Rig) -> None:
    for missing in missing_arm(rig):
        raise missing.error(rig)


def circle_of(rig: Rig) -> Circle:
    require_drivable_arm(rig)
    return require_part(rig, rig.tests.circle, "circle")


def hemisphere_of(rig: Rig) -> Hemisphere:
    return require_part(rig, rig.tests.hemisphere, "hemisphere")


@dataclass(frozen=True)
class CircleProgram:
    """Laps with lead-in and lead-out, and the returns between them, at the controller's period."""

    t_s: Array
    phi: Array
    q: Array


@dataclass(frozen=True)
class LapMotion:
    """Equal laps of a circle from rest to rest, and the returns between them, faster by the factor `back`."""

    t_s: Array
    phi: Array
    q: Array
    count: int
    back: float

    @property
    def round_s(self) -> float:
        """Time from the start of a lap to the next, with a pause before and after the return."""
        return float(self.t_s[-1] * (1 + 1 / self.back) + 2 * PAUSE_S)

    @property
    def end_s(self) -> float:
        return float((self.count - 1) * self.round_s + self.t_s[-1])

    def at(self, t_s: Array) -> Array:
        lap_s = self.t_s[-1]
        since = t_s - self.round_s * np.clip(np.floor(t_s / self.round_s), 0, self.count - 1)
        driven_back = np.maximum(since - lap_s - PAUSE_S, 0.0) * self.back
        on_lap = np.clip(np.minimum(since, lap_s) - driven_back, 0.0, lap_s)
        k = np.clip(np.searchsorted(self.t_s, on_lap, side="right") - 1, 0, len(self.t_s) - 2)
        share = (on_lap - self.t_s[k]) / (self.t_s[k + 1] - self.t_s[k])
        q: Array = self.q[k]
        q += share[:, None] * (self.q[k + 1] - q)
        return q


def circle_program(rig: Rig, direction: Direction) -> CircleProgram:
    """Circle program of a rig, all laps, from rest to rest. Raises FileError if the robot cannot drive it."""
    laps = circle_laps(rig, direction)
    t_s, back_s = laps.t_s, laps.t_s / laps.back
    times, rows = [t_s], [np.arange(len(t_s))]
    for done in range(1, laps.count):
        times += [t_s[-1] + PAUSE_S + back_s + (done - 1) * laps.round_s, t_s + done * laps.round_s]
        rows += [rows[0][::-1], rows[0]]
    order = np.concatenate(rows)
    return CircleProgram(np.concatenate(times), laps.phi[order], laps.q[order])


def circle_laps(rig: Rig, direction: Direction) -> LapMotion:
    """Laps of a circle program. Raises FileError if the robot cannot drive them.

    Between laps the robot returns along the circle, because few arms can turn the wrist by two more turns, twice as
    fast if the joint speeds permit it.
    """
    circle = circle_of(rig)
    arm, frame = arm_of(rig.robot), frame_of(circle)
    t_s, phi = lap(circle, direction)
    where = RigPlace.of(rig.name, "tests.circle")
    q = drive(arm, frame, phi, np.radians(circle.posture_deg), where)
    fastest = fastest_joints(t_s, q)
    for axis in np.flatnonzero(fastest > arm.speed):
        most, speed = np.degrees(arm.speed[axis]), np.degrees(fastest[axis])
        problem = f"axis {axis + 1} would move at {speed:.0f}°/s, but its limit is {most:.0f}°/s"
        raise PathError(where, problem, "lower speed_mm_s, or move the circle away from the singularity", "speed")
    return LapMotion(t_s, phi, q, circle.laps, way_back(arm, fastest))


def drive(arm: Arm, frame: CircleFrame, phi: Array, posture: Array, where: str) -> Array:
    """Reported angles (n, 6) rad along monotone circle angles phi (n,), in either direction, from the acw posture.

    A cw program reverses the same joint angles: a joint with a full turn starts at the end of the acw lap, because most
    have no second turn. If the lap does not fit the limits from the posture, it starts full turns away, if it fits
    there.
    """
    order = slice(None) if phi[-1] > phi[0] else slice(None, None, -1)
    poses = frame.poses(phi[order])
    try:
        return follow(arm, poses, posture, where)[order]
    except PathError as error:
        if error.reason != "limits":
            raise
        unlimited = replace(arm, limits=arm.limits + 4 * np.pi * np.array([-1.0, 1.0]))
        turned = _turned_within(arm, follow(unlimited, poses, posture, where))
        if turned is None:
            raise
        return turned[order]


def _turned_within(arm: Arm, q: Array) -> Array | None:
    """Path q (n, axes) rad turned by the fewest full turns of each joint that fit its limits; None if none do."""
    low, high = arm.limits.T
    fewest = np.ceil((low - q.min(axis=0)) / (2 * np.pi))
    most = np.floor((high - q.max(axis=0)) / (2 * np.pi))
    return None if (fewest > most).any() else np.asarray(q + 2 * np.pi * np.clip(0.0, fewest, most))


def lap(circle: Circle, direction: Direction) -> tuple[Array, Array]:
    """Time (n,) s and circle angle (n,) rad: lead-in, one lap at constant speed, lead-out, from rest to rest."""
    arc = np.radians(360.0 + 2 * circle.lead_deg)
    speed = circle.speed_mm_s / circle.radius_mm
    acceleration = ACCELERATION_MM_S2 / circle.radius_mm
    ramp_s = min(speed / acceleration, np.sqrt(arc / acceleration))
    cruise_s = max(0.0, arc / speed - ramp_s)
    t = np.arange(0.0, cruise_s + 2 * ramp_s + _CONTROL_PERIOD_S, _CONTROL_PERIOD_S)
    # Distance of a trapezoid: integral of a ramp up less that of a later ramp down.
    driven = acceleration / 2 * (_ramp(t, 0, ramp_s) - _ramp(t, ramp_s + cruise_s, 2 * ramp_s + cruise_s))
    start = np.radians(circle.start_deg) - SENSE[direction] * np.radians(circle.lead_deg)
    return t, start + SENSE[direction] * np.minimum(driven, arc)


def _ramp(t: Array, begin: float, end: float) -> Array:
    inside = np.clip(t, begin, end) - begin
    return np.asarray(inside**2 + 2 * (end - begin) * np.maximum(t - end, 0.0))


def way_back(arm: Arm, fastest: Array) -> float:
    """Speed of the return relative to a lap."""
    return _BACK if (_BACK * fastest < arm.speed).all() else 1.0


def fastest_joints(t_s: Array, q: Array) -> Array:
    return np.asarray(np.abs(np.diff(q, axis=0) / np.diff(t_s)[:, None]).max(axis=0))


@dataclass(frozen=True)
class TargetProgram:
    """Targets of the hemisphere in order of visits. All (n,) or (n, 6); angles in rad, numbers from 1."""

    target: Integers
    polar: Array
    azimuth: Array
    orientation: Integers
    q: Array


def radial_program(rig: Rig) -> TargetProgram:
    """Every target of the hemisphere in each orientation, `visits` times.

    The whole list is repeated, so visits to a target are minutes apart. Raises FileError if one is out of reach.
    """
    count, targets = hemisphere_of(rig).orientations, len(target_angles(hemisphere_of(rig))[0])
    target = np.repeat(np.arange(1, targets + 1), count)
    orientation = np.tile(np.arange(1, count + 1), targets)
    names = [f"target {t}, orientation {o}" for t, o in zip(target, orientation, strict=True)]
    once = _target_program(rig, target, orientation, names)
    rows = np.tile(np.arange(len(target)), hemisphere_of(rig).visits)
    return TargetProgram(target[rows], once.polar[rows], once.azimuth[rows], orientation[rows], once.q[rows])


def repeatability_program(rig: Rig) -> TargetProgram:
    """Repeatability targets in their middle orientation, one row each. Raises FileError like `radial_program`."""
    target = repeatability_targets(rig)
    middle = np.full(len(target), (hemisphere_of(rig).orientations + 1) // 2)
    return _target_program(rig, target, middle, [f"target {number}" for number in target])


def _target_program(rig: Rig, target: Integers, orientation: Integers, names: list[str]) -> TargetProgram:
    hemisphere = hemisphere_of(rig)
    polar, azimuth = (angle[target - 1] for angle in target_angles(hemisphere))
    poses = target_poses(hemisphere_frame(hemisphere), polar, azimuth, orientation, hemisphere.orientations)
    return TargetProgram(target, polar, azimuth, orientation, _reach(rig, hemisphere, poses, names))


def repeatability_targets(rig: Rig) -> Integers:
    """Target numbers (n,), from 1. Raises FileError for a target outside the hemisphere."""
    target, count = np.array(repeatability_of(rig).targets, dtype=np.int64), len(target_angles(hemisphere_of(rig))[0])
    if (unknown := target[target > count]).size:
        problem = f"target {unknown[0]} is not one of the {count} targets of the hemisphere"
        raise FileError(
            RigPlace.of(rig.name, "tests.repeatability"), problem, "correct targets", code="rig_file.invalid"
        )
    return target


def repeatability_of(rig: Rig) -> Repeatability:
    return rig.tests.repeatability or Repeatability()


def stops(q: Array, *, dwell_s: float) -> tuple[Array, Array]:
    """Times (n,) s and reported angles (n, 6) rad of a program stopping at each of q (m, 6) for `dwell_s`.

    Between stops all joints move together, from rest to rest; the slowest joint determines the time.
    """
    t, path = [np.zeros(1)], [q[:1]]
    for begin, end in pairwise(q):
        seconds = max(_SHORTEST_MOVE_S, float(np.abs(end - begin).max() / JOINT_SPEED))
        share = np.arange(_CONTROL_PERIOD_S, seconds, _CONTROL_PERIOD_S) / seconds
        smooth = (1 - np.cos(np.pi * share)) / 2
        t += [t[-1][-1] + np.array([dwell_s]), t[-1][-1] + dwell_s + seconds * share]
        path += [begin[None], begin + smooth[:, None] * (end - begin)]
        t.append(t[-2] + seconds)
        path.append(end[None])
    t.append(t[-1] + dwell_s)
    path.append(q[-1:])
    return np.concatenate(t), np.concatenate(path)


def radial_stops(rig: Rig) -> Array:
    return radial_program(rig).q


def repeatability_stops(rig: Rig) -> Array:
    """Joint angles (m, 6) rad: each target, then out and back, in and back, in rounds."""
    program, plan = repeatability_program(rig), repeatability_of(rig)
    radius = hemisphere_frame(hemisphere_of(rig)).direction(program.polar, program.azimuth)
    arm = arm_of(rig.robot)
    out = displace_tool(arm, program.q, plan.approach_mm * radius)
    back = displace_tool(arm, program.q, -plan.approach_mm * radius)
    at = program.q
    rounds = np.stack([out, at, back, at], axis=1)
    return np.concatenate([at[:, None], *[rounds] * plan.rounds], axis=1).reshape(-1, 6)


def displace_tool(arm: Arm, q: Array, offset_mm: Array) -> Array:
    """Joint angles (n, 6) rad with the tool displaced by offset_mm (n, 3) in the same orientation."""
    poses = forward(arm, q)
    poses[:, :3, 3] += offset_mm
    return newton(arm, poses, q)[0]


def _reach(rig: Rig, hemisphere: Hemisphere, poses: Array, names: list[str]) -> Array:
    arm = arm_of(rig.robot)
    posture = np.radians(hemisphere.posture_deg)
    q, good = newton(arm, poses, np.tile(posture, (len(poses), 1)))
    good &= (q >= arm.limits[:, 0]).all(axis=1) & (q <= arm.limits[:, 1]).all(axis=1)
    if not good.all():
        bad = [name for name, reached in zip(names, good, strict=True) if not reached]
        problem = f"{len(bad)} of {len(poses)} poses are out of reach or limits, first {bad[0]}"
        remedy = "move centre_mm, lower polar_max_deg, or set posture_deg near the pole"
        raise PathError(RigPlace.of(rig.name, "tests.hemisphere"), problem, remedy, "reach")
    return q


def feasible_tests(rig: Rig, file: str | Path) -> tuple[list[str], list[FileError]]:
    """A line for each test that the robot can drive, and an error for each of the others."""
    lines, errors = [], []
    for test in (_circle_lines, _hemisphere_lines, _repeatability_lines, _iso9283_lines):
        try:
            with named_by(file, rig):
                lines += test(rig)
        except FileError as error:
            errors.append(error)
    return lines, errors


def _circle_lines(rig: Rig) -> list[str]:
    circle = rig.tests.circle
    if circle is None:
        return ["the rig file declares no circle"] if rig.gauges.recorded else []
    seconds = circle_program(rig, "acw").t_s[-1]
    laps = f"{counted(circle.laps, 'lap')} with lead-in and lead-out"
    turns = reversals(circle, arm_of(rig.robot), RigPlace.of(rig.name, "tests.circle"))
    by_axis: dict[int, list[str]] = {}
    for turn in turns:
        by_axis.setdefault(turn.axis, []).append(f"{np.degrees(turn.phi):.0f}°")
    listed = "; ".join(f"{rig.robot.axis_words(axis)} {' '.join(marks)}" for axis, marks in by_axis.items())
    return [
        f"circle of radius {circle.radius_mm:g} mm: reachable; {seconds:.0f} s in each direction ({laps})",
        f"angles on the circle at which axes reverse: {listed}",
    ]


def _hemisphere_lines(rig: Rig) -> list[str]:
    hemisphere = rig.tests.hemisphere
    if hemisphere is None:
        return []
    named, program = f"hemisphere of radius {hemisphere.radius_mm:g} mm", radial_program(rig)
    return [f"{named}: {program.target.max()} targets in {program.orientation.max()} orientations, all reachable"]


def _repeatability_lines(rig: Rig) -> list[str]:
    if rig.tests.hemisphere is None:
        return ["repeatability: needs tests.hemisphere, which defines the targets"] if rig.tests.repeatability else []
    repeatability_targets(rig)
    return []


def _iso9283_lines(rig: Rig) -> list[str]:
    if rig.tests.iso9283 is None:
        return []
    cube = cube_of(rig)
    where = ", ".join(f"{coordinate:.6g}" for coordinate in cube.centre_mm)
    origin = ", found where there is room" if cube.found else ""
    return [f"ISO 9283 cube of {cube.side_mm:g} mm about {where} mm: reachable on its whole plane{origin}"]
