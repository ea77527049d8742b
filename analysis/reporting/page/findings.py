"""The faults that a diagnosis found, in sentences: what is wrong, where it shows, and what it makes of the error."""

from __future__ import annotations

import math
from dataclasses import dataclass

from analysis.inference.result import Diagnosis, Named, Rival
from analysis.reporting.answer_words import AnswerWords, fields_of, part_of
from analysis.reporting.diagnosis_words import likely_rivals, micrometres, percent, size, sure
from analysis.reporting.texts import Texts
from rigs.effects import Effect
from rigs.schema.part import CIRCLES

_MOST_GROUPS = 3
_SAME_DEG = 15.0
"""Places on the circle nearer than this are one reversal, seen in two runs."""


@dataclass(frozen=True)
class Finding:
    """One fault in sentences: what is wrong and how much, where it shows, what it makes of the error, and what it could
    be instead or together with. What to do stands in the acts."""

    what: str
    where: str
    share: str
    others: tuple[str, ...]
    sure: str


def findings_of(found: Diagnosis, texts: Texts) -> list[Finding]:
    """The faults of a diagnosis, the one that makes most of the error first."""
    return [_finding(found, one, texts) for one in sorted(found.standing, key=lambda one: -one.worth_um)]


def _finding(found: Diagnosis, one: Named, texts: Texts) -> Finding:
    words = AnswerWords(found, texts)
    rivals = " · ".join(_said(words, rival.effect, rival) for rival in likely_rivals(one))
    twins = texts("and").join(words.noun(twin) for twin in one.twins)
    others = [texts("rivals", others=rivals)] if rivals else []
    others += [texts("twins", others=twins)] if twins else []
    return Finding(
        what=_said(words, one.effect, one),
        where=_where(found, one, texts),
        share=_share(found, one, texts),
        others=tuple(others),
        sure=texts("sure", share=sure(one.posterior)),
    )


def _said(words: AnswerWords, effect: Effect, one: Named | Rival) -> str:
    """The sentence of an effect; one for which the language has none is said as what it is called, and its size."""
    template = words.texts.effects.get(effect.effect)
    if template is None:
        noun = words.noun(effect)
        return f"{noun[:1].upper()}{noun[1:]}: {size(one)}."
    axis = getattr(effect, "axis", None)
    joint = words.texts.axis(words.found.rig.robot, axis) if axis else ""
    said = template.format(**fields_of(effect) | {"size": size(one), "joint": joint})
    return f"{said[:1].upper()}{said[1:]}"


def _where(found: Diagnosis, one: Named, texts: Texts) -> str:
    """At which places of the circle the fault's joint turns back and the readings disagree."""
    axis = getattr(one.effect, "axis", None)
    places = [place for place in found.where if axis is not None and place.joint == axis and place.test in CIRCLES]
    if not places:
        return ""
    middles: list[float] = []
    for place in sorted(places, key=lambda place: -place.sigma):
        middle = (place.from_deg + ((place.to_deg - place.from_deg) % 360.0) / 2) % 360.0
        if all(abs((middle - other + 180.0) % 360.0 - 180.0) > _SAME_DEG for other in middles):
            middles.append(middle)
    listed = texts("and").join(f"{middle:.0f}°" for middle in sorted(middles))
    return texts("where", places=listed)


def _share(found: Diagnosis, one: Named, texts: Texts) -> str:
    """What a fault makes of the error; empty where that is not known."""
    part = part_of(found, one)
    if part is None or not math.isfinite(part.um):
        return ""
    return texts("made_of_error", share=percent(part.share), um=micrometres(part.um))


def diagnosis_words(found: Diagnosis) -> str:
    """What remains unexplained, what these tests cannot distinguish, and which test to run next, in the diagnosis' own
    words."""
    remainder = found.remainder
    lines = [f"Unexplained: {micrometres(remainder.um)}, {remainder.words}."]
    lines += [f"These tests cannot distinguish {' from '.join(group)}." for group in found.groups[:_MOST_GROUPS]]
    if found.next_test:
        lines.append(f"Next test: {found.next_test.test}, {found.next_test.why}.")
    return " ".join(lines)
