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
    flip, up, front = _configurations(arm, q[None])[0].tolist()
    return flip, up, front


def _configurations(arm: Arm, q: Array) -> Mask:
    """Flip, up and front (n, 3) at joint angles q (n, 6) rad."""
    frames = link_frames(arm, q)
    first, origins = frames[:, 0, :3, :3], frames[:, :, :3, 3]
    shoulder, elbow, wrist = origins[:, 1], origins[:, 2], origins[:, 4]
    reach, bend = wrist - shoulder, elbow - shoulder
    above = bend - (_dot(bend, reach) / _dot(reach, reach))[:, None] * reach
    front = _dot(wrist - origins[:, 0], first[:, :, 0])
    return np.column_stack([q[:, 4] > 0, _dot(above, first[:, :, 2]) > 0, front > 0])


def _dot(a: Array, b: Array) -> Array:
    products: Array = np.einsum("...i,...i", a, b)
    return products


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

    good: Mask = (_configurations(arm, q) == sides).all(axis=1)
    for row in np.flatnonzero(good):
        around = [q[row] + shift for shift in (-slack_rad, 0.0, slack_rad)]
        good[row] = all(number in {number_of(float(near[axis])) for near in around} for axis, number in numbers.items())
    return good


def wrist_in_front(arm: Arm, q: Array) -> Mask:
    """Mask (n,) of the joint angles q (n, 6) rad with the wrist at positive x of the frame that rotates with axis 1 and
    equals the base frame at zero."""
    frames = link_frames(arm, np.vstack([q, np.zeros(6)]))
    turned = frames[:-1, 0, :3, :3] @ frames[-1, 0, :3, :3].T
    forward = turned @ arm.T_world_base[:3, 0]
    ahead: Mask = _dot(frames[:-1, 4, :3, 3] - frames[:-1, 0, :3, 3], forward) > 0
    return ahead


def beyond_stretch(arm: Arm, q: Array) -> Mask:
    """Mask (n,) of the joint angles q (n, 6) rad where axis 3 has a larger angle than with shoulder, elbow and wrist on
    a line."""
    frames = link_frames(arm, q)
    shoulder, elbow, wrist = (frames[:, link, :3, 3] for link in (1, 2, 4))
    turning = _dot(np.cross(elbow - shoulder, wrist - elbow), frames[:, 2, :3, 2])
    beyond: Mask = arm.coupling[2, 2] * turning >= 0
    return beyond
