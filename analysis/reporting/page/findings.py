"""The faults that a diagnosis found, in sentences: what is wrong, where it shows, and what it makes of the error."""

from __future__ import annotations

import math
from dataclasses import dataclass

from analysis.inference.result import Diagnosis, Named, Rival
from analysis.reporting.answer_words import AnswerWords, fields_of, part_of
from analysis.reporting.diagnosis_words import likely_rivals, micrometres, percent, size, sure
from analysis.reporting.texts import Texts
from rigs.effects import Effect
from rigs.schema.vocabulary import CIRCLES

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


def findings_of(diagnosis: Diagnosis, texts: Texts) -> list[Finding]:
    """The faults of a diagnosis, the one that makes most of the error first."""
    words, findings = AnswerWords(diagnosis, texts), []
    for named in sorted(diagnosis.standing, key=lambda named: -named.worth_um):
        rivals = " · ".join(_sentence(words, rival.effect, rival) for rival in likely_rivals(named))
        twins = texts("and").join(words.noun(twin) for twin in named.twins)
        others = [texts("rivals", others=rivals)] if rivals else []
        others += [texts("twins", others=twins)] if twins else []
        part = part_of(diagnosis, named)  # what it makes of the error, where that is known
        made = ""
        if part is not None and math.isfinite(part.um):
            made = texts("made_of_error", share=percent(part.share), um=micrometres(part.um))
        finding = Finding(
            what=_sentence(words, named.effect, named),
            where=_where(diagnosis, named, texts),
            share=made,
            others=tuple(others),
            sure=texts("sure", share=sure(named.posterior)),
        )
        findings.append(finding)
    return findings


def _sentence(words: AnswerWords, effect: Effect, named: Named | Rival) -> str:
    """The sentence of an effect; one for which the language has none is said as what it is called, and its size."""
    template = words.texts.effects.get(effect.effect)
    if template is None:
        noun = words.noun(effect)
        return f"{noun[:1].upper()}{noun[1:]}: {size(named)}."
    axis = getattr(effect, "axis", None)
    joint = words.texts.axis(words.diagnosis.rig.robot, axis) if axis else ""
    sentence = template.format(**fields_of(effect) | {"size": size(named), "joint": joint})
    return f"{sentence[:1].upper()}{sentence[1:]}"


def _where(diagnosis: Diagnosis, named: Named, texts: Texts) -> str:
    """At which places of the circle the fault's joint turns back and the readings disagree."""
    axis = getattr(named.effect, "axis", None)
    places = [place for place in diagnosis.where if axis is not None and place.joint == axis and place.test in CIRCLES]
    if not places:
        return ""
    middles: list[float] = []
    for place in sorted(places, key=lambda place: -place.sigma):
        middle = (place.from_deg + ((place.to_deg - place.from_deg) % 360.0) / 2) % 360.0
        if all(abs((middle - known_deg + 180.0) % 360.0 - 180.0) > _SAME_DEG for known_deg in middles):
            middles.append(middle)
    listed = texts("and").join(f"{middle:.0f}°" for middle in sorted(middles))
    return texts("where", places=listed)


def diagnosis_words(diagnosis: Diagnosis) -> str:
    """What remains unexplained, what these tests cannot distinguish, and which test to run next, in the diagnosis' own
    words."""
    remainder = diagnosis.remainder
    lines = [f"Unexplained: {micrometres(remainder.um)}, {remainder.words}."]
    lines += [f"These tests cannot distinguish {' from '.join(group)}." for group in diagnosis.groups[:_MOST_GROUPS]]
    if diagnosis.next_test:
        lines.append(f"Next test: {diagnosis.next_test.test}, {diagnosis.next_test.why}.")
    return " ".join(lines)
