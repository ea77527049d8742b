"""The figures to beat in real cells (real-cells.md): truths and answers in, the table out.

A name is right where it is a fault or its twin, which no data of these tests can tell apart. Any other is wrong unless
the arm really has so much of it: from 5 healthy sizes on. Only names that stand count. Shares come with 95 % Wilson
intervals.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

from tests.support.rates import Row, counted, quantile, table, time_row
from tests.trials.blind.answers import Answer, Named, answer_of
from tests.worlds.stranger.faults import SIZE

FAULTY = 5.0
"""Healthy sizes from which an effect is a fault (real-cells.md, "The healthy arm")."""
ASSUMED = ("healthy", "one", "one_large", "two", "three")
"""Kinds whose noise and background are those of the specification: odds and sizes are scored on these."""
SHIFTED = ("background_low", "background_high", "heavy_tails", "off_grid", "dirty")
_SIZE_U, _SIZE_SHARE, _ORDER_SHARE = 3.0, 0.5, 0.05
"""A healthy size is right within three of its uncertainties or half of the size, and an order within 5 %."""
GIVEN = 0.2
"""Share of a foreign signal's energy that a wrong name may take."""


@dataclass(frozen=True)
class RealCase:
    """The hidden truth of a cell, and the answer of rig."""

    truth: Mapping[str, Any]
    answer: Answer

    @property
    def kind(self) -> str:
        return str(self.truth["kind"])

    @property
    def testable(self) -> bool:
        """Whether an oracle would see every fault."""
        return all(one["testable"] for one in self.truth["hidden"])

    @property
    def standing(self) -> list[Named]:
        return [named for named in self.answer.listed if named.stands]

    @property
    def wrong(self) -> list[Named]:
        """Material names whose true size is healthy."""
        return [named for named in self.standing if not (self.fault_of(named.name) or self._is_large(named.name))]

    def fault_of(self, name: str) -> Mapping[str, Any] | None:
        """The hidden fault of this name, otherwise one that changes the readings in the same way."""
        hidden = self.truth["hidden"]
        very = [one for one in hidden if one["name"] == name]
        return next(iter(very + [one for one in hidden if name in one["class"]]), None)

    def said(self, name: str) -> str:
        """Fault to which a name belongs, or the name itself."""
        fault = self.fault_of(name)
        return name if fault is None else str(fault["name"])

    def _is_large(self, name: str) -> bool:
        own = [one for one in self.truth["background"] if one["name"] == name]
        return any(abs(size_of(one)) >= FAULTY * one["healthy"] for one in own)

    def has(self, named: Named) -> bool | None:
        """Whether the arm has what a name says: a fault or large effect, or a healthy one of about the named size.

        None for a further wave of a rough gear or ball, whose orders are not in the truth.
        """
        if self.fault_of(named.name) or self._is_large(named.name):
            return True
        judged = [_is_as_named(one, named) for one in self.truth["background"] if one["name"] == named.name]
        return True if True in judged else None if None in judged else False

    @property
    def first(self) -> bool:
        return bool(self.standing) and self.fault_of(self.standing[0].name) is not None

    @property
    def listed(self) -> bool:
        """Whether a fault stands in the answer, as a name or as a rival of one."""
        said = {name for named in self.standing for name in (named.name, *named.rivals)}
        return any(said & set(one["class"]) for one in self.truth["hidden"])

    @property
    def all_named(self) -> bool:
        said = {named.name for named in self.standing}
        return all(said & set(one["class"]) for one in self.truth["hidden"])

    @property
    def outside(self) -> bool:
        return self.answer.condition == "outside_library"

    @property
    def tells_foreign(self) -> bool:
        """Called outside, or a remainder told of at least half its size."""
        return self.outside or self.answer.remainder_um >= 0.5 * self.truth["outside"][0]["rms_um"]

    @property
    def gives_foreign_away(self) -> bool:
        """Whether a wrong name takes more than a fifth of its energy."""
        most = GIVEN * self.truth["outside"][0]["rms_um"] ** 2
        return any(not named.worth_um**2 <= most for named in self.wrong)


