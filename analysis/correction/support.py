"""Which effects of a rig file can be corrected, and the reason for each that cannot.

A target can make up for what depends on the posture alone. What depends on where a joint came from, on time, or on the
instruments cannot be met by any target; and an effect that may as well be zero is left alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from rigs.effects import Effect, size_field
from rigs.rig import Rig

Use = Literal["joint zero", "link constant", "targets only", "none"]

_USES: dict[str, Use] = {
    "joint_offset": "joint zero",
    "link_geometry": "link constant",
    "compliance": "targets only",
    "link_bending": "targets only",
    "transmission_error": "targets only",
    "wrist_coupling": "targets only",
}
_HOW: dict[Use, str] = {
    "joint zero": "is the same in every posture: re-master the axis",
    "link constant": "is a constant of the arm",
    "targets only": "depends on the posture: no zero or constant holds it, corrected targets do",
}
_WHY_NOT = {
    "backlash": "depends on where the joint came from: only the same approach direction to every target helps",
    "reversal_spike": "fades after each reversal: only a pause, or the same approach direction, helps",
    "servo_lag": "shows in motion only: a slower path helps, another target does not",
    "thermal_growth": "changes with run time: warming up helps, a fixed target does not",
    "vibration": "swings about the target: only its cause can be mended",
    "time_lag": "is the clocks', the arm has no part in it",
    "clock_rate": "is the clocks', the arm has no part in it",
    "ball_form": "is the ball's, the arm has no part in it",
}


@dataclass(frozen=True)
class Support:
    """What an effect can be used for. value, u: its size and standard uncertainty, in its own unit, u nan where nobody
    knows; reason: why so, in words."""

    effect: Effect
    value: float
    u: float
    use: Use
    reason: str


def supports(rig: Rig) -> list[Support]:
    """Every effect of a rig file with what it can be used for, in the file's order."""
    return [_support(effect) for effect in rig.effects]


def _support(effect: Any) -> Support:
    field = size_field(effect)
    value = float(getattr(effect, field))
    u = effect.found.sd.get(field, float("nan")) if effect.found else float("nan")
    use = _USES.get(effect.effect, "none")
    if use == "none":
        reason = _WHY_NOT.get(effect.effect, "is the gauges', the arm has no part in it")
    elif effect.found is None:
        use, reason = "none", "stands in the rig file without where it came from: diagnose or calibrate it"
    elif not u > 0:
        use, reason = "none", "was found without an uncertainty: calibrate it"
    elif u >= abs(value) and effect.found.together:
        reason = f"is known only together with {' and '.join(effect.found.together)}: correct all or none of them"
    elif u >= abs(value):
        use, reason = "none", "is no larger than its uncertainty: it may as well be zero"
    else:
        reason = _HOW[use]
    return Support(effect, value, u, use, reason)
