"""Cables pulled out and reconnected during a recording, each link many times at random times.

Each reading encodes the time at which it was taken. A reading taken before its request, or buffered until the cable was
reconnected, is therefore detected in the recorded run.
"""

from __future__ import annotations

import contextlib
import random
import signal
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from daq.service.client import Client
from daq.store import Run, read_run, verify
from rigs.schema.condition import CONDITION
from tests.support.bench import PATIENCE_S, Bench, rig_text

STEP_NS = 1_000_000
"""Resolution of the readings: 1 ms, shown as 0.0001 mm or 0.0001°."""
STEP = 1e-4
STEPS_APART = 1000
OUT_S = 0.6
"""Longest disconnection. The connected intervals are equally long."""


class Clockwork:
    """Instruments that show the time since their creation: g1 positive, g2 negative, each joint with a different
    start value.
    """

    def __init__(self) -> None:
        self.start_ns = time.monotonic_ns()

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


@dataclass
class Replugged:
    """Result of a campaign on a rig. `back_s`: times from each reconnection to the next reading, by stream."""

    back_s: dict[str, list[float]] = field(default_factory=dict)
    lost: dict[str, int] = field(default_factory=dict)
    readings: dict[str, int] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    held: str = ""


def replug(folder: Path, kind: str, cycles: int, seed: int) -> Replugged:
    """Record while each link of the rig is disconnected and reconnected `cycles` times."""
    found, motion = Replugged(), Clockwork()
    with Bench(folder, rig_of(kind), motion) as bench:
        bench.start()
        said = threading.Thread(target=swallow, args=(bench,))
        said.start()
        streams = list(bench.all_reading()["streams"])
        path = bench.record()
        bench.until(lambda state: min(state["synced"].values()) > 0)  # the disk thread starts with its first work
        before = _held(bench)
        hands = [_Hand(bench, name, cycles, random.Random(f"{seed} {name}")) for name in streams]
        for hand in hands:
            hand.start()
        for hand in hands:
            hand.join()
            found.back_s[hand.stream] = hand.back_s
            found.problems += hand.problems
        bench.all_reading()
        found.held = f"{before} before, {_held(bench)} after"
        if _held(bench) != before:
            found.problems.append(f"the daemon held {found.held}")
        if (done := bench.run("rig", "record", "stop")).returncode:
            found.problems.append(done.stderr)
        bench.daemon.send_signal(signal.SIGTERM)
        said.join()
    found.problems += verify(path)
    run = read_run(path)
    for name in streams:
        found.lost[name] = run.manifest.counters[name].get("disconnected", 0)
        found.readings[name] = len(run.streams[name]["size"])
        if found.lost[name] != cycles:
            found.problems.append(f"{name}: {found.lost[name]} disconnects counted, {cycles} made")
        found.problems += wrong(run, name, motion)
    return found


class _Hand(threading.Thread):
    """Thread that disconnects a cable, reconnects it when the loss has been reported, and repeats when the stream is
    back.
    """

    def __init__(self, bench: Bench, stream: str, cycles: int, dice: random.Random) -> None:
        super().__init__(name=f"hand {stream}")
        self.stream, self.back_s, self.problems = stream, list[float](), list[str]()
        self._bench, self._cycles, self._dice = bench, cycles, dice

    def run(self) -> None:
        with Client(self._bench.socket) as client:
            try:
                for _ in range(self._cycles):
                    self._cycle(client)
            except TimeoutError as error:
                self.problems.append(str(error))

    def _cycle(self, client: Client) -> None:
        time.sleep(self._dice.uniform(0, OUT_S))
        self._bench.cell.unplug(self.stream)
        self._until(client, lambda state: not state["connected"], "was not missed")
        time.sleep(self._dice.uniform(0, OUT_S))
        count = self._state(client)["counters"]["samples"]
        began = time.monotonic()
        self._bench.cell.plug(self.stream)
        self._until(client, lambda state: state["counters"]["samples"] > count, "did not come back")
        self.back_s.append(time.monotonic() - began)

    def _until(self, client: Client, what: Any, told: str) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while not what(self._state(client)):
            if time.monotonic() > deadline:
                raise TimeoutError(f"{self.stream} {told} within {PATIENCE_S:.0f} s")
            time.sleep(0.01)

    def _state(self, client: Client) -> dict[str, Any]:
        state: dict[str, Any] = client.ask("status")["streams"][self.stream]
        return state


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
