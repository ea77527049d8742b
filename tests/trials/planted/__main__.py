"""Planted cases: every reported figure of every test in the noise of real cells, beside its truth."""

from __future__ import annotations

import argparse
import json
import sys
import time
import warnings
from collections.abc import Collection, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from tests.trials.planted.score import (
    CASES,
    CIRCLES,
    REPORTED,
    TABLE,
    Job,
    Point,
    as_json,
    points_of,
    report,
    scores_of,
)

KINDS = tuple(dict.fromkeys([TABLE, *(kind for _, kinds in CASES.values() for kind in kinds)]))


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="scripts/dev planted",
        description="Plant cases of every test, evaluate them, print how well the figures' uncertainties hold.",
        epilog=f"Seeds 0 to {REPORTED - 1} are for development; a published table uses --seed {REPORTED}.",
    )
    parser.add_argument("count", type=int, nargs="?", default=40, help="cases of each kind (40); a report has 300")
    parser.add_argument("--kind", help=f"some of {','.join(KINDS)} (all)")
    parser.add_argument("--test", help=f"some of {','.join(CASES)} (all); yaw has circularity and pairs with it")
    parser.add_argument("--laps", default="2", help="laps of a circle, visits of a target, or several: 1,2,3 (2)")
    parser.add_argument("--rows", default="1500", help="rows of a lap, or several: 1500,20000 (1500)")
    parser.add_argument("--seed", type=int, default=0, help="of the first case of each kind (0)")
    parser.add_argument("--jobs", type=int, default=1, help="processes (1)")
    parser.add_argument("--json", type=Path, help="write the scores to this file too")
    given = parser.parse_args()
    given.kind = _chosen(parser, given.kind, KINDS, "kind")
    given.test = _chosen(parser, given.test, CASES, "test")
    given.laps = [int(laps) for laps in given.laps.split(",")]
    given.rows = [int(rows) for rows in given.rows.split(",")]
    return given


def _chosen(parser: argparse.ArgumentParser, given: str | None, known: Collection[str], what: str) -> list[str]:
    chosen = given.split(",") if given else list(known)
    if unknown := [name for name in chosen if name not in known]:
        parser.error(f"no such {what}: {', '.join(unknown)}; known are {', '.join(known)}")
    return chosen


def main() -> None:
    warnings.simplefilter("ignore")  # numpy's, of cases that have too few rows for a figure; the scores count them
    given = arguments()
    seeds = range(given.seed, given.seed + given.count)
    whose = "for a report" if given.seed >= REPORTED else "for development"
    found: list[dict[str, object]] = []
    for laps in given.laps:
        for rows in given.rows:
            tests = [test for test in given.test if test in CIRCLES or rows == given.rows[0]]
            jobs = [
                Job(test, kind, seed, laps, rows)
                for test in tests
                for kind in given.kind
                if kind == TABLE or kind in CASES[test][1]
                for seed in seeds
            ]
            begin = time.monotonic()
            scores = scores_of(_points(jobs, given.jobs))
            seconds = time.monotonic() - begin
            print(f"\n{laps} laps or visits, {rows} rows a lap: {len(jobs)} cases in {seconds:.0f} s,", end=" ")
            chance = 100 * (0.95 * 0.05 / given.count) ** 0.5
            print(
                f"seeds {seeds.start} to {seeds[-1]} {whose}; shares of {given.count} near 95 % vary by {chance:.1f} %"
            )
            print(report(scores, repeated=laps > 1), flush=True)
            found += as_json(scores, laps, rows)
    if given.json:
        given.json.write_text(json.dumps(found, indent=1), encoding="utf-8")


def _points(jobs: Sequence[Job], processes: int) -> Iterator[Point]:
    with ProcessPoolExecutor(processes) as pool:
        for done, points in enumerate(pool.map(points_of, jobs), start=1):
            if sys.stderr.isatty():
                sys.stderr.write(f"\r\033[K{done} of {len(jobs)}" + "\n" * (done == len(jobs)))
            yield from points


if __name__ == "__main__":
    main()
