"""What a diagnosis found, a sentence for each effect, with its remedy and what the remedy is worth."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.diagnosis import Diagnosis, Named, Rival
from analysis.reporting.diagnosis_words import (
    accuracy_words,
    headline,
    likely_rivals,
    micrometres,
    plain,
    remedy,
    size,
    sure,
)
from analysis.reporting.page.texts import Texts
from rigs.effects import Effect
from rigs.rig import Rig
from rigs.schema.vocabulary import CIRCLES

_MOST_GROUPS = 3
_SAME_DEG = 15.0
"""Places on the circle nearer than this are one reversal, seen in two runs."""


@dataclass(frozen=True)
class Finding:
    """One effect in sentences: what is wrong and how much, where it shows, how much of the error it is, which others it
    could be, what to do (the effect's own words), and what that is worth."""

    what: str
    where: str
    share: str
    rivals: str
    remedy: str
    worth: str
    sure: str


def findings_of(found: Diagnosis, texts: Texts) -> list[Finding]:
    """The effects that a diagnosis stands by, the one that is worth most first."""
    return [_finding(found, one, texts) for one in sorted(found.standing, key=lambda one: -one.worth_um)]


def _finding(found: Diagnosis, one: Named, texts: Texts) -> Finding:
    others = " · ".join(_said(found.rig, rival.effect, rival, texts) for rival in likely_rivals(one))
    before, after = found.train.before_um, found.train.after_um
    worth = texts("worth", worth=micrometres(one.worth_um))
    if len(found.standing) == 1:
        worth += " " + texts("worth_gap", before=micrometres(before), after=micrometres(after))
    return Finding(
        what=_said(found.rig, one.effect, one, texts),
        where=_where(found, one, texts),
        share=_share(found, one, texts),
        rivals=texts("rivals", others=others) if others else "",
        remedy=remedy(one),
        worth=worth,
        sure=texts("sure", share=sure(one.posterior)),
    )


def _said(rig: Rig, effect: Effect, one: Named | Rival, texts: Texts) -> str:
    """The sentence of an effect; one for which the language has none is said in the effect's own words."""
    template = texts.effects.get(effect.effect)
    if template is None:
        words = plain(rig, effect)
        return f"{words[:1].upper()}{words[1:]}: {size(one)}."
    axis = getattr(effect, "axis", None)
    joint = rig.robot.axes[axis - 1].name if axis else ""
    fields = {name: value for name, value in effect.model_dump().items() if isinstance(value, int | float | str)}
    return template.format(**fields | {"size": size(one), "joint": f"{joint[:1].upper()}{joint[1:]}"})


def _where(found: Diagnosis, one: Named, texts: Texts) -> str:
    """At which places of the circle the effect's joint turns back and the readings disagree, and how much there."""
    axis = getattr(one.effect, "axis", None)
    places = [place for place in found.where if axis is not None and place.joint == axis and place.test in CIRCLES]
    if not places:
        return ""
    middles: list[float] = []
    for place in sorted(places, key=lambda place: -place.sigma):
        middle = (place.from_deg + ((place.to_deg - place.from_deg) % 360.0) / 2) % 360.0
        if all(abs((middle - other + 180.0) % 360.0 - 180.0) > _SAME_DEG for other in middles):
            middles.append(middle)
    largest_um = max(place.rms_um for place in places)
    listed = texts("and").join(f"{middle:.0f}°" for middle in sorted(middles))
    return texts("where", places=listed, um=micrometres(largest_um))


def _share(found: Diagnosis, one: Named, texts: Texts) -> str:
    """How much of the gap is this effect's: what comes back if it alone is taken out of the model again."""
    before, after, without = found.train.before_um, found.train.after_um, one.gap_without_um
    if not (math.isfinite(before) and math.isfinite(after) and math.isfinite(without)):
        return ""
    share = min(before, float(np.sqrt(max(0.0, without**2 - after**2))))
    return texts("share", share=micrometres(share), whole=micrometres(before))


def open_question(found: Diagnosis) -> str:
    """What a diagnosis could not answer, in its own words; nothing where it named a cause or found none."""
    return headline(found) if found.condition in ("outside_library", "not_testable_here") else ""


def diagnosis_words(found: Diagnosis) -> str:
    """What the diagnosis concluded, what remains, what these tests cannot distinguish, and which test to run next, in
    its own words."""
    remainder = found.remainder
    lines = [headline(found), accuracy_words(found)]
    lines.append(f"Unexplained: {micrometres(remainder.um)}, {remainder.words}.")
    lines += [f"These tests cannot distinguish {' from '.join(group)}." for group in found.groups[:_MOST_GROUPS]]
    if found.next_test:
        lines.append(f"Next test: {found.next_test.test}, {found.next_test.why}.")
    return " ".join(filter(None, lines))
