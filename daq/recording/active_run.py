"""A single run, from the request until it is closed. Samples are buffered while the disk creates the directory."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from pydantic import Field

from daq import clock
from daq.acquisition.host_clock import HOST
from daq.acquisition.plausibility import PlausibilityCheck
from daq.acquisition.stream_buffer import StreamBuffer, faults_of, samples_of, size_of
from daq.protocol.conversation import Fault, FaultKind, Item
from daq.recording.warnings import RateLimitedLog
from daq.store import RunWriter
from daq.store.ledger import Ending
from daq.store.manifest import DrivenWith, Operator, Placement, ViewZero, load_manifest
from daq.store.startup_recovery import recover_and_log
from daq.store.writer import MOST_PENDING
from rigs.errors import CellError, FileError, RigError
from rigs.readiness import gauges_needed
from rigs.schema.part import Part
from rigs.schema.vocabulary import CIRCLES, Direction, TestName

NAME_RULE = "use up to 64 letters, digits, . _ and -, starting with a letter or digit"


class RunLabel(Part):
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$")]
    test: TestName
    direction: Direction | None = None
    operator: Operator = ""
    placement: Placement = ""
    corrected: DrivenWith = ""
    view_zero_mm: ViewZero | None = None


_FRESH_S = 3.0


def require_readings(buffers: Mapping[str, StreamBuffer], test: TestName) -> None:
    needed = {"g1_mm", "q1_deg", *(f"{gauge}_mm" for gauge in gauges_needed(test))}
    for column in sorted(needed):
        states = [buffer.state() for buffer in buffers.values() if column in buffer.columns]
        name = "robot" if column == "q1_deg" else column.removesuffix("_mm")
        if not states:
            problem = f"is required by the {test} test, but missing in the rig file"
            raise CellError(name, problem, f"add gauges.{name}", code="rig_file.invalid")
        if states[0].age_s.get(column, 1e9) > _FRESH_S:
            last = states[0].last_fault or "nothing was received"
            stale = f"no reading in the last {_FRESH_S:.0f} s ({last})"
            raise CellError(name, stale, "fix the cause, then repeat the command", code="gauge.silent")


def samples_in(items: Sequence[Item]) -> int:
    dropped = sum(fault.count for fault in faults_of(items) if fault.kind is FaultKind.DROPPED)
    return len(samples_of(items)) + dropped


@dataclass(frozen=True)
class EndedRun:
    path: Path
    counters: dict[str, dict[str, int]]
    seal: str


@dataclass(frozen=True)
class RecordingGap:
    previous: Path
    device: int
    why: str
    taken: Counter[str]
    """Samples per stream accepted by the ended run."""
    lost: Counter[str] = field(default_factory=Counter)
    """Part of `taken` that could not be saved, known when the run is closed."""
    missed: Counter[str] = field(default_factory=Counter)
    """Samples per stream that arrived after the run had ended, and belong to no run."""

    def missed_text(self) -> str:
        return ", ".join(f"{count} of {name}" for name, count in self.missed.items() if count) or "none"

    def not_recorded(self, warnings: RateLimitedLog) -> dict[str, Fault]:
        """Recover the previous run. Returns a fault for each stream with unrecorded samples.

        Refuses an unmounted disk, to avoid writing below its mount point: the previous run is gone, and the device
        number of its parent has changed.
        """
        is_mounted = False
        with suppress(OSError):
            is_mounted = self.previous.is_dir() or self.previous.parent.stat().st_dev == self.device
        if not is_mounted:
            raise CellError(str(self.previous), "is gone", "remount the disk of the run", code="recording.failed")
        try:
            if self.previous.is_dir():
                recover_and_log(self.previous)
        except (OSError, RigError) as error:
            warnings.warn("recording", "former", str(error))
        return self.dropped()

    def dropped(self) -> dict[str, Fault]:
        """A fault for each stream with samples that were missed or could not be saved.

        If the manifest of the previous run cannot be read, all its samples count as lost, including drops counted in
        earlier runs.
        """
        stored: Counter[str] = Counter()
        with suppress(FileError):
            manifest = load_manifest(self.previous)
            for chunk in manifest.chunks:
                stored[chunk.stream] += chunk.rows
            for name, counter in manifest.counters.items():
                stored[name] += counter.get(FaultKind.DROPPED, 0)
        after, now_ns = f"samples not recorded after {self.previous.name}: {self.why}", clock.now_ns()
        lost = +self.missed + (self.taken - stored)
        return {name: Fault(FaultKind.DROPPED, now_ns, f"{count} {after}", count) for name, count in lost.items()}


class ActiveRun:
    """Collects the items of all streams, to be written once a writer exists."""

    def __init__(
        self, label: RunLabel, columns: Mapping[str, Sequence[str]], kept: Mapping[str, Sequence[Item]], since_ns: int
    ) -> None:
        """columns: column names per stream. kept: items buffered before the request, from `since_ns` on."""
        self.label, self.since_ns = label, since_ns
        self.gap: RecordingGap | None = None
        """Interval before this run, if it continues an earlier run."""
        self.writer: RunWriter | None = None
        self.begun: Future[Path] = Future()
        self.ended: Future[EndedRun] = Future()
        self.counters: dict[str, Counter[str]] = {name: Counter() for name in columns}
        self._columns = columns
        self._kept: dict[str, list[Item]] = {name: list(kept.get(name, ())) for name in columns}
        self._host_faults: list[Fault] = []
        self._plausibility = PlausibilityCheck(touching=label.test in CIRCLES)

    @property
    def sample_counts(self) -> Counter[str]:
        return Counter(
            {name: counter["samples"] + counter[FaultKind.DROPPED] for name, counter in self.counters.items()}
        )

    def is_behind(self, stream: str) -> bool:
        if self.writer:
            return self.writer.is_behind(stream)
        return sum(map(size_of, self._kept[stream])) >= MOST_PENDING

    def begin(self, writer: RunWriter, dropped: Mapping[str, Fault]) -> dict[str, list[Fault]]:
        """Write the buffered items, and the drops since the previous run. Returns the faults found in them."""
        self.writer = writer
        faults = {name: self.put(name, items) for name, items in self._kept.items()}
        self._kept.clear()
        self.put_host(self._host_faults)
        for name, fault in dropped.items():
            faults[name] += [fault, *self.put(name, [fault])]
        return faults

    @property
    def buffered_samples(self) -> Counter[str]:
        return Counter({name: samples_in(items) for name, items in self._kept.items()})

    def refuse(self, error: Exception) -> None:
        if self.gap:
            self.gap.missed.update(self.buffered_samples)
        self.begun.set_exception(error)
        self.ended.set_exception(error)

    def close(self, ending: Ending, why: str) -> None:
        if self.writer is not None:
            self.writer.close(ending, why, self.counters)

    def put(self, stream: str, items: Sequence[Item]) -> list[Fault]:
        """Write items, and the faults found in them by the plausibility checks. Returns these faults."""
        if self.writer is None:
            self._kept[stream].extend(items)
            return []
        self._write(self.writer, stream, items)
        doubts = self._plausibility.check(stream, self._columns[stream], items)
        self._write(self.writer, stream, doubts)
        return doubts

    def _write(self, writer: RunWriter, stream: str, items: Sequence[Item]) -> None:
        samples, faults = samples_of(items), faults_of(items)
        self.counters[stream]["samples"] += len(samples)
        self._count(stream, faults)
        writer.append(stream, samples)
        writer.append_faults(stream, faults)

    def put_host(self, faults: Sequence[Fault]) -> None:
        if self.writer is None:
            self._host_faults += faults
            return
        self._count(HOST, faults)
        self.writer.append_faults(HOST, faults)
        if any(fault.kind is FaultKind.CLOCK for fault in faults):
            self.writer.anchor()

    def _count(self, stream: str, faults: Sequence[Fault]) -> None:
        for fault in faults:
            if fault.count:
                self.counters.setdefault(stream, Counter())[fault.kind] += fault.count
