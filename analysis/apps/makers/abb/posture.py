"""Postures in RAPID: confdata.

Source: ABB, Technical reference manual, RAPID Instructions, Functions and Data types (3HAC050917), confdata.
"""

from __future__ import annotations

import numpy as np

from analysis.apps.makers.posture import beyond_stretch, wrist_in_front
from analysis.robot.kinematics.arm import Arm, Array, Mask


def agreeing(arm: Arm, q: Array, values: tuple[int, ...], slack_rad: float) -> Mask:
    """Return a mask (n,) of the solutions q (n, 6) rad that agree with confdata: the quadrants of axes 1, 4, 6.

    cfx only decides between the remaining solutions, because some arms do not use it and show 0. It is the sum of 4 for
    a wrist behind axis 1, 2 for a wrist behind the lower arm, and 1 for a negative axis 5.
    """
    low = np.array(values[:3]) * np.pi / 2
    turned = q[:, [0, 3, 5]]
    good: Mask = np.all((turned > low - slack_rad) & (turned < low + np.pi / 2 + slack_rad), axis=1)
    if good.sum() > 1 or values[3]:
        sides = [(not wrist_in_front(arm, angles), not beyond_stretch(arm, angles), angles[4] < 0) for angles in q]
        good &= np.array(sides) @ [4, 2, 1] == values[3]
    return good


def quadrants(_arm: Arm, q: Array) -> tuple[int, ...]:
    """Return cf1, cf4 and cf6 of joint angles q (6,) rad."""
    return tuple(np.floor(q[[0, 3, 5]] / (np.pi / 2)).astype(int).tolist())
