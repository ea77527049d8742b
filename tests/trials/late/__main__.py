"""Answers that come after their time: none may be credited to another request.

Every gauge that is asked for its readings, in simulated time; Modbus RTU, whose answers carry no number, over a real
pty through the daemon's reader too.
"""

from __future__ import annotations

from typing import Annotated

import typer

from tests.support.drivers import modbus
from tests.support.lateness import SLOWEST, TIMEOUT_S, polled, simulated, wired


def main(
    requests: Annotated[int, typer.Option(help="Requests to each gauge in simulated time.")] = 10_000,
    wire: Annotated[int, typer.Option(help="Requests over a pty, some 10 a second.")] = 200,
    slowest: Annotated[float, typer.Option(help="The slowest answer, in time-outs.")] = SLOWEST,
    seed: Annotated[int, typer.Option(help="Of the delays.")] = 7,
) -> None:
    """Count the answers that are shifted; exit code 1 where there is one."""
    shifted = 0
    for name, gauge in polled().items():
        late = simulated(gauge, requests, seed, slowest)
        print(f"{name}: {late}", flush=True)
        shifted += late.shifted
    if wire:
        late = wired(modbus(timeout_s=TIMEOUT_S), wire, seed)
        print(f"modbus rtu over a pty: {late}")
        shifted += late.shifted
    print(f"{shifted} answers shifted" if shifted else "no answer shifted")
    raise typer.Exit(1 if shifted else 0)


if __name__ == "__main__":
    typer.run(main)
