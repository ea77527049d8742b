"""The figures to beat (diagnosis.md): truths and answers in, the table out.

A name counts as right where it is the hidden one or of its class: what no data of these tests can part. An answer
that is missing or broken counts as one that says nothing. Shares come with 95 % Wilson intervals.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.trials.blind.answers import CONDITIONS, Answer, Named, answer_of

INSIDE = ("one", "two", "three", "wrong_form", "dense")
_Z = 1.959964


@dataclass(frozen=True)
class Case:
    """A truth beside its answer. hidden: names; classes: by hidden name what counts as it."""

    truth: Mapping[str, Any]
    answer: Answer

    @property
    def kind(self) -> str:
        return str(self.truth["kind"])

    @property
    def hidden(self) -> list[str]:
        return [one["name"] for one in self.truth["hidden"]]

    def pairs(self) -> list[tuple[Mapping[str, Any], Named]]:
        """Each hidden effect with the named one that is it, the very name before one of its class; each used once."""
        left, found = list(self.answer.effects), []
        for same in (lambda one: {one["name"]}, lambda one: set(one["class"])):
            for one in self.truth["hidden"]:
                if any(one is other for other, _ in found):
                    continue
                match = next((named for named in left if named.name in same(one)), None)
                if match:
                    left.remove(match)
                    found.append((one, match))
        return found

    @property
    def exact(self) -> bool:
        return len(self.pairs()) == len(self.hidden) == len(self.answer.effects)

    @property
    def listed(self) -> bool:
        """Whether every hidden effect stands in the answer, as a name or as a rival."""
        said = {name for named in self.answer.effects for name in (named.name, *named.rivals)}
        return all(said & set(one["class"]) for one in self.truth["hidden"])


@dataclass(frozen=True)
class Row:
    """One figure: its goal in words, its value in words, whether it is reached; None where there is no case for it."""

    figure: str
    goal: str
    value: str
    reached: bool | None


def cases_of(truths: Iterable[Mapping[str, Any]], answers: Mapping[str, Mapping[str, Any] | None]) -> list[Case]:
    """Truths with the answers that bear their cases' names."""
    return [Case(truth, answer_of(answers.get(truth["case"]))) for truth in truths]


def wilson(hits: int, n: int) -> tuple[float, float]:
    """95 % interval of a share (Wilson 1927)."""
    if not n:
        return 0.0, 1.0
    p, z = hits / n, _Z**2 / n
    half = _Z * math.sqrt(p * (1 - p) / n + z / (4 * n))
    return max(0.0, (p + z / 2 - half) / (1 + z)), min(1.0, (p + z / 2 + half) / (1 + z))


def rows_of(cases: Sequence[Case]) -> list[Row]:
    """The table of diagnosis.md, in its order."""
    of = {kind: [case for case in cases if case.kind == kind] for kind in ("none", "outside", *INSIDE)}
    inside = [case for kind in INSIDE for case in of[kind]]
    known = [case for kind in ("one", "two", "three") for case in of[kind]]
    return [
        _share("one hidden effect: exact name", 0.98, of["one"], _exact),
        _share("  truth in the list", 0.995, of["one"], _listed),
        _share("two hidden: exact", 0.92, of["two"], _exact),
        *_precision(of["two"]),
        _share("three hidden: exact", 0.80, of["three"], _exact),
        _share("right name, wrong form: exact", 0.85, of["wrong_form"], _exact),
        _share("  truth in the list", 0.95, of["wrong_form"], _listed),
        _share("all others at 20 % of their limit: exact", 0.95, of["dense"], _exact),
        _share("healthy arm: something named", 0.005, of["none"], _names, most=True),
        _share("outside the library: flagged", 0.98, of["outside"], _flagged),
        _share("  wrong name kept", 0.01, of["outside"], _names, most=True),
        _share("inside the library, called outside", 0.03, inside, _flagged, most=True),
        *_gaps([case for case in known if case.exact]),
        *_sizes(known),
        time_row([case.answer for case in cases], 2.0),
        _share("answers missing or broken", 0.0, cases, _missing, most=True),
    ]


def _exact(case: Case) -> bool:
    return case.exact


def _listed(case: Case) -> bool:
    return case.listed


def _names(case: Case) -> bool:
    return bool(case.answer.effects)


def _flagged(case: Case) -> bool:
    return case.answer.condition == "outside_library"


def _missing(case: Case) -> bool:
    return case.answer.condition not in CONDITIONS


def _share(figure: str, goal: float, cases: Sequence[Case], test: Callable[[Case], bool], *, most: bool = False) -> Row:
    return counted(figure, goal, sum(map(test, cases)), len(cases), most=most)


def counted(figure: str, goal: float, hits: int, n: int, *, most: bool = False) -> Row:
    sign = "≤" if most else "≥"
    if not n:
        return Row(figure, f"{sign} {100 * goal:g} %", "no cases", None)
    low, high = wilson(hits, n)
    value = f"{100 * hits / n:.1f} % ({100 * low:.1f} … {100 * high:.1f}), {hits} of {n}"
    return Row(figure, f"{sign} {100 * goal:g} %", value, hits / n <= goal if most else hits / n >= goal)


