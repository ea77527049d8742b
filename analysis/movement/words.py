"""What a cause is called, and its size with its uncertainty and direction."""

from __future__ import annotations

import math

from analysis.movement.causes import Cause
from analysis.movement.result import CauseOdds, short_name
from rigs.schema.part import Vector

_SMALL = 2.0
"""Multiple of u up to which a component of a direction is left out."""


def name_of(cause: Cause, *, of_tracker: bool = False) -> str:
    """Return what a cause is called in a sentence."""
    if cause.members:
        return " and ".join(name_of(member, of_tracker=of_tracker) for member in cause.members)
    names = {
        "base": "the base or the instrument" if of_tracker else "the base", "tool": "the tool",
        "zero": f"the zero of axis {cause.axis}", "nothing": "nothing", "other": "something else",
        "instrument": f"the instrument of {short_name(cause)}", "socket": f"socket {short_name(cause)}",
        "target": f"the target {short_name(cause)}".rstrip(),
    }  # fmt: skip
    return names[cause.what]


def direction(vector: Vector, u: float) -> str:
    """Return the components of a shift, without those that are smaller than their uncertainty lets see."""
    shown = [f"{name} {value:+.2f}" for name, value in zip("xyz", vector, strict=True) if abs(value) > _SMALL * u]
    return f"{', '.join(shown)} mm" if shown else "no clear direction"


def size_of(cause: CauseOdds) -> str:
    """Return the size of a cause with its uncertainty and direction; empty if it has none."""
    if cause.together:
        return "; ".join(f"{name_of(member.cause)} {size_of(member)}" for member in cause.together)
    if cause.size_deg is not None and cause.u is not None:
        return f"{cause.size_deg:+.3f} ± {cause.u:.3f}°"
    if cause.translation_mm is None or cause.u is None:
        return ""
    length = math.hypot(*cause.translation_mm)
    words = f"{length:.2f} ± {cause.u:.2f} mm ({direction(cause.translation_mm, cause.u)})"
    if cause.rotation_deg is None or cause.u_rotation_deg is None:
        return words
    turn = math.hypot(*cause.rotation_deg)
    return words + (f", turned by {turn:.3f} ± {cause.u_rotation_deg:.3f}°" if turn > 2 * cause.u_rotation_deg else "")
