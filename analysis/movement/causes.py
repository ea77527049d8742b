"""Causes of a change between two sets of readings, with prior odds and prior sizes.

The prior odds are chosen, since field statistics are not published. Four readings in sockets have a weight of millions
to 1, so they matter only for causes that the readings hardly show.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from analysis.diagnosis.judge.result import Alike
from analysis.robot.kinematics.arm import Array

What = Literal["nothing", "base", "instrument", "socket", "target", "tool", "zero", "pair", "triple", "other"]

PRIOR: dict[What, float] = {
    "nothing": 0.90, "base": 0.02, "instrument": 0.003, "socket": 0.013, "target": 0.003, "tool": 0.02, "zero": 0.034,
    "pair": 0.0007, "triple": 5e-6, "other": 0.0063,
}  # fmt: skip
"""Prior probability of each kind of cause, shared by the members. Chosen: most checks find no movement. If something
moved, a second part moved as well in 1 of 140 cases, and if two moved, a third one in as many.
"""
LEVELS = np.array([0.3, 1.0, 3.0, 10.0])
"""Multiples of the typical size whose mixture is the prior of a size. Chosen: factors of about three cover 0.1 to 20 mm
with nearly even density.
"""
SHIFT_MM = 0.7
"""Typical size of a shift along an axis. Chosen: a crash or a tool change moves frames by tenths of a millimetre to
some millimetres.
"""
TURN_RAD = SHIFT_MM / 500
"""Typical rotation of a base: the typical shift at half a metre, about the width of a pedestal."""
ZERO_RAD = float(np.radians(0.1))
"""Typical error of a joint zero after a crash: belts and clutches slip by hundredths to tenths of a degree."""


@dataclass(frozen=True)
class Cause:
    """A possible cause. `name`: of the socket, target or instrument. `axis`: of the zero, from 1. `members`: of a pair
    or triple.
    """

    what: What
    axis: int | None = None
    name: str = ""
    members: tuple[Cause, ...] = ()

    @property
    def scale(self) -> Array:
        """Typical sizes (m,) of the parameters: mm for shifts, rad for rotations and zeros."""
        if self.what in ("base", "instrument"):
            return np.array([SHIFT_MM] * 3 + [TURN_RAD] * 3)
        if self.what == "zero":
            return np.array([ZERO_RAD])
        if self.members:
            return np.concatenate([member.scale for member in self.members])
        return np.full(3, SHIFT_MM) if self.what in ("socket", "target", "tool") else np.empty(0)


def look_alike(cause: Cause, axes: int, *, of_tracker: bool) -> Alike | None:
    """The part with the same change of every reading as a cause, if any.

    The instrument looks like the base to a tracker, the plate of all sockets looks like it to touches, and a rotation
    about the first or last axis looks like the zero.
    """
    if cause.what == "base":
        return "instrument" if of_tracker else "plate"
    return "base" if cause.axis == 1 else "tool" if cause.axis == axes else None


NOTHING, OTHER = Cause("nothing"), Cause("other")


def prior_of(causes: list[Cause]) -> dict[Cause, float]:
    """Prior probability by cause; the causes of one kind share what the kind has."""
    counts = {what: sum(cause.what == what for cause in causes) for what in PRIOR}
    raw = {cause: PRIOR[cause.what] / counts[cause.what] for cause in causes}
    total = sum(raw.values())
    return {cause: value / total for cause, value in raw.items()}
