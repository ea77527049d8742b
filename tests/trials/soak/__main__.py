"""An hour of recording: memory, descriptors and threads must be flat from its second third on.

The exit code is 1 otherwise. In real time it is the real daemon on an emulated cell; with --times 30 the daemon's
buffers, recorder and store are given half an hour's items in a minute.
"""

from __future__ import annotations

import logging
import tempfile
from pathlib import Path
from typing import Annotated

import typer

from tests.support.soaking import accelerated, in_real_time, wrong

ROWS = 20


def main(
    minutes: Annotated[float, typer.Option(help="Of recording.")] = 60,
    times: Annotated[float, typer.Option(help="Times real time; 1 is the real daemon.")] = 1,
) -> None:
    """Record and watch; prints some twenty rows of what was seen, and the verdict on all of it."""
    logging.disable()  # its warnings of planted faults
    every_s = minutes * 60 / times / 200
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        watch = in_real_time(folder, minutes, every_s) if times == 1 else accelerated(folder, minutes, times, every_s)
        print(" minutes       MB  descriptors  threads   samples")
        rows = []
        for row in watch:
            if len(rows) % max(1, 200 // ROWS) == 0:
                print(
                    f"{row.minutes:8.1f} {row.rss_mb:8.1f} {row.descriptors:12d} {row.threads:8d} {row.samples:9d}",
                    flush=True,
                )
            rows.append(row)
    problems = wrong(rows)
    print("; ".join(problems) or f"{minutes:g} minutes, {rows[-1].samples} samples: nothing grew")
    raise typer.Exit(1 if problems else 0)


if __name__ == "__main__":
    typer.run(main)
