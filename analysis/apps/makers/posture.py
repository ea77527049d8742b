"""Posture flags: the arm configuration meant by a target, in the terms of the makers.

The definition of the flags by each maker could not be confirmed for every arm: the operator compares them with the
pendant (docs/robot-programs.md). Turns are certain, because they follow from the joint angles.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from analysis.robot.kinematics.arm import Arm, Array, Mask, link_frames

_FULL_TURN = 2 * np.pi


@dataclass(frozen=True)
class Posture:
    """Posture of the arm.

    flip: axis 5 has a positive angle. up: the elbow is above the line from shoulder to wrist. front: the wrist is on
    the side of axis 1 that the arm faces.
    """

    flip: bool
    up: bool
    front: bool


def posture_of(arm: Arm, q: Array) -> Posture:
    """Return the posture at joint angles q (6,) rad."""
    first, shoulder, elbow, _, wrist, _ = link_frames(arm, q[None])[0]
    reach = wrist[:3, 3] - shoulder[:3, 3]
    bend = elbow[:3, 3] - shoulder[:3, 3]
    above = bend - (bend @ reach) / (reach @ reach) * reach
    return Posture(
        flip=bool(q[4] > 0),
        up=bool(above @ first[:3, 2] > 0),
        front=bool((wrist[:3, 3] - first[:3, 3]) @ first[:3, 0] > 0),
    )


def turns(q_rad: float) -> int:
    """Return the number of full turns of a joint angle in rad outside the range (-180°, 180°); each end counts as a
    turn."""
    return int(np.copysign(np.floor(abs(q_rad) / _FULL_TURN + 0.5), q_rad))


def agreeing(
    arm: Arm,
    q: Array,
    sides: tuple[int, ...],
    numbers: Mapping[int, int],
    number_of: Callable[[float], int],
    slack_rad: float,
) -> Mask:
    """Return a mask (n,) of the solutions q (n, 6) rad that have the given posture and turns.

    sides: flip, up and front. numbers: required number of each axis, from 0, as computed by `number_of` from its angle.
    slack_rad: tolerance of these angles.
    """

    def agrees(angles: Array) -> bool:
        around = [angles + shift for shift in (-slack_rad, 0.0, slack_rad)]
        if not all(
            number in {number_of(float(shifted[axis])) for shifted in around} for axis, number in numbers.items()
        ):
            return False
        stands = posture_of(arm, angles)
        return (stands.flip, stands.up, stands.front) == sides

    return np.array([agrees(angles) for angles in q])


def wrist_in_front(arm: Arm, q: Array) -> bool:
    """Return whether the wrist is in front of axis 1 at joint angles q (6,) rad.

    In front means positive x of the frame that rotates with axis 1 and equals the base frame at zero.
    """
    frames = link_frames(arm, np.stack([q, np.zeros(6)]))
    turned = frames[0, 0, :3, :3] @ frames[1, 0, :3, :3].T
    forward = turned @ arm.T_world_base[:3, 0]
    return bool((frames[0, 4, :3, 3] - frames[0, 0, :3, 3]) @ forward > 0)


def beyond_stretch(arm: Arm, q: Array) -> bool:
    """Return whether axis 3 is beyond the stretched posture at joint angles q (6,) rad.

    Shoulder, elbow and wrist are on a line in the stretched posture; beyond means a larger angle of axis 3.
    """
    _, shoulder, elbow, _, wrist, _ = link_frames(arm, q[None])[0]
    lower, upper = elbow[:3, 3] - shoulder[:3, 3], wrist[:3, 3] - elbow[:3, 3]
    return bool(arm.coupling[2, 2] * (np.cross(lower, upper) @ elbow[:3, 2]) >= 0)
