"""Correctable effects of a rig file, and reasons for the uncorrectable effects.

A target can compensate posture-dependent effects, but not effects of direction, time or instruments. If the diagnosis
says *correct nothing* (`rigs.calibration.verdict_of`), a correction is refused, or written and marked.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.evidence.significance import POSSIBLE_SIGMA
from rigs.calibration import ground_of, verdict_of
from rigs.effects import Effect, size_field
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.effect import Use, is_play
from rigs.text import as_argument

_HOW: dict[Use, str] = {
    "joint zero": "is the same in every posture: re-master the axis",
    "link constant": "is a constant of the arm",
    "targets only": "depends on the posture: use corrected targets, not a zero or constant",
}


@dataclass(frozen=True)
class Support:
    """Whether and why an effect is used for a correction, with its size and standard uncertainty (NaN if unknown)."""

    effect: Effect
    value: float
    u: float
    use: Use
    reason: str


def supports(rig: Rig) -> list[Support]:
    unknown = float("nan")
    return [
        _support(effect, effect.found.sd.get(size_field(effect), unknown) if effect.found else unknown)
        for effect in rig.effects
    ]


def supports_of_usual_size(rig: Rig) -> list[Support]:
    """Calibrated effects of normal size that are certain enough to correct."""
    if rig.calibrated is None:
        return []
    terms = [(rig.calibrated.terms[parameter.term], parameter.field) for parameter in rig.calibrated.parameters]
    return [
        _support(term.effect, float(np.linalg.norm(rig.calibrated.root[row])), from_calibration=True)
        for row, (term, field) in enumerate(terms)
        if not term.named and field == size_field(term.effect)
    ]


def _support(effect: Effect, u: float, *, from_calibration: bool = False) -> Support:
    value = float(getattr(effect, size_field(effect)))
    use = effect.compensation().use
    if use == "none":
        return Support(effect, value, u, use, effect.compensation().why_not)
    if effect.found is None and not from_calibration:
        why = "has no provenance in the rig file: diagnose or calibrate the arm"
        return Support(effect, value, u, "none", why)
    if not u > 0:
        return Support(effect, value, u, "none", "has no uncertainty: calibrate the arm")
    if u >= abs(value):
        alike = " and ".join(effect.found.together if effect.found else ())
        if not alike:
            return Support(effect, value, u, "none", "is not larger than the uncertainty: the true value may be zero")
        return Support(effect, value, u, use, f"is known only together with {alike}: correct all of them or none")
    rivals = " or ".join(effect.found.rivals if effect.found else ())
    doubt = f"; the same runs show {rivals} as well: measure which it is first" * bool(rivals)
    return Support(effect, value, u, use, _HOW[use] + doubt)


ANYWAY = "written although rig advises against a correction by this model"
"""Mark in every file written against the verdict."""


def known_plays(rig: Rig) -> tuple[Effect, ...]:
    """Backlash of the rig file and the calibration that is known well enough for a program, whatever its size.

    In a program the side of each link is known at each target, as in the reversal compensation of machine tools (ISO
    230-1), so the command leads by half the backlash. If a joint reverses between two targets, the link crosses the
    backlash gradually; this part of the error remains.
    """
    unsure = {id(support.effect) for support in supports(rig) if support.value < POSSIBLE_SIGMA * support.u}
    plays = [
        effect for effect in rig.effects if effect.STAGE == "joint" and is_play(effect) and id(effect) not in unsure
    ]
    plays += [
        support.effect
        for support in supports_of_usual_size(rig)
        if support.effect.STAGE == "joint" and is_play(support.effect) and support.value >= POSSIBLE_SIGMA * support.u
    ]
    return tuple(plays)


def why_nothing(rig: Rig) -> str:
    """Sentence that refuses corrections by a rig's model; empty if the model may be used."""
    reason = reason_against_model(rig)
    return f"do not correct with this model: {reason}" if reason else ""


def reason_against_model(rig: Rig) -> str:
    if rig.calibrated is None or verdict_of(rig.calibrated) == "correct":
        return ""
    judged = rig.calibrated.judged
    assert judged is not None  # noqa: S101 - without it the verdict is to correct
    if ground_of(rig.calibrated) == "not_shown":
        return "the runs cannot show the cause, and the remaining error elsewhere is unknown"
    remainder = f"{judged.handed_um:.0f} of {judged.before_um:.0f} µm rms remain"
    if ground_of(rig.calibrated) == "no_gain_elsewhere":
        return f"{remainder} in runs not used to fit it, no less than with the nominal arm"
    where = (
        "in the runs used to fit it, without validation elsewhere"
        if judged.place == "used"
        else "in runs not used to fit it"
    )
    return f"{judged.unexplained_um:.0f} µm have an unknown cause; {remainder} {where}"


def reason_to_measure_first(rig: Rig) -> str:
    """Explain why the diagnosis asks for more readings before its model corrects the arm; empty if it does not."""
    judged = rig.calibrated.judged if rig.calibrated else None
    if judged is None or not judged.measure_first:
        return ""
    why = _WHY_FIRST.get(judged.measure_why, "no reading was left out of the fit to show its error")
    if judged.measure_why not in _WHY_FIRST and judged.left_out_um is not None:
        why = f"it misses left-out readings by {judged.left_out_um:.0f} µm rms, and they are few"
    return f"the calibration asks for more readings before the model is used: {why}"


_WHY_FIRST = {
    "few_runs": "they do not show whether a part is faulty",
    "revisit": "no place was measured twice, so its error and the scatter cannot be separated",
    "commanded": "the joint angles are only commanded, and the arm may not have reached them",
    "early": "the joints were read before they came to rest",
    "other_robot": "the constants of the controller may be those of another robot",
}
"""Explanations of `measure_why`; without one, the left-out readings are the reason."""


def require_usable_model(rig: Rig, rig_file: str, *, anyway: bool) -> None:
    """Raise FileError if a rig's model must not be used for correction, unless `anyway`."""
    if (why := why_nothing(rig)) and not anyway:
        remedy = f"plan the next measurement: rig plan {as_argument(rig_file)}; --anyway writes the files with a remark"
        raise FileError(rig_file, why, remedy, code="calibration.missing")
