"""Long recordings with monitoring of memory, descriptors and threads.

In real time, the real daemon records an emulated cell. Accelerated, the buffers, recorder and store of the daemon
process the data of many hours within minutes.
"""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from daq.acquisition.stream_buffer import StreamBuffer
from daq.acquisition.streams import JOINTS
from daq.protocol.conversation import NO_TIME, Fault, FaultKind, Sample
from daq.protocol.positions import SteadyRate
from daq.recording.active_run import RunLabel
from daq.recording.machine import RecordingRequest
from daq.service.client import Client
from daq.store import verify
from tests.support.bench import Bench, rig_text
from tests.support.recorders import recorder_of
from tests.support.replugging import Clockwork, swallow

GROWTH_MB = 8.0
"""Allowed memory growth from the second third to the last. Smaller changes come from the allocator."""
RATES_HZ = {"g1": 50.0, "g2": 50.0, "robot": 500.0}
COLUMNS = {"g1": ("g1_mm",), "g2": ("g2_mm",), "robot": JOINTS}
SLICE_S = 0.1


@dataclass(frozen=True)
class Held:
    """Resources of a process at a time: recorded minutes, megabytes, descriptors, threads and samples so far."""

    minutes: float
    rss_mb: float
    descriptors: int
    threads: int
    samples: int


def held(pid: int, minutes: float, samples: int) -> Held:
    """Current resources."""
    process = Path(f"/proc/{pid}")
    rss_mb = int((process / "statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
    return Held(
        minutes, rss_mb, len(list((process / "fd").iterdir())), len(list((process / "task").iterdir())), samples
    )


def in_real_time(folder: Path, minutes: float, every_s: float) -> Iterator[Held]:
    """Record with the real daemon: two gauges at 4800 baud and a robot at 500 Hz. Raises AssertionError for a faulty
    run.
    """
    with Bench(folder, rig_text("sylvac").replace("57600", "4800"), Clockwork()) as bench:
        bench.start()
        threading.Thread(target=swallow, args=(bench,), daemon=True).start()
        bench.all_reading()
        path = bench.record()
        began = time.monotonic()
        while (now := time.monotonic() - began) < minutes * 60:
            with Client(bench.socket) as client:
                samples = sum(client.ask("status")["samples"].values())
            yield held(bench.daemon.pid, now / 60, samples)
            time.sleep(min(every_s, max(0.0, minutes * 60 - now)))
        assert bench.run("rig", "record", "stop").returncode == 0
        assert verify(path) == []


def accelerated(folder: Path, minutes: float, times: float, every_s: float) -> Iterator[Held]:
    """Record at `times` the real speed, with a fault per second in each stream, without links and readers."""
    buffers = {name: StreamBuffer(name, columns) for name, columns in COLUMNS.items()}
    recorder = recorder_of(folder, buffers)
    recorder.start()
    _deliver(buffers, {name: SteadyRate(rate, 0) for name, rate in RATES_HZ.items()}, 0)
    path = recorder.start_run(RecordingRequest(RunLabel(name="soak", test="yaw", direction="acw"))).result()
    paces = {name: SteadyRate(rate, 0) for name, rate in RATES_HZ.items()}
    began, told_s, recorded_s = time.monotonic(), -math.inf, 0.0
    while recorded_s < minutes * 60:
        recorded_s += SLICE_S * times
        _deliver(buffers, paces, round(recorded_s * 1e9))
        time.sleep(max(0.0, began + recorded_s / times - time.monotonic()))
        if time.monotonic() - told_s > every_s:
            told_s = time.monotonic()
            samples = sum(buffer.state().counters["samples"] for buffer in buffers.values())
            yield held(os.getpid(), recorded_s / 60, samples)
    ended = recorder.stop_run().result()
    recorder.shut_down("complete", "")
    for name, buffer in buffers.items():
        kept = ended.counters[name]
        assert kept["samples"] == buffer.state().counters["samples"] - 1, f"{name}: {kept}"
    assert verify(path) == []


def _deliver(buffers: dict[str, StreamBuffer], paces: dict[str, SteadyRate], until_ns: int) -> None:
    now_ns = time.monotonic_ns()
    for name, buffer in buffers.items():
        value = math.sin(until_ns * 1e-9)
        width = len(buffer.columns)
        buffer.deliver([Sample((value,) * width, NO_TIME, at, now_ns, 9) for at in paces[name].due(until_ns)])
        buffer.deliver([Fault(FaultKind.GARBLED, now_ns, f"{value} is not a reading")])


def wrong(rows: list[Held]) -> list[str]:
    """A line for each resource that grew from the second third to the last.

    The first third is the warm-up: each stream closes its first chunks, and the allocator reserves memory for that.
    """
    third = max(1, len(rows) // 3)
    first, last = rows[-2 * third : -third], rows[-third:]
    grown_mb = median(row.rss_mb for row in last) - median(row.rss_mb for row in first)
    problems = [f"memory grew by {grown_mb:.1f} MB"] if grown_mb > GROWTH_MB else []
    counts: dict[str, Callable[[Held], int]] = {"descriptors": lambda r: r.descriptors, "threads": lambda r: r.threads}
    for name, count in counts.items():
        before, after = max(map(count, first)), min(map(count, last))
        if after > before:
            problems.append(f"{name} grew from {before} to {after}")
    return problems
