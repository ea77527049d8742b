"""Count false changes in the history of a robot, and measure how soon and exactly a real one is reported."""

from __future__ import annotations

import sys
import tempfile
import time
from argparse import Namespace
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.apps.plant.changes import FALSE_ALARMS, Change
from analysis.apps.plant.collect import Workers, collect
from analysis.apps.plant.history import Series, history_of
from tests.support.figure_histories import CIRCLES, GROWING, Growth, collected, drawn_history
from tests.support.recorded_histories import recorded_history
from tests.support.trial import Trial, main, seeds

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


Case = tuple[str, str, int, int, float | None]
"""Layout, kind of growth ("" for none), seed, seeds below which delays are found, size of the season."""


def draw(given: Namespace) -> Iterator[Case]:
    """Robots that do not change and robots whose play grows; or recorded runs of both."""
    if given.files:
        yield from (
            ("files", kind, seed, 0, None)
            for seed in range(given.seed, given.seed + given.files)
            for kind in ("", "at 10")
        )
        return
    for layout in given.layout:
        still = range(given.seed, given.seed + (given.still or given.count))
        yield from ((layout, "", seed, 0, given.season) for seed in still)
        for kind in KINDS:
            yield from ((layout, kind, seed, given.seed + given.delays, None) for seed in seeds(given))


def judged(case: Case) -> tuple[str, str, Found | int | str]:
    layout, kind, seed, delays_below, season = case
    if layout == "files":
        return layout, kind, through_files(seed, 10 if kind else 20)
    if kind:
        return layout, kind, of_growing(layout, kind, delays_below, seed)
    return layout, kind, alarms_of(layout, {} if season is None else {"season": season}, seed)


def report(done: Sequence[tuple[str, str, Found | int | str]]) -> str:
    lines = []
    for layout, kind in dict.fromkeys((layout, kind) for layout, kind, _ in done):
        own = [found for *group, found in done if group == [layout, kind]]
        alarms = [one for one in own if isinstance(one, int)]
        if alarms:
            wrong = sum(map(bool, alarms))
            lines.append(
                f"{layout}, no change: {wrong} of {len(alarms)} robots with a change reported "
                f"({wrong / len(alarms):.1%}; stated {FALSE_ALARMS:.0%}); changes in all {sum(alarms)}"
            )
        elif layout != "files":
            lines.append(f"{layout}, play grows {kind}: {words([one for one in own if isinstance(one, Found)])}")
    return "\n".join(lines)


def through_files(seed: int, begin: int) -> str:
    """What the history of 20 recorded runs reports, whose play grows at a run."""
    with tempfile.TemporaryDirectory() as name:
        figure = recorded_history(Path(name), seed, 20, begin)
        began = time.monotonic()
        found = collect(Path(name), "ur10e", Workers(), lambda doing, done, total: None)
        took = time.monotonic() - began
        growth = f"grows at run {begin}" if begin < 20 else "does not grow"
        lines = [f"seed {seed}, {figure} {growth}; {len(found.runs)} runs, {took:.0f} s; changes:"]
        for series, change in history_of(found).changed:
            way = f"{change.before:.4f} to {change.after:.4f} ± {change.u:.4f}"
            lines.append(f"  {series.figure}: {way}, between runs {change.first} and {change.last}")
    return "\n".join(lines)


def alarms_of(layout: str, world: dict[str, float], seed: int) -> int:
    """Number of changes reported for a robot that does not change."""
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


TRIAL = Trial(
    draw,
    judged,
    report,
    line=lambda one: one[2] if isinstance(one[2], str) else "",
    count=50,
    seed=50_000,
    options={
        "still": (int, "robots that do not change (as many)"),
        "layout": (tuple(LAYOUTS), "layouts (all)", LAYOUTS),
        "delays": (50, "robots of each kind asked again after each run (50)"),
        "files": (0, "robots of 20 recorded runs instead, so many of each kind"),
        "season": (float, "size of the season over a run's scatter (drawn, 0 to 1)"),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
