"""The parts of the error as rows of a table with a bar in each: the largest first, the small ones in one line."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from analysis.inference.result import BudgetPart, Diagnosis
from analysis.reporting.answer_words import AnswerWords, doubt_words, shown_parts
from analysis.reporting.diagnosis_words import beside_u
from analysis.reporting.texts import Texts

_TENTHS = 1000
"""Tenths of a percent in a whole."""


@dataclass(frozen=True)
class BudgetRow:
    """A part of the error. beside: its size and why it is no fault; share: in percent; start, width: of its bar in
    percent of the column; rank: its class, empty where it has none; rank_words: the class in words; times: how many
    times as much as usual it does."""

    part: str
    beside: tuple[str, ...]
    um: str
    share: str
    start: float
    width: float
    rank: str
    rank_words: str
    times: str


@dataclass(frozen=True)
class BudgetTable:
    """The rows of the parts, the line of the small ones, and whether a share is below zero, which is to be explained.
    zero: where the bars start, in percent of their column."""

    rows: tuple[BudgetRow, ...]
    negative: bool
    zero: float


def budget_table(found: Diagnosis, texts: Texts) -> BudgetTable | None:
    """The table of the budget of a diagnosis; None where it has none. The shares that are shown add up to 100 %."""
    if not found.budget:
        return None
    large, small = shown_parts(found)
    shares = [one.share for one in large] + ([sum(one.share for one in small)] if small else [])
    low, high = min(0.0, *shares), max(0.0, *shares)
    span = high - low or 1.0
    words, rows = AnswerWords(found, texts), []
    for k, (share, tenths) in enumerate(zip(shares, _tenths(shares), strict=True)):
        start, width = 100 * (min(share, 0.0) - low) / span, 100 * abs(share) / span
        shown = f"{tenths / 10:.1f} %".replace("-", "−")
        if k < len(large):
            rows.append(_row(large[k], words, shown, start, width))
        else:
            rows.append(BudgetRow(texts("smaller_parts", count=len(small)), (), "", shown, start, width, "", "", ""))
    return BudgetTable(tuple(rows), any(one.share < 0 for one in large), -100 * low / span)


def _row(part: BudgetPart, words: AnswerWords, share: str, start: float, width: float) -> BudgetRow:
    texts = words.texts
    doubt = [doubt_words(part.doubt, texts)] if part.doubt and part.doubt != "usual" else []
    return BudgetRow(
        part=words.part_name(part),
        beside=tuple(filter(None, [words.size_of(part), *doubt])),
        um=beside_u(part.um, part.u_um),
        share=share,
        start=start,
        width=width,
        rank=part.rank or "",
        rank_words=words.rank_of(part),
        times=words.times_usual(part),
    )


def _tenths(shares: Sequence[float]) -> list[int]:
    """Shares that add up to 1 in whole tenths of a percent that add up to 1000: what rounding leaves goes to those that
    lost most by it."""
    exact = [_TENTHS * one for one in shares]
    whole = [math.floor(one) for one in exact]
    left = _TENTHS - sum(whole)
    for k in sorted(range(len(exact)), key=lambda k: whole[k] - exact[k])[:left]:
        whole[k] += 1
    return whole
