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
from typing import Any

from tests.support.rates import Row, counted, table, time_row
from tests.trials.blind.answers import Answer, Named, answer_of
from tests.worlds.stranger.faults import SIZE

FAULTY = 5.0
"""Healthy sizes from which an effect is a fault (real-cells.md, "The healthy arm")."""
ASSUMED = ("healthy", "one", "one_large", "two", "three")
"""Kinds whose noise and background are those of the specification: sizes are scored on these."""
SHIFTED = ("background_low", "background_high", "heavy_tails", "off_grid", "dirty")
_SIZE_U, _SIZE_SHARE, _ORDER_SHARE = 3.0, 0.5, 0.05
"""A healthy size is right within three of its uncertainties or half of the size, and an order within 5 %."""


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
        """True if an oracle would detect every fault."""
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
    def all_named(self) -> bool:
        said = {named.name for named in self.standing}
        return all(said & set(one["class"]) for one in self.truth["hidden"])

    @property
    def outside(self) -> bool:
        return self.answer.condition == "outside_library"

    def sizes_within_2u(self) -> list[bool]:
        """Sizes of faults named by their very name; the truth is the planted and the healthy share."""
        found = []
        for named in self.standing:
            one = self.fault_of(named.name)
            if one is not None and one["name"] == named.name:
                value, u = named.parameters.get(one["size"], (math.nan, math.nan))
                found.append(bool(abs(value - one["parameters"][one["size"]]) <= 2 * u))
        return found


def size_of(one: Mapping[str, Any]) -> float:
    """Size of a background fault: its only parameter that is not a shape."""
    return float(next(iter(one["parameters"].values())))


def _is_as_named(one: Mapping[str, Any], named: Named) -> bool | None:
    """True if a background effect has about the named size; None if it is a wave of another order."""
    order, _ = named.parameters.get("order", (math.nan, math.nan))
    if "order" in one["parameters"] and abs(order / one["parameters"]["order"] - 1) > _ORDER_SHARE:
        return None
    true, (size, u) = abs(size_of(one)), named.parameters[SIZE[one["effect"]]]
    return bool(abs(abs(size) - true) <= max(_SIZE_U * u, _SIZE_SHARE * true))


def real_cases_of(
    truths: Iterable[Mapping[str, Any]], answers: Mapping[str, Mapping[str, Any] | None]
) -> list[RealCase]:
    return [RealCase(truth, answer_of(answers.get(truth["case"]))) for truth in truths]


def _kinds(*kinds: str, testable: bool = True) -> Callable[[RealCase], bool]:
    return lambda case: case.kind in kinds and (case.testable or not testable)


_GOALS: tuple[tuple[str, float, Callable[[RealCase], bool], Callable[[RealCase], bool]], ...] = (
    ("healthy arm: no name that is not there", 0.99, _kinds("healthy"), lambda case: not case.wrong),
    ("  not called outside", 0.98, _kinds("healthy"), lambda case: not case.outside),
    ("one fault, testable: first and right", 0.97, _kinds("one"), lambda case: case.first),
    ("  at least 8 × healthy: first and right", 0.99, _kinds("one_large"), lambda case: case.first),
    ("two faults, testable: all named", 0.93, _kinds("two"), lambda case: case.all_named),
    ("three faults, testable: all named", 0.93, _kinds("three"), lambda case: case.all_named),
    ("foreign and larger than all else: called outside", 0.97, _kinds("foreign_large"), lambda case: case.outside),
    ("foreign, a third of the fault: fault named", 0.93, _kinds("foreign_third"), lambda case: case.all_named),
    *((f"{kind}: first and right", 0.92, _kinds(kind), lambda case: case.first) for kind in SHIFTED),
)
"""Figure, goal, cells that count, and whether a cell is right."""


def rows_of(cases: Sequence[RealCase]) -> list[Row]:
    """Shares of right cells, wrong names and sizes, with their goals."""
    rows = []
    for figure, goal, counts, is_right in _GOALS:
        own = [case for case in cases if counts(case)]
        rows.append(counted(figure, goal, sum(map(is_right, own)), len(own)))
    for kinds in (ASSUMED, *((kind,) for kind in SHIFTED)):
        own = [case for case in cases if case.kind in kinds]
        figure = f"wrong names in {', '.join(kinds)}"
        rows.append(counted(figure, 0.02, sum(len(c.wrong) for c in own), sum(len(c.standing) for c in own), most=True))
    known = [size for case in cases if _kinds(*ASSUMED)(case) for size in case.sizes_within_2u()]
    missing = sum(case.answer.condition == "none" for case in cases)
    return [
        *rows,
        counted("size: truth within 2 u", 0.93, sum(known), len(known)),
        time_row([case.answer.seconds for case in cases], 3.0),
        counted("answers missing or broken", 0.0, missing, len(cases), most=True),
    ]


def real_report(cases: Sequence[RealCase]) -> str:
    """The table, the conditions by kind and the commonest wrong names."""
    lines = [*table(rows_of(cases)), ""]
    for kind in dict.fromkeys(case.kind for case in cases):
        own = [case for case in cases if case.kind == kind]
        conditions = ", ".join(f"{n} {said}" for said, n in Counter(c.answer.condition for c in own).most_common())
        lines.append(f"{kind}: {sum(case.testable for case in own)} of {len(own)} testable; {conditions}")
    if wrong := Counter(named.name for case in cases for named in case.wrong):
        lines.append("wrong names: " + ", ".join(f"{name} ({count})" for name, count in wrong.most_common(15)))
    return "\n".join(lines)
