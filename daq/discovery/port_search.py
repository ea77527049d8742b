"""Parallel search of ports. Each port is opened exclusively and left with the original settings.

The first line settings with a matching protocol end the search of a port, after all interfaces were tried with them.
"""

from __future__ import annotations

import contextlib
import math
import os
import termios
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from pydantic import TypeAdapter, ValidationError
from serial.tools import list_ports

from daq import clock, gauges
from daq.acquisition.host_clock import StallWatch
from daq.acquisition.stream_buffer import faults_of
from daq.acquisition.streams import Stream
from daq.discovery.attempts import Attempt, FoundGauge, PortReport, Probing, Sends, attempts
from daq.discovery.cell_finding import FindingVerdict
from daq.discovery.examine_computer import examine_port
from daq.discovery.trial import Trial, try_line
from daq.protocol.conversation import FaultKind, Host
from daq.wire.serial_port import is_built_in, port_names
from rigs.schema.gauges import Gauge
from rigs.schema.links import Line, Port

_ANSWER_S = 0.3
"""Time limit for a response: 21 ms of characters at 4800 baud, 16 ms of an adapter, up to 50 ms of an instrument."""
_STALL_NS = 250_000_000
"""Stall of the computer after which an attempt is repeated: a response may have been missed."""
_MOST_REPEATS = 3
_PATIENCE_S = 2.0
_SILENT_S = 20.0
"""Time limit for a built-in port, which exists even if no instrument is connected."""
_CONFIRM_S = 0.5
"""Time for further readings after a match."""
LISTEN_S = 1.0
_ROOT = Path("/")

_PORT: TypeAdapter[str] = TypeAdapter(Port)
Progress = Callable[[str], None]


@dataclass(frozen=True)
class SearchOptions:
    ports: tuple[str, ...]
    """Serial devices and TCP addresses named by the user. Other ports are not opened."""
    named: Mapping[str, Sequence[Attempt]] = field(default_factory=dict)
    """Attempts for ports with a known instrument."""
    listen_s: float = LISTEN_S
    """Listening time for each setting."""
    modbus_units: tuple[int, ...] = (1,)


def ports_here() -> dict[str, str]:
    """Serial ports of this computer with the description of the system. No port is opened."""
    known = (port for port in list_ports.comports() if port.description != "n/a")
    descriptions = {Path(port.device).resolve(): port.description for port in known}
    return {name: descriptions.get(Path(name).resolve(), "") for name in port_names()}


def search(options: SearchOptions, progress: Progress) -> list[PortReport]:
    """Search all ports in parallel. Ctrl-C ends all attempts and restores the settings of the ports."""
    descriptions, reports, stop = ports_here(), dict[str, PortReport](), clock.Event()

    def search_one(port: str) -> None:
        reports[port] = search_port(PortReport(port, descriptions.get(port, "")), options, progress, stop)

    threads = [clock.Thread(target=search_one, args=(port,), name=f"search {port}") for port in options.ports]
    try:
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    except BaseException:
        stop.set()
        join_started(threads)
        raise
    return [reports[port] for port in options.ports]


def join_started(threads: Sequence[threading.Thread]) -> None:
    """Wait for all started threads. A thread that is still starting will stop immediately."""
    for thread in threads:
        if thread.is_alive():
            thread.join()


def search_port(report: PortReport, options: SearchOptions, progress: Progress, stop: threading.Event) -> PortReport:
    port = report.port
    try:
        _PORT.validate_python(port)
    except ValidationError:
        return _failed_report(report, "is not a port", "write a port such as /dev/serial/by-id/… or tcp://host:502")
    if port.startswith("/"):
        for finding in examine_port(port, port, _ROOT, served=False):
            if finding.verdict is FindingVerdict.WRONG:
                return _failed_report(report, finding.what.removeprefix(f"{port}: "), finding.remedy)
    tried = options.named.get(port) or attempts(port, options.modbus_units)
    stalls = StallWatch(_STALL_NS)
    stalls.start()
    try:
        with _restored_settings(port):
            return _search_attempts(
                report, tried, partial(_try_attempt, port, stalls, options.listen_s), progress, stop
            )
    except (OSError, termios.error) as error:
        return _failed_report(report, f"is not a serial port ({error.args[-1]})", "give the path of a serial port")
    finally:
        stalls.stop()


def host_of(members: Sequence[Gauge], sends: Sends, listen_s: float, silences: int = 1) -> Host:
    timeout_s = listen_s if sends == "nothing" else _ANSWER_S if sends == "requests" else members[0].timeout_s
    limited = [gauge.model_copy(update={"timeout_s": timeout_s}) for gauge in members]
    return Probing(gauges.host(limited), sends, silences)