def size_of(one: Mapping[str, Any]) -> float:
    """Of a fault of the background: the one parameter that is no shape."""
    return float(next(iter(one["parameters"].values())))


def _is_as_named(one: Mapping[str, Any], named: Named) -> bool | None:
    """Whether an effect of the background has about the size of a name; None if it is a wave of another order."""
    order, _ = named.parameters.get("order", (math.nan, math.nan))
    if "order" in one["parameters"] and abs(order / one["parameters"]["order"] - 1) > _ORDER_SHARE:
        return None
    true, (size, u) = abs(size_of(one)), named.parameters[SIZE[one["effect"]]]
    return bool(abs(abs(size) - true) <= max(_SIZE_U * u, _SIZE_SHARE * true))


def real_cases_of(
    truths: Iterable[Mapping[str, Any]], answers: Mapping[str, Mapping[str, Any] | None]
) -> list[RealCase]:
    return [RealCase(truth, answer_of(answers.get(truth["case"]))) for truth in truths]


def rows_of(cases: Sequence[RealCase]) -> list[Row]:
    """The table of real-cells.md, in its order."""

    def of(*kinds: str, testable: bool = True) -> list[RealCase]:
        return [case for case in cases if case.kind in kinds and (case.testable or not testable)]

    healthy, large, third = of("healthy"), of("foreign_large"), of("foreign_third")
    seen_foreign = [case for case in third if case.truth["outside"][0]["testable"]]
    known = of("one", "one_large", "two", "three")
    return [
        _share("healthy arm: a name that is not there", 0.01, healthy, lambda c: bool(c.wrong), most=True),
        _share("  called outside", 0.02, healthy, lambda c: c.outside, most=True),
        _share("one fault, testable: first and right", 0.97, of("one"), lambda c: c.first),
        _share("  in the list", 0.98, of("one"), lambda c: c.listed),
        _share("  at least 8 × healthy: first and right", 0.99, of("one_large"), lambda c: c.first),
        _share("  at least 8 × healthy: in the list", 0.995, of("one_large"), lambda c: c.listed),
        _share("two faults, testable: all named", 0.93, of("two"), lambda c: c.all_named),
        _share("three faults, testable: all named", 0.93, of("three"), lambda c: c.all_named),
        _wrong("names whose true size is healthy", of(*ASSUMED, testable=False)),
        *_removed(known),
        _sizes(known),
        _share("foreign and larger than all else: called outside", 0.97, large, lambda c: c.outside),
        _share("  a wrong name given more than a fifth", 0.02, large, lambda c: c.gives_foreign_away, most=True),
        _share("foreign, a third of the fault: fault named", 0.93, third, lambda c: c.all_named),
        _share("  reported, where visible", 0.90, seen_foreign, lambda c: c.tells_foreign),
        _share("  a wrong name given more than a fifth", 0.02, third, lambda c: c.gives_foreign_away, most=True),
        *[row for kind in SHIFTED for row in _shifted(kind, of(kind), of(kind, testable=False))],
        _rates(cases),
        time_row([case.answer.seconds for case in cases if case.kind not in ("rate_500", "rate_4000")], 3.0),
        _share("answers missing or broken", 0.0, cases, lambda c: c.answer.condition == "none", most=True),
    ]  # fmt: skip


def _share(
    figure: str, goal: float, cases: Sequence[RealCase], test: Callable[[RealCase], bool], *, most: bool = False
) -> Row:
    return counted(figure, goal, sum(map(test, cases)), len(cases), most=most)


def _wrong(figure: str, cases: Sequence[RealCase]) -> Row:
    return counted(figure, 0.02, sum(len(c.wrong) for c in cases), sum(len(c.standing) for c in cases), most=True)


