"""Least squares: which of the constants of an arm are wrong, by its poses or touches, or by the runs of a cell.

An ordinary calibration. From gauges, by the equations of docs/method.md alone, ball and zeros of each set-up are fitted
beside a, alpha, d and zero of each axis, from poses frame and target, from touches the ball and the place of each
socket; all readings alike. It names a constant that is at least five usual sizes off and three times its uncertainty,
and knows no plays, gears or soft joints.
"""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from tests.trials.ground.plain_arm import (
    Array,
    Frame,
    PlainArm,
    framed,
    read_arm,
    read_columns,
    read_poses,
    read_touches,
)

ROWS = 120
"""Readings of a circle that are used, evenly chosen."""
NAMES = (("link_geometry", "a", 0.2), ("link_geometry", "alpha", 0.02), ("link_geometry", "d", 0.2),
         ("joint_offset", "", 0.02))  # fmt: skip
"""Part, field and usual size of the constants, in the order of `PlainArm.changed`."""
WEAK = 100.0
"""Usual sizes of a prior: what no reading determines stays where it was."""
BALL_MM = (0.0, 0.0, 120.0)
"""Position of the ball on the flange, as stated by the page."""
UNUSUAL, SURE = 5.0, 3.0
"""Usual sizes, and uncertainties, from which a constant is named."""


@dataclass(frozen=True)
class Run:
    """Joint angles q (m, 6) rad and readings g (m, k) mm of a test, with its set-up and the radius of its link."""

    test: str
    q: Array
    g: Array
    setup: str
    radius: float


Rows = list[list[str]]
"""Of an answer: part, axis, size, u."""


def named_in_poses(here: Path) -> Rows:
    """Return what poses of an arm name."""
    arm, given = read_arm(here / "arm.csv"), read_poses(here / "train.csv")
    return named(
        arm.axes,
        lambda x: Frame(x[4 * arm.axes :]).places(changed(arm, x), given.q) - given.xyz_mm,
        framed(arm, given).values,
    )


def named_in_touches(here: Path) -> Rows:
    """Return what touches of sockets name."""
    arm = read_arm(here / "arm.csv")
    touches = read_touches(here / "touches.csv", arm.axes)
    socket = np.unique(touches.socket, return_inverse=True)[1]

    def balls(x: Array, ball: Array) -> Array:
        R, p = changed(arm, x).flange(touches.q)
        return np.asarray(p + R @ ball)

    zero, ball = np.zeros(4 * arm.axes), np.array(BALL_MM)
    starts = np.array([balls(zero, ball)[socket == k].mean(axis=0) for k in range(socket.max() + 1)])
    return named(
        arm.axes,
        lambda x: balls(x, x[len(zero) :][:3]) - x[len(zero) + 3 :].reshape(-1, 3)[socket],
        np.concatenate([ball, starts.ravel()]),
    )


def named_in_cell(here: Path) -> Rows:
    """Return what the runs of a cell name."""
    cell = yaml.safe_load((here / "cell.yaml").read_text(encoding="utf-8"))
    arm, base, tool = arm_of(cell["robot"])
    coupling = np.array(cell["robot"].get("coupling", np.eye(6)), dtype=float)
    offsets = np.array([cell["gauges"][name]["offset_mm"] for name in ("g1", "g2")], dtype=float)
    with (here / "runs.csv").open(encoding="utf-8", newline="") as file:
        runs = [read_run(here, line, cell, coupling) for line in csv.DictReader(file)]
    setups = list(dict.fromkeys(run.setup for run in runs))
    starts = [cell["tests"]["hemisphere" if setup == "radial" else "circle"]["centre_mm"] for setup in setups]

    def left(x: Array) -> Array:
        own = changed(arm, x, coupling)
        parts = []
        for run in runs:
            k = 24 + 5 * setups.index(run.setup)
            parts.append(
                (read(own, base, tool, run, offsets, x[k : k + 3]) - x[k + 3 : k + 3 + run.g.shape[1]] - run.g).ravel()
            )
        return np.concatenate(parts)

    return named(6, left, np.concatenate([np.append(place, [0.0, 0.0]) for place in starts]))


