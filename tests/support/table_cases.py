"""Helpers of the table tests: valid tables of all five kinds as text, for the shipped robot."""

from __future__ import annotations

from functools import cache

import numpy as np

from analysis.robot.geometry.circle import SENSE, frame_of, link_readings
from analysis.robot.geometry.driven_programs import radial_program
from analysis.robot.kinematics.arm import Array, arm_of, forward
from analysis.robot.kinematics.follow import follow
from rigs.load import load, load_hidden
from rigs.rig import Rig
from rigs.schema.vocabulary import Direction, TestName

RIG_FILE = "paper-fanuc"
TESTS: tuple[TestName, ...] = ("yaw", "roll", "radial", "repeatability", "pose")
JOINTS = [f"q{axis}_deg" for axis in range(1, 7)]
EXTRA = ["plain", 'a "b", c', "größe µ", "3.10", "", " kept ", "two\nlines", "'=1+1", "\r", "7\ufeff"]
"""Cells of an additional column, each difficult to parse in its own way."""
Rows = dict[str, list[str]]


@cache
def rig() -> Rig:
    return load_hidden(RIG_FILE).apply_to(load(RIG_FILE)[0])


@cache
def circle_values(test: TestName, direction: Direction) -> tuple[Array, Array, Array]:
    """Return t_s (n,), q (n, 6) rad and g_mm (n, 2) of an error-free lap, with the ball at the place of the rig
    file.
    """
    circle = rig().tests.circle
    phi = np.radians(np.arange(-10.0, 371.0, 2.0))
    order = slice(None) if direction == "acw" else slice(None, None, -1)
    arm, frame = arm_of(rig().robot), frame_of(circle)
    q = follow(arm, frame.poses(phi), np.radians(circle.posture_deg), "test")[order]
    ball = frame.centre + np.array(circle.eccentricity_mm)
    g_mm = link_readings(forward(arm, q), ball, np.array([25.0, -25.0]), "roll" if test == "roll" else "yaw", 70.0)
    assert SENSE[direction] * np.diff(frame.angle(forward(arm, q)[:, :3, 3])).sum() > 0
    return np.arange(len(phi)) * 0.1, q, g_mm


def rows_of(test: TestName, direction: Direction = "acw") -> Rows:
    """A valid table as text columns by name, with additional columns between the others, and times if
    possible.
    """
    if test in ("yaw", "roll"):
        t_s, q, g_mm = circle_values(test, direction)
        table = {"t_s": texts(t_s), "direction": [direction] * len(t_s), **joints(q)}
        table |= {"g1_mm": texts(g_mm[:, 0]), "g2_mm": texts(g_mm[:, 1])}
    else:
        rng = np.random.default_rng(1)
        n = 24
        if test == "pose":
            table = _poses(np.radians(np.array([-2.8, 35.8, 7.6, 171.0, 110.0, -5.7]) + rng.uniform(-20, 20, (n, 6))))
        else:
            table = _targets(test, n, rng)
    extra = [EXTRA[k % len(EXTRA)] for k in range(len(table["q1_deg"]))]
    first, *rest = table.items()
    return dict([("notes, if any", extra), first, ("7", list(reversed(extra))), *rest, ("", extra)])


def _targets(test: TestName, n: int, rng: np.random.Generator) -> Rows:
    """First n readings of a radial program; of a repeatability program three at each of some targets."""
    program = radial_program(rig())
    row = np.arange(n) if test == "radial" else 3 * (np.arange(n) // 3) + 1
    numbers, q, g_mm = [str(target) for target in program.target[row]], program.q[row], texts(rng.normal(0, 0.1, n))
    if test == "radial":
        around = (program.azimuth[row] + np.pi) % (2 * np.pi) - np.pi
        place = {"polar_deg": texts(np.degrees(program.polar[row])), "azimuth_deg": texts(np.degrees(around))}
        third = {"orientation": [str(orientation) for orientation in program.orientation[row]]}
        return {"target": numbers, **place, **third, **joints(q), "g1_mm": g_mm}
    words = [("none", "out", "in")[k % 3] for k in range(n)]
    time = {"t_s": texts(np.arange(n) * 1.7)}
    return {"target": numbers, **time, "approach": words, "round": ["1"] * n, **joints(q), "g1_mm": g_mm}


def _poses(q: Array) -> Rows:
    T = forward(arm_of(rig().robot), q)
    turns = texts_of(("rx_deg", "ry_deg", "rz_deg"), _rpy_deg(T[:, :3, :3]))
    seen = T[:, :3, 3] + [3000.0, 10.0, -400.0] + np.random.default_rng(1).normal(0, 0.02, (len(q), 3))
    return {**joints(q), **texts_of(("x_mm", "y_mm", "z_mm"), seen), **turns}


def _rpy_deg(R: Array) -> Array:
    roll, yaw = np.arctan2(R[:, 2, 1], R[:, 2, 2]), np.arctan2(R[:, 1, 0], R[:, 0, 0])
    return np.degrees(np.stack([roll, np.arcsin(-R[:, 2, 0]), yaw], axis=1))


def texts(values: Array) -> list[str]:
    return [repr(float(value)) for value in values]


def texts_of(names: tuple[str, ...], values: Array) -> Rows:
    return {name: texts(column) for name, column in zip(names, values.T, strict=True)}


def joints(q: Array) -> Rows:
    return texts_of(tuple(JOINTS), np.degrees(q))


def scaled(column: list[str], factor: float) -> list[str]:
    return [repr(float(text) * factor) for text in column]


def csv_text(rows: Rows) -> str:
    """Format a table as CSV with quotes everywhere, unlike the program under test."""

    def line(cells: list[str]) -> str:
        return ",".join('"' + cell.replace('"', '""') + '"' for cell in cells) + "\n"

    return line(list(rows)) + "".join(line(list(cells)) for cells in zip(*rows.values(), strict=True))


def plain(test: TestName, direction: Direction = "acw") -> Rows:
    """A valid table without additional columns."""
    return {name: cells for name, cells in rows_of(test, direction).items() if name not in ("notes, if any", "7", "")}
