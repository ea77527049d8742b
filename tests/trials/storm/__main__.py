"""Faults by seed in simulated time: cables, late answers, disks, clocks, kills, in one world after the other."""

from __future__ import annotations

import sys
import time
from argparse import Namespace
from collections import Counter
from collections.abc import Iterator, Sequence

from tests.support.trial import Trial, main
from tests.trials.storm.life import Told
from tests.trials.storm.storm import weather


def draw(given: Namespace) -> Iterator[int]:
    """Seeds of worlds until the time is over, or one."""
    if given.seed is not None:
        yield given.seed
        return
    until_s, seed = time.monotonic() + given.seconds, given.first
    while time.monotonic() < until_s:
        yield seed
        seed += 1


def line(told: Told) -> str:
    if not told.violations:
        return ""
    return "\n".join([
        f"seed {told.world.seed}: {told.world}",
        f"  {told.seconds:.0f} simulated s in {told.took_s:.1f} s, {told.rows} rows in {told.runs} runs",
        *(f"  VIOLATION {violation}" for violation in told.violations[:10]),
        f"  again: scripts/dev storm --seed {told.world.seed}",
    ])  # fmt: skip


def report(found: Sequence[Told]) -> str:
    if not found:
        return ""
    blows, faults = sum((told.blows for told in found), Counter()), sum((told.faults for told in found), Counter())
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


TRIAL = Trial(
    draw,
    weather,
    report,
    line=line,
    failed=lambda done: any(told.violations for told in done),
    options={
        "SECONDS": (60.0, "how long in real time; the last worlds are finished (60)"),
        "seed": (int, "this world alone, as it was when it failed"),
        "first": (0, "seed of the first world (0)"),
    },
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
