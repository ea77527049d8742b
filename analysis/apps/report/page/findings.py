"""The diagnosis on the page: faults in sentences, and tables with bars of the error budget and the staircase."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from analysis.apps.report.answer_words import AnswerWords, fields_of, part_of, shown_parts
from analysis.apps.report.diagnosis_words import error_size, micrometres, percent, size, sure
from analysis.apps.report.stairs import residual_words, stairs_of
from analysis.apps.report.texts import Texts
from analysis.diagnosis.judge.result import Diagnosis, Named, Rival, likely_rivals
from rigs.effect_names import name_in_words
from rigs.effects import Effect
from rigs.schema.vocabulary import CIRCLES

_MOST_GROUPS = 3
_SAME_DEG = 15.0
"""Distance below which places on the circle count as the same reversal, seen in two runs."""


@dataclass(frozen=True)
class FaultText:
    """A fault in sentences: cause and size, place, share of the error, rivals and indistinguishable effects, and odds.

    The recommended acts are listed separately.
    """

    what: str
    where: str
    share: str
    others: tuple[str, ...]
    sure: str


def findings_of(diagnosis: Diagnosis, texts: Texts) -> list[FaultText]:
    """Return the faults of a diagnosis, largest part of the error first."""
    words, findings = AnswerWords(diagnosis, texts), []
    for named in sorted(diagnosis.standing, key=lambda named: -named.contribution_um):
        rivals = " · ".join(_sentence(words, rival.effect, rival) for rival in likely_rivals(named))
        twins = texts("and").join(words.noun(twin) for twin in named.twins)
        others = [texts("rivals", others=rivals)] if rivals else []
        others += [texts("twins", others=twins)] if twins else []
        part = part_of(diagnosis, named)  # share of the error, if known
        made = ""
        if part is not None and math.isfinite(part.um):
            made = texts("made_of_error", share=percent(part.share), um=micrometres(part.um))
        finding = FaultText(
            what=_sentence(words, named.effect, named),
            where=_where(diagnosis, named, texts),
            share=made,
            others=tuple(others),
            sure=texts("sure", share=sure(named.probability)),
        )
        findings.append(finding)
    return findings


def _sentence(words: AnswerWords, effect: Effect, named: Named | Rival) -> str:
    """Return the sentence of an effect. If the language has none, return name and size."""
    template = words.texts.effects.get(effect.effect)
    if template is None:
        noun = words.noun(effect)
        return f"{noun[:1].upper()}{noun[1:]}: {size(named)}."
    axis = getattr(effect, "axis", None)
    joint = words.texts.axis(words.diagnosis.rig.robot, axis) if axis else ""
    sentence = template.format(**fields_of(effect) | {"size": size(named), "joint": joint})
    return f"{sentence[:1].upper()}{sentence[1:]}"


def _where(diagnosis: Diagnosis, named: Named, texts: Texts) -> str:
    """Return the places on the circle at which the faulty joint reverses and the readings disagree with the model."""
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
    """Return the unexplained rest, the indistinguishable effects and the next test, as English sentences."""
    remainder = diagnosis.remainder
    lines = [f"Unexplained error: {micrometres(remainder.um)} rms, {remainder.words}."]
    groups = diagnosis.groups[:_MOST_GROUPS]
    lines += [f"These tests cannot separate {'; '.join(map(name_in_words, group))}." for group in groups]
    if diagnosis.next_test:
        lines.append(f"Most useful next test: {diagnosis.next_test.test} ({diagnosis.next_test.why}).")
    return " ".join(lines)


_TENTHS = 1000
"""Tenths of a percent in 100 %."""


@dataclass(frozen=True)
class BudgetRow:
    """A row of the error budget on the page.

    beside: size, doubt, and sizes of cancelling parts. share: in percent. width: of the bar, in percent of the column.
    rank: class, possibly empty. rank_words: class as text. times: multiple of the usual size.
    """

    part: str
    beside: tuple[str, ...]
    um: str
    share: str
    width: float
    rank: str
    rank_words: str
    times: str


def budget_rows(diagnosis: Diagnosis, texts: Texts) -> list[BudgetRow]:
    """Return a row for each part of the error, and a row for all small parts. The shown shares add up to 100 %."""
    large, small = shown_parts(diagnosis)
    shares = [part.share for part in large] + ([sum(part.share for part in small)] if small else [])
    words, rows = AnswerWords(diagnosis, texts), []
    for k, (share, tenths) in enumerate(zip(shares, _tenths(shares), strict=True)):
        width, shown = 100 * share / max(shares), f"{tenths / 10:.1f} %"
        if k == len(large):
            rows.append(BudgetRow(texts.counted("smaller_parts", len(small)), (), "", shown, width, "", "", ""))
            continue
        part = large[k]
        doubt = [texts(f"doubt_{part.doubt}")] if part.doubt and part.doubt != "usual" else []
        row = BudgetRow(
            part=words.part_name(part),
            beside=tuple(filter(None, [words.size_of(part), *doubt, *words.describe_parts_alone(part.shown_together)])),
            um=error_size(part.um, part.u_um),
            share=shown,
            width=width,
            rank=part.rank or "",
            rank_words=words.rank_of(part),
            times=words.times_usual(part),
        )
        rows.append(row)
    return rows


def _tenths(shares: Sequence[float]) -> list[int]:
    """Round shares, which add up to 1, to tenths of a percent that add up to 1000.

    The shares with the largest rounding losses are rounded up.
    """
    exact = [_TENTHS * share for share in shares]
    whole = [math.floor(tenths) for tenths in exact]
    lost = _TENTHS - sum(whole)
    for k in sorted(range(len(exact)), key=lambda k: whole[k] - exact[k])[:lost]:
        whole[k] += 1
    return whole


@dataclass(frozen=True)
class StepRow:
    """A step: name, formatted residual at each place, bar widths in percent of the column, and a sentence for screen
    readers.
    """

    name: str
    left: tuple[str, ...]
    widths: tuple[float, ...]
    sentence: str


@dataclass(frozen=True)
class StepTable:
    """Rows of the steps, and column headings of the places."""

    places: tuple[str, ...]
    rows: tuple[StepRow, ...]


def step_table(diagnosis: Diagnosis, texts: Texts) -> StepTable | None:
    """Return the table of the staircase of a diagnosis, if it has any."""
    stairs = stairs_of(diagnosis, texts)
    if stairs is None:
        return None
    rows = []
    for number, step in enumerate(stairs.steps):
        widths = tuple(100 * residue.um / stairs.largest_um for residue in step.left)
        last = len(stairs.steps) - 1
        sentence = (
            texts("step_now", number=number, count=last, part=step.part)
            if step.part
            else texts("step_start", count=last, name=step.name)
        )
        rows.append(StepRow(step.name, tuple(map(residual_words, step.left)), widths, sentence))
    return StepTable(tuple(texts(f"runs_{place}") for place in stairs.places), tuple(rows))
