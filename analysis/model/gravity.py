"""Gravity: what the links and the payload weigh on each joint, and on the base that carries them all."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from analysis.kinematics.arm import Arm, Array, base_places, blocks, link_columns
from rigs.schema.robot import Robot

_G = 9.80665
"""m/s², the standard acceleration of free fall (ISO 80000-3), against z of the world."""


@dataclass(frozen=True)
class Load:
    """mass (axes,) kg of each link, centre (axes, 3) mm in its frame, payload_kg at the flange."""

    mass: Array
    centre: Array
    payload_kg: float


def load_of(robot: Robot) -> Load:
    """What a rig file says that the links weigh."""
    mass = np.array([axis.mass_kg for axis in robot.axes])
    return Load(mass, np.array([axis.centre_mm for axis in robot.axes], dtype=float), robot.payload_kg)


@dataclass(frozen=True, eq=False)
class Pull:
    """What gravity does at n postures: torque (n, axes) Nm on each joint of the controller, and moment (n, 3) Nm of all
    that the arm carries about the origin of its base, in the axes of the base."""

    torque: Array
    moment: Array


_recent: deque[tuple[Arm, Load, Array, Pull]] = deque(maxlen=32)
"""The pull on the last traces: a fit asks for that on the same few over and over. Nothing is changed in place."""
_KEPT_ROWS = 50_000
"""Longer traces are not kept: 32 of them would fill 150 MB and more with what a simulation asks for once."""


def pull(arm: Arm, load: Load, q: Array) -> Pull:
    """What gravity does at angles q (n, axes) rad."""
    for known_arm, known_load, known_q, pulled in _recent:
        if (
            known_q is q
            and known_arm is arm
            and known_load.mass is load.mass
            and known_load.centre is load.centre
            and known_load.payload_kg == load.payload_kg
        ):
            return pulled
    # Masses (axes,) kg and their centres (axes, 3) mm with the payload, which hangs at the flange, the last frame.
    mass, centre = load.mass.copy(), load.centre.copy()
    mass[-1] += load.payload_kg
    if mass[-1] > 0:
        centre[-1] *= load.mass[-1] / mass[-1]
    per_theta, about_base = np.empty((arm.axes, len(q))), np.zeros((3, len(q)))
    for block in blocks(len(q)):
        links = list(link_columns(arm, q[block]))
        beyond_kg, beyond_kg_mm = 0.0, np.zeros((2, links[0].shape[2]))
        for axis in reversed(range(arm.axes)):
            x, y, z, origin = links[axis][:, :2]
            beyond_kg += mass[axis]
            beyond_kg_mm += mass[axis] * (origin + centre[axis, 0] * x + centre[axis, 1] * y + centre[axis, 2] * z)
            across_x, across_y = beyond_kg_mm - beyond_kg * origin
            per_theta[axis, block] = _G * (z[1] * across_x - z[0] * across_y)
        beside_x, beside_y = beyond_kg_mm - beyond_kg * base_places(arm, q[block])[:, :2].T
        about_base[:2, block] = -_G * beside_y, _G * beside_x
    pulled = Pull((arm.coupling.T @ per_theta / 1000.0).T, about_base.T @ arm.T_world_base[:3, :3] / 1000.0)
    if len(q) <= _KEPT_ROWS:
        _recent.append((arm, load, q, pulled))
    return pulled
