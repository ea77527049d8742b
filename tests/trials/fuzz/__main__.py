"""Mutated inputs to both sides of every protocol, and to the readers of rig files, run directories and tables.

No exception but a RigError, nothing that takes long, no growth; and after its inputs each conversation must still do
its work. A failure is shown with its seed and its bytes.
"""

from __future__ import annotations

import faulthandler
import tempfile
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Annotated

import typer

from tests.trials.fuzz.fuzz_files import use
from tests.trials.fuzz.fuzzing import GROWTH_MB, Outcome, blocks, is_file, run_block, targets

_WHOLE = 5
"""Failures shown with where and with what; of the others the first line."""
_MEMORY = Path("/dev/shm")  # noqa: S108 - files there cost no disk; each process has a directory of its own


def main(
    count: Annotated[int, typer.Option(help="Inputs to each protocol, some 2000 a second and core.")] = 1_000_000,
    files: Annotated[int, typer.Option(help="Inputs to each kind of file.")] = 20_000,
    seed: Annotated[int, typer.Option(help="Of the mutations.")] = 1,
    only: Annotated[list[str] | None, typer.Option(help="A target; may be given several times.")] = None,
    jobs: Annotated[int, typer.Option(help="Processes.")] = 2,
) -> None:
    """Feed every target; exit code 1 where anything is wrong."""
    unknown = set(only or ()) - targets().keys()
    if unknown:
        typer.echo(f"error: no target {', '.join(sorted(unknown))}; known: {', '.join(targets())}", err=True)
        raise typer.Exit(2)
    wrong = 0
    with tempfile.TemporaryDirectory(dir=_MEMORY if _MEMORY.is_dir() else None) as scratch:
        for target in only or targets():
            work = blocks(target, seed, files if is_file(target) else count)
            outcomes: list[Outcome] = []
            with ProcessPoolExecutor(jobs, initializer=_begin, initargs=(Path(scratch),)) as pool:
                try:
                    outcomes.extend(pool.map(run_block, work))
                except BrokenProcessPool:
                    print(f"{target}: a process died in one of {work[len(outcomes) : len(outcomes) + jobs]}")
                    wrong += 1
            wrong += report(target, outcomes)
    print(f"{wrong} things are wrong" if wrong else "no exception, no hang, no growth")
    raise typer.Exit(1 if wrong else 0)


def _begin(scratch: Path) -> None:
    faulthandler.enable()
    use(scratch)


def report(target: str, outcomes: list[Outcome]) -> int:
    """Print the line of a target; returns how many things are wrong with it."""
    by_process = defaultdict(list)
    for outcome in outcomes:
        by_process[outcome.pid].append(outcome.rss_mb)
    # The first block of a process loads what is needed.
    grown_mb = max((rss[-1] - rss[0] for rss in by_process.values()), default=0.0)
    inputs, seconds = sum(o.inputs for o in outcomes), sum(o.seconds for o in outcomes)
    slowest = max((o.slowest_s for o in outcomes), default=0.0)
    print(
        f"{target}: {inputs} inputs, {inputs / max(seconds, 1e-9):.0f} a second and core, slowest {slowest:.2f} s, "
        f"grown {grown_mb:.1f} MB",
        flush=True,
    )
    failures = [o.failure for o in outcomes if o.failure]
    for number, failure in enumerate(failures):
        print(failure if number < _WHOLE else failure.partition("\n")[0])
    if grown_mb > GROWTH_MB:
        failures.append("growth")
        print(f"{target}: a process grew by more than {GROWTH_MB:.0f} MB")
    return len(failures)


if __name__ == "__main__":
    typer.run(main)
