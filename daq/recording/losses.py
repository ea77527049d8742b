"""Samples that came for a recording and are neither in a run nor counted in one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from daq import clock
from daq.acquisition.stream_buffer import StreamBuffer
from daq.protocol.conversation import Fault, FaultKind
from daq.recording.rate_limited_log import RateLimitedLog


class Losses:
    """Counts such samples of each stream, and reports faults that were found after a stream was read."""

    def __init__(self, buffers: Mapping[str, StreamBuffer], warnings: RateLimitedLog) -> None:
        self._buffers, self._warnings = buffers, warnings
        self.counts: Counter[str] = Counter()

    def add(self, samples: Counter[str], why: str) -> None:
        """Report and count samples that no run holds or counts."""
        self.counts += samples
        for name, count in (+samples).items():
            what = f"{count} samples are in no run: {why}"
            self.report(name, [Fault(FaultKind.DROPPED, clock.now_ns(), what, count)])

    def report(self, name: str, faults: Sequence[Fault]) -> None:
        """Log and count faults of a stream that were found here and are in the run already."""
        self._warnings.warn_faults(name, faults)
        self._buffers[name].count(faults)
