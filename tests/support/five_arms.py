"""Five arms for checking kinematics: the two shipped arms, and a FANUC, an ABB and a KUKA with published parameters.

The parameters are those of M. Brandstötter, A. Angerer and M. Hofbaur, An Analytical Solution of the Inverse Kinematics
Problem of Industrial Serial Manipulators with an Ortho-parallel Basis and a Spherical Wrist (2014), as published for
the solver of py-opw-kinematics and its predecessors:

- FANUC M-16iB/20: ros-industrial/fanuc, fanuc_m16ib_support/config/opw_parameters_m16ib20.yaml (also a test file
of rs-opw-kinematics); its J3 is relative to the horizontal, so axis 3 turns by J2 + J3;
- ABB IRB 2400/10 and KUKA KR 6 R700 sixx: Jmeyer1292/opw_kinematics, opw_parameters_examples.h, and
rs-opw-kinematics, src/parameters_robots.rs.

In this notation joint i turns by sign · u - offset, and the arm is upright at zero.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from py_opw_kinematics import KinematicModel
from py_opw_kinematics import Robot as Peer
from scipy.spatial.transform import RigidTransform

from analysis.robot.kinematics.arm import Arm, arm_of, transform
from rigs.load import load
from rigs.schema.robot import Pose

Array = NDArray[np.float64]

J2_IN_J3 = np.eye(6)
J2_IN_J3[2, 1] = 1.0
HERE = Pose()


@dataclass(frozen=True)
class Opw:
    """Parameters in mm and degrees, and the coupling from the controller's q to the u of the reference solver."""

    a1: float
    a2: float
    b: float
    c1: float
    c2: float
    c3: float
    c4: float
    offsets: tuple[float, ...]
    signs: tuple[int, ...]
    coupling: Array
    base: Pose = HERE
    tool: Pose = HERE

    def arm(self) -> Arm:
        """Arm in modified Denavit-Hartenberg parameters."""
        signs = np.array(self.signs, dtype=float)
        return Arm(
            a=np.array([0, self.a1, self.c2, -self.a2, 0, 0], dtype=float),
            alpha=np.radians([0.0, -90, 0, -90, -90, 90]),
            beta=np.zeros(6),
            d=np.array([self.c1, self.b, 0, self.c3, 0, self.c4], dtype=float),
            offset=np.radians(np.array([0.0, -90, -90, 180, 0, 0]) - self.offsets),
            coupling=signs[:, None] * self.coupling,
            T_world_base=transform(self.base),
            T_flange_tool=transform(self.tool),
            limits=np.radians([[-170.0, 170], [-120, 120], [-150, 150], [-190, 190], [-140, 140], [-270, 270]]),
            speed=np.ones(6),
        )

    def upright(self, angles: Array) -> Array:
        """Joint angles q (n, 6) rad for rotations (n, 6) rad from the upright posture."""
        u = (angles + np.radians(self.offsets)) * self.signs
        return u @ np.linalg.inv(self.coupling).T


@dataclass(frozen=True)
class PeerArm:
    """py-opw-kinematics with the joint angles, base and tool of the arm."""

    opw: Opw

    @property
    def _robot(self) -> Peer:
        o = self.opw
        flips = tuple(sign < 0 for sign in o.signs)
        return Peer(KinematicModel(o.a1, o.a2, o.b, o.c1, o.c2, o.c3, o.c4, o.offsets, flips))  # type: ignore[arg-type]

    def forward(self, q: Array) -> Array:
        """Return T_world_tool (n, 4, 4)."""
        flange = self._robot.batch_forward(self._u(q)).as_matrix()
        return transform(self.opw.base) @ flange @ transform(self.opw.tool)

    def jacobian(self, q: Array) -> Array:
        """Geometric Jacobian (n, 6, 6) of the tool in the world, from the joint frames of the reference
        solver.
        """
        frames = self._robot.batch_joint_poses(self._u(q)).as_matrix().reshape(len(q), 6, 4, 4)
        frames = transform(self.opw.base) @ frames
        tool = (frames[:, 5] @ transform(self.opw.tool))[:, :3, 3]
        about = [2, 1, 1, 2, 1, 2]  # joints 1, 4 and 6 turn about the z axis of their frame; 2, 3 and 5 about y
        axes = np.stack([frames[:, joint, :3, about[joint]] for joint in range(6)], axis=1)
        axes = axes * np.array(self.opw.signs, dtype=float)[:, None]
        linear = np.cross(axes, tool[:, None] - frames[:, :, :3, 3])
        return np.einsum("nik,ij->nkj", np.concatenate([linear, axes], axis=2), self.opw.coupling)

    def inverse(self, poses: Array) -> Array:
        """All branches (n, 8, 6) rad found by the reference solver, nan for missing branches."""
        flange = np.linalg.inv(transform(self.opw.base)) @ poses @ np.linalg.inv(transform(self.opw.tool))
        u = np.radians(self._robot.reach(RigidTransform.from_matrix(flange)).joints)
        return u @ np.linalg.inv(self.opw.coupling).T

    def _u(self, q: Array) -> Array:
        return np.degrees(q @ self.opw.coupling.T)


