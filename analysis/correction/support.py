"""Which effects of a rig file can be corrected, and the reason for each that cannot.

A target can make up for what depends on the posture alone. What depends on where a joint came from, on time, or on the
instruments cannot be met by any target; and an effect that may as well be zero is left alone.
"""

from __future__ import annotations

from dataclasses import dataclass

from rigs.effects import Effect, size_field
from rigs.rig import Rig
from rigs.schema.effect import Use

_HOW: dict[Use, str] = {
    "joint zero": "is the same in every posture: re-master the axis",
    "link constant": "is a constant of the arm",
    "targets only": "depends on the posture: no zero or constant holds it, corrected targets do",
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


def _support(effect: Effect) -> Support:
    field = size_field(effect)
    value = float(getattr(effect, field))
    u = effect.found.sd.get(field, float("nan")) if effect.found else float("nan")
    use = effect.compensation().use
    reason = _why_not(effect, value, u)
    if reason:
        return Support(effect, value, u, "none", reason)
    if u >= abs(value) and effect.found and effect.found.together:
        alike = " and ".join(effect.found.together)
        return Support(effect, value, u, use, f"is known only together with {alike}: correct all or none of them")
    return Support(effect, value, u, use, _HOW[use])


def _why_not(effect: Effect, value: float, u: float) -> str:
    """Why an effect is left alone; empty where it need not be."""
    if effect.compensation().use == "none":
        return effect.compensation().why_not
    if effect.found is None:
        return "stands in the rig file without where it came from: diagnose or calibrate it"
    if not u > 0:
        return "was found without an uncertainty: calibrate it"
    small = u >= abs(value) and not effect.found.together
    return "is no larger than its uncertainty: it may as well be zero" if small else ""
