"""Two gauges at the line's full pace and RTDE at 500 Hz into rigd: samples counted at both ends.

Every reading is its own number, so a lost, doubled or swapped one shows in the recorded values.
"""

from __future__ import annotations

import json
import time
from collections import Counter
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
import yaml
from _daemon_on_cell import daemon_on

from daq.emulators import emulated
from daq.store import Run, read_run
from rigs.load import find, parse

STEP_MM = 1e-4
STEP_DEG = 1e-6
_IN_TRANSIT_S = 0.3


class Counting:
    """Instruments that show how often they have been read."""

    def __init__(self) -> None:
        self.count: Counter[str] = Counter()

    def gauge_mm(self, name: str, now_ns: int) -> float:
        self.count[name] += 1
        return self.count[name] * STEP_MM

    def joints_deg(self, now_ns: int) -> list[float]:
        self.count["robot"] += 1
        return [self.count["robot"] * STEP_DEG] * 6


def rig_text() -> str:
    """The paper's gauges on a UR10e."""
    data = yaml.safe_load(find("ur10e").read_text())
    data["gauges"] = yaml.safe_load(find("paper-fanuc").read_text())["gauges"]
    return yaml.safe_dump(data)


def main(seconds: Annotated[float, typer.Argument(help="How long to record.")] = 60.0) -> None:
    """Record and compare the counts of both ends; the exit code is 1 where a sample is missing."""
    text, motion = rig_text(), Counting()
    cell = emulated(parse(text, "pace"), motion)
    with daemon_on(cell, text) as client:
        client.ask("record_start", name="pace", test="yaw", direction="acw")
        time.sleep(seconds)
        end_ns = time.monotonic_ns()
        for gauge in ("g1", "g2"):
            cell.silence(gauge)
        time.sleep(_IN_TRANSIT_S)  # a pty that is closed loses what nobody has read yet
        sent = cell.stop()  # nothing more comes, so what is recorded now is all there will be
        time.sleep(_IN_TRANSIT_S)
        run = read_run(Path(client.ask("record_stop")["run"]))
    raise typer.Exit(report(run, sent, end_ns))


def report(run: Run, sent: dict[str, int], end_ns: int) -> int:
    lost = 0
    for name, column, step in (("g1", "g1_mm", STEP_MM), ("g2", "g2_mm", STEP_MM), ("robot", "q1_deg", STEP_DEG)):
        numbers = np.round(run.streams[name][column] / step).astype(int)
        missing = int((np.diff(numbers) - 1).sum())
        last = int(numbers[-1])
        seconds = float(np.ptp(run.streams[name]["last_byte_ns"])) / 1e9
        print(
            f"{name}: {len(numbers)} recorded, numbers {numbers[0]} to {last} of {sent[name]} sent; "
            f"{missing} missing by sequence, {sent[name] - last} missing at the end; {len(numbers) / seconds:.1f} Hz"
        )
        lost += abs(missing) + abs(sent[name] - last)
    faults = Counter(f"{fault['stream']} {fault['kind']}" for fault in run.faults if fault["at_ns"] < end_ns)
    print(f"faults until the instruments were switched off: {json.dumps(faults) if faults else 'none'}")
    print("no sample missing" if not lost else f"{lost} samples missing")
    return 1 if lost else 0


if __name__ == "__main__":
    typer.run(main)
