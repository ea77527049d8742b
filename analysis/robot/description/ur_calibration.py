"""Factory constants of one Universal Robots arm, from its controller or from the ROS driver, as the axes of a robot.

calibration.conf holds differences from the classic Denavit-Hartenberg constants of the model (metres and radians):
T(i-1,i) = RotZ(theta) TransZ(d) TransX(a) RotX(alpha). Axes 2, 3 and 4 are nearly parallel, so their common normals
have offsets of hundreds of metres, which almost cancel. The YAML of the ROS package ur_calibration (usually
my_robot_calibration.yaml) holds six frames instead, each relative to the one before. Both are written with Hayati's
beta, which describes the same lines in space with plausible lengths.
"""

from __future__ import annotations

import configparser
import json
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from analysis.robot.description.axis_lines import AxisLines
from analysis.robot.description.rig_section import (
    TOLERANCE,
    Joint,
    checked_section,
    flange_poses,
    largest_difference,
    random_postures,
)
from analysis.robot.kinematics.arm import Array, arm_of, link_frames, transforms
from rigs.arms import arm_names, load_arm
from rigs.errors import FileError
from rigs.files import read_text
from rigs.schema.part import MM_PER_M, Part
from rigs.schema.robot import JointAxis, Pose, Robot
from rigs.yaml_text import read_yaml

MAKER = "Universal Robots"
_ROUNDING = 1e-14
"""Rounding error relative to the largest length. Lengths are doubles, rounded about ten times before they cancel."""
_LARGEST = 1e6
"""Largest value in metres or radians. Common normals of nearly parallel axes reach a few hundred."""
_MOST_BYTES = 100_000
"""Largest file size in bytes. A calibration.conf has about 2000 bytes."""
_REMEDY = "give calibration.conf of the controller, or the YAML of ur_calibration, unchanged"
ROS_KINEMATICS = "kinematics:"
"""First key of the YAML written by ur_calibration of ROS."""
_NOT_CALIBRATED = "0"
"""Value of calibration_status for an arm that was not measured; 1 and 2 mean a measured arm."""
_SAME_MODEL_MM = 5.0
"""Largest difference of a link length between two arms of a model: 1.05 mm among the ten of docs/controller.md, so five
times that. The wrists of a UR3 and a UR3e differ by 10 and 19 mm.
"""
_MOST_MOVED_MM = 12.0
"""Largest displacement of the flange by own constants: 5 mm among the ten arms. The differences of a UR5 moved the
flange of a UR16e by 13 mm.
"""
_DATA_SHEET_MM = 1e-3
"""Displacement of the flange below which constants are those of the data sheet, rounded: the driver's defaults."""


NOT_THE_CONTROLLERS = "rig_not_of_the_controller"
"""Hash in the YAML that `rig export-urdf` writes. The driver compares it with the checksum of the controller's
calibration and correctly reports a difference at each start."""


class _Frame(Part):
    """A frame of the ROS YAML relative to the one before, in m and rad."""

    x: float
    y: float
    z: float
    roll: float
    pitch: float
    yaw: float


class _Frames(Part):
    """Frames of the ROS YAML. hash: checksum with which the driver recognises the robot."""

    shoulder: _Frame
    upper_arm: _Frame
    forearm: _Frame
    wrist_1: _Frame
    wrist_2: _Frame
    wrist_3: _Frame
    hash: str


@dataclass(frozen=True)
class FactoryConstants:
    """Axes of an arm with the constants of its controller.

    moved_mm: largest displacement of the flange from the data sheet, over random postures. notes: facts for the user.
    """

    axes: tuple[JointAxis, ...]
    moved_mm: float
    notes: tuple[str, ...]
    serial: str = ""
    """Checksum in the YAML by which the driver recognises the robot."""

    @property
    def is_data_sheet(self) -> bool:
        """True if the robot was not measured."""
        return self.moved_mm < _DATA_SHEET_MM


