"""Faults by seed in simulated time: cables, late answers, disks, clocks, kills, in one world after the other."""

from __future__ import annotations

import sys
import time
from argparse import Namespace
from collections import Counter
from collections.abc import Iterator, Sequence

from tests.support.trial import Trial, main
from tests.trials.storm.life import Told
from tests.trials.storm.mutants import MUTANTS
from tests.trials.storm.storm import weather

_PLANTED_IN = 30
"""Worlds in which a bug must be found."""


def draw(given: Namespace) -> Iterator[int | str]:
    """Seeds of worlds until the time is over, or one; or the names of the bugs to plant."""
    if given.planted or given.seed is not None:
        yield from MUTANTS if given.planted else [given.seed]
        return
    until_s, seed = time.monotonic() + given.seconds, given.first
    while time.monotonic() < until_s:
        yield seed
        seed += 1


def judged(case: int | str) -> Told | tuple[str, int | None]:
    """What became of a world; or the name of a bug and the seed of the first world that shows it."""
    return weather(case) if isinstance(case, int) else (case, planted_bug_found(case))


def planted_bug_found(name: str) -> int | None:
    for seed in range(_PLANTED_IN):
        with MUTANTS[name]():
            if weather(seed).violations:
                return seed
    return None


def line(told: Told | tuple[str, int | None]) -> str:
    if isinstance(told, tuple):
        return f"{told[0]}: found in the world of seed {told[1]}" if told[1] is not None else f"{told[0]}: NOT found"
    return _told(told) * bool(told.violations)


def _told(told: Told) -> str:
    return "\n".join([
        f"seed {told.world.seed}: {told.world}",
        f"  {told.seconds:.0f} simulated s in {told.took_s:.1f} s, {told.rows} rows in {told.runs} runs",
        *(f"  VIOLATION {violation}" for violation in told.violations[:10]),
        f"  again: scripts/dev storm --seed {told.world.seed}",
    ])  # fmt: skip


def report(done: Sequence[Told | tuple[str, int | None]]) -> str:
    found = [told for told in done if isinstance(told, Told)]
    if not found:
        return ""
    blows, faults = Counter[str](), Counter[str]()
    for told in found:
        blows.update({str(blow): count for blow, count in told.blows.items()})
        faults.update({str(kind): count for kind, count in told.faults.items()})
    hours, asleep = sum(told.seconds for told in found) / 3600, sum(told.asleep_s for told in found) / 3600
    wrong = [told.world.seed for told in found if told.violations]
    lines = [
        f"{len(found)} worlds: {hours:.1f} simulated hours awake, {asleep:.0f} asleep; "
        f"{sum(told.runs for told in found)} runs, {sum(told.rows for told in found)} rows held against what was sent"
    ]
    for is_long, name in ((True, "hours"), (False, "seconds")):
        some = [told for told in found if told.world.is_long is is_long]
        if some:
            pace = sum(told.seconds for told in some) / sum(told.took_s for told in some)
            lines.append(f"{len(some)} worlds of {name}: {pace:.0f} simulated s in each real one")
    lines.append("dealt: " + ", ".join(f"{count} {blow}" for blow, count in sorted(blows.items())))
    lines.append("named: " + ", ".join(f"{count} {kind}" for kind, count in sorted(faults.items())))
    count = sum(len(told.violations) for told in found)
    lines.append(f"{count} violations" + (f", in the worlds of seeds {wrong}" if wrong else ""))
    return "\n".join(lines)


def is_wrong(done: Sequence[Told | tuple[str, int | None]]) -> bool:
    return any(told[1] is None if isinstance(told, tuple) else told.violations for told in done)


TRIAL = Trial(
    draw,
    judged,
    report,
    line=line,
    failed=is_wrong,
    options={
        "SECONDS": (60.0, "how long in real time; the last worlds are finished (60)"),
        "seed": (int, "this world alone, as it was when it failed"),
        "first": (0, "seed of the first world (0)"),
        "planted": (False, "how soon bugs that are planted are found"),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
