"""Planted cases: every reported figure of every test in the noise of real cells, beside its truth.

Seeds below 50000 are for development; a published table uses `--seed 50000`.
"""

from __future__ import annotations

import json
import sys
import warnings
from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path

from tests.support.trial import Trial, main, seeds
from tests.trials.planted.score import CASES, CIRCLES, TABLE, Job, Point, as_json, points_of, report, scores_of

KINDS = tuple(dict.fromkeys([TABLE, *(kind for _, kinds in CASES.values() for kind in kinds)]))
OPTIONS = {
    "kind": (",".join(KINDS), f"some of {','.join(KINDS)} (all)"),
    "test": (",".join(CASES), f"some of {','.join(CASES)} (all); yaw has circularity and pairs with it"),
    "laps": ("2", "laps of a circle, visits of a target, or several: 1,2,3 (2)"),
    "rows": ("1500", "rows of a lap, or several: 1500,20000 (1500)"),
    "scores": (Path, "write the scores to this JSON file too"),
}
Result = tuple[Job, list[Point], Path | None]


def draw(given: Namespace) -> Iterator[tuple[Job, Path | None]]:
    rows = [int(one) for one in given.rows.split(",")]
    for laps in map(int, given.laps.split(",")):
        for test in given.test.split(","):
            for count in rows if test in CIRCLES else rows[:1]:
                for kind in given.kind.split(","):
                    if kind == TABLE or kind in CASES[test][1]:
                        yield from ((Job(test, kind, seed, laps, count), given.scores) for seed in seeds(given))


def judged(case: tuple[Job, Path | None]) -> Result:
    warnings.simplefilter("ignore")  # numpy's, of cases that have too few rows for a figure; the scores count them
    return case[0], points_of(case[0]), case[1]


def tables(done: Sequence[Result]) -> str:
    """The table of each number of laps and rows."""
    parts, found = [], []
    for laps, rows in dict.fromkeys((job.laps, job.rows) for job, *_ in done):
        own = [points for job, points, _ in done if (job.laps, job.rows) == (laps, rows)]
        scores = scores_of(point for points in own for point in points)
        parts.append(
            f"\n{laps} laps or visits, {rows} rows a lap: {len(own)} cases\n{report(scores, repeated=laps > 1)}"
        )
        found += as_json(scores, laps, rows)
    if file := done[0][2]:
        file.write_text(json.dumps(found, indent=1), encoding="utf-8")
    return "\n".join(parts)


TRIAL = Trial(draw, judged, tables, line=lambda one: "", count=40, options=OPTIONS)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