def factory_constants(robot: Robot, path: Path) -> FactoryConstants:
    """Read the constants of one robot of this model. Names, limits, masses, base and tool are kept. Raises FileError.

    robot: the arm of the data sheet, from the library or a rig file.
    """
    if not robot.name.startswith(MAKER):
        raise FileError(
            str(path),
            f"is of {MAKER}, but the arm is {robot.name}",
            "give the arm that the file is of",
            code="robot.other",
        )
    arm = arm_of(robot)
    axes, source, tolerance_mm, notes = _lines(path, robot)
    # Centres of mass do not move, with all joints at zero.
    links = np.linalg.inv(arm.T_world_base) @ link_frames(arm, np.zeros((1, 6)))[0]
    centres = [T[:3, 3] + T[:3, :3] @ np.array(axis.centre_mm) for axis, T in zip(robot.axes, links, strict=True)]
    section = checked_section(
        robot.name,
        axes,
        [
            Joint(axis.name, axis.limits_deg, axis.speed_deg_s, axis.mass_kg, centre_mm)
            for axis, centre_mm in zip(robot.axes, centres, strict=True)
        ],
        [f"{robot.name} with the constants of its controller: {path.name}"],
        source,
        path,
        tolerance_mm,
    )
    _require_same_model(section.robot, robot, path, names_type=_CONF.search(read_text(path, _MOST_BYTES)) is None)
    bare = robot.model_copy(update={"base": Pose(), "tool": Pose()})
    q = random_postures(robot)
    moved_mm, _ = largest_difference(flange_poses(section.robot, q), flange_poses(bare, q))
    turned = _turned_zeros(section.robot, robot)
    if moved_mm > _MOST_MOVED_MM and not turned:
        problem = f"moves the flange by {moved_mm:.0f} mm: it is of another type of arm, or damaged"
        raise FileError(
            str(path),
            problem,
            f"give the file of this {robot.name}, or the arm that the file is of",
            code="robot.other",
        )
    hashed = re.search(r"^\s*hash\s*:\s*(\S{1,100})\s*$", read_text(path, _MOST_BYTES), re.MULTILINE)
    serial = hashed[1] if hashed else ""
    return FactoryConstants(section.robot.axes, moved_mm, (*notes, *turned), serial)


def is_ur_calibration(text: str) -> bool:
    return bool(_UR_FORMS.search(text))


_UR_FORMS = re.compile(r"^\s*(\[\w+\]|kinematics\s*:|delta_\w+\s*=|(shoulder|upper_arm|hash)\s*:)", re.MULTILINE)
_CONF = re.compile(r"^\s*(\[\w+\]|delta_\w+\s*=)", re.MULTILINE)


def _lines(path: Path, robot: Robot) -> tuple[AxisLines, Callable[[Array], Array], float, tuple[str, ...]]:
    """Joint axes in a file, the flange poses that it states (for a check), their rounding, and notes."""
    try:
        text = read_text(path, _MOST_BYTES)
    except OSError as error:
        raise FileError(str(path), error.strerror or str(error), _REMEDY, code="controller.invalid") from None
    tolerance_mm, notes = TOLERANCE, tuple[str, ...]()
    if _CONF.search(text) is None:
        links = _ros_links(_frames(text, str(path)))
    else:
        (theta, by_a, d, by_alpha), is_calibrated = _differences(text, path)
        nominal = arm_of(robot)
        # The classic constants of a joint are the modified constants of the link before it.
        a, alpha = np.append(nominal.a[1:], 0.0), np.append(nominal.alpha[1:], 0.0)
        links = _classic_links(nominal.offset + theta, a + by_a, nominal.d + d, alpha + by_alpha)
        notes = () if is_calibrated else ("calibration_status is 0: the arm was not calibrated",)
        tolerance_mm += _ROUNDING * float(np.abs(d).max())
    T = _frames_along(links, np.zeros((1, 6)))[0]
    lines = AxisLines(T[:6, :3, 3], T[:6, :3, 2], T[6])
    return lines, lambda q: _frames_along(links, q)[:, 6], tolerance_mm, notes


def _frames_along(links: Array, q: Array) -> Array:
    """Frames (n, 7, 4, 4) in mm of the six joints before they turn, and of the flange.

    links (7, 4, 4): each frame in the one before, with all joints at zero.
    """
    frames = [np.broadcast_to(links[0], (len(q), 4, 4))]
    for link, angle in zip(links[1:], q.T, strict=True):
        turns = np.zeros((len(q), 6))
        turns[:, 5] = np.degrees(angle)
        frames.append(frames[-1] @ transforms(turns) @ link)
    return np.stack(frames, axis=1)


def _turned_zeros(own: Robot, robot: Robot) -> list[str]:
    """A note on each link that lies on the other side of its joint than in the data sheet."""
    return [
        f"the file counts the joint before {robot.axis_words(axis)} from half a turn; check that it was not edited"
        for axis, (x, y) in enumerate(zip(own.axes, robot.axes, strict=True), 1)
        if x.a_mm * y.a_mm < -(_SAME_MODEL_MM**2)
    ]


