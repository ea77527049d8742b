"""Each cable of a real daemon that records, unplugged and plugged in again: gauges, Modbus and a robot.

Gauges on ptys behind stable names, polled and continuous, Modbus RTU and TCP, and a robot at 500 Hz over TCP. Then the
run must verify, each reading in it must be right, each disconnect be counted, and the daemon hold no more descriptors
and threads than before.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Annotated

import typer

from tests.support.replugging import KINDS, replug, report


def main(
    cycles: Annotated[int, typer.Option(help="Unplugs of each link.")] = 100,
    seed: Annotated[int, typer.Option(help="Of the random moments.")] = 1,
) -> None:
    """Pull and put back the cables of each rig; exit code 1 where anything is wrong."""
    problems = 0
    for kind in KINDS:
        with tempfile.TemporaryDirectory() as scratch:
            found = replug(Path(scratch), kind, cycles, seed)
        print(report(kind, cycles, found), flush=True)
        problems += len(found.problems)
    print(f"{problems} things are wrong" if problems else "nothing wrong, nothing lost but the gaps")
    raise typer.Exit(1 if problems else 0)


if __name__ == "__main__":
    typer.run(main)
