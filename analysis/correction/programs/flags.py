"""Which solutions of the nominal arm agree with the flags that a program gives to a Cartesian target.

What is certain counts first. KUKA's T has the signs of all axes, bit 0 of S the side of axis 1 on which the wrist is,
as KUKA's Expert Programming defines it; bit 1 of S says on which side of the outstretched arm axis 3 stands. Bit 2 of
S, whose sense differs between arms, is not used, since T has the sign of axis 5. ABB's confdata has the quadrants of
axes 1, 4 and 6 (Technical reference manual RAPID, confdata); cfx, which some arms do not have and then show as 0, only
decides between what is left. The letters of FANUC's CONFIG and Yaskawa's RCONF are those of `rig program`: a posture,
and the turns beyond.
"""

from __future__ import annotations

import numpy as np

from analysis.correction.programs.target import Flags
from analysis.kinematics.arm import Arm, Array, Mask, link_frames
from analysis.robot_programs.posture import posture_of, turns

_ROUNDING_RAD = np.radians(0.02)
"""A pose with the decimals of a program, 0.001 mm and 0.001°, gives wrist angles back within this: beside the end of a
quadrant or a turn either flag agrees. Chosen."""


def agreeing(arm: Arm, q: Array, flags: Flags, slack_rad: float = _ROUNDING_RAD) -> Mask:
    """Return which of the solutions q (n, 6) rad agree with flags (n,); `slack_rad` is by how much an angle may stand
    beyond its sign, quadrant or turn."""
    if not len(q):
        return np.zeros(0, dtype=bool)
    values = flags.values
    match flags.maker:
        case "fanuc" | "yaskawa":
            good = np.array([_same_letters(arm, posture, flags, slack_rad) for posture in q])
        case "kuka":
            status, turn = values
            signs = (turn >> np.arange(6)) & 1
            good = np.all(np.where(signs == 1, q < slack_rad, q > -slack_rad), axis=1)
            overhead = np.array([not _front(arm, posture) for posture in q])
            beyond = np.array([_beyond_stretch(arm, posture) for posture in q])
            good &= (overhead == bool(status & 1)) & (beyond == bool(status >> 1 & 1))
        case _:
            good = _quadrants(q[:, [0, 3, 5]], np.array(values[:3]), slack_rad)
            if good.sum() > 1 or values[3]:
                good &= np.array([_cfx(arm, posture) == values[3] for posture in q])
    return np.asarray(good, dtype=bool)


def _same_letters(arm: Arm, q: Array, flags: Flags, slack_rad: float) -> bool:
    stands = posture_of(arm, q)
    letters = (int(stands.flip), int(stands.up), int(stands.front))
    around = [q + shift for shift in (-slack_rad, 0.0, slack_rad)]
    if flags.maker == "fanuc":
        counts = [{turns(float(turned_q[axis])) for turned_q in around} for axis in (3, 4, 5)]
        return letters == flags.values[:3] and all(
            n in counts_of_axis for n, counts_of_axis in zip(flags.values[3:], counts, strict=True)
        )
    sides = [{int(not -np.pi < turned_q[axis] <= np.pi) for turned_q in around} for axis in (3, 5, 0)]
    same_letters = tuple(1 - letter for letter in letters) == flags.values[:3]
    return same_letters and all(n in sides_of_axis for n, sides_of_axis in zip(flags.values[3:], sides, strict=True))


def _quadrants(q: Array, quadrants: Array, slack_rad: float) -> Mask:
    low = quadrants * np.pi / 2
    inside: Mask = np.all((q > low - slack_rad) & (q < low + np.pi / 2 + slack_rad), axis=1)
    return inside


def _front(arm: Arm, q: Array) -> bool:
    """Whether the wrist lies at positive x of the frame that turns with axis 1 and is the base's frame at zero."""
    frames = link_frames(arm, np.stack([q, np.zeros(6)]))
    turned = frames[0, 0, :3, :3] @ frames[1, 0, :3, :3].T
    forward = turned @ arm.T_world_base[:3, 0]
    return bool((frames[0, 4, :3, 3] - frames[0, 0, :3, 3]) @ forward > 0)


def _beyond_stretch(arm: Arm, q: Array) -> bool:
    """Whether axis 3 stands at a larger angle than the one at which shoulder, elbow and wrist are in a line."""
    _, shoulder, elbow, _, wrist, _ = link_frames(arm, q[None])[0]
    lower, upper = elbow[:3, 3] - shoulder[:3, 3], wrist[:3, 3] - elbow[:3, 3]
    return bool(arm.coupling[2, 2] * (np.cross(lower, upper) @ elbow[:3, 2]) >= 0)


def _cfx(arm: Arm, q: Array) -> int:
    """0 to 7: 4 for a wrist behind axis 1, 2 for one behind the lower arm, 1 for a negative axis 5."""
    return 4 * (not _front(arm, q)) + 2 * (not _beyond_stretch(arm, q)) + int(q[4] < 0)