_PUBLISHED: dict[str, dict[str, Any]] = yaml.safe_load("""
paper-fanuc: {lengths: [254.5, -142.4, 0, 0, 695, 666.3, 0], offsets: [0, 0, -90, 180, 0, 0],
  signs: [1, 1, -1, 1, 1, -1], tool: {xyz_mm: [0, 0, 327.3]}}
FANUC M-16iB/20: {lengths: [150, -100, 0, 525, 770, 740, 100], offsets: [0, 0, -90, 0, 0, 180],
  signs: [1, 1, -1, -1, -1, -1], base: {xyz_mm: [100, -50, 30], rpy_deg: [1, -2, 30]},
  tool: {xyz_mm: [20, -30, 200], rpy_deg: [10, 45, -20]}}
ABB IRB 2400/10: {lengths: [100, -135, 0, 615, 705, 755, 85], offsets: [0, 0, -90, 0, 0, 0], signs: [1, 1, 1, 1, 1, 1],
  tool: {xyz_mm: [0, 0, 150]}}
KUKA KR 6 R700: {lengths: [25, -35, 0, 400, 315, 365, 80], offsets: [0, -90, 0, 0, 0, 0], signs: [-1, 1, 1, -1, 1, -1],
  base: {rpy_deg: [180, 0, 0]}, tool: {xyz_mm: [50, 0, 100], rpy_deg: [0, 90, 0]}}
""")
OPW = {
    name: Opw(
        *of.pop("lengths"),
        tuple(of["offsets"]),
        tuple(of["signs"]),
        J2_IN_J3 if name == "FANUC M-16iB/20" else np.eye(6),
        Pose.model_validate(of.get("base", {})),
        Pose.model_validate(of["tool"]),
    )
    for name, of in _PUBLISHED.items()
}

ARMS: dict[str, Arm] = {
    "paper-fanuc": arm_of(load("paper-fanuc")[0].robot),
    "ur10e": arm_of(load("ur10e-cell")[0].robot),
    **{name: opw.arm() for name, opw in OPW.items() if name != "paper-fanuc"},
}


def calibrated(arm: Arm, seed: int) -> Arm:
    """Arm with random errors of every constant, as after a calibration: 0.5 mm and 0.05° (1 sigma)."""
    rng = np.random.default_rng(seed)
    return replace(
        arm,
        a=arm.a + rng.normal(0, 0.5, 6),
        d=arm.d + rng.normal(0, 0.5, 6),
        alpha=arm.alpha + np.radians(rng.normal(0, 0.05, 6)),
        beta=np.radians(rng.normal(0, 0.05, 6)),
        offset=arm.offset + np.radians(rng.normal(0, 0.05, 6)),
    )


def apart(arm: Arm, q: Array, p: Array) -> Array:
    """Largest difference (…) rad between joint angles q and p (…, 6), ignoring full turns."""
    difference = (q - p) @ arm.coupling.T
    return np.abs(difference - 2 * np.pi * np.rint(difference / (2 * np.pi))).max(axis=-1)


def pose_apart(T: Array, target: Array) -> tuple[float, float]:
    """Largest differences between poses (n, 4, 4): position in mm, rotation in rad as the chord of the
    matrices.
    """
    off = T - target
    return (
        float(np.linalg.norm(off[:, :3, 3], axis=1).max(initial=0.0)),
        float((np.linalg.norm(off[:, :3, :3], axis=(1, 2)) / np.sqrt(2)).max(initial=0.0)),
    )
