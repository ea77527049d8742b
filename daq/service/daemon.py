"""The daemon: a reader per link, a recorder, a control socket, and notifications to the service manager."""

from __future__ import annotations

import contextlib
import logging
import math
import os
import shutil
import socket
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError

from daq import clock
from daq.acquisition.capture_writer import CaptureWriter, ReplayMarks
from daq.acquisition.host_clock import HOST, DriftMonitor
from daq.acquisition.reader import StreamReader, keep_stamps_prompt
from daq.acquisition.stream_buffer import StreamBuffer, samples_of
from daq.acquisition.streams import ROBOT, streams_of
from daq.protocol.conversation import Item
from daq.recording.active_run import NAME_RULE, RunLabel
from daq.recording.automatic import Arbiter
from daq.recording.recorder import Recorder
from daq.service.control import ControlServer
from daq.service.maintenance import Maintenance, RunRetention
from daq.service.metrics import metrics_text
from daq.service.trust import InstanceLock
from daq.store import RunWriter, new_manifest
from daq.store.ledger import Ending
from daq.store.startup_recovery import StartupRecovery
from daq.wire.links import Link, open_link
from rigs.errors import CellError, RigError, UseError
from rigs.rig import Rig
from rigs.schema.part import Part
from rigs.schema.vocabulary import CIRCLES
from rigs.text import escape_lines, escape_text


def notify(message: str) -> None:
    """Send a message to the service manager, such as `READY=1`, with a variable per line (sd_notify(3))."""
    address = os.environ.get("NOTIFY_SOCKET")
    if not address:
        return
    if address.startswith("@"):
        address = "\0" + address[1:]
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
        sock.sendto(escape_lines(message).encode(), address)


MOST = 20
"""Samples per stream in an answer to a live view, evenly thinned: at ten answers a second, a screen cannot show more.

Encoding takes processor time from the readers, 0.35 ms for three streams on a busy computer.
"""
_DIGITS = 7
"""Decimals of values: 0.1 nm or 1e-7 degrees."""
_LONGEST_RIG = 500_000
"""Characters of the rig file in an answer. Shipped ones have 4000."""


class _Request(Part):
    """Request for samples. after: last known sample number by stream. rig: the rig file is needed."""

    command: str
    after: dict[str, Annotated[int, Field(ge=0)]] = Field(default={}, max_length=64)
    rig: bool = False


def recent_samples(request: Mapping[str, Any], buffers: Mapping[str, StreamBuffer], rig_text: str) -> dict[str, Any]:
    try:
        asked = _Request.model_validate(request)
    except ValidationError as error:
        problem = f"invalid samples request: {error.errors(include_url=False)[0]['msg']}"
        remedy = 'send {"command": "samples", "after": {"g1": 0}}'
        raise CellError("control socket", problem, remedy, code="request.invalid") from None
    streams = {}
    for name, buffer in buffers.items():
        newest, samples = buffer.recent(asked.after.get(name, 0))
        step = max(1, math.ceil(len(samples) / MOST))
        rows = [
            [
                sample.first_byte_ns,
                *(round(value, _DIGITS) if math.isfinite(value) else None for value in sample.values),
            ]
            for sample in samples[::-1][::step][::-1]  # always includes the newest sample
        ]
        streams[name] = {"newest": newest, "columns": list(buffer.columns), "rows": rows}
    text = rig_text if asked.rig and len(rig_text) <= _LONGEST_RIG else ""
    return {"now_ns": clock.now_ns(), "streams": streams, "rig_lines": text.splitlines()}


log = logging.getLogger("rigd")
_BRIEF = 80
_MOST_SAID = 300
"""Characters of a client's remark about a run: a path or a sentence."""
_HEART_STOPS_S = 5.0
_LEAVE_S = 3.0
"""Time for a reader to close the port. Then name resolution and a long recovery are abandoned."""


