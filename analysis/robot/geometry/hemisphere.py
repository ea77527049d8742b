"""Hemisphere of the radial and repeatability tests: frame, targets and tool poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.robot.kinematics.arm import Array, Integers
from rigs.schema.declared_tests import Hemisphere

_TILT_RAD = np.radians(20.0)
"""Angle between neighbouring orientations at a target, within the range of the ball's socket."""
_LEAN = 0.5
"""Tilt of the tool from the axis of the hemisphere, relative to the tilt that points at the ball. Half of it is
within the reach of most arms; pointing at the ball is not.
"""


@dataclass(frozen=True)
class HemisphereFrame:
    """centre (3,) mm; u, v, n (3,) unit vectors, n to the middle of the hemisphere, azimuth from u to v; radius mm."""

    centre: Array
    u: Array
    v: Array
    n: Array
    radius: float

    def direction(self, polar: Array, azimuth: Array) -> Array:
        around = np.cos(azimuth)[:, None] * self.u + np.sin(azimuth)[:, None] * self.v
        return np.cos(polar)[:, None] * self.n + np.sin(polar)[:, None] * around


def hemisphere_frame(hemisphere: Hemisphere) -> HemisphereFrame:
    n = np.array(hemisphere.normal) / np.linalg.norm(hemisphere.normal)
    u = np.array(hemisphere.zero) - (np.array(hemisphere.zero) @ n) * n
    u /= np.linalg.norm(u)
    return HemisphereFrame(np.array(hemisphere.centre_mm), u, np.cross(n, u), n, hemisphere.radius_mm)


def target_angles(hemisphere: Hemisphere) -> tuple[Array, Array]:
    """Polar angles and azimuths (k,) rad of the targets, numbered from 1: the pole, then ring by ring."""
    polar, azimuth = [0.0], [0.0]
    for ring in np.arange(hemisphere.step_deg, hemisphere.polar_max_deg + 1e-9, hemisphere.step_deg):
        around = np.arange(0.0, 360.0 - 1e-9, hemisphere.step_deg)
        polar += [float(ring)] * len(around)
        azimuth += around.tolist()
    return np.radians(polar), np.radians(azimuth)


def target_poses(frame: HemisphereFrame, polar: Array, azimuth: Array, orientation: Integers, count: int) -> Array:
    """T_world_tool (k, 4, 4) at targets: TCP on the sphere, the tool tilted inwards.

    orientation (k,) from 1 to `count`: tilts about the tool's x axis, evenly around the middle one.
    """
    direction = frame.direction(polar, azimuth)
    lean = _about(np.cross(frame.n, direction), _LEAN * polar)
    pole = np.stack([frame.u, np.cross(-frame.n, frame.u), -frame.n], axis=1)
    R = lean @ pole
    tilt = _TILT_RAD * (orientation - (count + 1) / 2)
    T = np.zeros((len(polar), 4, 4))
    T[:, :3, :3] = R @ _about(np.broadcast_to([1.0, 0.0, 0.0], (len(polar), 3)), tilt)
    T[:, :3, 3] = frame.centre + frame.radius * direction
    T[:, 3, 3] = 1.0
    return T


def _about(axis: Array, angle: Array) -> Array:
    """Rotations (k, 3, 3) about axes (k, 3) by angles (k,) rad; the identity for a zero axis."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

    length = np.linalg.norm(axis, axis=1, keepdims=True)
    unit = np.divide(axis, length, out=np.zeros_like(axis), where=length > 1e-9)
    return np.asarray(Rotation.from_rotvec(unit * angle[:, None]).as_matrix())
