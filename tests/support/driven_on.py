"""Circles that start where the robot stands, and poses of a tool with several reflectors.

The cw lap starts at the end of the acw lap, so a joint that turns by a full turn per lap differs by full turns between
the directions. Also included: two continuous laps, and joints that start shifted by full turns.

Written from docs/method.md and a rig file, with the arm of `tests.worlds.arms.independent_arm`. Nothing is imported
from rig.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from tests.worlds.arms import independent_arm
from tests.worlds.arms.independent_arm import RIGS, Constants, Seen, Wrong, flange, none

Array = NDArray[np.float64]
ROBOTS = ("paper-fanuc", "ur10e")
RATE_HZ = 25.0
LEAD_DEG = 12.0
_NODES = 240
"""Path nodes per turn solved by inverse kinematics and then interpolated by a spline."""


@dataclass(frozen=True)
class Drive:
    """A lap to be driven. sense: 1 for acw, -1 for cw; turns (6,): full turns by which the joints start shifted."""

    test: str
    sense: int
    laps: int = 1
    turns: tuple[int, ...] = (0, 0, 0, 0, 0, 0)


@dataclass(frozen=True)
class Driven:
    """Recorded data: t_s (n,), reported q (n, 6) rad, g_mm (n, 2)."""

    t_s: Array
    q: Array
    g_mm: Array


@dataclass(frozen=True)
class _Circle:
    centre: Array
    axes: Array
    """Columns: direction of angle zero, direction to its left, normal."""
    radius: float
    speed: float
    start: float
    posture: Array
    tool: tuple[Array, Array]

    def place(self, phi: float) -> tuple[Array, Array]:
        """Return rotation (3, 3) and position (3,) of the tool at a circle angle."""
        u, v, n = self.axes.T
        r = u * np.cos(phi) + v * np.sin(phi)
        return np.stack([n, np.cross(-r, n), -r], axis=1), self.centre + self.radius * r


@cache
def _circle(name: str) -> _Circle:
    data = yaml.safe_load((RIGS / f"{name}.yaml").read_text(encoding="utf-8"))
    circle, tool = data["tests"]["circle"], data["robot"]["tool"]
    n = np.array(circle["normal"], float) / np.linalg.norm(circle["normal"])
    u = np.array(circle.get("zero", [1, 0, 0]), float)
    u -= (u @ n) * n
    u /= np.linalg.norm(u)
    turn = Rotation.from_euler("xyz", tool.get("rpy_deg", [0, 0, 0]), degrees=True).as_matrix()
    return _Circle(
        np.array(circle["centre_mm"], float), np.stack([u, np.cross(n, u), n], axis=1), circle["radius_mm"],
        circle["speed_mm_s"], np.radians(circle["start_deg"]), np.radians(circle["posture_deg"]),
        (turn, np.array(tool["xyz_mm"], float)),
    )  # fmt: skip


def _tool(arm: Constants, wrong: Wrong, circle: _Circle, q: Array) -> tuple[Array, Array]:
    R, p = flange(arm, wrong, q)
    turn, xyz = circle.tool
    return R @ turn, p + R @ xyz


def _solved(arm: Constants, circle: _Circle, phi: float, q: Array) -> Array:
    """Solve the joints (6,) for a circle angle by Newton's method, starting from nearby joints."""
    R, p = circle.place(phi)
    for _ in range(30):
        M, x = _tool(arm, none(), circle, np.vstack([q, q + 1e-6 * np.eye(6)]))
        off = np.concatenate([x - p, 100 * Rotation.from_matrix(M @ R.T).as_rotvec()], axis=1)
        step = np.linalg.lstsq((off[1:] - off[0]).T / 1e-6, -off[0], rcond=None)[0]
        q = q + step * min(1.0, 0.3 / np.abs(step).max())
        if np.abs(step).max() < 1e-10:
            break
    return q


@cache
def _track(name: str, sense: int, laps: int) -> CubicSpline:
    """Joints over the circle angle as a spline, from the lead-in to the lead-out of the laps."""
    arm, circle = independent_arm.constants_of(name), _circle(name)
    step = 2 * np.pi / _NODES
    before = int(np.ceil(np.radians(LEAD_DEG) / step)) + 2
    ahead = step * np.arange(-before, laps * _NODES + before + 1)
    q = [_solved(arm, circle, circle.start, circle.posture)]
    for away in ahead[before - 1 :: -1]:
        q.insert(0, _solved(arm, circle, circle.start + sense * away, q[0]))
    for away in ahead[before + 1 :]:
        q.append(_solved(arm, circle, circle.start + sense * away, q[-1]))
    return CubicSpline(ahead, np.array(q))


def winds(name: str) -> Array:
    """Full turns (6,) of each joint per acw lap."""
    track = _track(name, 1, 1)
    return np.round((track(2 * np.pi) - track(0)) / (2 * np.pi))


def drive(
    name: str, one: Drive, wrong: Wrong, rng: np.random.Generator, *, play_rad: Array | None = None,
    ball_mm: Array | None = None, white_mm: float = 0.001,
) -> Driven:  # fmt: skip
    """Drive and record a lap. play_rad (6,): backlash of each joint; ball_mm (3,): offset of the ball from the
    centre.
    """
    arm, circle = independent_arm.constants_of(name), _circle(name)
    lead = np.radians(LEAD_DEG)
    step = circle.speed / circle.radius / RATE_HZ
    ahead = np.arange(-lead, 2 * np.pi * one.laps + lead, step)
    q = _track(name, one.sense, one.laps)(ahead)
    link = np.stack([_lagging(joint, width) for joint, width in zip(q.T, play_rad, strict=True)], axis=1) \
        if play_rad is not None else q  # fmt: skip
    M, p = _tool(arm, wrong, circle, link + np.radians(rng.normal(0, 0.0005, 6)))
    way = circle.centre + (np.zeros(3) if ball_mm is None else ball_mm) - p
    way /= (s := np.linalg.norm(way, axis=1))[:, None]
    x, y, z = (np.einsum("ni,ni->n", way, M[:, :, k]) for k in range(3))
    across = y if one.test == "yaw" else x
    g_mm = np.stack([(s - circle.radius - w * across) / z for w in (25.0, -25.0)], axis=1)
    g_mm += rng.uniform(-0.3, 0.3, 2) + rng.normal(0, white_mm, g_mm.shape)
    return Driven(np.arange(len(q)) / RATE_HZ, q + 2 * np.pi * np.array(one.turns), g_mm)


def _lagging(joint: Array, width: float) -> Array:
    """Return joint angles lagging by half the backlash after it has been crossed."""
    side, driven = joint[0] - np.sign(joint[1] - joint[0]) * width / 2, np.empty_like(joint)
    for k, motor in enumerate(joint):
        side = min(max(side, motor - width / 2), motor + width / 2)
        driven[k] = side
    return driven


def remounted(cell: independent_arm.Cell, q: Array, targets_mm: Array, rng: np.random.Generator) -> list[Seen]:
    """Measure the same poses by one tracker with its reflector at each of several places (k, 3) of the tool."""
    return [replace(cell, tool_mm=place).seen(q, rng) for place in targets_mm]
