"""The `robot:` section of a rig file, created from computed constants, as an object and as text."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import yaml
from pydantic import ValidationError

from analysis.robot.description.axis_lines import AxisLines, DenavitHartenberg, denavit_hartenberg
from analysis.robot.kinematics.arm import RAIL_MM, Array, arm_of, forward, roll_pitch_yaw
from rigs.errors import FileError
from rigs.problems import plain_message
from rigs.schema.robot import Pose, Rail, Robot, identity
from rigs.schema.vocabulary import Build
from rigs.text import escape_text
from rigs.yaml_text import flow

_DECIMALS = 13
"""Decimals of mm and degrees. An error of 1e-13 degrees moves a flange at 3 m by less than 1e-11 mm."""
_CENTRE_DECIMALS = 3
"""Decimals of a centre of mass in mm. No source is accurate to a micrometre."""
TOLERANCE = 1e-9
"""Largest permitted difference between section and source, in mm and rad."""
_POSTURES = 200
"""Number of random postures, which moves each joint through the complete range. The URDF library needs 1 ms for each.
"""
_ZERO = 1e-11
"""Magnitude in mm or degrees of a rounded zero. Doubles of a few metres have a resolution of 1e-12 mm."""


@dataclass(frozen=True)
class Joint:
    """Properties of a joint in a source, except the axis.

    limits_deg: in the direction of the joint. speed_deg_s, mass_kg. centre_mm (3,): centre of mass in the base frame,
    with all joints at zero.
    """

    name: str
    limits_deg: tuple[float, float]
    speed_deg_s: float
    mass_kg: float = 0.0
    centre_mm: Array = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class RobotSection:
    """A robot, and the section as text.

    largest_mm, largest_rad: largest differences from the poses of the source, over random postures.
    """

    robot: Robot
    text: str
    largest_mm: float
    largest_rad: float

    def with_build(self, build: Build) -> RobotSection:
        head = "".join(line for line in self.text.splitlines(keepends=True) if line.startswith("#"))
        robot = self.robot.model_copy(update={"build": build})
        return replace(self, robot=robot, text=head + robot_text(robot))


def robot_of(name: str, constants: DenavitHartenberg, joints: Sequence[Joint], rail: Rail | None = None) -> Robot:
    """Robot from constants and joints. The transformation after the last joint becomes the `tool`."""
    dh, axes = constants, list[dict[str, object]]()
    columns = zip(dh.a, dh.alpha, dh.beta, dh.d, dh.offset, dh.T_base_link, joints, strict=True)
    for a, alpha, beta, d, offset, T, joint in columns:
        centre_mm = (joint.centre_mm - T[:3, 3]) @ T[:3, :3] if joint.mass_kg else np.zeros(3)  # in the link's frame
        axes.append(
            {
                "name": joint.name, "a_mm": _written(a), "alpha_deg": _degrees(alpha), "beta_deg": _degrees(beta),
                "d_mm": _written(d), "offset_deg": _degrees(offset), "limits_deg": joint.limits_deg,
                "speed_deg_s": joint.speed_deg_s, "mass_kg": joint.mass_kg,
                "centre_mm": _vector(centre_mm.round(_CENTRE_DECIMALS)),
            }
        )  # fmt: skip
    coupling = tuple(tuple(float(ratio) for ratio in row) for row in np.diag(dh.senses))
    roll, pitch, yaw = (_degrees(angle) for angle in roll_pitch_yaw(dh.T_last_flange))
    tool = Pose(xyz_mm=_vector(dh.T_last_flange[:3, 3]), rpy_deg=(roll, pitch, yaw))
    base = Pose(xyz_mm=_vector(dh.base_mm))
    return Robot.model_validate(
        {"name": name, "axes": axes, "coupling": coupling, "base": base, "rail": rail, "tool": tool}
    )  # validated as a whole, so that an error names the axis


def robot_text(robot: Robot) -> str:
    fields = robot.model_dump(mode="json", exclude_defaults=True)
    if robot.coupling == identity(len(robot.axes)):
        fields.pop("coupling", None)
    lines = ["robot:", f"  name: {flow(fields.pop('name'))}", "  axes: # modified Denavit-Hartenberg (Craig)"]
    lines += [f"    - {flow(axis)}" for axis in fields.pop("axes")]
    for key, value in fields.items():
        rows = [f"    - {flow(row)}" for row in value] if key in ("coupling", "drives") else []
        lines += [f"  {key}:", *rows] if rows else [f"  {key}: {flow(value)}"]
    return "\n".join(lines) + "\n"


def checked_section(
    name: str,
    axes: AxisLines,
    joints: Sequence[Joint],
    head: Sequence[str],
    source: Callable[[Array], Array],
    path: Path,
    tolerance_mm: float = TOLERANCE,
) -> RobotSection:
    """Build a section, and compare it with the source.

    source: flange poses (n, 4, 4) mm for joint angles q (n, axes) rad, computed independently. Raises FileError, naming
    path, if the section cannot be written or the difference exceeds the tolerance.
    """
    try:
        section = robot_text(robot_of(name, denavit_hartenberg(axes), joints, axes.rail))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        in_axis = first["loc"][0] == "axes" and len(first["loc"]) > 1
        place = f"joint {joints[int(first['loc'][1])].name}" if in_axis else f"the robot {name}"
        quantity = next((step for step in reversed(first["loc"]) if isinstance(step, str)), "")
        remedy = "correct it: the units are metres and radians"
        problem = f"{place}: {quantity} {plain_message(first, Robot)}"
        raise FileError(str(path), problem, remedy, code="urdf.invalid") from None
    text = "".join(f"# {escape_text(line)}\n" for line in head) + section
    robot = parsed(text)
    q = random_postures(robot)
    largest_mm, largest_rad = largest_difference(flange_poses(robot, q), source(q))
    if not (largest_mm <= tolerance_mm and largest_rad <= TOLERANCE):
        apart = f"{largest_mm:.1e} mm and {largest_rad:.1e} rad"
        problem = f"converted to modified Denavit-Hartenberg parameters, the arm differs by {apart}"
        raise FileError(
            str(path),
            problem,
            "no file was written; please report this with the input file",
            code="urdf.invalid",
        )
    return RobotSection(robot, text, largest_mm, largest_rad)


def parsed(text: str) -> Robot:
    return Robot.model_validate(yaml.safe_load(text)["robot"])


def random_postures(robot: Robot) -> Array:
    """The same random joint angles (200, axes) rad at each call, within the limits, with the rail position in m."""
    limits = np.radians([axis.limits_deg for axis in robot.axes])
    if robot.rail:
        limits = np.vstack([limits, np.array(robot.rail.limits_mm) / RAIL_MM])
    low, high = limits.T
    return np.random.default_rng(0).uniform(low, high, (_POSTURES, len(low)))


def flange_poses(robot: Robot, q: Array) -> Array:
    return forward(arm_of(robot), q)


def largest_difference(T: Array, its_T: Array) -> tuple[float, float]:
    # Use the chord of the rotation: the arc cosine of its trace loses all digits near zero.
    chord = np.linalg.norm(T[:, :3, :3] - its_T[:, :3, :3], axis=(1, 2)) / np.sqrt(2)
    return float(np.linalg.norm(T[:, :3, 3] - its_T[:, :3, 3], axis=1).max()), float(chord.max())


def _written(value: float) -> float:
    """Round to 13 decimals; a rounded zero becomes exactly zero."""
    return 0.0 if abs(value) < _ZERO else round(float(value), _DECIMALS)


def _degrees(angle: float) -> float:
    degrees = _written(float(np.degrees(angle)))
    return -degrees if degrees == -180.0 else degrees


def _vector(values: Array) -> tuple[float, float, float]:
    x, y, z = (_written(value) for value in values)
    return x, y, z