def changed(arm: PlainArm, x: Array, coupling: Array | None = None) -> PlainArm:
    """An arm with its constants changed by the first of x, in mm and degrees, zeros through a coupling."""
    change = x[: 4 * arm.axes].reshape(4, -1).copy()
    if coupling is not None:
        change[3] = coupling @ change[3]
    change[[1, 3]] *= 1e3 * np.radians(1)  # to mrad
    return arm.changed(change.ravel())


def named(axes: int, left: Callable[[Array], Array], setup: Array) -> Rows:
    """Constants that are off by residuals (mm) of a vector of constants and set-up, the surest first."""
    count = 4 * axes
    usual = np.repeat([size for *_, size in NAMES], axes)
    found = least_squares(
        lambda x: np.concatenate([left(x).ravel(), x[:count] / (WEAK * usual)]),
        np.concatenate([np.zeros(count), setup]),
        x_scale="jac", loss="soft_l1", f_scale=0.1, max_nfev=30,
    )  # fmt: skip
    variance = float(np.mean(left(found.x) ** 2))
    seen = np.linalg.norm(found.jac, axis=0) > 0  # a hemisphere has one zero of the two
    covariance = variance * np.linalg.inv(found.jac[:, seen].T @ found.jac[:, seen])
    u = np.sqrt(np.diag(covariance))[:count]
    size = found.x[:count]
    off = (np.abs(size) >= UNUSUAL * usual) & (np.abs(size) >= SURE * u)
    rows = []
    for k in sorted(np.flatnonzero(off), key=lambda k: -abs(size[k]) / u[k]):
        part, field, _ = NAMES[k // axes]
        rows.append([part, f"{k % axes + 1}{'.' * bool(field)}{field}", f"{size[k]:.6g}", f"{u[k]:.6g}"])
    return rows


def arm_of(robot: dict[str, Any]) -> tuple[PlainArm, Array, Array]:
    """Arm of a cell, and the frames (4, 4) of base and tool."""

    def of(key: str) -> Array:
        return np.array([axis.get(key, 0.0) for axis in robot["axes"]], dtype=float)

    def frame(pose: dict[str, Any]) -> Array:
        T = np.eye(4)
        T[:3, :3] = Rotation.from_euler("xyz", pose.get("rpy_deg", (0, 0, 0)), degrees=True).as_matrix()
        T[:3, 3] = pose.get("xyz_mm", (0, 0, 0))
        return T

    arm = PlainArm(of("a_mm"), np.radians(of("alpha_deg")), of("d_mm"), np.radians(of("offset_deg")), np.zeros(6),
                   np.zeros((6, 3)))  # fmt: skip
    return arm, frame(robot.get("base", {})), frame(robot.get("tool", {}))


def read_run(here: Path, line: dict[str, str], cell: dict[str, Any], coupling: Array) -> Run:
    columns = read_columns(here / line["file"])
    q = np.radians(np.column_stack([columns[f"q{k}_deg"] for k in range(1, 7)])) @ coupling.T
    g = np.column_stack([columns[name] for name in ("g1_mm", "g2_mm") if name in columns])
    is_circle = line["test"] in ("yaw", "roll")
    chosen = np.linspace(0, len(q) - 1, ROWS).astype(int) if is_circle and len(q) > ROWS else np.arange(len(q))
    radius = float(cell["tests"]["circle" if is_circle else "hemisphere"]["radius_mm"])
    return Run(line["test"], q[chosen], g[chosen], line["test"] if is_circle else "radial", radius)


def read(arm: PlainArm, base: Array, tool: Array, run: Run, offsets: Array, ball: Array) -> Array:
    """Return what the gauges read (m, k) mm, less their zeros."""
    R, p = arm.flange(run.q)
    place = (p + R @ tool[:3, 3]) @ base[:3, :3].T + base[:3, 3]
    turn = base[:3, :3] @ R @ tool[:3, :3]
    way = ball - place
    distance = np.linalg.norm(way, axis=1)
    if run.setup == "radial":
        return np.asarray((distance - run.radius)[:, None])
    line, across = way / distance[:, None], turn[:, :, 1 if run.test == "yaw" else 0]
    to_e, to_z = (line * across).sum(axis=1), (line * turn[:, :, 2]).sum(axis=1)
    return np.asarray(((distance - run.radius)[:, None] - to_e[:, None] * offsets) / to_z[:, None])
