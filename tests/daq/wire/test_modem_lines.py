import fcntl
import os
import struct
import termios
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import pytest

import daq.gauges
from daq.acquisition.stream_buffer import faults_of, samples_of
from daq.emulators.pty_line import PtyLine
from daq.protocol.conversation import ConversationStep, FaultKind, Host, Item
from daq.wire import links, serial_port
from daq.wire.conversation_loop import run_conversation
from daq.wire.links import SerialLink, open_link
from rigs.schema.links import Line, ModemLines
from tests.support.drivers import gauge, sylvac
from tests.support.simulated_conversation import S, Script

LINE = Line.model_validate("4800 7E2")
LEAST_OFF_NS = 110_000_000
ANSWER_NS = 16 * S // 1000


@dataclass
class OptoRS:
    """A cable as its manual has it: supplied by one line high and one low, asked by its own pin.

    Duplex: DTR high and RTS low supply it, `?` asks. Simplex: RTS high supplies it, DTR low for 110 ms asks.
    """

    simplex: bool
    dtr: bool
    rts: bool
    off_since_ns: int | None = None
    asked_ns: list[int] = field(default_factory=list)

    @property
    def supplied(self) -> bool:
        return self.rts if self.simplex else self.dtr and not self.rts

    def hear(self, step: ConversationStep, now_ns: int) -> bytes:
        """Immediate answer to a step."""
        if step.dtr is not None:
            fallen, self.dtr = self.dtr and not step.dtr, step.dtr
            risen_after = None if self.off_since_ns is None or not step.dtr else now_ns - self.off_since_ns
            self.off_since_ns = now_ns if fallen else None if step.dtr else self.off_since_ns
            if self.simplex and self.supplied and risen_after is not None and risen_after >= LEAST_OFF_NS:
                return self._reading(now_ns)
        return self._reading(now_ns) if not self.simplex and self.supplied and b"?\r" in step.send else b""

    def _reading(self, now_ns: int) -> bytes:
        self.asked_ns.append(now_ns)
        return b"+1.234\r"


def _talk(host: Host, cable: OptoRS, seconds: int) -> list[Item]:
    step, now_ns, items, coming = host.connected(0), 0, list[Item](), list[tuple[int, bytes]]()
    while now_ns < seconds * S:
        items += step.items
        if answer := cable.hear(step, now_ns):
            coming.append((now_ns + ANSWER_NS, answer))
        if coming and coming[0][0] <= step.wake_ns:
            now_ns, data = coming.pop(0)
            step = host.received(data, now_ns)
        else:
            now_ns = max(now_ns, step.wake_ns)
            step = host.tick(now_ns)
    return items


@pytest.mark.parametrize("cable", ["duplex", "simplex"])
def test_a_cable_with_its_lines_is_read(cable):
    probe = sylvac(cable=cable)
    model = OptoRS(cable == "simplex", probe.modem.dtr, probe.modem.rts)
    items = _talk(daq.gauges.host([probe]), model, 20)
    assert {item.values for item in samples_of(items)} == {(1.234,)}
    assert len(items) > (400 if cable == "duplex" else 60) and not faults_of(items)


@pytest.mark.parametrize("cable", ["duplex", "simplex"])
def test_a_cable_with_the_lines_of_the_other_is_silent(cable):
    wrong = OptoRS(cable == "simplex", dtr=True, rts=cable == "duplex")
    if cable == "simplex":
        wrong.rts = False
    items = _talk(daq.gauges.host([sylvac(cable=cable)]), wrong, 5)
    assert {item.kind for item in faults_of(items)} == {FaultKind.SILENT}
    assert not samples_of(items)


def test_a_simplex_reading_is_requested_when_its_line_goes_off():
    script = Script(daq.gauges.host([sylvac(cable="simplex")]))
    off = script.wake()
    assert off.dtr is False and off.send == b""
    requested_ns = script.now_ns
    on = script.wake()
    assert on.dtr is True and script.now_ns - requested_ns >= LEAST_OFF_NS
    script.receive(b"+1.000\r", script.now_ns + 5)
    (sample,) = script.taken()
    assert sample.requested_ns == requested_ns
    assert script.wake().dtr is False and script.now_ns - requested_ns >= 2 * LEAST_OFF_NS


def test_a_simplex_cable_cannot_send_continuously():
    with pytest.raises(ValueError, match="write mode: polled"):
        sylvac(cable="simplex", mode="continuous")


# --- the calls of the system ---

_CALLS = {getattr(termios, name): name for name in ("TIOCMBIS", "TIOCMBIC", "TIOCMSET")}
_LINES = {termios.TIOCM_DTR: "DTR", termios.TIOCM_RTS: "RTS"}


