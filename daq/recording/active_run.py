"""A run that is being written: its label, what was put into it, and what is doubtful about that."""

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
    """Writes the items of all streams into one run. counters: stream → samples, and faults of each kind."""

    def __init__(self, label: Label, writer: RunWriter, since_ns: int, columns: Mapping[str, Sequence[str]]) -> None:
        """columns: of each stream."""
        self.label, self.writer, self.since_ns = label, writer, since_ns
        self.counters: dict[str, Counter[str]] = {name: Counter() for name in columns}
        self._columns = columns
        self._plausibility = PlausibilityCheck(touching=label.test in ("yaw", "roll"))

    @property
    def taken(self) -> Counter[str]:
        """The number of samples of each stream that were put into it."""
        return Counter({name: counter["samples"] for name, counter in self.counters.items()})

    def put(self, stream: str, items: Sequence[Item]) -> list[Fault]:
        """Write items into the run, then the faults that say what is doubtful about them, which are returned."""
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

    def put_host(self, faults: Sequence[Fault]) -> None:
        """Write faults of the computer itself, and after a step of the wall clock an anchor for the time since then."""
        for fault in faults:
            self.counters.setdefault(HOST, Counter())[fault.kind] += fault.count
        self.writer.append_faults(HOST, faults)
        if any(fault.kind is FaultKind.CLOCK for fault in faults):
            self.writer.anchor()
