import logging
import os
import termios
import threading
import tty
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import daq.acquisition.reader
import daq.acquisition.streams
import daq.recording.recorder
from daq.acquisition.reader import StreamReader
from daq.acquisition.stream_buffer import StreamBuffer, faults_of
from daq.acquisition.streams import Stream, streams_of
from daq.emulators.simulated_clock import SimulatedClock
from daq.protocol.conversation import ConversationStep, Fault, FaultKind, Item, Sample
from daq.wire.links import Link, LinkLost, open_link
from rigs.errors import CellError
from rigs.load import parse
from rigs.schema.links import Line
from tests.support.bench import PATIENCE_S, rig_text
from tests.support.refusals import refused
from tests.support.replugging import KINDS, replug, replug_simulated, wrong


@pytest.mark.parametrize("replugged", [replug_simulated, pytest.param(replug, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("kind", KINDS)
def test_every_cable_comes_back_and_nothing_is_wrong(tmp_path, kind, replugged):
    run, motion = replugged(tmp_path, kind)
    assert {name: run.manifest.counters[name]["disconnected"] for name in run.streams} == dict.fromkeys(run.streams, 1)
    assert not [told for name in run.streams for told in wrong(run, name, motion)]
    assert [fault["detail"] for fault in run.faults if " reconnected after " in fault["detail"]]
    rows = run.streams["g1"]
    behind = {name: np.roll(values, 1) if name.endswith("_mm") else values for name, values in rows.items()}
    shifted = replace(run, streams=run.streams | {"g1": behind})
    assert any("before they were asked for" in told for told in wrong(shifted, "g1", motion))


class _OneReading:
    def connected(self, now_ns: int) -> ConversationStep:
        return ConversationStep(items=(Sample((1.0,), 0, now_ns, now_ns, 1),), hang_up=True)

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        return ConversationStep()

    def tick(self, now_ns: int) -> ConversationStep:
        return ConversationStep()

    def handle_link_loss(self, now_ns: int) -> tuple[Item, ...]:
        return ()


@pytest.mark.parametrize(
    "port", [f"/{'a' * 300}", "/dev/null", "/dev", "/dev/tty\0", "/etc/hostname/x", "/etc/hostname"]
)
def test_invalid_port_is_reported_and_released(port):
    before = len(list(Path("/proc/self/fd").iterdir()))
    with pytest.raises(CellError):
        open_link("g1", port, Line(baud=9600, bits=8, parity="N", stop=1))
    assert len(list(Path("/proc/self/fd").iterdir())) == before


def test_a_character_of_wrong_parity_is_no_digit():
    """A digit of which the line turned a bit is another digit, and only its parity tells."""
    for line, checked in (("4800 7E2", True), ("9600 8N1", False)):
        master, slave = os.openpty()
        tty.setraw(slave)
        link = open_link("g1", os.ttyname(slave), Line.model_validate(line))
        assert bool(termios.tcgetattr(link.fileno())[0] & termios.INPCK) == checked
        link.close()
        os.close(master)
        os.close(slave)


def test_names_that_go_while_they_are_listed_end_no_reader(monkeypatch):
    def gone(self: Path) -> None:
        raise FileNotFoundError(str(self))

    monkeypatch.setattr(Path, "iterdir", gone)
    with refused("port.missing"):
        open_link("g1", "/dev/serial/by-id/usb-1", Line(baud=9600, bits=8, parity="N", stop=1))


def test_outage_is_one_fault_with_each_reason_once(monkeypatch):
    # private _FIRST_PAUSE_S, _LONGEST_PAUSE_S: an outage takes seconds with the real pauses
    monkeypatch.setattr(daq.acquisition.reader, "_FIRST_PAUSE_S", 0.001)
    monkeypatch.setattr(daq.acquisition.reader, "_LONGEST_PAUSE_S", 0.001)
    gauge = streams_of(parse(rig_text(), "bench"))[0]
    stream = Stream(gauge.name, ("g1_mm",), gauge.port, gauge.line, _OneReading)
    buffer, attempts, ended = StreamBuffer(stream.name, stream.columns), [], threading.Event()

    def opened(*_: object, **__: object) -> Link:
        attempts.append(None)
        if len(attempts) == 40:
            return Link("g1", -1, lambda: None)
        if len(attempts) > 45:
            ended.set()
        raise CellError("g1", "absent" if len(attempts) < 20 else "forbidden", "connect it")

    stream = replace(stream, opening=opened)
    reader = StreamReader(stream, buffer, Link("g1", -1, lambda: None))
    reader.start()
    assert ended.wait(PATIENCE_S)
    reader.stop()
    reader.join()
    faults = faults_of(buffer.drain())
    assert {fault.kind for fault in faults} == {FaultKind.DISCONNECTED}
    told = [(fault.count, fault.detail.split(": ")[-1].split(";")[0].split(" after ")[0]) for fault in faults]
    lost, back = (1, "the protocol failed"), (0, f"{stream.port} reconnected")
    assert told == [lost, (0, "absent"), (0, "forbidden"), back, lost, (0, "forbidden")]
    assert buffer.state().counters["disconnected"] == 2


class _Breaking(Link):
    def __init__(self, piece: bytes, count: int) -> None:
        super().__init__("g1", -1, lambda: None)
        self._pieces = [piece] * count

    def read(self, timeout_s: float) -> bytes:
        if not self._pieces:
            raise LinkLost("unplugged")
        return self._pieces.pop()

    def write(self, data: bytes) -> None:
        pass


def test_held_back_faults_are_reported_on_disconnection():
    stream = streams_of(parse(rig_text("sylvac"), "bench"))[0]
    buffer = StreamBuffer(stream.name, stream.columns)
    link = _Breaking(b"ERR0\r", 50)
    with SimulatedClock(1).running():
        # private _read: what the thread does until its link is lost, without the thread
        StreamReader(stream, buffer, link)._read(link)
    assert buffer.state().counters == {"device_error": 50, "disconnected": 1}


def test_details_of_a_fault_are_logged_once(caplog):
    """The end of an outage within ten seconds of its beginning is no repetition."""
    buffer = StreamBuffer("g1", ("g1_mm",))
    recorder = daq.recording.recorder.Recorder({"g1": buffer}, _no_run, lambda: None)
    buffer.deliver([Fault(FaultKind.DISCONNECTED, 1, "lost"), Fault(FaultKind.DISCONNECTED, 2, "back", 0)])
    buffer.deliver([Fault(FaultKind.DISCONNECTED, 3, "lost")])
    with caplog.at_level(logging.INFO, "rigd"):
        recorder.start()
        recorder.shut_down("complete", "")
    assert [record.getMessage() for record in caplog.records] == ["g1: disconnected: lost", "g1: back"]


def _no_run(*_: Any) -> Any:
    raise AssertionError
