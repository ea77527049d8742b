"""A URDF as the `robot:` section of a rig file, held against the library that read it before anyone sees it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from analysis.arms.robot_section import flange_poses, largest_difference, parsed, random_postures, robot_of, robot_text
from analysis.arms.six_axes import SixAxes, denavit_hartenberg
from analysis.arms.urdf_chain import Chain, axes_of, chain_of, joints_of, others_of
from analysis.arms.urdf_file import read_urdf, yourdfpy_module
from analysis.kinematics.arm import Array
from rigs.errors import FileError
from rigs.schema.robot import Robot
from rigs.text import plain

TOLERANCE = 1e-9
"""mm and rad that the written section may differ from the URDF."""
_EXACT_RAD, _SLIGHT_RAD = 1e-6, 0.02
"""Axes are parallel or at right angles to a micrometre a metre, or say so where they are nearly so, within a degree."""
_POSTURES = 200
"""Enough to move each joint through its range; the library takes milliseconds for each."""


@dataclass(frozen=True)
class UrdfArm:
    """An arm of a URDF. text: the `robot:` section, with comments; doubts: what a person should look at.

    largest_mm, largest_rad: between the section as written and the URDF, on random postures.
    """

    robot: Robot
    text: str
    base: str
    tip: str
    doubts: tuple[str, ...]
    largest_mm: float
    largest_rad: float


def import_urdf(path: Path, base: str | None = None, tip: str | None = None) -> UrdfArm:
    """Return the arm between two links of a URDF. Raises FileError, with the remedy, for what is no six-axis arm."""
    urdf = read_urdf(path)
    chain = chain_of(urdf, base, tip, str(path))
    axes = axes_of(chain)
    text = _section(urdf, chain, axes, path)
    robot = parsed(text)
    largest_mm, largest_rad = _checked(robot, urdf, chain, path)
    doubts = [*_slightly_off(axes, chain), *_left_out(others_of(urdf, chain))]
    return UrdfArm(robot, text, chain.base, chain.tip, tuple(doubts), largest_mm, largest_rad)


def _section(urdf: Any, chain: Chain, axes: SixAxes, path: Path) -> str:
    try:
        section = robot_text(robot_of(urdf.name, denavit_hartenberg(axes), joints_of(urdf, chain)))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(map(str, first["loc"]))
        raise FileError(str(path), f"{place}: {first['msg']}", "correct it: URDF is in metres and radians") from None
    head = (
        f"# From {path.name}: {chain.base} to {chain.tip}. Joints count as in the URDF, which may not be as the",
        "# controller counts: compare zeros, signs, and J3 of a FANUC, and correct offset_deg and coupling.",
    )
    return "\n".join([*map(plain, head), section])


def _checked(robot: Robot, urdf: Any, chain: Chain, path: Path) -> tuple[float, float]:
    """Largest differences (mm, rad) between the section and the library's forward kinematics. Raises FileError."""
    q = random_postures(np.array([axis.limits_deg for axis in robot.axes]), _POSTURES)
    largest_mm, largest_rad = largest_difference(flange_poses(robot, q), library_poses(urdf, chain, q))
    if not (largest_mm <= TOLERANCE and largest_rad <= TOLERANCE):
        what = f"as modified Denavit-Hartenberg it differs by {largest_mm:.1e} mm and {largest_rad:.1e} rad"
        raise FileError(str(path), what, "nothing is written; send us this file, please")
    return largest_mm, largest_rad


def library_poses(urdf: Any, chain: Chain, q: Array) -> Array:
    """Return the poses (n, 4, 4) mm of the tip in the base frame as yourdfpy computes them; q (n, 6) rad."""
    yourdfpy = yourdfpy_module()
    joints = [*chain.up, *chain.down]
    ends = {name for joint in joints for name in (joint.parent, joint.child)}
    links = [link for link in urdf.links if link.name in ends]
    model = yourdfpy.URDF(robot=yourdfpy.Robot(urdf.name, links, joints), load_meshes=False)
    names = [joint.name for joint in chain.moving]
    poses = []
    for angles in q.tolist():
        model.update_cfg(dict(zip(names, angles, strict=True)))
        poses.append(model.get_transform(chain.tip, chain.base))
    T = np.array(poses, dtype=float)
    T[:, :3, 3] *= 1000.0
    return T


def _slightly_off(axes: SixAxes, chain: Chain) -> list[str]:
    """What to say of successive axes that are nearly, and not quite, parallel or at right angles."""
    said = []
    for one, joint, following in zip(range(5), chain.moving[:5], chain.moving[1:], strict=True):
        z, z_next = axes.directions[one], axes.directions[one + 1]
        sine, cosine = float(np.linalg.norm(np.cross(z, z_next))), abs(float(z @ z_next))
        off = min(sine, cosine)
        if _EXACT_RAD < off < _SLIGHT_RAD:
            how = "parallel" if sine < cosine else "at right angles"
            said.append(
                f"the axes of {joint.name} and {following.name} are {np.degrees(off):.4f} degrees from {how}, and are "
                "kept so; if the URDF was rounded (1.571 for 1.5707963267948966), correct it there"
            )
    return said


def _left_out(names: Sequence[str]) -> list[str]:
    if not names:
        return []
    return [f"{len(names)} further moving joints are left out, with the masses on them: {', '.join(names)}"]