def _shifted(kind: str, testable: Sequence[RealCase], every: Sequence[RealCase]) -> list[Row]:
    return [
        _share(f"{kind}: first and right", 0.92, testable, lambda case: case.first),
        _wrong("  wrong names that stand", every),
    ]


def _removed(cases: Sequence[RealCase]) -> list[Row]:
    """Of every case, whatever was named: an answer without names removes nothing."""
    removed = [1 - case.answer.left["unseen_place"] for case in cases if "unseen_place" in case.answer.left]
    return [
        quantile("gap of the faults removed at an unseen place (energy): median", 0.999, removed, 50),
        quantile("  p10", 0.98, removed, 10),
    ]


def _sizes(cases: Sequence[RealCase]) -> Row:
    """Of faults named by their very name: the truth is planted and healthy share."""
    covered = []
    for case in cases:
        for named in case.standing:
            one = case.fault_of(named.name)
            if one is None or one["name"] != named.name:
                continue
            value, sd = named.parameters.get(one["size"], (math.nan, math.nan))
            if math.isfinite(value) and math.isfinite(sd):
                covered.append(abs(value - one["parameters"][one["size"]]) <= 2 * sd)
    row = counted("size: truth within 2 u", 0.93, sum(covered), len(covered))
    if not covered:
        return row
    return Row(row.figure, "93 … 97 %", row.value, 0.93 <= sum(covered) / len(covered) <= 0.97)


def _rates(cases: Sequence[RealCase]) -> Row:
    """Cases of one seed at all rates that were tried, with one condition and the same names."""
    by_seed: dict[int, list[tuple[str, frozenset[str]]]] = {}
    for case in cases:
        if case.kind.startswith("rate_"):
            said = case.answer.condition, frozenset(case.said(named.name) for named in case.standing)
            by_seed.setdefault(case.truth["seed"], []).append(said)
    groups = [said for said in by_seed.values() if len(said) > 1]
    return counted(
        "50, 500, 4000 Hz: same condition and names", 0.98, sum(len(set(g)) == 1 for g in groups), len(groups)
    )


def notes(cases: Sequence[RealCase]) -> list[str]:
    """Verdicts by kind, how many cases are testable, and the commonest wrong names."""
    lines = []
    for kind in dict.fromkeys(case.kind for case in cases):
        own = [case for case in cases if case.kind == kind]
        conditions = ", ".join(f"{n} {said}" for said, n in Counter(c.answer.condition for c in own).most_common())
        seconds = [case.answer.seconds for case in own if math.isfinite(case.answer.seconds)]
        line = f"{kind}: {sum(case.testable for case in own)} of {len(own)} testable; {conditions}"
        lines.append(f"{line}; {median(seconds):.1f} s a case" if seconds else line)
    wrong = Counter(named.name for case in cases for named in case.wrong)
    missed = [
        (one["name"], bool({named.name for named in case.answer.listed} & set(one["class"])))
        for case in cases
        for one in case.truth["hidden"]
        if one["testable"] and not {named.name for named in case.standing} & set(one["class"])
    ]
    below = Counter(name for name, is_listed in missed if is_listed)
    unseen = Counter(name for name, is_listed in missed if not is_listed)
    listed = (
        ("wrong names", wrong), ("testable faults missed", unseen), ("testable faults found, but not stood by", below)
    )  # fmt: skip
    for what, names in listed:
        if names:
            lines.append(f"{what}: " + ", ".join(f"{name} ({count})" for name, count in names.most_common(15)))
    return lines


def real_report(cases: Sequence[RealCase]) -> str:
    """The table and the notes, as text."""
    return "\n".join([*table(rows_of(cases)), "", *notes(cases)])


def as_json(cases: Sequence[RealCase]) -> dict[str, Any]:
    return {"figures": [row.__dict__ for row in rows_of(cases)]}
