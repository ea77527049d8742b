"""Answers that come after their time: none may be credited to another request.

Every gauge that is asked for its readings, in simulated time; Modbus RTU, whose answers carry no number, over a real
pty through the daemon's reader too.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Iterator, Sequence

from tests.support.drivers import modbus
from tests.support.lateness import SLOWEST, TIMEOUT_S, Late, polled, simulated, wired
from tests.support.trial import Trial, main


def draw(given: Namespace) -> Iterator[tuple[str, Namespace]]:
    yield from ((name, given) for name in (*polled(), *(["modbus rtu over a pty"] if given.wire else [])))


def judged(case: tuple[str, Namespace]) -> tuple[str, Late]:
    name, given = case
    if name in polled():
        return name, simulated(polled()[name], given.requests, given.seed, given.slowest)
    return name, wired(modbus(timeout_s=TIMEOUT_S), given.wire, given.seed)


def has_shifted(done: Sequence[tuple[str, Late]]) -> bool:
    return any(late.shifted for _, late in done)


TRIAL = Trial(
    draw, judged, line=lambda one: f"{one[0]}: {one[1]}", failed=has_shifted,
    options={
        "requests": (10_000, "requests to each gauge in simulated time (10000)"),
        "wire": (200, "requests over a pty, some 10 a second (200)"),
        "slowest": (SLOWEST, "the slowest answer, in time-outs"),
        "seed": (7, "of the delays (7)"),
    },
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(main(TRIAL))
