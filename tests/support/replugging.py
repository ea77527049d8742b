"""Cables pulled out and reconnected during a recording.

Each reading encodes the time at which it was taken. A reading taken before its request, or buffered until the cable was
reconnected, is therefore detected in the recorded run.
"""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from daq import clock
from daq.store import Run, read_run, verify
from rigs.schema.condition import CONDITION
from tests.support.bench import Bench, rig_text
from tests.support.simulated_bench import SimulatedBench

STEP_NS = 1_000_000
"""Resolution of the readings: 1 ms, shown as 0.0001 mm or 0.0001°."""
STEP = 1e-4
STEPS_APART = 1000


class Clockwork:
    """Instruments that show the time since their creation: g1 positive, g2 negative, each joint with a different
    start value.
    """

    def __init__(self) -> None:
        self._start_ns: int | None = None

    @property
    def start_ns(self) -> int:
        """Time of the first use: the clock of a simulated cell runs only later."""
        if self._start_ns is None:
            self._start_ns = clock.now_ns()
        return self._start_ns

    def gauge_mm(self, name: str, now_ns: int) -> float:
        return self._steps(now_ns) * STEP * (1 if name == "g1" else -1)

    def joints_deg(self, now_ns: int) -> list[float]:
        return [(self._steps(now_ns) + axis * STEPS_APART) * STEP for axis in range(6)]

    def _steps(self, now_ns: int) -> int:
        return (now_ns - self.start_ns) // STEP_NS

    def taken_ns(self, column: str, values: Any) -> Any:
        """Times at which readings of a column were taken, rounded down to STEP_NS."""
        steps = np.round(values / STEP) * (-1 if column == "g2_mm" else 1)
        axis = int(column[1]) - 1 if column.startswith("q") else 0
        return self.start_ns + (steps - axis * STEPS_APART).astype(np.int64) * STEP_NS


def rig_of(kind: str) -> str:
    """A rig that together with the other covers every kind of link: `serial` (polled and continuous) or
    `modbus` (TCP and RTU).
    """
    data = yaml.safe_load(rig_text("polled" if kind == "serial" else "modbus"))
    if kind == "serial":
        data["gauges"]["g2"]["mode"] = "continuous"
    else:
        data["gauges"]["g1"] |= {"port": "tcp://127.0.0.1:502", "rate_hz": 100}
        scaled = {"address": 202, "type": "int32", "scale": STEP}
        for name in ("g1", "g2"):
            data["gauges"][name] |= {"value": scaled, "timeout_s": 0.1}
    return yaml.safe_dump(data)


def replug_simulated(folder: Path, kind: str) -> tuple[Run, Clockwork]:
    """Record in simulated time while all links of a rig are disconnected and reconnected."""
    with SimulatedBench(folder, rig_of(kind), motion := Clockwork()) as bench:
        bench.start().all_reading()
        path = bench.record()
        bench.recorded(10)
        for line in bench.cell.lines.values():
            line.unplug()
        bench.until(lambda state: not any(one["connected"] for one in state["streams"].values()))
        for line in bench.cell.lines.values():
            line.plugged = True
        before = bench.status()["samples"]
        bench.until(lambda state: all(count > before[name] + 10 for name, count in state["samples"].items()))
        bench.stop()
    assert verify(path) == []
    return read_run(path), motion


def replug(folder: Path, kind: str) -> tuple[Run, Clockwork]:
    """Record while all links of a rig are disconnected and reconnected. Fails if the daemon holds more afterwards."""
    with Bench(folder, rig_of(kind), motion := Clockwork()) as bench:
        bench.start()
        said = threading.Thread(target=swallow, args=(bench,))
        said.start()
        streams = list(bench.all_reading()["streams"])
        path = bench.record()
        bench.until(lambda state: min(state["synced"].values()) > 0)  # the disk thread starts with its first work
        before = _held(bench)
        for name in streams:
            bench.cell.unplug(name)
        bench.until(lambda state: not any(one["connected"] for one in state["streams"].values()))
        for name in streams:
            bench.cell.plug(name)
        bench.all_reading()
        assert _held(bench) == before
        assert bench.run("rig", "record", "stop").returncode == 0
        bench.daemon.send_signal(signal.SIGTERM)
        said.join()
    assert verify(path) == []
    return read_run(path), motion


def wrong(run: Run, stream: str, motion: Clockwork) -> list[str]:
    """A line for each kind of error in the readings of a stream."""
    rows = run.streams[stream]
    columns = run.manifest.streams[stream]
    taken = motion.taken_ns(columns[0], rows[columns[0]])
    lost = [fault for fault in run.faults if fault["stream"] == stream and fault["kind"] == "disconnected"]
    gaps = [fault["at_ns"] for fault in lost if fault["count"]]
    last_gap = np.searchsorted(np.sort(gaps), rows["last_byte_ns"])
    since = np.concatenate([[0], np.sort(gaps)])[last_gap]
    asked = np.maximum(rows["requested_ns"], 0)
    tests = {
        "came before they were taken": taken > rows["first_byte_ns"],
        "were taken before they were asked for": taken < asked - STEP_NS,
        "are out of order": np.diff(taken, prepend=taken[:1]) < 0,
        "are older than the link they came by": taken < since - STEP_NS,
    }
    for other in (column for column in columns[1:] if column not in CONDITION):  # not encoded in the readings
        tests[f"have another {other}"] = motion.taken_ns(other, rows[other]) != taken
    return [f"{stream}: {np.count_nonzero(bad)} readings {told}" for told, bad in tests.items() if bad.any()]


def _held(bench: Bench) -> str:
    """Open resources of the daemon, excluding files of the run, after the served clients have
    disconnected.
    """
    time.sleep(0.5)
    process, descriptors = Path(f"/proc/{bench.daemon.pid}"), 0
    for entry in (process / "fd").iterdir():
        with contextlib.suppress(FileNotFoundError):
            descriptors += not entry.readlink().is_relative_to(bench.folder / "runs")
    return f"{descriptors} descriptors, {len(list((process / 'task').iterdir()))} threads"


def swallow(bench: Bench) -> None:
    """Read and discard the log of the daemon, which would block on a full pipe."""
    bench.daemon.stderr.read()


KINDS = ("serial", "modbus")
