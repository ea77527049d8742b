"""Which effects of a rig file can be corrected, and the reason for each that cannot.

A target can compensate what depends on the posture alone. No target can compensate what depends on the direction from
which a joint came, on time, or on the instruments. An effect that is not significantly different from zero is not
corrected.
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
    """The use of an effect for a correction: `value` and `u` are its size and standard uncertainty in its own unit,
    with u NaN where it is unknown; `reason` explains the use in words."""

    effect: Effect
    value: float
    u: float
    use: Use
    reason: str


def supports(rig: Rig) -> list[Support]:
    """Return every effect of a rig file with its use, in the order of the file."""
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
    rivals = " or ".join(effect.found.rivals) if effect.found else ""
    doubt = f"; the same runs show {rivals} as well: measure which it is first" * bool(rivals)
    return Support(effect, value, u, use, _HOW[use] + doubt)


def _why_not(effect: Effect, value: float, u: float) -> str:
    """Return why an effect is not corrected, or an empty text."""
    if effect.compensation().use == "none":
        return effect.compensation().why_not
    if effect.found is None:
        return "stands in the rig file without where it came from: diagnose or calibrate it"
    if not u > 0:
        return "was found without an uncertainty: calibrate it"
    small = u >= abs(value) and not effect.found.together
    return "is no larger than its uncertainty: it may as well be zero" if small else ""