def _require_same_model(own: Robot, robot: Robot, path: Path, *, names_type: bool) -> None:
    """Raise FileError if the link lengths are those of another type of arm.

    names_type: the lengths are complete, and not differences from a model, so they tell which type it is.
    """

    def difference_mm(other: Robot) -> float:
        axes = zip(own.axes, other.axes, strict=True)
        return max(max(abs(abs(x.a_mm) - abs(y.a_mm)), abs(abs(x.d_mm) - abs(y.d_mm))) for x, y in axes)

    if (apart_mm := difference_mm(robot)) <= _SAME_MODEL_MM:
        return
    if not names_type:
        problem = f"is of another type of arm, or damaged: a length differs from {robot.name} by {apart_mm:.1f} mm"
        raise FileError(
            str(path), problem, "give the file of this arm, or the arm that the file is of", code="robot.other"
        )
    arms = [arm for arm in map(load_arm, arm_names()) if arm.maker == MAKER and len(arm.robot.axes) == len(robot.axes)]
    nearest = min(arms, key=lambda arm: difference_mm(arm.robot))
    fits = difference_mm(nearest.robot) <= _SAME_MODEL_MM
    of = f"fits {nearest.name}" if fits else "fits no arm of the library"
    problem = f"is of another type of arm: a length differs from {robot.name} by {apart_mm:.1f} mm; it {of}"
    raise FileError(str(path), problem, "give the arm that the file is of, or the file of this arm", code="robot.other")


# The YAML of the ROS package ur_calibration.


def _frames(text: str, where: str) -> _Frames:
    _, data = read_yaml(text, where)
    kinematics = data.get("kinematics") if isinstance(data, dict) else None
    if not isinstance(kinematics, dict):
        raise FileError(where, "has no key kinematics", _REMEDY, code="controller.invalid")
    if kinematics.get("hash") == NOT_THE_CONTROLLERS:
        raise FileError(
            where,
            "was written by rig export-urdf: it is the measured arm",
            "give the controller's own file",
            code="controller.invalid",
        )
    if "hash" not in kinematics:
        raise FileError(
            where, "has no kinematics.hash: it was cut off or edited by hand", _REMEDY, code="controller.invalid"
        )
    try:
        return _Frames.model_validate(kinematics)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        place = ".".join(map(str, ("kinematics", *first["loc"])))
        missing = "is missing: the file was cut off" if first["type"] == "missing" else "is not a number"
        raise FileError(where, f"{place} {missing}", _REMEDY, code="controller.invalid") from None


def _ros_links(frames: _Frames) -> Array:
    rows = [getattr(frames, name) for name in _Frames.model_fields if name != "hash"]
    places = np.array([[MM_PER_M * row.x, MM_PER_M * row.y, MM_PER_M * row.z] for row in rows])
    angles = np.degrees([[row.roll, row.pitch, row.yaw] for row in rows])
    return np.concatenate([transforms(np.hstack([places, angles])), np.eye(4)[None]])


# The file calibration.conf of the controller.


def _differences(text: str, path: Path) -> tuple[list[Array], bool]:
    """Differences (6,) of theta in rad, a and d in mm, and alpha in rad, and whether the arm was calibrated."""
    parser = configparser.ConfigParser(interpolation=None, inline_comment_prefixes=("#",))
    try:
        parser.read_string(text, source=path.name)
    except configparser.Error as error:
        raise FileError(
            str(path), error.message.splitlines()[0].rstrip("."), _REMEDY, code="controller.invalid"
        ) from None
    if "mounting" not in parser:
        raise FileError(str(path), "has no section [mounting]", _REMEDY, code="controller.invalid")
    section = dict(parser["mounting"])
    deltas = []
    for key in ("delta_theta", "delta_a", "delta_d", "delta_alpha"):
        if key not in section:
            raise FileError(str(path), f"has no {key}", _REMEDY, code="controller.invalid")
        try:
            values = np.array(json.loads(section[key]), dtype=float)
        except (ValueError, TypeError, RecursionError, OverflowError):
            values = np.array([])
        if values.shape != (6,) or not (np.abs(values) < _LARGEST).all():
            raise FileError(str(path), f"{key} is not a list of six numbers", _REMEDY, code="controller.invalid")
        deltas.append(values * (MM_PER_M if key in ("delta_a", "delta_d") else 1.0))
    return deltas, section.get("calibration_status") != _NOT_CALIBRATED


def _classic_links(theta: Array, a: Array, d: Array, alpha: Array) -> Array:
    c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    none, one = np.zeros(6), np.ones(6)
    rows = [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [none, sa, ca, d], [none, none, none, one]]
    return np.concatenate([np.eye(4)[None], np.moveaxis(np.array(rows), 2, 0)])
