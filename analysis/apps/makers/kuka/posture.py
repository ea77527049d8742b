"""Postures in KRL: Status and Turn.

Source: KUKA System Software 8.x, Operating and Programming Instructions for System Integrators; KUKA, Expert
Programming.
"""

from __future__ import annotations

import numpy as np

from analysis.apps.makers.posture import beyond_stretch, wrist_in_front
from analysis.robot.kinematics.arm import Arm, Array, Mask


def agreeing(arm: Arm, q: Array, values: tuple[int, ...], slack_rad: float) -> Mask:
    """Return a mask (n,) of the solutions q (n, 6) rad that agree with Status and Turn."""
    status, turn = values
    return agreeing_status(arm, q, (status,), slack_rad) & agreeing_turn(arm, q, (turn,), slack_rad)


def agreeing_status(arm: Arm, q: Array, values: tuple[int, ...], _slack_rad: float) -> Mask:
    """Return a mask (n,) of the solutions q (n, 6) rad that agree with Status.

    Bit 0 is the side of axis 1 on which the wrist is, as defined in KUKA's Expert Programming. Bit 1 is the side of
    the outstretched arm on which axis 3 is. Bit 2 is not used, because its sense differs between arms: T contains the
    sign of axis 5. Status alone therefore leaves the wrist open.
    """
    sides = not values[0] & 1, bool(values[0] >> 1 & 1)
    return np.array([(wrist_in_front(arm, angles), beyond_stretch(arm, angles)) == sides for angles in q])


def agreeing_turn(_arm: Arm, q: Array, values: tuple[int, ...], slack_rad: float) -> Mask:
    """Return a mask (n,) of the solutions q (n, 6) rad that agree with Turn, the signs of all axes."""
    signs = (values[0] >> np.arange(6)) & 1
    good: Mask = np.all(np.where(signs == 1, q < slack_rad, q > -slack_rad), axis=1)
    return good
