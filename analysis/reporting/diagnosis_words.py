"""A diagnosis in plain words, for screen and picture alike."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from analysis.diagnosis.answer import BudgetPart, Condition, Doubt
from analysis.diagnosis.budget import CERTAIN_SIGMA
from analysis.diagnosis.diagnosis import ODDS, Curve, Diagnosis, Gap, Named, Place, ResidualBand, Rival
from analysis.measures.parameters import parameters_of, quantity_of
from analysis.measures.quantity import Quantity
from rigs.effects import Effect, size_field
from rigs.rig import Rig
from rigs.schema.effect import name_of

_WHOLE_LAP_DEG = 350.0
LARGE_SHARE = 1 / 3
"""Share of the error from which a part is said in the first sentence, whatever its size."""
_IMITATES: tuple[Doubt, ...] = ("contradicted", "series", "no_better")
"""Doubts of effects that stand for something else, so that the error comes from no such cause."""


def plain(rig: Rig, effect: Effect) -> str:
    """An effect as a person says it: `play of axis 1 (Theta)`."""
    axis = getattr(effect, "axis", None)
    return effect.plain("" if axis is None else joint(rig, axis))


def joint(rig: Rig, axis: int) -> str:
    """`axis 1 (Theta)`."""
    return f"axis {axis} ({rig.robot.axes[axis - 1].name})"


def with_uncertainty(effect: Effect, field: str, sd: Mapping[str, float], times: float = 1.0) -> str:
    """A parameter ± `times` its standard uncertainty, to sensible digits; alone where no uncertainty is known."""
    one = quantity_of(effect, field, sd)
    if not 0 < one.u < math.inf:
        return f"{one.value:.4g} {one.sign}".rstrip()
    return str(Quantity(one.value, times * one.u, one.unit))


def size(one: Named | Rival, times: float = 1.0) -> str:
    """The size of a named effect or of a rival, ± `times` its standard uncertainty."""
    return with_uncertainty(one.effect, size_field(one.effect), one.sd, times)


def beside_size(one: Named) -> list[str]:
    """The parameters that say how it looks: those fitted, and those that each such effect has (the order of a gear)."""
    fields = type(one.effect).model_fields
    return [
        field
        for field in parameters_of(one.effect)
        if field != size_field(one.effect) and (field in one.sd or fields[field].is_required())
    ]


def remedy(one: Named) -> str:
    """What to do about a name, and which others it may be instead."""
    others = " or ".join(rival_names(one))
    return f"only if it is not {others}: {one.remedy}" if others else one.remedy


def rival_names(one: Named) -> list[str]:
    """The names of the rivals of a name that cannot be dismissed."""
    return [name_of(rival.effect) for rival in likely_rivals(one)]


def likely_rivals(one: Named) -> list[Rival]:
    """The rivals of a name that cannot be dismissed."""
    return [rival for rival in one.rivals if rival.posterior * ODDS >= one.posterior]


def sure(posterior: float) -> str:
    """A share of the evidence in percent, never more than is known."""
    if posterior > 0.999:
        return "> 99.9 %"
    if posterior < 0.01:
        return "< 1 %"
    return f"{100 * posterior:.1f} %" if posterior > 0.99 else f"{100 * posterior:.0f} %"


def headline(found: Diagnosis) -> str:
    """The condition of the arm in a sentence, and in a second one what makes more than a third of its error."""
    if found.condition == "not_testable_here":
        return "These runs cannot show whether something is worn, loose or shifted."
    condition, large = _condition(found), _large(found)
    # What is certain comes before what is not known.
    return f"{large} {condition}".strip() if found.condition == "undecided" else f"{condition} {large}".strip()


def _condition(found: Diagnosis) -> str:
    named = "; ".join(f"{plain(found.rig, one.effect)}, {size(one)}{_makes(found, one)}" for one in found.standing)
    several = f"{len(found.standing)} faults were found" if len(found.standing) > 1 else "One fault was found"
    beside = f" beside {named}" if named else ""
    again = f" Drive each test {found.runs_to_decide} times to decide it." if found.runs_to_decide else ""
    words: dict[Condition, str] = {
        "named": f"{several}: {named}.",
        "ambiguous": f"There is a fault, and these tests cannot distinguish which: {_alternatives(found)}.",
        "outside_library": f"An error that no known effect explains remains{beside}: {_unexplained(found)}.",
        "undecided": f"These runs are too few to decide whether something is worn, loose or shifted.{again}",
        "uncalibrated": "Nothing was found worn, loose or shifted; the arm has many errors of usual size.",
        "nothing_unusual": "Nothing was found worn, loose or shifted.",
    }
    return words[found.condition]


def accuracy_words(found: Diagnosis) -> str:
    """The error now and after the calibration in one sentence, and how it is judged."""
    own = found.accuracy
    where = {"unseen": "at the unseen place", "held_out": "on what was left out", "used": "on these runs"}[own.place]
    now = f"The error is {micrometres(own.now_um)} rms, at most {micrometres(own.now_largest_um)}"
    left = f"the calibrated model leaves {micrometres(own.calibrated_um)} {where}"
    if own.place != "used":
        left += f" (of {micrometres(own.before_there_um)})"
    return f"{now}; {left}. {_judged(found)}"


def _judged(found: Diagnosis) -> str:
    by = {"tolerance": "--tolerance-um", "rig_file": "the limits of the rig file", "data_sheet": "the data sheet"}
    own = found.accuracy
    if own.standing is None or own.limit is None:
        return "Accuracy: not judged; give --tolerance-um, or limits in the rig file."
    return f"Accuracy: {own.standing}, by {by[own.limit]}."


def _large(found: Diagnosis) -> str:
    """What makes more than a third of the error and is no fault, as a sentence; nothing where nothing does."""
    parts = [one for one in found.budget if one.share > LARGE_SHARE and one.sigma >= CERTAIN_SIGMA]
    said = [
        f"{percent(one.share)} of the error comes from {part_name(found, one)}{_size_of(found, one)}"
        for one in parts
        if one.kind not in ("scatter", "unexplained") and one.rank != "unusual" and one.doubt not in _IMITATES
    ]
    return f"{'; '.join(said)}." if said else ""


def _size_of(found: Diagnosis, part: BudgetPart) -> str:
    if part.index is None:
        return ""
    times = f", {part.times_usual:.1f} × usual" if part.times_usual and math.isfinite(part.times_usual) else ""
    return f" ({size(found.effects[part.index])}{times})"


def _makes(found: Diagnosis, one: Named) -> str:
    part = next((part for part in found.budget if part.index is not None and found.effects[part.index] is one), None)
    return f", {percent(part.share)} of the error" if part else ""


def _unexplained(found: Diagnosis) -> str:
    left = found.remainder
    return f"{micrometres(left.um)} rms, {percent(left.share)} of its energy"


def part_name(found: Diagnosis, part: BudgetPart) -> str:
    """A part of the budget as a person says it."""
    if part.index is not None:
        return plain(found.rig, found.effects[part.index].effect)
    of = joint(found.rig, part.axis) if part.axis else ""
    return {
        "constants": "the arm's constants and zeros",
        "gravity": "what yields under load",
        "curve": f"the angle error of {of} over its angle",
        "reversal": f"what {of} does where it turns back",
        "warming": "warming",
        "gauges": "gauges and ball",
        "clocks": "times of readings",
        "scatter": "scatter from run to run, and noise",
        "unexplained": "unexplained",
        "effect": part.name,
    }[part.kind]


def percent(share: float) -> str:
    """A share in percent, as many digits as a reader needs."""
    value = 100 * share
    return f"{value:.0f} %" if abs(value) >= 0.95 else f"{value:.1f} %"


def micrometres(um: float) -> str:
    """A size in µm as a person can use it: two digits below ten, whole numbers above."""
    if not math.isfinite(um):
        return "–"
    return f"{um:.0f} µm" if um >= 9.95 else f"{um:.1f} µm"


def doubt_words(doubt: Doubt) -> str:
    """Why the diagnosis does not stand by an effect."""
    return {
        "usual": "no larger than healthy arms, or this arm elsewhere, show",
        "healthy_shows_it": "a healthy arm may show it by chance",
        "rival": "another effect is likelier",
        "held_out": "makes held-out runs worse",
        "unsure": "what it does is not known to half of itself",
        "contradicted": "set-ups show different shares of it",
        "series": "one of more waves than a joint has",
        "no_better": "the model explains these runs no better with it",
    }[doubt]


def _alternatives(found: Diagnosis) -> str:
    """Each name with those of its rivals that cannot be dismissed."""
    words = []
    for one in found.standing:
        likely = [rival.effect for rival in likely_rivals(one)]
        words.append(" or ".join(plain(found.rig, effect) for effect in (one.effect, *likely)))
    return "; ".join(words)


def runs_of(one: Place | Curve | ResidualBand) -> str:
    """`yaw acw`, `radial`."""
    return f"{one.test} {one.direction}" if one.direction else one.test


def stretch(place: Place) -> str:
    """Where on the circle, or at which targets: `231–243°`, `targets 3–7`."""
    low, high = place.from_deg, place.to_deg
    if place.test not in ("yaw", "roll"):
        what = "row" if place.test == "pose" else "target"
        return f"{what} {low:.0f}" if low == high else f"{what}s {low:.0f}–{high:.0f}"
    return "whole lap" if whole_lap(place) else f"{low:.0f}–{high:.0f}°"


def whole_lap(place: Place) -> bool:
    """Whether a place is the circle from end to end."""
    turn = place.to_deg - place.from_deg
    return turn >= 360 or turn % 360 >= _WHOLE_LAP_DEG


def closed(gap: Gap) -> float:
    """Share of the gap's energy that the names and a healthy arm's share of everything remove; nan without a gap."""
    return 1 - (gap.calibrated_um / gap.before_um) ** 2 if gap.before_um > 0 else math.nan


def shortened(names: Iterable[str]) -> str:
    """Names of effects, those of one kind together, as an effect and all the seats that it has."""
    seats: dict[str, list[str]] = {}
    for name in names:
        kind, _, seat = name.partition(" ")
        seats.setdefault(kind, []).append(seat)
    return ", ".join(" ".join([kind, *sorted(filter(None, own))]) for kind, own in seats.items())
