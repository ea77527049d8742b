"""Closed formulas of the ball link, the hemisphere and a nominal arm.

The simulator is not used here. The noisy cells of `cells`, `circles`, `targets` and `poses` use these formulas.
"""

import dataclasses

import numpy as np

from analysis.robot.kinematics.arm import Arm
from analysis.runs.tables import RadialTable, RepeatabilityTable

RADIUS_MM, BASELINE_MM = 70.0, 50.0
_HAND = float(np.cross([-1.0, 0, 0], [0, 0, 1.0])[1])
"""Component of y_T along v at phi = 0: z_T × x_T with z_T = -u, x_T = n."""


def link_readings(
    phi: np.ndarray,
    ball_mm: np.ndarray,
    test: str,
    angle_rad: np.ndarray,
    distance_mm: np.ndarray,
    baseline_mm: float = BASELINE_MM,
) -> np.ndarray:
    """Return readings (n, 2) mm of g1 and g2 at phi (n,) rad. ball_mm (3,): ball relative to the centre along u, v,
    n; angle_rad, distance_mm (n,): errors of the robot.
    """
    x, y = RADIUS_MM * np.cos(phi) - ball_mm[0], RADIUS_MM * np.sin(phi) - ball_mm[1]
    along_z = x * np.cos(phi) + y * np.sin(phi)
    along_y = _HAND * (x * np.sin(phi) - y * np.cos(phi))
    angle = np.arctan2(ball_mm[2] if test == "roll" else along_y, along_z) + angle_rad
    distance = np.hypot(x, y) + distance_mm - RADIUS_MM
    half = np.tan(angle) * baseline_mm / 2
    return np.stack([distance - half, distance + half], axis=1)


# --- tables of targets


def hemisphere() -> RadialTable:
    """37 targets in steps of 30° with three orientations, without readings."""
    places = [(0.0, 0.0)] + [(polar, azimuth) for polar in (30.0, 60.0, 90.0) for azimuth in range(0, 360, 30)]
    rows = [(k + 1, *place, o) for k, place in enumerate(places) for o in (1, 2, 3)]
    target, polar, azimuth, orientation = (np.array(column) for column in zip(*rows, strict=True))
    zeros = np.zeros(len(rows))
    return RadialTable(
        target, np.radians(polar), np.radians(azimuth), orientation, zeros, np.zeros((len(rows), 6)), zeros
    )


def with_readings(table: RadialTable, g_mm: np.ndarray) -> RadialTable:
    return dataclasses.replace(table, g_mm=g_mm)


def directions(table: RadialTable) -> np.ndarray:
    """Unit vectors (n, 3) from the ball to the target of each row, with z towards polar angle 0."""
    s = np.sin(table.polar)
    return np.stack([s * np.cos(table.azimuth), s * np.sin(table.azimuth), np.cos(table.polar)], axis=1)


def true_radial(table: RadialTable) -> np.ndarray:
    """Return readings (n,) mm: radius 0.192 too large, a displacement to one side, and an error of each target and
    orientation.
    """
    robot = np.random.default_rng(77).normal(0, 0.12, (100, 4))
    pull = directions(table) @ np.array([0.3, -0.2, 0.1])
    return 0.192 + pull + 0.9 * robot[table.target, 3] + 0.5 * robot[table.target, table.orientation - 1]


def repeatability_table(g: np.ndarray) -> RepeatabilityTable:
    """A table of readings g (targets, rounds, 2): out, then in."""
    targets, rounds, _ = g.shape
    rows = [(t + 1, side, r + 1) for t in range(targets) for r in range(rounds) for side in ("out", "in")]
    target, approach, round_ = zip(*rows, strict=True)
    zeros = np.zeros(len(rows))
    return RepeatabilityTable(
        np.array(target), np.array(approach), np.array(round_), zeros, np.zeros((len(rows), 6)), g.ravel()
    )


def ur10() -> Arm:
    """Nominal UR10 from the README of the data set, converted from standard DH to Craig's convention."""
    ninety = np.pi / 2
    return Arm(
        a=np.array([0, 0, -612.0, -572.3, 0, 0]),
        alpha=np.array([0, ninety, 0, 0, ninety, -ninety]),
        beta=np.zeros(6),
        d=np.array([127.3, 0, 0, 163.941, 115.7, 92.2]),
        offset=np.zeros(6),
        coupling=np.eye(6),
        T_world_base=np.eye(4),
        T_flange_tool=np.eye(4),
        limits=np.full((6, 2), np.pi),
        speed=np.ones(6),
    )