@pytest.fixture
def calls(monkeypatch):
    seen: list[str] = []
    ioctl, write = fcntl.ioctl, os.write

    def traced(fd: int, request: int, argument: Any = 0, *rest: Any) -> Any:
        if request in _CALLS:
            seen.append(f"{_CALLS[request]} {_LINES[struct.unpack('I', argument)[0]]}")
            return 0
        return ioctl(fd, request, argument, *rest)

    def written(fd: int, data: bytes) -> int:
        seen.append(f"write {data!r}")
        return write(fd, data)

    monkeypatch.setattr(fcntl, "ioctl", traced)
    monkeypatch.setattr("daq.wire.links.os.write", written)
    return seen


@pytest.mark.parametrize(
    ("modem", "set_first"),
    [
        (ModemLines(dtr=True, rts=False), ["TIOCMBIS DTR", "TIOCMBIC RTS"]),
        (ModemLines(dtr=True, rts=True), ["TIOCMBIS DTR", "TIOCMBIS RTS"]),
        (None, ["TIOCMBIS DTR", "TIOCMBIS RTS"]),
    ],
)
def test_the_lines_are_set_before_the_first_byte(calls, modem, set_first):
    line = PtyLine(LINE)
    link = open_link("g1", line.port, LINE, modem=modem)
    link.write(b"?\r")
    link.set_dtr(False)
    link.set_dtr(True)
    link.close()
    line.close()
    writes = calls.index("write b'?\\r'")
    assert calls[writes - 2 : writes] == set_first
    assert calls[writes + 1 :][:2] == ["TIOCMBIC DTR", "TIOCMBIS DTR"]


def test_a_conversation_moves_the_line(calls):
    line = PtyLine(LINE)
    link = open_link("g1", line.port, LINE, modem=sylvac(cable="simplex").modem)
    calls.clear()
    run_conversation(
        link, daq.gauges.host([sylvac(cable="simplex", timeout_s=0.05)]), lambda _: None, lambda: len(calls) >= 4
    )
    link.close()
    line.close()
    assert calls[:4] == ["TIOCMBIC DTR", "TIOCMBIS DTR"] * 2


def test_a_pty_without_modem_lines_is_opened_all_the_same():
    line = PtyLine(LINE)
    link = open_link("g1", line.port, LINE, modem=ModemLines(dtr=True, rts=False))
    link.set_dtr(False)
    link.close()
    line.close()


# --- an echo ---


@pytest.mark.parametrize("cut", [1, 2, 100])
@pytest.mark.parametrize(
    ("interface", "request_", "reply"),
    [
        ("sylvac_opto_rs", b"?\r", b"+1.500\r"),
        ("tesa_tt", b"?\r", b"+0001.50\r\n"),
        ("mahr_c1202", b"M1?\r", b"1 +001.5000 mm\r"),
        ("mitutoyo_usb", b"1\r", b"01A+0001.500\r"),
        ("cdi_iq", b"R\r", b"+  1.5000, MM\r\n"),
    ],
)
def test_a_request_that_is_echoed_is_no_answer(interface, request_, reply, cut):
    script = Script(daq.gauges.host([gauge(interface)]))
    assert script.wake().send == request_
    heard = request_ + reply
    for k in range(0, len(heard), cut):
        script.receive(heard[k : k + cut], script.now_ns + 1)
    (sample,) = script.taken()
    assert sample.values == (1.5,) and sample.size == len(reply)


def test_errors_counted_by_the_port_are_reported(monkeypatch):
    """A pty counts nothing, so the counts are given; their places are those of `linux/serial.h`."""
    counts, now_s = [0] * 20, [0.0]
    monkeypatch.setattr(serial_port.fcntl, "ioctl", lambda fd, request, room: struct.pack("@20i", *counts))
    monkeypatch.setattr(links.clock, "now_s", lambda: now_s[0])
    master, slave = os.openpty()
    try:
        link = SerialLink("g1", SimpleNamespace(fileno=lambda: slave, close=lambda: None))
        counts[6:9], counts[10], now_s[0] = [2, 3, 4], 1, 2.0
        (fault,) = link.take_ignored()
        assert (fault.kind, fault.count) == (FaultKind.LINE, 10)
        assert "3 overrun, 2 wrong framing, 4 wrong parity, 1 buffer overrun" in fault.detail
        now_s[0] = 4.0
        assert link.take_ignored() == []
    finally:
        os.close(master)
        os.close(slave)


def test_a_port_that_counts_nothing_has_no_line_errors():
    master, slave = os.openpty()
    try:
        assert serial_port.line_errors(slave) == {}
    finally:
        os.close(master)
        os.close(slave)
