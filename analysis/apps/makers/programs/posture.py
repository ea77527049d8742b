"""Which of the arm's solutions a target means, in words that makers have for it.

No maker's definition of every letter could be confirmed for every arm: a person compares them with the pendant
(docs/robot-programs.md). Turns are certain, since they follow from the joint angles alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from analysis.robot.kinematics.arm import Arm, Array, Mask, link_frames

_FULL_TURN = 2 * np.pi


@dataclass(frozen=True)
class Posture:
    """flip: axis 5 stands at a positive angle; up: the elbow lies above the line from shoulder to wrist; front: the
    wrist lies on the side of axis 1 to which the arm faces."""

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
    """Which solutions q (n, 6) rad stand on these sides, flip, up and front, and each axis (from 0) of `numbers` at an
    angle of its number; one within slack_rad of such an angle does as well."""

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
    """Whether at joint angles q (6,) rad the wrist lies at positive x of the frame that turns with axis 1 and is the
    base's frame at zero."""
    frames = link_frames(arm, np.stack([q, np.zeros(6)]))
    turned = frames[0, 0, :3, :3] @ frames[1, 0, :3, :3].T
    forward = turned @ arm.T_world_base[:3, 0]
    return bool((frames[0, 4, :3, 3] - frames[0, 0, :3, 3]) @ forward > 0)


def beyond_stretch(arm: Arm, q: Array) -> bool:
    """Whether at joint angles q (6,) rad axis 3 stands at a larger angle than the one at which shoulder, elbow and
    wrist are in a line."""
    _, shoulder, elbow, _, wrist, _ = link_frames(arm, q[None])[0]
    lower, upper = elbow[:3, 3] - shoulder[:3, 3], wrist[:3, 3] - elbow[:3, 3]
    return bool(arm.coupling[2, 2] * (np.cross(lower, upper) @ elbow[:3, 2]) >= 0)
