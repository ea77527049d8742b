"""Answers of text gauges with lost, added or wrong characters: readings recorded wrong without a fault.

Each session reads a gauge in simulated time, over a line that damages one answer in twelve, also the first ones. The
gauge is near zero, near a power of ten or elsewhere, at rest or in motion. Of wrong readings without a fault, those
within three of the usual steps between readings count as *near*, because they look like motion, and those among the
last two of a session as *last two*, because a changed digit shows by later readings. A damaged answer can be right.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from tests.support.damaged_lines import DAMAGES, LOSSES, PRINTING, Recorded, recorded
from tests.support.trial import Trial, main, markdown, seeds


@dataclass(frozen=True)
class Session:
    gauge: str
    damage: str
    seed: int


def draw(given: Namespace) -> Iterator[Session]:
    gauges = [name for name in PRINTING if not given.gauges or any(word in name for word in given.gauges)]
    for seed in seeds(given):
        yield from (Session(gauge, damage, seed) for gauge in gauges for damage in given.damages)


def judged(session: Session) -> Recorded:
    return recorded(session.gauge, session.damage, session.seed)


def line(result: Recorded) -> str:
    return "\n".join(f"{result.gauge}, {result.damage}: {wrong}" for wrong in result.wrong + result.last)


def report(results: Sequence[Recorded]) -> str:
    head = (
        "damage",
        "damaged",
        "wrong without a fault",
        "last two",
        "near",
        "up to mm",
        "doubted",
        "right per good answer",
    )
    by_damage = [_row(name, [one for one in results if one.damage == name]) for name in DAMAGES]
    by_gauge = [_row(name, [one for one in results if one.gauge == name]) for name in PRINTING]
    rows = [row for row in (*by_damage, *by_gauge, _row("all", results)) if row[1]]
    return markdown(head, rows)


def _row(name: str, results: Sequence[Recorded]) -> tuple[object, ...]:
    def total(count: Callable[[Recorded], int]) -> int:
        return sum(map(count, results))

    near_mm = [mm for one in results for mm in one.near_mm]
    good = total(lambda one: one.sent - one.damaged)
    return (
        name,
        total(lambda one: one.damaged),
        total(lambda one: len(one.wrong)),
        total(lambda one: len(one.last)),
        len(near_mm),
        f"{max(near_mm, default=0.0):.4f}",
        total(lambda one: one.marked),
        f"{100 * total(lambda one: one.right) / max(1, good):.1f} %",
    )


def failed(results: Sequence[Recorded]) -> bool:
    return any(one.wrong + one.last for one in results if one.damage in LOSSES)


TRIAL = Trial(
    draw, judged, report, line, failed, count=2,
    options={
        "gauges": (("",), "words of their names (all)"),
        "damages": (tuple(DAMAGES), "kinds of damage (all)", tuple(DAMAGES)),
    },
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(main(TRIAL))
