"""Arms for programs: the two shipped arms, a ceiling-mounted KUKA with published parameters, and library arms, each
with a circle it can drive.

The ceiling-mounted arm has the constants of tests/support/five_arms.py (KUKA KR 6 R700), a tilted tool, reversed signs
of three axes and a base upside down, so no frame of a program is the identity.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from analysis.apps.makers.emulated import Array, Flange, ToolPose
from rigs.load import SHIPPED, load, parse
from rigs.rig import Rig
from rigs.schema.robot import Pose as RigPose
from tests.support.shipped_cells import cell_name
from tests.worlds.arms.independent_arm import constants_from, flange, none

ARMS = ("ur10e", "paper-fanuc", "kuka-hanging")
_KUKA = """
name: KUKA KR 6 R700 sixx, hanging
axes:
  - {name: A1, d_mm: 400, limits_deg: [-170, 170], speed_deg_s: 360}
  - {name: A2, a_mm: 25, alpha_deg: -90, limits_deg: [-190, 45], speed_deg_s: 300}
  - {name: A3, a_mm: 315, offset_deg: -90, limits_deg: [-120, 156], speed_deg_s: 360}
  - {name: A4, a_mm: 35, alpha_deg: -90, d_mm: 365, offset_deg: 180, limits_deg: [-185, 185], speed_deg_s: 381}
  - {name: A5, alpha_deg: -90, limits_deg: [-120, 120], speed_deg_s: 388}
  - {name: A6, alpha_deg: 90, d_mm: 80, limits_deg: [-350, 350], speed_deg_s: 615}
coupling:
  - [-1, 0, 0, 0, 0, 0]
  - [0, 1, 0, 0, 0, 0]
  - [0, 0, 1, 0, 0, 0]
  - [0, 0, 0, -1, 0, 0]
  - [0, 0, 0, 0, 1, 0]
  - [0, 0, 0, 0, 0, -1]
base: {xyz_mm: [200, -100, 1500], rpy_deg: [180, 0, 30]}
tool: {xyz_mm: [50, 0, 100], rpy_deg: [0, 90, 10]}
payload_kg: 2
"""
_TESTS = """
circle:
  centre_mm: [478, 211, 1002]
  normal: [-0.186, 0.039, -0.982]
  zero: [-0.462, -0.885, 0.052]
  start_deg: 5
  posture_deg: [20, -110, 120, -10, 75, -180]
hemisphere:
  centre_mm: [448, 13, 1093]
  normal: [0.753, 0.635, -0.171]
  zero: [-0.15, -0.087, -0.985]
  radius_mm: 150
  polar_max_deg: 60
  posture_deg: [0, -80, 100, 0, 60, 0]
repeatability: {targets: [1, 4, 9], rounds: 2}
"""
LIBRARY: dict[str, dict[str, Any]] = yaml.safe_load("""
kuka-kr-10-r1100-2:
  centre_mm: [-561.2, 293.1, 486.5]
  normal: [0.1649, -0.3845, 0.9083]
  zero: [-0.9858, -0.0945, 0.139]
  posture_deg: [20, -111.3, -95.5, 24.1, -48.3, -170]
abb-irb-120:
  centre_mm: [124.1, 29.3, 292]
  normal: [0.3147, 0.266, 0.9112]
  zero: [-0.7906, -0.4578, 0.4067]
  posture_deg: [20, -38.9, 57, -8.2, 94.9, 170]
yaskawa-gp7:
  centre_mm: [615.2, 212.8, 215.3]
  normal: [-0.267, -0.0971, 0.9588]
  zero: [0.8279, 0.4862, 0.2797]
  posture_deg: [20, 23.1, 17.3, 0, -67.7, -170]
fanuc-m-10ia:
  centre_mm: [755.8, 264, 256.3]
  normal: [0.2617, 0.0954, 0.9604]
  zero: [0.8294, 0.4867, -0.2743]
  start_deg: 40
  posture_deg: [20, 10.7, -31, 180, 75.2, -310]
""")
"""Circles found by a search over postures. Axis 6 of each passes 180°, and so does J4 of the FANUC, with a flipped
wrist.
"""


@lru_cache
def rig_of(name: str) -> Rig:
    """Rig of an arm whose controller computes with the data sheet."""
    if name == "kuka-hanging":
        robot, tests = yaml.safe_load(_KUKA), yaml.safe_load(_TESTS)
    elif name in LIBRARY:
        section = yaml.safe_load((SHIPPED / "arms" / f"{name}.yaml").read_text(encoding="utf-8"))["robot"]
        robot = section | {"tool": {"xyz_mm": [0, 0, 100], "rpy_deg": [0, 90, 0]}, "payload_kg": 2}
        tests = {"circle": LIBRARY[name] | {"radius_mm": 60, "speed_mm_s": 20}}
    else:
        rig = load(cell_name(name))[0]
        return rig.model_copy(update={"robot": rig.robot.model_copy(update={"controller": "data_sheet"})})
    rig = yaml.safe_load((SHIPPED / "ur10e-cell.yaml").read_text(encoding="utf-8"))
    return parse(
        yaml.safe_dump(rig | {"name": name, "robot": robot | {"controller": "data_sheet"}, "tests": tests}), name
    )


def flange_of(rig: Rig) -> Flange:
    """Return independent forward kinematics of a rig's flange in the base frame."""
    arm = constants_from(rig.robot.model_dump())

    def at(q: Array) -> tuple[Array, Array]:
        matrices, places = flange(arm, none(), q[None])
        return matrices[0], places[0]

    return at


def pose_of(pose: RigPose) -> ToolPose:
    """Convert a pose of a rig file: rotations about the fixed x, y, z axes."""
    return ToolPose(np.array(pose.xyz_mm), Rotation.from_euler("xyz", pose.rpy_deg, degrees=True))


def reached(rig: Rig, q: Array) -> tuple[Array, Rotation]:
    """Return positions (n, 3) mm and orientations of the tool in the base frame at joint angles q (n, 6) rad."""
    tool, at = pose_of(rig.robot.tool), flange_of(rig)
    matrices, places = zip(*(at(row) for row in q), strict=True)
    turns = Rotation.from_matrix(np.array(matrices))
    return np.array(places) + turns.apply(tool.place), turns * tool.turn