def _precision(cases: Sequence[Case]) -> list[Row]:
    right = sum(len(case.pairs()) for case in cases)
    named = sum(len(case.answer.effects) for case in cases)
    hidden = sum(len(case.hidden) for case in cases)
    return [counted("  precision", 0.97, right, named), counted("  recall", 0.96, right, hidden)]


def _gaps(cases: Sequence[Case]) -> list[Row]:
    held = [1 - case.answer.left["held_out"] for case in cases if "held_out" in case.answer.left]
    unseen = [case.answer.left["unseen_place"] for case in cases if "unseen_place" in case.answer.left]
    return [
        quantile("gap removed, run left out: median", 0.995, held, 50),
        quantile("  p10", 0.97, held, 10),
        quantile("left at an unseen place: p90", 0.08, unseen, 90, most=True),
    ]


def quantile(figure: str, goal: float, values: Sequence[float], percent: float, *, most: bool = False) -> Row:
    sign = "≤" if most else "≥"
    if not len(values):
        return Row(figure, f"{sign} {100 * goal:g} %", "no cases", None)
    value = float(np.percentile(values, percent))
    text = f"{100 * value:.2f} % of {len(values)}"
    return Row(figure, f"{sign} {100 * goal:g} %", text, value <= goal if most else value >= goal)


def _sizes(cases: Sequence[Case]) -> list[Row]:
    """Of effects named by their very name."""
    errors, covered = [], []
    for case in cases:
        for one, named in case.pairs():
            value, sd = named.parameters.get(one["size"], (math.nan, math.nan))
            truth = float(one["parameters"][one["size"]])
            if named.name == one["name"] and math.isfinite(value):
                errors.append(abs(value / truth - 1))
                covered += [abs(value - truth) <= 2 * sd] * math.isfinite(sd)
    cover = counted("  2-sigma cover", 0.93, sum(covered), len(covered))
    if covered:
        cover = Row(cover.figure, "93 … 97 %", cover.value, 0.93 <= np.mean(covered) <= 0.97)
    return [
        quantile("size: median error", 0.01, errors, 50, most=True),
        quantile("  p90 error", 0.10, errors, 90, most=True),
        cover,
    ]


def time_row(answers: Iterable[Answer], most_s: float) -> Row:
    seconds = [answer.seconds for answer in answers if math.isfinite(answer.seconds)]
    if not seconds:
        return Row("time a case", f"≤ {most_s:g} s", "no cases", None)
    text = f"median {np.median(seconds):.2f} s, p90 {np.percentile(seconds, 90):.2f} s, most {max(seconds):.1f} s"
    return Row("time a case", f"≤ {most_s:g} s", text, bool(np.median(seconds) <= most_s))


def confusions(cases: Sequence[Case]) -> list[tuple[str, str, int]]:
    """Return (hidden, stated, count), most frequent first; `-` for a missing side."""
    counts: Counter[tuple[str, str]] = Counter()
    for case in cases:
        counts.update(_confused(case))
    return [(one, other, count) for (one, other), count in counts.most_common()]


def _confused(case: Case) -> list[tuple[str, str]]:
    """Every hidden name that was missed with every wrong name that was said."""
    if case.kind == "outside":
        return [(f"({case.truth['outside']['effect']})", named.name) for named in case.answer.effects]
    if case.exact:
        return []
    good = case.pairs()
    missed = [one["name"] for one in case.truth["hidden"] if not any(one is other for other, _ in good)]
    wrong = [named.name for named in case.answer.effects if not any(named is other for _, other in good)]
    return [(one, other) for one in missed or ["-"] for other in wrong or [f"- ({case.answer.condition})"]]


def notes(cases: Sequence[Case]) -> list[str]:
    """What helps to read the table: conditions by kind, and misses that a nearer look could hardly have avoided."""
    lines = []
    for kind in dict.fromkeys(case.kind for case in cases):
        conditions = Counter(case.answer.condition for case in cases if case.kind == kind)
        lines.append(f"{kind}: " + ", ".join(f"{count} {said}" for said, count in conditions.most_common()))
    missed = [case for case in cases if case.kind in INSIDE and not case.exact]
    near = sum(any(one["nearest_rival"]["sigma"] < 3 for one in case.truth["hidden"]) for case in missed)
    lines.append(f"{near} of {len(missed)} misses inside the library have a rival nearer than 3 sigma")
    return lines


def table(rows: Sequence[Row]) -> list[str]:
    """Lines of figure, goal, value and whether it is reached."""
    width, wide = (max(len(text) for text in column) for column in ([r.figure for r in rows], [r.goal for r in rows]))
    mark = {True: "reached", False: "NOT REACHED", None: ""}
    lines = [f"{'figure':{width}}  {'goal':{wide}}  value"]
    return lines + [
        f"{row.figure:{width}}  {row.goal:{wide}}  {row.value}  {mark[row.reached]}".rstrip() for row in rows
    ]


def report(cases: Sequence[Case], most_pairs: int = 25) -> str:
    """The table, the confusion pairs and the notes, as text."""
    lines = table(rows_of(cases))
    pairs = confusions(cases)[:most_pairs]
    lines += ["", "hidden → named instead, how often:"] * bool(pairs)
    lines += [f"  {one} → {other}: {count}" for one, other, count in pairs]
    return "\n".join([*lines, "", *notes(cases)])
