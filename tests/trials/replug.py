"""Each cable of a real daemon that records, unplugged and plugged in again: gauges, Modbus and a robot.

Gauges on ptys behind stable names, polled and continuous, Modbus RTU and TCP, and a robot at 500 Hz over TCP. Then the
run must verify, each reading in it must be right, each disconnect be counted, and the daemon hold no more descriptors
and threads than before.
"""

from __future__ import annotations

import sys
import tempfile
from argparse import Namespace
from collections.abc import Iterator, Sequence
from pathlib import Path

from tests.support.replugging import KINDS, replug, report
from tests.support.trial import Trial, main


def draw(given: Namespace) -> Iterator[tuple[str, int, int]]:
    yield from ((kind, given.cycles, given.seed) for kind in KINDS)


def judged(case: tuple[str, int, int]) -> tuple[str, bool]:
    kind, cycles, seed = case
    with tempfile.TemporaryDirectory() as scratch:
        found = replug(Path(scratch), kind, cycles, seed)
    return report(kind, cycles, found), bool(found.problems)


def is_wrong(done: Sequence[tuple[str, bool]]) -> bool:
    return any(wrong for _, wrong in done)


TRIAL = Trial(
    draw, judged, line=lambda one: one[0], failed=is_wrong,
    options={"cycles": (100, "unplugs of each link (100)"), "seed": (1, "of the random moments (1)")},
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(main(TRIAL))
