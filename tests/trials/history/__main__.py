"""Count how often a robot's history reports a change that is not there, and how soon and how exactly one that is."""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from analysis.apps.plant.changes import FALSE_ALARMS, Change
from analysis.apps.plant.collect import collect
from analysis.apps.plant.history import Series, history_of
from tests.support.figure_histories import CIRCLES, GROWING, Growth, collected, drawn_history
from tests.trials.history.recorded_histories import recorded_history

LAYOUTS = {"75 visits of 4 tests": (75, CIRCLES), "300 runs of one test": (300, CIRCLES[:1])}
KINDS = {"at once": 1, "in 30 runs": 30, "in 100 runs": 100}
"""In how many runs of one test a play grows; a layout of fewer visits has a quarter."""
AFTER = (4, 5, 6, 7, 8, 10, 12, 15, 20, 25, 30, 40, 60, 80, 120)
"""Numbers of runs after the start of the growth at which the history is evaluated."""


@dataclass(frozen=True)
class Found:
    """Whether the growing play of one robot was found; errors, in runs, of the begin and the end that are reported;
    runs until it was first reported, None where it never was; how many other changes were reported."""

    seen: bool
    first_error: float
    last_error: float
    delay: float | None
    others: int


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="scripts/dev history", description=__doc__)
    parser.add_argument("count", type=int, nargs="?", default=50, help="robots of each kind (50)")
    parser.add_argument("--still", type=int, help="robots that do not change (as many)")
    parser.add_argument(
        "--seed", type=int, default=50_000, help="of the first (50000; those below are for development)"
    )
    parser.add_argument("--jobs", type=int, default=1, help="processes (1)")
    parser.add_argument("--layout", choices=LAYOUTS, help="one of the layouts (all)")
    parser.add_argument("--delays", type=int, default=50, help="robots of each kind asked again after each run (50)")
    parser.add_argument("--files", type=int, default=0, help="robots of 20 recorded runs instead, so many of each kind")
    parser.add_argument("--season", type=float, help="size of the season over a run's scatter (drawn, 0 to 1)")
    return parser.parse_args()


def main() -> None:
    given = arguments()
    seeds = range(given.seed, given.seed + given.count)
    still_seeds = range(given.seed, given.seed + (given.still or given.count))
    world = {} if given.season is None else {"season": given.season}
    if given.files:
        through_files(range(given.seed, given.seed + given.files))
        return
    with ProcessPoolExecutor(given.jobs) as pool:
        for layout in [given.layout] if given.layout else LAYOUTS:
            alarms = list(pool.map(partial(alarms_of, layout, world), still_seeds))
            wrong = sum(map(bool, alarms))
            print(
                f"{layout}, no change: {wrong} of {len(alarms)} robots with a change reported "
                f"({wrong / len(alarms):.1%}; stated {FALSE_ALARMS:.0%}); changes in all {sum(alarms)}",
                flush=True,
            )
            for kind in KINDS:
                job = partial(of_growing, layout, kind, given.seed + given.delays)
                print(f"{layout}, play grows {kind}: {words(list(pool.map(job, seeds)))}", flush=True)


def through_files(seeds: Sequence[int]) -> None:
    """Print what the history of recorded runs reports, whose play grows at run 11 of 20 or not at all."""
    for seed in seeds:
        for begin in (10, 20):
            with tempfile.TemporaryDirectory() as name:
                figure = recorded_history(Path(name), seed, 20, begin)
                began = time.monotonic()
                found = collect(Path(name), "ur10e", lambda done, total: None)
                took = time.monotonic() - began
                history = history_of(found)
                growth = f"grows at run {begin}" if begin < 20 else "does not grow"
                print(f"seed {seed}, {figure} {growth}; {len(found.runs)} runs, {took:.0f} s; changes:", flush=True)
                for series, change in history.changed:
                    way = f"{change.before:.4f} to {change.after:.4f} ± {change.u:.4f}"
                    print(f"  {series.figure}: {way}, between runs {change.first} and {change.last}", flush=True)


def alarms_of(layout: str, world: dict[str, float], seed: int) -> int:
    """Return the number of changes reported for a robot that does not change."""
    visits, tests = LAYOUTS[layout]
    return len(history_of(collected(drawn_history(seed, visits, tests, **world))).changed)


def of_growing(layout: str, kind: str, delays_below: int, seed: int) -> Found:
    """What is reported of a robot whose play grows from a visit in the middle third on."""
    visits, tests = LAYOUTS[layout]
    long = max(1, KINDS[kind] * visits // 300)
    begin = int(np.random.default_rng((seed, 1)).integers(visits // 3, visits // 2))
    runs = drawn_history(seed, visits, tests, Growth(begin, long))
    found = history_of(collected(runs)).changed
    ours = [one for one in found if is_ours(one, begin, long)]
    delay = next(
        (
            after
            for after in AFTER
            if seed < delays_below
            and begin + after <= visits
            and any(
                is_ours(one, begin, long) for one in history_of(collected(runs[: (begin + after) * len(tests)])).changed
            )
        ),
        None,
    )
    if not ours:
        return Found(False, np.nan, np.nan, delay, len(found))
    _, best = min(ours, key=lambda one: one[1].chance)
    return Found(True, best.first - (begin - 1), best.last - (begin + long - 1), delay, len(found) - len(ours))


def is_ours(one: tuple[Series, Change], begin: int, long: int) -> bool:
    """Whether a change overlaps the growth; that of the band, which the play widens, counts too."""
    series, change = one
    near = change.last >= begin - 3 and change.first <= begin + long + 2
    return series.figure in (GROWING, "band_deg") and change.after > change.before and near


def words(found: Sequence[Found]) -> str:
    seen = [one for one in found if one.seen]
    delays = [one.delay for one in found if one.delay is not None]
    return "; ".join(_facts(found, seen, delays))


def _facts(found: Sequence[Found], seen: Sequence[Found], delays: Sequence[float]) -> Iterator[str]:
    yield f"found {len(seen)} of {len(found)}"
    if seen:
        for name, errors in (
            ("begin", [abs(one.first_error) for one in seen]),
            ("end", [abs(one.last_error) for one in seen]),
        ):
            within = [sum(error <= runs for error in errors) for runs in (1, 2, 5)]
            yield f"{name} within 1, 2, 5 runs: {', '.join(map(str, within))}, median {np.median(errors):g}"
    if delays:
        low, high = np.quantile(delays, (0.5, 0.9))
        yield f"of {len(delays)}: first reported {low:g} runs after the first grown one (median), {high:g} (90 %)"
    yield f"robots with another change reported: {sum(map(bool, (one.others for one in found)))}"


if __name__ == "__main__":
    main()
