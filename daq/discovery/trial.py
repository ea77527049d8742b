"""Short conversation with an instrument, as in the daemon, and the resulting findings."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from daq import clock
from daq.acquisition.stream_buffer import faults_of, samples_of, size_of
from daq.acquisition.streams import Stream
from daq.discovery.cell_finding import CellFinding, check_condition, condition_in, doubtful, ok, wrong
from daq.protocol.bus import Bus
from daq.protocol.conversation import Fault, FaultKind, Item, Sample
from daq.wire.conversation_loop import run_conversation
from daq.wire.links import Link, LinkLost
from rigs.errors import CellError
from rigs.schema.condition import CONDITION
from rigs.schema.links import Line, tcp_address
from rigs.signedness import unsigned_readings

_LISTEN_S = 2.0
_TALK_S, _LONGEST_WAIT_S = 1.0, 5.0
"""Time for the first readings after discarding old data, and the longest wait."""
_ENOUGH = 3
"""Consecutive readings that rule out chance: 1 in 64 random triples is a valid Micro-Epsilon value."""
OF_THE_INSTRUMENT = {FaultKind.MISSING, FaultKind.DEVICE_ERROR}
"""Faults reported by the instrument itself. They prove the protocol."""
_FEW, _POOR_SHARE = 2, 0.05
"""Tolerable number of faults, absolute and per reading. The second is also the tolerable share of lost time."""
_SLOW = 0.5
_POOR_PPM = 1000.0
_USUAL = (
    "9600 8N1, 4800 7E2, 9600 7E1, 9600 7E2, 19200 8E1, 19200 8N1, 9600 8E1, 38400 8N1, 57600 8N1, 115200 8N1, "
    "115200 8E1, 921600 8N1"
)
USUAL_LINES = tuple(map(Line.model_validate, _USUAL.split(", ")))
"""Settings of gauges at delivery, the most common first."""


@dataclass(frozen=True)
class Trial:
    items: Sequence[Item] = ()
    seconds: float = 0.0
    received: int = 0
    carried: int = 0
    """Bytes in both directions."""
    error: CellError | None = None
    """Why a port did not open."""

    @property
    def samples(self) -> list[Sample]:
        return list(samples_of(self.items))

    @property
    def rate_hz(self) -> float:
        """Readings per second; 0 if all arrived at the same time, as before the loss of a link."""
        stamps_ns = samples_of(self.items).last_byte_ns
        lasted_ns = int(stamps_ns[-1] - stamps_ns[0]) if len(stamps_ns) else 0
        return (len(stamps_ns) - 1) * 1e9 / lasted_ns if lasted_ns else 0.0

    @property
    def evidence(self) -> tuple[bool, float, int]:
        """Agreement with the protocol, a sort key: whether enough readings in a row exclude chance, the share of
        understood messages, and the number of readings."""
        readings = row = longest = faults = 0
        for item in self.items:
            if not isinstance(item, Fault):
                row, readings = row + size_of(item), readings + size_of(item)
                longest = max(longest, row)
            elif item.kind not in OF_THE_INSTRUMENT:
                row, faults = 0, faults + item.count
        return longest >= _ENOUGH, readings / max(1, readings + faults), readings

    @property
    def faults(self) -> Counter[FaultKind]:
        kinds = Counter[FaultKind]()
        for fault in faults_of(self.items):
            kinds[fault.kind] += fault.count
        return kinds

    @property
    def unanswered_s(self) -> float:
        """Time between readings with an unanswered request or a late answer; not the time before the first reading."""
        lost_ns, last_ns, is_late = 0, 0, False
        for item in self.items:
            if isinstance(item, Fault):
                is_late |= item.kind in {FaultKind.SILENT, FaultKind.LATE}
                continue
            stamps_ns = samples_of([item]).last_byte_ns
            if is_late and last_ns:
                lost_ns += int(stamps_ns[0]) - last_ns
            last_ns, is_late = int(stamps_ns[-1]), False
        return lost_ns / 1e9

    @property
    def understood(self) -> bool:
        """True if the protocol works: mostly readings, or errors reported by the instrument."""
        kinds = self.faults
        answered, garbled = len(samples_of(self.items)) + kinds[FaultKind.DEVICE_ERROR], kinds[FaultKind.GARBLED]
        return answered >= _ENOUGH and answered > garbled

    @property
    def last_fault(self) -> str:
        return next((item.detail for item in reversed(self.items) if isinstance(item, Fault)), "")


def describe_silence(port: str, trial: Trial) -> str:
    """A host may accept the connection and send no data."""
    is_lost = any(fault.kind == FaultKind.DISCONNECTED for fault in faults_of(trial.items))
    return ACCEPTED if tcp_address(port) and not trial.error and not is_lost else "nothing arrived"


ACCEPTED = "accepts the connection, but sends no data"


class _Counted:
    def __init__(self, link: Link) -> None:
        self._link = link
        self.received = self.carried = 0

    def read(self, timeout_s: float) -> bytes:
        data = self._link.read(timeout_s)
        self.received += len(data)
        self.carried += len(data)
        return data

    def write(self, data: bytes) -> None:
        self._link.write(data)
        self.carried += len(data)

    def set_dtr(self, on: bool) -> None:
        self._link.set_dtr(on)


def try_line(stream: Stream, line: Line, patience_s: float, listen_s: float) -> Trial:
    """Run a conversation with these line settings until it works, and then for another `listen_s`."""
    try:
        link = replace(stream, line=line).open()
    except CellError as error:
        return Trial(error=error)
    counted, items, began = _Counted(link), list[Item](), clock.now_s()
    until, understood = began + patience_s, False

    def ended() -> bool:
        nonlocal until, understood
        if not understood and Trial(items).understood:
            understood, until = True, clock.now_s() + listen_s
        return clock.now_s() >= until

    def deliver(new: Sequence[Item]) -> None:
        link.note_items(new)
        items.extend(new)

    host, end = stream.host(), list[Item]()
    try:
        run_conversation(counted, host, deliver, ended)
    except LinkLost as lost:
        end.append(Fault(FaultKind.DISCONNECTED, clock.now_ns(), f"the connection was lost: {lost}"))
    finally:
        link.close()
    items += [*host.handle_link_loss(clock.now_ns()), *link.take_ignored(), *end]  # including pending faults
    return Trial(items, clock.now_s() - began, counted.received, counted.carried)


def examine_conversation(stream: Stream, timeout_s: float) -> Iterator[CellFinding]:
    patience_s, serial = _TALK_S + min(_LONGEST_WAIT_S, 2 * timeout_s), stream.port.startswith("/")
    trial = try_line(stream, stream.line, patience_s, _LISTEN_S)

    def search() -> Line | None:
        others = (line for line in USUAL_LINES if serial and line != stream.line)
        return next((line for line in others if try_line(stream, line, patience_s, 0).understood), None)

    yield check_answers(stream, trial, search)
    if trial.understood and trial.samples:
        yield from filter(
            None, (check_rate(stream, trial) if serial else None, check_clock(stream.name, trial.samples))
        )
        yield from check_signs(stream, trial)
        yield from check_condition(stream.name, condition_in(stream.columns, trial.samples[-1]))


def check_signs(stream: Stream, trial: Trial) -> Iterator[CellFinding]:
    """Gauges of a link that report negative values as large positive values."""
    for name, column in zip(stream.columns, samples_of(trial.items).values.T, strict=True):
        if name.endswith("_mm") and (unsigned := unsigned_readings(column)):
            yield wrong(stream.name, f"{name}: {unsigned[0]}", unsigned[1])


def check_answers(stream: Stream, trial: Trial, search: Callable[[], Line | None]) -> CellFinding:
    """Check that the protocol works. search: finds the correct line settings."""
    if trial.error is not None:
        return wrong(stream.name, f"{stream.port}: {trial.error.what}", trial.error.remedy)
    how = f"{stream.port} at {stream.line}" if stream.port.startswith("/") else stream.port
    how += f" with {stream.modem}" if stream.modem else ""
    if trial.samples and trial.understood:
        return _check_readings(stream, trial, how)
    if trial.understood:
        return wrong(stream.name, f"{how}: the device answers with an error", trial.last_fault)
    if line := search():
        return wrong(stream.name, f"does not answer at {stream.line}, but answers at {line}", f"write line: {line}")
    observation, remedy = describe_silence(stream.port, trial), "check that it is on, and the cable"
    if trial.received:
        observation = f"{trial.received} bytes arrived, but no reading"
        remedy = "check `interface` and the port: the connected device is of a different kind"
    return wrong(stream.name, f"{how}: {observation}", trial.last_fault or remedy)


def _check_readings(stream: Stream, trial: Trial, how: str) -> CellFinding:
    """All gauges of a link must deliver readings, with few faults."""
    readings = samples_of(trial.items)
    observation = f"{how}: {len(readings)} readings in {trial.seconds:.0f} s"
    silent = [stream.columns[k] for k in np.flatnonzero(np.isnan(readings.values).all(axis=0))]
    if missing := [name for name in silent if name not in CONDITION]:
        return wrong(stream.name, f"{observation}, but without {', '.join(missing)}", trial.last_fault)
    faults = trial.faults
    counts = ", ".join(f"{count} {kind}" for kind, count in faults.items() if count)
    if trial.unanswered_s > _POOR_SHARE * trial.seconds:
        pauses = f"{trial.unanswered_s:.1f} s of them without an answer"
        return doubtful(stream.name, f"{observation}, {pauses} ({counts})", trial.last_fault)
    if faults.total() > _FEW and faults.total() > _POOR_SHARE * len(readings):
        return doubtful(stream.name, f"{observation}, and {counts}", trial.last_fault)
    return ok(stream.name, f"{observation}; not available: {', '.join(silent)}" if silent else observation)


def check_rate(stream: Stream, trial: Trial) -> CellFinding | None:
    readings, reached_hz = len(trial.samples), trial.rate_hz
    if readings < _ENOUGH or not reached_hz:
        return None
    host = stream.host()
    gap_ns = host.gap_ns if isinstance(host, Bus) else 0
    possible_hz = readings * 1e9 / (trial.carried * stream.line.character_ns + readings * gap_ns)
    observation = f"{reached_hz:.1f} readings a second; the line supports {possible_hz:.1f}"
    if reached_hz >= _SLOW * possible_hz:
        return ok(stream.name, observation)
    remedy = "shorten the adapter's latency timer; otherwise the instrument is the limit"
    return doubtful(stream.name, observation, remedy)


def check_clock(about: str, samples: Sequence[Sample]) -> CellFinding | None:
    """Compare the rate of the instrument clock with this computer's, by the earliest arrivals: delays are positive."""
    quarter = len(samples) // 4
    if quarter < _ENOUGH or math.isnan(samples[0].device_time_s):
        return None
    begin_ns, end_ns = samples[0].last_byte_ns, samples[-1].last_byte_ns
    if begin_ns == end_ns:  # all arrived at the same time, as before the loss of a link
        return None
    late_ns = [sample.last_byte_ns - begin_ns - sample.device_time_s * 1e9 for sample in samples]
    slope = (min(late_ns[-quarter:]) - min(late_ns[:quarter])) / (0.75 * (end_ns - begin_ns))
    level_ns = [late - slope * (s.last_byte_ns - begin_ns) for late, s in zip(late_ns, samples, strict=True)]
    jitter_ns = sorted(level_ns)[len(level_ns) // 2] - min(level_ns)
    drift_ppm, uncertain_ppm = -1e6 * slope, 1e6 * jitter_ns / (end_ns - begin_ns)
    observation = f"the clock runs {drift_ppm:+z.0f} ± {uncertain_ppm:.0f} ppm against this computer's"
    if abs(drift_ppm) - 3 * uncertain_ppm < _POOR_PPM:
        return ok(about, observation)
    return doubtful(about, observation, "check `rate_hz` and the unit of the clock; a good clock is within 100 ppm")
