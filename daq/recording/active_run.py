"""A run that is being written: what it is of, what it was given, and what there is to doubt about that."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from daq.acquisition.host_clock import HOST
from daq.acquisition.plausibility import PlausibilityCheck
from daq.acquisition.stream_buffer import faults_of, samples_of
from daq.protocol.conversation import Fault, FaultKind, Item
from daq.recording.label import Label
from daq.store import RunWriter


class ActiveRun:
    """counters: stream → samples, and faults of each kind."""

    def __init__(self, label: Label, writer: RunWriter, since_ns: int, columns: Mapping[str, Sequence[str]]) -> None:
        """columns: of each stream."""
        self.label, self.writer, self.since_ns = label, writer, since_ns
        self.counters: dict[str, Counter[str]] = {name: Counter() for name in columns}
        self._columns = columns
        self._plausibility = PlausibilityCheck(touching=label.test in ("yaw", "roll"))

    @property
    def taken(self) -> Counter[str]:
        """Samples of each stream that it was given."""
        return Counter({name: counter["samples"] for name, counter in self.counters.items()})

    def put(self, stream: str, items: Sequence[Item]) -> list[Fault]:
        """Write items into the run, and behind them what is doubtful about them. Returns these doubts, to report."""
        self._write(stream, items)
        doubts = self._plausibility.check(stream, self._columns[stream], items)
        self._write(stream, doubts)
        return doubts

    def _write(self, stream: str, items: Sequence[Item]) -> None:
        samples, faults = samples_of(items), faults_of(items)
        self.counters[stream]["samples"] += len(samples)
        for fault in faults:
            if fault.count:
                self.counters[stream][fault.kind] += fault.count
        self.writer.append(stream, samples)
        self.writer.append_faults(stream, faults)

    def put_clock(self, faults: Sequence[Fault]) -> None:
        """Steps of the wall clock, and what time it is since."""
        if faults:
            self.counters.setdefault(HOST, Counter())[FaultKind.CLOCK] += len(faults)
            self.writer.append_faults(HOST, faults)
            self.writer.anchor()
