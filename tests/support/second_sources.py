"""Independent published data of the library arms, evaluated in their own notation.

The numbers are in second_sources.yaml. Only `differences` uses the library.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from analysis.robot.kinematics.arm import arm_of, forward
from rigs.schema.robot import Robot

Array = NDArray[np.float64]
Numbers = tuple[float, ...]
Source = Callable[[Array], Array]
"""Function from joint angles (n, axes) rad of the controller to poses (n, 4, 4) of the flange in the base frame, in
mm.
"""

O = (0.0, 0.0, 0.0)  # noqa: E741 - origin


def _frame(xyz: Sequence[float], rpy: Sequence[float]) -> Array:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
    T[:3, 3] = np.multiply(1000.0, xyz)
    return T


@dataclass(frozen=True)
class Chain:
    """Joints of a URDF: xyz (m), rpy (rad) and axis of each. tool: xyz and rpy. base_m: height of the library's base
    above the first link. j3_counts_j2: the third joint of the URDF is J2 + J3 of the controller.
    """

    joints: tuple[tuple[Numbers, Numbers, Numbers], ...]
    tool: tuple[Numbers, Numbers] = (O, O)
    base_m: float = 0.0
    j3_counts_j2: bool = False

    def __call__(self, q: Array) -> Array:
        turns = q.copy()
        if self.j3_counts_j2:
            turns[:, 2] += turns[:, 1]
        T = np.broadcast_to(_frame((0, 0, -self.base_m), O), (len(q), 4, 4))
        for (xyz, rpy, axis), turn in zip(self.joints, turns.T, strict=True):
            R = np.broadcast_to(np.eye(4), (len(q), 4, 4)).copy()
            R[:, :3, :3] = Rotation.from_rotvec(np.outer(turn, axis)).as_matrix()
            T = T @ _frame(xyz, rpy) @ R
        return T @ _frame(*self.tool)

    def urdf(self, limit: str = '<limit lower="-3" upper="2.5" velocity="3.5" effort="0"/>') -> str:
        """Chain as a URDF file, from the link `base_link` to `tool0`."""
        links = ["base_link", *(f"link_{one}" for one in range(1, len(self.joints) + 1)), "tool0"]
        parts = [f'<link name="{name}"/>' for name in links]
        for one, (xyz, rpy, axis) in enumerate(self.joints):
            parts.append(
                f'<joint name="joint_{one + 1}" type="revolute"><parent link="{links[one]}"/>'
                f'<child link="{links[one + 1]}"/>{_origin(xyz, rpy)}<axis xyz="{_words(axis)}"/>{limit}</joint>'
            )
        ends = f'<parent link="link_{len(self.joints)}"/><child link="tool0"/>'
        parts.append(f'<joint name="flange" type="fixed">{ends}{_origin(*self.tool)}</joint>')
        return '<?xml version="1.0"?>\n<robot name="chain">' + "\n".join(parts) + "</robot>\n"


def _words(numbers: Sequence[float]) -> str:
    return " ".join(repr(float(one)) for one in numbers)


def _origin(xyz: Sequence[float], rpy: Sequence[float]) -> str:
    return f'<origin xyz="{_words(xyz)}" rpy="{_words(rpy)}"/>'


def catalogue(rows: Sequence[Numbers], senses: Numbers = (), j3_counts_j2: bool = False) -> Source:
    """Source for rows of alpha (degrees), a, d (mm), theta (degrees). A third joint relative to J2 is
    converted.
    """

    def poses(q: Array) -> Array:
        turns = q * (senses or (1,) * q.shape[1])
        if j3_counts_j2:
            turns[:, 2] -= senses[1] * q[:, 1]
        T = np.broadcast_to(np.eye(4), (len(q), 4, 4))
        for (alpha, a, d, theta), turn in zip(rows, turns.T, strict=True):
            T = T @ _turns("x", np.radians(alpha)) @ _frame((a / 1000, 0, 0), O)
            T = T @ _turns("z", turn + np.radians(theta)) @ _frame((0, 0, d / 1000), O)
        return T

    return poses


def classic(rows: Sequence[Numbers], j3_counts_j2: bool = False, fixed: bool = False) -> Source:
    """Source for rows of theta (degrees), d, a (mm), alpha (degrees): RotZ TransZ TransX RotX.

    fixed: no joint turns the first row.
    """

    def poses(q: Array) -> Array:
        turns = np.insert(q, 0, 0.0, axis=1) if fixed else q.copy()
        if j3_counts_j2:
            turns[:, 2] += turns[:, 1]
        T = np.broadcast_to(np.eye(4), (len(q), 4, 4))
        for (theta, d, a, alpha), turn in zip(rows, turns.T, strict=True):
            T = T @ _turns("z", turn + np.radians(theta)) @ _frame((a / 1000, 0, d / 1000), O)
            T = T @ _turns("x", np.radians(alpha))
        return T

    return poses


def _turns(axis: str, angle: Array | float) -> Array:
    """Return rotations (n, 4, 4) about an axis."""
    angles = np.atleast_1d(np.asarray(angle, dtype=float))
    T = np.broadcast_to(np.eye(4), (len(angles), 4, 4)).copy()
    T[:, :3, :3] = Rotation.from_euler(axis, angles[:, None]).as_matrix()
    return T


def quaternions(bodies: Sequence[tuple[Numbers, Numbers]]) -> Source:
    """Source for MuJoCo bodies with position (m) and quaternion (w, x, y, z), whose joints turn about z."""

    def poses(q: Array) -> Array:
        T = np.broadcast_to(np.eye(4), (len(q), 4, 4))
        for (xyz, (w, *vector)), turn in zip(bodies, q.T, strict=True):
            body = _frame(xyz, O)
            body[:3, :3] = Rotation.from_quat([*vector, w]).as_matrix()
            T = T @ body @ _turns("z", turn)
        return T

    return poses


def screws(rows: Sequence[Numbers], home: Numbers) -> Source:
    """Source for screw axes (rotation, then moment, m) in the base and the home position (m) of the tool.

    The tool is rotated so that its z axis points along the x axis of the base (K. M. Lynch, F. C. Park, Modern
    Robotics, 2017).
    """

    def poses(q: Array) -> Array:
        T = np.broadcast_to(np.eye(4), (len(q), 4, 4))
        for (*turn, mx, my, mz), angle in zip(rows, q.T, strict=True):
            axis = np.array(turn)
            point = 1000 * np.cross(axis, (mx, my, mz))
            step = np.broadcast_to(np.eye(4), (len(q), 4, 4)).copy()
            step[:, :3, :3] = Rotation.from_rotvec(np.outer(angle, axis)).as_matrix()
            step[:, :3, 3] = point - step[:, :3, :3] @ point
            T = T @ step
        return T @ _frame(home, (0, pi / 2, 0))

    return poses


def _source(notation: str, rows: list[Any], **more: Any) -> Source:
    if notation == "chain":
        joints = tuple((tuple(xyz), tuple(rpy), tuple(axis)) for xyz, rpy, axis in rows)
        return Chain(joints, **more)
    made: dict[str, Callable[..., Source]] = {
        "catalogue": catalogue, "classic": classic, "quaternions": quaternions, "screws": screws,
    }  # fmt: skip
    return made[notation](rows, **more)


SOURCES: dict[str, dict[str, Source]] = {
    arm: {kind: _source(**fields) for kind, fields in sources.items()}
    for arm, sources in yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8")).items()
}
"""Sources of the constants of each arm: by arm, then by the kind of numbers, as in the key `sources` of an arm."""


def differences(robot: Robot, source: Source, number: int) -> tuple[float, float]:
    """Largest flange differences between a robot and a source, in mm and rad, on random postures within
    the limits.
    """
    low, high = np.radians([axis.limits_deg for axis in robot.axes]).T
    q = np.random.default_rng(16).uniform(low, high, (number, len(low)))
    ours, theirs = forward(arm_of(robot), q), source(q)
    turned = Rotation.from_matrix(ours[:, :3, :3].transpose(0, 2, 1) @ theirs[:, :3, :3]).magnitude()
    return float(np.linalg.norm((ours - theirs)[:, :3, 3], axis=1).max()), float(turned.max())
