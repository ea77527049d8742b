"""Constants of a real UR10e from the factory, as its controller has them.

Facts about one delivered arm, collected from a public repository in November 2026: the six frames that the ROS drivers
of Universal Robots read from the controller (ur_calibration), each relative to the one before at joint angle 0.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from analysis.robot.description.ur_calibration import factory_constants
from rigs.schema.robot import LinkConstants, Robot

FRAMES = {
    "shoulder": (0.0, 0.0, 0.18058554, 0.0, 0.0, 3.14934757e-08),
    "upper_arm": (0.000105985698, 0.0, 0.0, 1.56989097, 0.0, -4.44809222e-06),
    "forearm": (-0.612322657, 0.0, 0.0, 3.14157032, 3.14062144, -3.14159199),
    "wrist_1": (-0.571569716, -0.000608325984, 0.174193422, 0.0034922301, -0.000961540405, -2.62851208e-06),
    "wrist_2": (9.16117351e-06, -0.119867067, -3.3630133e-05, 1.57107689, 0.0, 7.68266982e-07),
    "wrist_3": (-2.33679627e-05, 0.115496058, 9.71472681e-05, 1.57163746, 3.14159265, -3.14159262),
}
"""x, y, z in m, then roll, pitch, yaw in rad."""


def ur_frames() -> NDArray[np.float64]:
    """Frames (6, 4, 4) of the links in mm; each joint turns about z of its frame."""
    T = np.tile(np.eye(4), (6, 1, 1))
    rows = np.array(list(FRAMES.values()))
    T[:, :3, :3] = Rotation.from_euler("xyz", rows[:, 3:]).as_matrix()
    T[:, :3, 3] = 1000 * rows[:, :3]
    return T


def write_ur_calibration(path: Path) -> None:
    keys = ("x", "y", "z", "roll", "pitch", "yaw")
    frames = {link: dict(zip(keys, row, strict=True)) for link, row in FRAMES.items()}
    path.write_text(yaml.safe_dump({"kinematics": {**frames, "hash": "calib_1"}}, sort_keys=False), encoding="utf-8")


def ur_constants(robot: Robot) -> tuple[LinkConstants, ...]:
    """Constants that rig reads from the file of the user."""
    with tempfile.TemporaryDirectory() as directory:
        path = Path(directory) / "my_robot_calibration.yaml"
        write_ur_calibration(path)
        axes = factory_constants(robot, path).axes
    return tuple(LinkConstants(**{key: getattr(axis, key) for key in LinkConstants.model_fields}) for axis in axes)
