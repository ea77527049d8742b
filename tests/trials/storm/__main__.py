"""Faults by seed in simulated time: cables, late answers, disks, clocks, kills, in one world after the other."""

from __future__ import annotations

import itertools
import multiprocessing
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from typing import Annotated

import typer

from tests.trials.storm.life import Told
from tests.trials.storm.mutants import MUTANTS
from tests.trials.storm.storm import weather

_WORLDS_EACH = 40
"""Worlds of one process, which then makes way for another: what libraries hold does not add up."""

_PLANTED_IN = 30
"""Worlds in which a bug must be found."""


def main(
    seconds: Annotated[float, typer.Argument(help="How long in real time; the last worlds are finished.")] = 60,
    seed: Annotated[int | None, typer.Option(help="This world alone, as it was when it failed.")] = None,
    first: Annotated[int, typer.Option(help="Seed of the first world.")] = 0,
    planted: Annotated[bool, typer.Option("--planted", help="How soon bugs that are planted are found.")] = False,
    jobs: Annotated[int, typer.Option(help="Worlds at a time, each in a process of its own.")] = 1,
) -> None:
    """Live one world after the other, and hold what is recorded against what the emulated instruments sent."""
    if planted:
        raise typer.Exit(_planted(first))
    began_s, found = time.perf_counter(), list[Told]()
    for told in [weather(seed)] if seed is not None else _worlds(seconds, first, jobs):
        found.append(told)
        if told.violations or seed is not None:
            _tell(told)
        elif len(found) % 10 == 0:
            print(f"{len(found)} worlds, {time.perf_counter() - began_s:.0f} s", flush=True)
    raise typer.Exit(_report(found, time.perf_counter() - began_s))


def _planted(first: int) -> int:
    """Plant each bug and live world after world until one is wrong; return the exit code."""
    missed = 0
    for name, mutant in MUTANTS.items():
        began_s = time.perf_counter()
        for seed in range(first, first + _PLANTED_IN):
            with mutant():
                told = weather(seed)
            if told.violations:
                took_s = time.perf_counter() - began_s
                print(
                    f"{name}: found in the world of seed {seed} after {took_s:.1f} s: {told.violations[0]}", flush=True
                )
                break
        else:
            missed += 1
            print(f"{name}: NOT found in {_PLANTED_IN} worlds", flush=True)
    return 1 if missed else 0


def _worlds(seconds: float, first: int, jobs: int) -> Iterator[Told]:
    until_s = time.perf_counter() + seconds
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=context, max_tasks_per_child=_WORLDS_EACH) as pool:
        seeds, going = itertools.count(first), set[Future[Told]]()
        while going or time.perf_counter() < until_s:
            while len(going) < jobs and time.perf_counter() < until_s:
                going.add(pool.submit(weather, next(seeds)))
            done, going = wait(going, return_when=FIRST_COMPLETED)
            yield from (one.result() for one in done)


def _tell(told: Told) -> None:
    print(f"seed {told.world.seed}: {told.world}")
    print(f"  {told.seconds:.0f} simulated s in {told.took_s:.1f} s, {told.rows} rows in {told.runs} runs")
    for violation in told.violations[:10]:
        print(f"  VIOLATION {violation}")
    if told.violations:
        print(f"  again: scripts/dev storm --seed {told.world.seed}", flush=True)


def _report(found: list[Told], took_s: float) -> int:
    """Print the figures; return the exit code."""
    blows, faults = Counter[str](), Counter[str]()
    for told in found:
        blows.update({str(blow): count for blow, count in told.blows.items()})
        faults.update({str(kind): count for kind, count in told.faults.items()})
    hours, asleep = sum(told.seconds for told in found) / 3600, sum(told.asleep_s for told in found) / 3600
    wrong = [told.world.seed for told in found if told.violations]
    print(f"{len(found)} worlds in {took_s:.0f} s: {hours:.1f} simulated hours awake, {asleep:.0f} asleep;", end=" ")
    print(
        f"{sum(told.runs for told in found)} runs, {sum(told.rows for told in found)} rows held against what was sent"
    )
    for is_long, name in ((True, "hours"), (False, "seconds")):
        some = [told for told in found if told.world.is_long is is_long]
        if some:
            pace = sum(told.seconds for told in some) / sum(told.took_s for told in some)
            print(f"{len(some)} worlds of {name}: {pace:.0f} simulated s in each real one")
    print("dealt: " + ", ".join(f"{count} {blow}" for blow, count in sorted(blows.items())))
    print("named: " + ", ".join(f"{count} {kind}" for kind, count in sorted(faults.items())))
    count = sum(len(told.violations) for told in found)
    print(f"{count} violations" + (f", in the worlds of seeds {wrong}" if wrong else ""))
    return 1 if wrong else 0


if __name__ == "__main__":
    typer.run(main)