def _search_attempts(
    report: PortReport,
    tried: Sequence[Attempt],
    trial_of: Callable[[Attempt], Trial],
    progress: Progress,
    stop: threading.Event,
) -> PortReport:
    best: list[tuple[Attempt, Trial]] = []
    own_error: tuple[Attempt, Trial] | None = None
    received = 0
    unanswered: set[tuple[bytes, Line]] = set()
    until_s = clock.now_s() + (_SILENT_S if is_built_in(report.port) else math.inf)
    for number, attempt in enumerate(tried, 1):
        if not received and clock.now_s() > until_s:
            return _silent_report(report, 0, number - 1, len(tried))
        answered = best[0] if best else own_error
        if stop.is_set() or (answered and attempt.line != answered[0].line):
            break
        asked = attempt.request, attempt.line
        if asked in unanswered:  # a different interface with the same request
            continue
        progress(f"{number} of {len(tried)}: {attempt.interface} at {attempt.line} on {report.port}")
        trial = trial_of(attempt)
        if trial.error is not None:
            return _failed_report(report, trial.error.what, trial.error.remedy)
        kinds = {fault.kind for fault in faults_of(trial.items)}
        if FaultKind.DISCONNECTED in kinds:
            return _failed_report(report, f"disappeared during the search ({trial.last_fault})", "plug it in again")
        received += trial.received
        if attempt.sends == "requests" and not trial.received:
            unanswered.add(asked)
        if trial.evidence[0]:
            best.append((attempt, trial))
        elif not trial.samples and kinds == {FaultKind.DEVICE_ERROR}:
            own_error = own_error or (attempt, trial)
    if best:
        ranked = sorted(best, key=_rank, reverse=True)
        also = tuple(attempt.interface for attempt, _ in ranked[1:] if attempt.interface != ranked[0][0].interface)
        return _with_gauges(report, *ranked[0], also)
    if own_error:
        attempt, trial = own_error
        problem = f"{attempt.interface} at {attempt.line}: the device answers with an error"
        return _failed_report(report, problem, trial.last_fault)
    return _silent_report(report, received, len(tried), len(tried))


def _rank(candidate: tuple[Attempt, Trial]) -> tuple[bool, float, bool, int]:
    """Sort key of a matching attempt.

    An interface whose messages end in a carriage return also matches instruments that add a line feed.
    """
    enough, understood, readings = candidate[1].evidence
    return enough, understood, not candidate[0].gauges[0].ends_in_cr, readings


def _try_attempt(port: str, stalls: StallWatch, listen_s: float, attempt: Attempt) -> Trial:
    """Make an attempt, and repeat it if the computer stalled before the first reading."""
    host = partial(host_of, attempt.gauges, attempt.sends, listen_s)
    stream = Stream(port, (), port, attempt.line, host, modem=attempt.gauges[0].modem)
    stalls.take()
    for _ in range(1 + _MOST_REPEATS):
        trial = try_line(stream, attempt.line, _PATIENCE_S + listen_s, _CONFIRM_S)
        if trial.samples or trial.error or not stalls.take():
            break
    return trial


def _with_gauges(report: PortReport, attempt: Attempt, trial: Trial, also: tuple[str, ...]) -> PortReport:
    found = []
    for column, gauge in enumerate(attempt.gauges):
        values = (sample.values[column] for sample in reversed(trial.samples))
        reading = next((value for value in values if not math.isnan(value)), None)
        if reading is not None:
            declared = gauge.model_copy(update={"line": attempt.line})
            found.append(FoundGauge(declared, reading, trial.rate_hz, attempt.sends, also))
    return replace(report, gauges=tuple(found))


def _silent_report(report: PortReport, received: int, attempts_made: int, of: int) -> PortReport:
    if received:
        problem = f"{received} bytes arrived, but none of the {attempts_made} attempts can decode them"
        return _failed_report(report, problem, "see rig interfaces; give the interface: --key g1.interface=… --g1 PORT")
    problem = f"silent in {attempts_made} attempt{'s' * (attempts_made != 1)}"
    if attempts_made < of:
        problem += f" of {of}; a built-in port is tried for at most {_SILENT_S:.0f} s"
    remedy = (
        "switch it on and check the cable; if it sends only when a button is pressed, press it during a longer "
        "--listen-s; if it sends only after a command, give the interface: --g1 PORT --key g1.interface=…"
    )
    return _failed_report(report, problem, remedy)


def _failed_report(report: PortReport, problem: str, remedy: str) -> PortReport:
    return replace(report, problem=problem, remedy=remedy)


@contextlib.contextmanager
def _restored_settings(port: str) -> Iterator[None]:
    """Restore the settings of a serial port at the end, and keep it open, so that its control lines do not change."""
    if not port.startswith("/"):
        yield
        return
    fd = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        before = termios.tcgetattr(fd)
        try:
            yield
        finally:
            with contextlib.suppress(termios.error):  # unplugged in the meantime
                termios.tcsetattr(fd, termios.TCSANOW, before)
    finally:
        os.close(fd)
