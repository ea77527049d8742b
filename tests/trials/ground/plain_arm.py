"""The nominal arm of a task as its page tells it, and where a tracker's target stands: nothing here is of the product.

Any number of revolute axes, modified Denavit-Hartenberg. An entrant may use this file, or write its own from the page.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from tests.worlds.chain import gravity_torques, link_frames

Array = NDArray[np.float64]
XYZ = ("x_mm", "y_mm", "z_mm")


@dataclass(frozen=True)
class PlainArm:
    """Constants of n axes, each (n,): a and d in mm, alpha and offset in rad, mass in kg; centre (n, 3) mm."""

    a: Array
    alpha: Array
    d: Array
    offset: Array
    mass: Array
    centre: Array

    @property
    def axes(self) -> int:
        return len(self.a)

    def changed(self, change: Array) -> PlainArm:
        """Arm with a, alpha, d and offset changed by (4 n,), in mm and mrad."""
        a, alpha, d, offset = change.reshape(4, -1)
        return replace(
            self, a=self.a + a, alpha=self.alpha + alpha / 1e3, d=self.d + d, offset=self.offset + offset / 1e3
        )

    def flange(self, q: Array) -> tuple[Array, Array]:
        """Rotation (m, 3, 3) and place (m, 3) mm of the flange at joint angles q (m, n) rad."""
        R, p = self.frames(q)
        return R[:, -1], p[:, -1]

    def frames(self, q: Array) -> tuple[Array, Array]:
        """Rotation (m, n, 3, 3) and place (m, n, 3) mm of the frame of each axis at joint angles q (m, n) rad."""
        return link_frames(self.a, self.alpha, 0.0, self.d, q + self.offset)

    def torques(self, q: Array) -> Array:
        """Torque (m, n) Nm of gravity about each axis of an upright arm at joint angles q (m, n) rad."""
        return gravity_torques(*self.frames(q), self.mass, self.centre)


COLUMNS = (
    "axis", "a_mm", "alpha_deg", "d_mm", "offset_deg", "mass_kg", "centre_x_mm", "centre_y_mm", "centre_z_mm",
)  # fmt: skip


def write_arm(path: Path, arm: PlainArm) -> None:
    angles = np.degrees([arm.alpha, arm.offset])
    rows = np.column_stack([
        np.arange(arm.axes) + 1, arm.a, angles[0], arm.d, angles[1], arm.mass, arm.centre
    ])  # fmt: skip
    write_rows(path, COLUMNS, [[f"{value:.9g}" for value in row] for row in rows])


def read_arm(path: Path) -> PlainArm:
    columns = read_columns(path)
    centre = np.column_stack([columns[f"centre_{axis}_mm"] for axis in "xyz"])
    alpha, offset = np.radians(columns["alpha_deg"]), np.radians(columns["offset_deg"])
    return PlainArm(columns["a_mm"], alpha, columns["d_mm"], offset, columns["mass_kg"], centre)


@dataclass(frozen=True)
class Poses:
    """Postures q (m, n) rad with their placement (m,); xyz_mm (m, 3) as measured, nan where this is asked."""

    q: Array
    xyz_mm: Array
    placement: NDArray[np.str_]

    def of(self, chosen: NDArray[np.bool_]) -> Poses:
        """Return those of a mask (m,)."""
        return Poses(*(getattr(self, one.name)[chosen] for one in fields(self)))


def joints(count: int) -> list[str]:
    """Names of the columns of joint angles."""
    return [f"q{k}_deg" for k in range(1, count + 1)]


def write_poses(path: Path, poses: Poses, *, asked: bool) -> None:
    """Write train.csv, or test.csv without the positions."""
    names = ["pose", "placement", *joints(poses.q.shape[1]), *(() if asked else XYZ)]
    rows = []
    for k, (q, xyz) in enumerate(zip(np.degrees(poses.q), poses.xyz_mm, strict=True), start=1):
        places = [] if asked else [f"{value:.5f}" for value in xyz]
        rows.append([str(k), poses.placement[k - 1], *(f"{value:.6f}" for value in q), *places])
    write_rows(path, names, rows)


def read_poses(path: Path) -> Poses:
    """Read train.csv or test.csv."""
    columns = read_columns(path)
    count = sum(name.startswith("q") for name in columns)
    q = np.radians(np.column_stack([columns[name] for name in joints(count)]))
    places = [columns.get(name, np.full(len(q), np.nan)) for name in XYZ]
    return Poses(q, np.column_stack(places), columns["placement"])


def read_columns(path: Path) -> dict[str, NDArray[np.generic]]:
    """Read a CSV file as columns, numeric if all values are numbers."""
    with path.open(encoding="utf-8", newline="") as file:
        lines = list(csv.reader(file))
    names, rows = lines[0], [line for line in lines[1:] if line]
    found: dict[str, NDArray[np.generic]] = {}
    for k, name in enumerate(names):
        text = np.array([row[k] for row in rows])
        try:
            found[name] = text.astype(float) if rows else np.zeros(0)
        except ValueError:
            found[name] = text
    return found


def write_rows(path: Path, names: list[str] | tuple[str, ...], rows: list[list[str]]) -> None:
    """Write a CSV file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows(rows)


def write_answer(path: Path, places: Array, u: Array) -> None:
    """Write the answer to a task: places (m, 3) mm and u (m,) mm, nan where a program states none."""
    rows = [
        [str(k), *(f"{value:.5f}" for value in place), "" if np.isnan(own) else f"{own:.5f}"]
        for k, (place, own) in enumerate(zip(places, u, strict=True), start=1)
    ]
    write_rows(path, ("pose", *XYZ, "u_mm"), rows)


@dataclass(frozen=True)
class Frame:
    """Where an instrument sees the base (turn as a rotation vector in mrad, place in mm) and where its target sits on
    the flange (mm), in one vector (9,)."""

    values: Array

    def places(self, arm: PlainArm, q: Array) -> Array:
        """Return where the instrument sees the target (m, 3) mm at joint angles q (m, n) rad."""
        return self.seen(*arm.flange(q))

    def seen(self, R: Array, p: Array) -> Array:
        """Return where the instrument sees the target (m, 3) mm of flanges turned by R (m, 3, 3) at p (m, 3) mm."""
        turn = Rotation.from_rotvec(self.values[:3] / 1e3).as_matrix()
        return np.asarray((p + R @ self.values[6:]) @ turn.T + self.values[3:6])


def framed(arm: PlainArm, poses: Poses) -> Frame:
    """Fit frame and target of one placement to an arm as it is."""
    return framed_at(*arm.flange(poses.q), poses.xyz_mm)


def framed_at(R: Array, p: Array, seen: Array) -> Frame:
    """Fit frame and target to flanges turned by R (m, 3, 3) at p (m, 3) mm, whose targets were seen at (m, 3) mm."""
    turn, _ = Rotation.align_vectors(seen - seen.mean(axis=0), p - p.mean(axis=0))
    start = np.concatenate([1e3 * turn.as_rotvec(), seen.mean(axis=0) - turn.apply(p.mean(axis=0)), np.zeros(3)])

    def left(x: Array) -> Array:
        return (Frame(x).seen(R, p) - seen).ravel()

    return Frame(least_squares(left, start, x_scale="jac", xtol=1e-14, ftol=1e-14).x)
