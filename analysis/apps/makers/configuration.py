"""Configuration of an arm: which of its solutions a target means, in the flags of the makers.

Their definition could not be confirmed for every arm: the operator compares them with the pendant
(docs/robot-programs.md). Turns are certain.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from analysis.robot.kinematics.arm import Arm, Array, Mask, link_frames


def configuration_of(arm: Arm, q: Array) -> tuple[bool, bool, bool]:
    """Flags at joint angles q (6,) rad: flip (axis 5 is positive), up (the elbow is above the line from shoulder to
    wrist) and front (the wrist is on the side of axis 1 that the arm faces)."""
    first, shoulder, elbow, _, wrist, _ = link_frames(arm, q[None])[0]
    reach = wrist[:3, 3] - shoulder[:3, 3]
    bend = elbow[:3, 3] - shoulder[:3, 3]
    above = bend - (bend @ reach) / (reach @ reach) * reach
    front = (wrist[:3, 3] - first[:3, 3]) @ first[:3, 0] > 0
    return bool(q[4] > 0), bool(above @ first[:3, 2] > 0), bool(front)


def turns(q_rad: float) -> int:
    """Full turns of a joint angle outside (-180°, 180°); each end of the range counts as a turn."""
    return int(np.copysign(np.floor(abs(q_rad) / (2 * np.pi) + 0.5), q_rad))


def agreeing(
    arm: Arm,
    q: Array,
    sides: tuple[int, ...],
    numbers: Mapping[int, int],
    number_of: Callable[[float], int],
    slack_rad: float,
) -> Mask:
    """Mask (n,) of the solutions q (n, 6) rad with the given flags and turns.

    sides: flip, up and front. numbers: by axis, from 0, what `number_of` gives for its angle, or for one up to
    slack_rad away.
    """

    def agrees(angles: Array) -> bool:
        if configuration_of(arm, angles) != sides:
            return False
        around = [angles + shift for shift in (-slack_rad, 0.0, slack_rad)]
        return all(number in {number_of(float(near[axis])) for near in around} for axis, number in numbers.items())

    return np.array([agrees(angles) for angles in q])


def wrist_in_front(arm: Arm, q: Array) -> bool:
    """True if the wrist is at positive x of the frame that rotates with axis 1 and equals the base frame at zero."""
    frames = link_frames(arm, np.stack([q, np.zeros(6)]))
    turned = frames[0, 0, :3, :3] @ frames[1, 0, :3, :3].T
    forward = turned @ arm.T_world_base[:3, 0]
    return bool((frames[0, 4, :3, 3] - frames[0, 0, :3, 3]) @ forward > 0)


def beyond_stretch(arm: Arm, q: Array) -> bool:
    """True if axis 3 has a larger angle than with shoulder, elbow and wrist on a line."""
    _, shoulder, elbow, _, wrist, _ = link_frames(arm, q[None])[0]
    lower, upper = elbow[:3, 3] - shoulder[:3, 3], wrist[:3, 3] - elbow[:3, 3]
    return bool(arm.coupling[2, 2] * (np.cross(lower, upper) @ elbow[:3, 2]) >= 0)