class Daemon:
    def __init__(
        self,
        rig: Rig,
        rig_text: str,
        runs: Path,
        socket_path: Path,
        capture: Path | None = None,
        metrics: Path | None = None,
        *,
        opening: Callable[..., Link] = open_link,
    ) -> None:
        """metrics: file for Prometheus's node_exporter. opening: opens the links, like `open_link`."""
        self._rig, self._rig_text, self._runs, self._socket_path = rig, rig_text, runs, socket_path
        self._streams = [replace(stream, opening=opening) for stream in streams_of(rig)]
        self._buffers = {stream.name: StreamBuffer(stream.name, stream.columns) for stream in self._streams}
        self._recorder = Recorder(self._buffers, self._create, self._after_round, self._on_items)
        self._arbiter = Arbiter(self._recorder, rig.automatic)
        self._drift = {stream.name: DriftMonitor() for stream in self._streams}
        self._retention = RunRetention(runs, rig.name, rig.retention) if rig.retention else None
        self._maintenance = Maintenance(metrics, lambda: metrics_text(self._status()), self._retention)
        self._replay = ReplayMarks(Path(rig.replay)) if rig.replay else None
        self._control = ControlServer(socket_path, self.answer)
        self._capture = CaptureWriter(capture, self._streams) if capture else None
        self._startup_recovery = StartupRecovery(runs)
        self._locks = ExitStack()
        self._readers: list[StreamReader]

    def start(self) -> None:
        """Take the locks, open every link, and start reading. The error names all ports that failed."""
        with ExitStack() as undo:
            undo.enter_context(self._locks)
            self._locks.callback(InstanceLock.take(self._rig.name, self._socket_path).release)
            with suppress(OSError):
                self._runs.mkdir(parents=True, exist_ok=True)
            for stream in self._streams:
                if stream.name != ROBOT and stream.opening is open_link:  # a controller serves several clients
                    self._locks.callback(InstanceLock.take_gauge(stream.name, stream.port).release)
            links = self._open_links()
            for link in links.values():
                undo.callback(link.close)
            self._control.start()
            undo.callback(self._control.close)
            self._maintenance.start()
            undo.callback(self._maintenance.stop)
            if self._capture:
                self._capture.start()
            undo.pop_all()
        self._readers = [StreamReader(s, self._buffers[s.name], links[s.name], self._capture) for s in self._streams]
        if self._replay:
            self._replay.skip()
        _warn_if_not_writable(self._runs)
        keep_stamps_prompt()
        for thread in (*self._readers, self._recorder, self._startup_recovery):
            thread.start()
        ports = ", ".join(f"{stream.name} on {stream.port}" for stream in self._streams)
        log.info("serving %s: %s; control socket %s", self._rig.name, ports, self._socket_path)
        notify(f"READY=1\nSTATUS=reading {escape_text(ports)}")

    def close(self, exit_status: Ending, why: str) -> Path | None:
        """Stop all parts in order, the control socket first, so that clients cannot start a recording afterwards.

        Returns the directory if a recording was interrupted.
        """
        notify("STOPPING=1")
        self._maintenance.stop()
        self._control.close()
        self._startup_recovery.stop()
        cut_short = self._recorder.shut_down(exit_status, why)
        for reader in self._readers:
            reader.stop()
        for thread in (*self._readers, self._startup_recovery):
            thread.join(_LEAVE_S)
        if self._capture:
            self._capture.finish(_LEAVE_S)
        self._maintenance.join(_LEAVE_S)
        self._locks.close()
        return cut_short

    def answer(self, request: dict[str, Any]) -> dict[str, Any]:
        match request.get("command"):
            case "status":
                return self._status()
            case "samples":
                return recent_samples(request, self._buffers, self._rig_text)
            case "metrics":
                return {"text": metrics_text(self._status())}
            case "record_start":
                return {"run": str(self._arbiter.start(_label(request)))}
            case "record_stop":
                ended = self._arbiter.stop()
                return {"run": str(ended.path), "counters": ended.counters, "seal": ended.seal}
            case "judged":
                self._recorder.note_end(_text_in(request, "run"), _text_in(request, "said"))
                return {}
            case other:
                commands = "available: status, samples, metrics, record_start, record_stop, judged"
                raise CellError("rigd", f"unknown command {_short(other)}", commands, code="request.invalid")

    def _open_links(self) -> dict[str, Link]:
        links: dict[str, Link] = {}
        errors: list[CellError] = []
        for stream in self._streams:
            try:
                links[stream.name] = stream.open()
            except CellError as error:
                errors.append(error)
        if not errors:
            return links
        for link in links.values():
            link.close()
        raise errors[0] if len(errors) == 1 else Unreachable(errors)

    def _create(self, label: RunLabel, follows: str) -> RunWriter:
        manifest = new_manifest(
            **dict(label), rig_name=self._rig.name, rig_text=self._rig_text, follows=follows,
            streams={stream.name: stream.columns for stream in self._streams},
        )  # fmt: skip
        return RunWriter.create(self._runs, manifest, companions=self._rig.companion_files)

    def _status(self) -> dict[str, Any]:
        try:  # the disk for the runs
            usage = shutil.disk_usage(next(path for path in (self._runs, *self._runs.parents) if path.exists()))
            disk = {"free_bytes": usage.free, "size_bytes": usage.total}
        except OSError:
            disk = None
        return {
            "rig": self._rig.name,
            "baseline_mm": self._rig.gauges.baseline_mm,
            "streams": {s.name: {"port": s.port, **vars(self._buffers[s.name].state())} for s in self._streams},
            HOST: dict(self._recorder.host.counts),
            "clocks": {name: vars(clock) for name, watch in self._drift.items() if (clock := watch.state())},
            "automatic": self._arbiter.state(),
            "retention": self._retention.state() if self._retention else None,
            "disk": disk,
            **self._recorder.state(),
        }

    def _on_items(self, name: str, items: Sequence[Item]) -> None:
        self._drift[name].feed(samples_of(items))
        if name == ROBOT:
            self._arbiter.feed(items)

    def _after_round(self) -> None:
        self._arbiter.after_round()
        for stream, fault in self._replay.read_new() if self._replay else ():
            if stream in self._buffers:
                self._buffers[stream].deliver([fault])
        is_watched = os.environ.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        is_watched &= os.environ.get("WATCHDOG_USEC", "").isdigit()
        if is_watched and all(buffer.alive(_HEART_STOPS_S) for buffer in self._buffers.values()):
            notify("WATCHDOG=1")


