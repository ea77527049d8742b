"""Postures in KRL: Status and Turn.

Source: KUKA System Software 8.x, Operating and Programming Instructions for System Integrators; KUKA, Expert
Programming.
"""

from __future__ import annotations

import numpy as np

from analysis.apps.makers.programs.posture import beyond_stretch, wrist_in_front
from analysis.robot.kinematics.arm import Arm, Array, Mask


def agreeing(arm: Arm, q: Array, values: tuple[int, ...], slack_rad: float) -> Mask:
    """Return a mask (n,) of the solutions q (n, 6) rad that agree with Status and Turn.

    T contains the signs of all axes. Bit 0 of S is the side of axis 1 on which the wrist is, as defined in KUKA's
    Expert Programming. Bit 1 of S is the side of the outstretched arm on which axis 3 is. Bit 2 of S is not used,
    because its sense differs between arms: T contains the sign of axis 5.
    """
    status, turn = values
    signs = (turn >> np.arange(6)) & 1
    good: Mask = np.all(np.where(signs == 1, q < slack_rad, q > -slack_rad), axis=1)
    sides = not status & 1, bool(status >> 1 & 1)
    for k in np.flatnonzero(good):
        good[k] = (wrist_in_front(arm, q[k]), beyond_stretch(arm, q[k])) == sides
    return good
