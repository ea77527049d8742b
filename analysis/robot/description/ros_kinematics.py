"""Import of a UR's calibration: the differences in calibration.conf, applied to the `robot:` section of the model.

The file contains the maker's measurements of this arm, as differences from the classic Denavit-Hartenberg constants of
the model (metres and radians): T(i-1,i) = RotZ(theta) TransZ(d) TransX(a) RotX(alpha). Axes 2, 3 and 4 are nearly
parallel. Their common normals therefore have offsets of hundreds of metres, which almost cancel. The section is written
with Hayati's beta instead, which describes the same lines in space with plausible lengths.
"""

from __future__ import annotations

import configparser
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.robot.description.axis_lines import AxisLines
from analysis.robot.description.rig_section import (
    TOLERANCE,
    Joint,
    RobotSection,
    checked_section,
    flange_poses,
    largest_difference,
    random_postures,
)
from analysis.robot.kinematics.arm import Array, arm_of, link_frames
from rigs.arms import LibraryArm
from rigs.errors import FileError
from rigs.files import read_text

MAKER = "Universal Robots"
_ROUNDING = 1e-14
"""Rounding error relative to the largest length. Lengths are doubles, rounded about ten times before they cancel."""
_LARGEST = 1e6
"""Largest value in metres or radians. Common normals of nearly parallel axes reach a few hundred."""
_MOST_BYTES = 100_000
"""Largest file size in bytes. A calibration.conf has about 2000 bytes."""
_REMEDY = "give calibration.conf of the controller, unchanged"
ROS_KINEMATICS = "kinematics:"
"""First key of the YAML written by ur_calibration of ROS. It contains the frames of the URDF instead of differences."""
_NOT_CALIBRATED = "0"
"""Value of calibration_status for an arm that was not measured; 1 and 2 mean a measured arm."""
_LARGE_MM = 50.0
"""Displacement beyond any deformation. The file then belongs to a different model."""


@dataclass(frozen=True)
class Differences:
    """Differences from the classic constants: theta, alpha (6,) rad, and a, d (6,) mm."""

    theta: Array
    a: Array
    d: Array
    alpha: Array
    is_calibrated: bool


@dataclass(frozen=True)
class DescribedArm:
    """A calibrated arm. doubts: facts for the user to check.

    moved_mm: largest flange displacement relative to the published arm, over random postures.
    """

    section: RobotSection
    doubts: tuple[str, ...]
    moved_mm: float


def calibrated(arm: LibraryArm, path: Path) -> DescribedArm:
    """Apply the calibration in a file to an arm of the library. Raises FileError."""
    if arm.maker != MAKER:
        raise FileError(arm.name, "has no calibration.conf: only the arms of Universal Robots do", "remove it")
    by, nominal = read_calibration(path), arm_of(arm.robot)
    # The classic constants of a joint are the modified constants of the link before it.
    a, alpha = np.append(nominal.a[1:], 0.0), np.append(nominal.alpha[1:], 0.0)
    classic = _Classic(nominal.offset + by.theta, a + by.a, nominal.d + by.d, alpha + by.alpha)
    # Names, limits and masses are as published. Centres of mass do not move, with all joints at zero.
    links = link_frames(nominal, np.zeros((1, 6)))[0]
    centres = [T[:3, 3] + T[:3, :3] @ np.array(axis.centre_mm) for axis, T in zip(arm.robot.axes, links, strict=True)]
    section = checked_section(
        f"{arm.robot.name}, calibrated",
        classic.axes(),
        [
            Joint(axis.name, axis.limits_deg, axis.speed_deg_s, axis.mass_kg, centre_mm)
            for axis, centre_mm in zip(arm.robot.axes, centres, strict=True)
        ],
        [f"{arm.maker} {arm.model} with its own calibration: {path.name}"],
        lambda q: classic.frames(q)[:, 6],
        path,
        TOLERANCE + _ROUNDING * float(np.abs(by.d).max()),
    )
    q = random_postures(arm.robot)
    moved_mm, _ = largest_difference(flange_poses(section.robot, q), flange_poses(arm.robot, q))
    doubts = [] if by.is_calibrated else ["calibration_status is 0: the arm was not calibrated"]
    if moved_mm > _LARGE_MM:
        doubts.append(f"that is more than {_LARGE_MM:g} mm; check that the file is of this model")
    return DescribedArm(section, tuple(doubts), moved_mm)


def read_calibration(path: Path) -> Differences:
    """Read the differences in a calibration.conf. Raises FileError."""
    parser = configparser.ConfigParser(interpolation=None, inline_comment_prefixes=("#",))
    try:
        text = read_text(path, _MOST_BYTES)
        if text.lstrip().startswith(ROS_KINEMATICS):
            raise FileError(
                str(path), "is a YAML file of the ROS package ur_calibration, with frames of a URDF", _REMEDY
            )
        parser.read_string(text, source=path.name)
    except OSError as error:
        raise FileError(str(path), error.strerror or str(error), _REMEDY) from None
    except configparser.Error as error:
        raise FileError(str(path), error.message.splitlines()[0].rstrip("."), _REMEDY) from None
    if "mounting" not in parser:
        raise FileError(str(path), "has no section [mounting]", _REMEDY)
    section = dict(parser["mounting"])
    deltas = []
    for key in ("delta_theta", "delta_a", "delta_d", "delta_alpha"):
        if key not in section:
            raise FileError(str(path), f"has no {key}", _REMEDY)
        try:
            values = np.array(json.loads(section[key]), dtype=float)
        except (ValueError, TypeError, RecursionError, OverflowError):
            values = np.array([])
        if values.shape != (6,) or not (np.abs(values) < _LARGEST).all():
            raise FileError(str(path), f"{key} is not a list of six numbers", _REMEDY)
        deltas.append(values)
    theta, a, d, alpha = deltas
    is_calibrated = section.get("calibration_status") != _NOT_CALIBRATED
    return Differences(theta, 1000.0 * a, 1000.0 * d, alpha, is_calibrated)


@dataclass(frozen=True)
class _Classic:
    """Classic constants: theta with all joints at zero and alpha (6,) rad, and a, d (6,) mm."""

    theta: Array
    a: Array
    d: Array
    alpha: Array

    def frames(self, q: Array) -> Array:
        """Return the base frame and the frame after each joint, (n, 7, 4, 4) mm, at q (n, 6) rad."""
        frames = [np.broadcast_to(np.eye(4), (len(q), 4, 4))]
        for theta, a, d, alpha in zip((q + self.theta).T, self.a, self.d, self.alpha, strict=True):
            c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
            T = np.zeros((len(q), 4, 4))
            T[:, 0] = np.stack([c, -s * ca, s * sa, a * c], axis=1)
            T[:, 1] = np.stack([s, c * ca, -c * sa, a * s], axis=1)
            T[:, 2] = [0.0, sa, ca, d]
            T[:, 3, 3] = 1.0
            frames.append(frames[-1] @ T)
        return np.stack(frames, axis=1)

    def axes(self) -> AxisLines:
        """Return the joint axes. Each is the z axis of the previous frame."""
        T = self.frames(np.zeros((1, 6)))[0]
        return AxisLines(T[:6, :3, 3], T[:6, :3, 2], T[6])
