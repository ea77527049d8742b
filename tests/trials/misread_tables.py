"""Import of tables whose joints have other zeros, directions or units than the arm, of sound and home-made arms.

Home-made arms have errors that rig does not model, rounded angles and wrong places (`tests.support.misread_joints`). A
table is *right* if the import reads it as it is, or offers that first; *equivalent* if these places do not distinguish
the reading from the truth; *asked* if the truth is another answer or the table is refused; otherwise *wrong*.
"""

from __future__ import annotations

import sys
import tempfile
from argparse import Namespace
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.support.misread_joints import draw_homemade, draw_misread, outcome_of
from tests.support.trial import Trial, main, markdown, seeds

_DRAW = {"sound": draw_misread, "home-made": draw_homemade}
OUTCOMES = ("right", "equivalent", "asked", "wrong")


@dataclass(frozen=True)
class Case:
    kind: str
    seed: int


@dataclass(frozen=True)
class Result:
    case: Case
    table: str
    outcome: str
    answer: str


def draw(given: Namespace) -> Iterator[Case]:
    for seed in seeds(given):
        yield from (Case(kind, seed) for kind in given.kinds)


def judged(case: Case) -> Result:
    table = _DRAW[case.kind](np.random.default_rng([98, case.seed]))
    with tempfile.TemporaryDirectory() as folder:
        return Result(case, table.words, *outcome_of(table, Path(folder)))


def line(result: Result) -> str:
    if result.outcome in ("right", "equivalent"):
        return ""
    return f"{result.case.kind} {result.case.seed}, {result.table}: {result.outcome}: {result.answer}"


def report(results: Sequence[Result]) -> str:
    rows = []
    for kind in _DRAW:
        counts = Counter(result.outcome for result in results if result.case.kind == kind)
        rows.append((kind, counts.total(), *(counts[outcome] for outcome in OUTCOMES)))
    return markdown(("arm", "tables", *OUTCOMES), [row for row in rows if row[1]])


TRIAL = Trial(
    draw, judged, report, line, failed=lambda results: any(result.outcome == "wrong" for result in results), count=100,
    options={"kinds": (tuple(_DRAW), "kinds of arms (all)", tuple(_DRAW))},
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(main(TRIAL))
