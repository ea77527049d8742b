"""An hour of recording: memory, descriptors and threads must be flat from its second third on.

In real time it is the real daemon on an emulated cell; with `--times 30` the daemon's buffers, recorder and store are
given half an hour's items in a minute.
"""

from __future__ import annotations

import logging
import sys
import tempfile
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path

from tests.support.soaking import accelerated, in_real_time, wrong
from tests.support.trial import Trial, main

ROWS, LOOKS = 20, 200


def draw(given: Namespace) -> Iterator[tuple[float, float]]:
    yield given.recording, given.times


def judged(case: tuple[float, float]) -> list[str]:
    """Record and watch; print some twenty rows, and return the problems."""
    minutes, times = case
    logging.disable()  # its warnings of planted faults
    every_s, rows = minutes * 60 / times / LOOKS, []
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        watch = in_real_time(folder, minutes, every_s) if times == 1 else accelerated(folder, minutes, times, every_s)
        print(" minutes       MB  descriptors  threads   samples")
        for row in watch:
            if len(rows) % (LOOKS // ROWS) == 0:
                count = f"{row.descriptors:12d} {row.threads:8d} {row.samples:9d}"
                print(f"{row.minutes:8.1f} {row.rss_mb:8.1f} {count}", flush=True)
            rows.append(row)
    return list(wrong(rows))


TRIAL = Trial(
    draw, judged, line=lambda problems: "; ".join(problems) or "nothing grew", failed=any,
    options={
        "recording": (60.0, "minutes of recording (60)"),
        "times": (1.0, "times real time; 1 is the real daemon (1)"),
    },
)  # fmt: skip

if __name__ == "__main__":
    sys.exit(main(TRIAL))