class Unreachable(CellError):
    def __init__(self, errors: list[CellError]) -> None:
        RigError.__init__(
            self, "cell", f"{len(errors)} connections cannot be opened: " + " | ".join(map(str, errors)), "see each"
        )
        self._errors = errors

    def lines(self) -> list[str]:
        return [str(error) for error in self._errors]


def _warn_if_not_writable(runs: Path) -> None:
    """Warn at start-up if recordings would be refused. A restart is not needed after the repair."""
    try:
        runs.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=runs).close()
    except FileExistsError:
        log.warning("%s: runs cannot be recorded: it is a file; give rigd a directory", runs)
    except OSError as error:
        log.warning("%s: runs cannot be recorded: %s; give rigd write permission", runs, error.strerror or error)


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= _BRIEF else f"{text[:_BRIEF]}…"


def _text_in(request: Mapping[str, Any], key: str) -> str:
    text = request.get(key)
    if not isinstance(text, str):
        problem, remedy = f"{key} {_short(text)} must be text", "send the name of the run and the problem"
        raise UseError("judged", problem, remedy, code="request.invalid")
    return escape_text(text[:_MOST_SAID])


def _label(request: dict[str, Any]) -> RunLabel:
    try:
        label = RunLabel(**{key: value for key, value in request.items() if key != "command"})
    except ValidationError as error:
        detail = error.errors(include_url=False)[0]
        key = str(detail["loc"][0]) if detail["loc"] else "a key"
        named = key if key.isidentifier() and len(key) < _BRIEF else _short(key)
        pattern = detail["type"] == "string_pattern_mismatch"
        problem = f"{named} {_short(detail['input'])} is not valid" + ("" if pattern else f": {detail['msg']}")
        remedy = NAME_RULE if pattern else "see rig record start --help"
        raise UseError("recording", problem, remedy, code="request.invalid") from None
    if label.test in CIRCLES and label.direction is None:
        where, remedy = f"{label.test} test", "add --direction cw or --direction acw"
        raise UseError(where, "needs its direction", remedy, code="request.invalid")
    if label.test not in CIRCLES and label.direction is not None:
        problem = f"a {label.test} test does not have a direction"
        raise UseError("--direction", problem, "remove it", code="request.invalid")
    return label
