import fcntl
import importlib
import math
import os
import signal
import termios
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import Any, TypeVar

import pytest
from pydantic import ValidationError

from daq import clock
from daq.acquisition.host_clock import StallWatch
from daq.acquisition.streams import Stream, streams_of
from daq.discovery import port_watch
from daq.discovery.attempts import Attempt, PortReport, attempts, missing_keys, named_attempts
from daq.discovery.port_search import SearchOptions, host_of, ports_here, search
from daq.discovery.port_watch import PortWatch, pushed_gauge
from daq.discovery.trial import Trial, try_line
from daq.emulators.instruments import instruments_of
from daq.emulators.pty_line import PtyLine, heard
from daq.emulators.simulated_cell import SimulatedLine
from daq.emulators.simulated_clock import SimulatedClock
from daq.protocol.conversation import Device, Fault, FaultKind, Sample
from daq.wire.serial_port import port_names
from rigs.interfaces import list_interfaces
from rigs.load import parse
from rigs.schema.links import Line
from tests.support.bench import PATIENCE_S, ByHand
from tests.support.simulated_conversation import Script
from tests.support.unknown_cells import GAUGES, cell_text, switched_on

LISTEN_S = 0.3
SEARCH = importlib.import_module("daq.discovery.port_search")  # its package has a function of the same name
_One = TypeVar("_One")


def searched(*ports: str, **more: object) -> list[PortReport]:
    return search(SearchOptions(ports, listen_s=LISTEN_S, **more), lambda doing: None)


@dataclass
class Simulated:
    """A cell as `switched_on` makes it, in simulated time. Its ports are ptys, which keep their settings alone; the
    bytes go by lines in memory."""

    lines: dict[str, SimulatedLine]
    hand: ByHand

    @property
    def gauge_ports(self) -> list[str]:
        return list(self.lines)


@contextmanager
def simulated(kind: str, *told: bytes) -> Iterator[Simulated]:
    rig, made = parse(cell_text(kind, "ur"), "unknown"), Simulated({}, ByHand())
    devices = instruments_of(rig, made.hand)
    with ExitStack() as at_the_end:
        at_the_end.enter_context(SimulatedClock(1).running())
        patched = at_the_end.enter_context(pytest.MonkeyPatch.context())
        true: dict[str, Line] = {}

        def switched_on(stream: Stream, word: bytes) -> Device:
            device: Any = devices[stream.name]()
            if word:
                device.connected = lambda now_ns: replace(device.received(word, now_ns), send=b"")
            return device

        for stream, word in zip_longest(streams_of(rig)[:-1], told, fillvalue=b""):
            pty = PtyLine(stream.line)
            at_the_end.callback(pty.close)
            line, true[pty.port] = SimulatedLine(stream.name, stream.line.character_ns), stream.line
            made.lines[pty.port] = line
            line.serve(partial(switched_on, stream, word), [])

        def opened(name: str, port: str, line: Line, **_: object) -> Any:
            cable = made.lines[port]
            end, send = cable.open(), None
            cable.change = lambda data: (data, 0)
            if line.baud != true[port].baud:
                send, cable.change = end.write, lambda data: (heard(data, true[port], line), 0)
                end.write = lambda data: send(heard(data, line, true[port]))
            return end

        for module in (SEARCH, port_watch):
            patched.setattr(module, "Stream", partial(Stream, opening=opened))
        yield made


@pytest.mark.parametrize("kind", [kind for kind in GAUGES if "at" not in kind.split()])
def test_the_gauges_of_a_cell_are_found(kind):
    with simulated(kind, *[b"OUTPUT RS422\n"] * 2 * (kind == "micro_epsilon")) as unknown:
        unknown.hand.mm = {"g1": 0.125, "g2": 0.25} if kind != "micro_epsilon" else {"g1": -3.75, "g2": -2.5}
        reports = searched(*unknown.gauge_ports)
    found = [gauge for report in reports for gauge in report.gauges]
    wanted = GAUGES[kind]
    assert [gauge.gauge.interface for gauge in found] == [gauge["interface"] for gauge in wanted], reports
    assert [gauge.gauge.channel for gauge in found] == [gauge.get("channel", 1) for gauge in wanted]
    measured = list(unknown.hand.mm.values())[: len(wanted)]
    if kind == "micro_epsilon":  # in percent of 10 mm, from the start of its range
        measured = [10 * (value + 5) for value in measured]
    assert [gauge.reading_mm for gauge in found] == pytest.approx(measured, abs=0.006)
    assert {gauge.lacks for gauge in found} == {("range_mm",) if kind == "micro_epsilon" else ()}


def test_a_silent_port_of_the_computer_is_given_up_soon(monkeypatch):
    monkeypatch.setattr(SEARCH, "is_built_in", lambda port: True)
    # private: the real limit is 20 s
    monkeypatch.setattr(SEARCH, "_SILENT_S", 0.5)
    line = PtyLine(Line.model_validate("9600 8N1"))
    try:
        (report,) = searched(line.port)
    finally:
        line.close()
    assert not report.gauges and "built-in port" in report.problem


def test_the_ports_to_choose_from_are_those_of_rig_doctor(tmp_path):
    (tmp_path / "dev").mkdir()
    for name, kind in [("ttyS0", "4"), ("ttyS1", "0"), ("ttyUSB0", "")]:
        (tmp_path / "dev" / name).touch()
        (tmp_path / "sys/class/tty" / name).mkdir(parents=True)
        (tmp_path / "sys/class/tty" / name / "type").write_text(f"{kind}\n")
    assert port_names(tmp_path) == ["/dev/ttyUSB0", "/dev/ttyS0"]
    assert list(ports_here()) == port_names()


def test_a_cable_that_was_left_streaming_is_only_listened_to():
    with simulated("sylvac", b"OUT1\r") as unknown:
        reports = searched(*unknown.gauge_ports)
    modes = [gauge.gauge.mode for report in reports for gauge in report.gauges]
    assert modes == ["continuous", "polled"]


def of(interface: str, port: str) -> dict[str, list[Attempt]]:
    return {port: [attempt for attempt in attempts(port) if attempt.interface == interface]}


def test_sensor_started_by_command_is_silent_unless_named():
    with simulated("micro_epsilon") as unknown:
        port, _ = unknown.gauge_ports
        (listened,) = searched(port, named=of("micro_epsilon_ild1420", port))
        fields = {"interface": "micro_epsilon_ild1420", "port": port, "range_mm": 10, "zero_mm": 5}
        (named,) = searched(port, named={port: named_attempts(fields)})
    assert listened.problem.startswith("silent") and "interface" in listened.remedy
    (gauge,) = named.gauges
    assert (gauge.sends, gauge.lacks) == ("all", ()) and gauge.reading_mm == pytest.approx(0.1, abs=1e-3)


def test_other_line_settings_are_tried_after_those_of_the_maker():
    with simulated("keyence at 38400") as unknown:
        (port,) = unknown.gauge_ports
        (report,) = searched(port, named=of("keyence_dl_rs1a", port))
    assert [str(gauge.gauge.line) for gauge in report.gauges] == ["38400 8N1"] * 2


def test_a_modbus_unit_with_registers_of_its_own():
    with simulated("other registers at") as unknown:
        (port,) = unknown.gauge_ports
        (report,) = searched(port, named=of("modbus_map", port))
    assert report.problem.startswith("modbus_map at 57600 8E1: ")
    assert "ILLEGAL_ADDRESS" in report.remedy and "check `address`" in report.remedy


def test_ports_that_cannot_be_searched(tmp_path):
    (tmp_path / "file").write_text("no port")
    for port in searched("ttyUSB0", "tcp://host", "tcp://host:99999", "", "udp://127.0.0.1:5"):
        assert port.problem == "is not a port" and "/dev/" in port.remedy
    missing, file = searched(str(tmp_path / "none"), str(tmp_path / "file"))
    assert "exist" in missing.problem
    assert "not a serial" in file.problem, file


def test_a_port_that_another_program_has_locked():
    with switched_on("tesa") as unknown:
        (port,) = unknown.gauge_ports
        with Path(port).open("rb") as held:
            fcntl.flock(held, fcntl.LOCK_EX)
            (report,) = searched(port)
    assert report.problem.startswith("in use")


def test_a_silent_port_and_one_that_babbles():
    silent, babbling = (PtyLine(Line.model_validate("9600 8N1"), paced=False) for _ in range(2))
    stop = threading.Event()

    def babble() -> None:
        while not stop.wait(0.02):
            babbling.write(bytes(range(33, 120)))

    thread = threading.Thread(target=babble)
    thread.start()
    named = {
        port: named_attempts({"interface": "tesa_tt", "port": port, "line": "9600 8N1", "timeout_s": 0.2})
        for port in (silent.port, babbling.port)
    }
    try:
        nothing, something = searched(silent.port, babbling.port, named=named)
    finally:
        stop.set()
        thread.join()
        silent.close()
        babbling.close()
    assert nothing.problem.startswith("silent") and "--listen-s" in nothing.remedy
    assert "bytes arrived" in something.problem and "rig interfaces" in something.remedy


def test_a_request_that_nothing_answers_is_sent_once_at_each_line():
    silent, said = PtyLine(Line.model_validate("9600 8N1"), paced=False), list[str]()
    tried = [attempt for attempt in attempts(silent.port) if attempt.request == b"?\r"][:4]
    try:
        search(SearchOptions((silent.port,), {silent.port: tried}, LISTEN_S), said.append)
    finally:
        silent.close()
    assert len({str(attempt.line) for attempt in tried}) == len(said) < len(tried)


def test_attempt_during_a_stall_is_repeated(monkeypatch):
    """An answer that arrives while the computer stalls is missed, so the request is sent again."""
    watches, held_up = list[StallWatch](), list[Line]()

    class Watched(StallWatch):
        def start(self) -> None:
            super().start()
            watches.append(self)

    def stood_still(stream: Stream, line: Line, *patience: float) -> Trial:
        if line in held_up:
            return try_line(stream, line, *patience)
        held_up.append(line)
        watches[0].note(0, 300_000_000)
        return Trial()

    monkeypatch.setattr(SEARCH, "StallWatch", Watched)
    monkeypatch.setattr(SEARCH, "try_line", stood_still)
    with simulated("tesa") as unknown:
        (port,) = unknown.gauge_ports
        (report,) = searched(port, named=of("tesa_tt", port))
    assert report.gauges and held_up


def test_ctrl_c_ends_the_search_and_restores_the_port():
    # What a shell starts in the background ignores it from the beginning.
    before_test = signal.signal(signal.SIGINT, signal.default_int_handler)
    with ExitStack() as at_the_end, switched_on("tesa") as unknown:
        at_the_end.callback(signal.signal, signal.SIGINT, before_test)
        (port,) = unknown.gauge_ports
        fd = os.open(port, os.O_RDWR | os.O_NOCTTY)
        try:
            before = termios.tcgetattr(fd)
            with pytest.raises(KeyboardInterrupt):
                search(SearchOptions((port,), listen_s=LISTEN_S), lambda doing: signal.raise_signal(signal.SIGINT))
            assert termios.tcgetattr(fd) == before
        finally:
            os.close(fd)
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("search")]


def test_a_port_that_disappears_while_it_is_searched():
    with simulated("tesa") as unknown:
        (port,) = unknown.gauge_ports
        (report,) = search(
            SearchOptions((port,), listen_s=LISTEN_S),
            lambda doing: unknown.lines[port].unplug() if "tesa" in doing else None,
        )
    assert not report.gauges and report.problem and report.remedy


def _awaited(what: Callable[[], _One | None]) -> _One:
    """Poll until the result is not empty, in the time of the cell."""
    deadline = clock.now_s() + PATIENCE_S
    while not (found := what()):
        assert clock.now_s() < deadline
        clock.sleep(0.01)
    return found


def test_the_gauge_that_is_pushed_is_seen():
    with simulated("keyence") as unknown:
        (report,) = searched(*unknown.gauge_ports)
        with PortWatch(report.gauges) as watch:
            watch.measure_rest()
            places = list(watch.readings_mm())
            for _ in range(20):
                clock.sleep(0.02)
                assert watch.pushed_gauge(places) is None
            unknown.hand.mm["g2"] += 1.5
            place = _awaited(lambda: watch.pushed_gauge(places))
            assert watch.grows(place)
            watch.measure_rest()
            unknown.hand.mm["g2"] -= 1.5
            unknown.hand.mm["g1"] += 1.5
            other = _awaited(lambda: watch.pushed_gauge(places[:1]))  # while the finger leaves the second one
    assert other == places[0]
    assert place == report.gauges[1].place and place.endswith("#2")


GOOD = Sample((1.0,), -1, 0, 0, 8)


def fault(kind: FaultKind) -> Fault:
    return Fault(kind, 0, "")


@pytest.mark.parametrize(
    ("items", "enough"),
    [
        ([GOOD] * 3, True),
        ([GOOD] * 2, False),
        ([GOOD, fault(FaultKind.LATE)] * 20, False),
        ([GOOD, GOOD, fault(FaultKind.GARBLED)] * 20, False),
        ([fault(FaultKind.GARBLED), *[GOOD] * 3], True),
        ([GOOD, fault(FaultKind.MISSING)] * 3, True),
        ([GOOD, fault(FaultKind.DEVICE_ERROR)] * 3, True),
        ([fault(FaultKind.DEVICE_ERROR)] * 9, False),
        ([], False),
    ],
)
def test_readings_in_a_row(items, enough):
    assert Trial(items).evidence[0] is enough


def test_the_clean_protocol_ranks_first():
    faults = [fault(FaultKind.GARBLED), replace(fault(FaultKind.GARBLED), count=500)]
    doubtful, many = (Trial([*[GOOD] * 9, one]).evidence for one in faults)
    assert Trial([GOOD] * 5).evidence > doubtful > many > Trial([GOOD]).evidence


REST = {"a": [0.0, 0.001, 0.0, 0.001, 0.0], "b": [5.0, 5.001, 5.0, 5.0, 5.0]}


@pytest.mark.parametrize(
    ("now_mm", "moved"),
    [
        ({"a": 0.0, "b": 5.0}, None),
        ({"a": 0.1, "b": 5.0}, None),
        ({"a": 0.9, "b": 5.0}, "a"),
        ({"a": -0.9, "b": 5.1}, "a"),
        ({"a": 0.0, "b": 3.0}, "b"),
        ({"a": 0.9, "b": 5.9}, None),
        ({"a": 0.9}, "a"),
        ({}, None),
        ({"a": math.nan, "b": 5.0}, None),
    ],
)
def test_the_gauge_that_moved(now_mm, moved):
    assert pushed_gauge(REST, now_mm) == moved


def test_an_unrestful_gauge_has_to_move_further():
    rest = {"a": [0.0, 0.3, -0.3, 0.2, 0.0], "b": [0.0] * 5}
    assert pushed_gauge(rest, {"a": 0.5, "b": 0.0}) is None
    assert pushed_gauge(rest, {"a": 2.5, "b": 0.0}) == "a"


PORT = "/dev/ttyUSB0"


def test_every_confirmed_gauge_is_tried_and_no_other():
    confirmed = {one.name for one in list_interfaces() if one.kind == "gauge" and one.origin.standing == "confirmed"}
    assert {attempt.interface for attempt in attempts(PORT)} == confirmed


def test_these_requests_are_sent_and_no_other():
    """As docs/rig-init.md lists them: what is added here is sent to machines that nobody has named."""
    sent = {attempt.request for attempt in attempts(PORT) if attempt.sends == "requests"}
    texts = {b"?\r", b"M0\r\n", b"R\r", b"M\r", b"1\r", b"\x02", b"\x1bA0800\r"}
    assert sent == texts | {bytes.fromhex("01 04 00c8 000d b031")}


def test_the_makers_line_settings_come_before_others():
    lines = {one.name: one.line for one in list_interfaces()}
    asked = [attempt for attempt in attempts(PORT) if attempt.sends == "requests"]
    declared = [attempt for attempt in asked if str(attempt.line) == lines[attempt.interface]]
    assert len(declared) > 5
    # Baumer's own settings are those of the shipped rig, not the default of any Modbus gauge.
    first_others = [str(attempt.line) != lines[attempt.interface] for attempt in asked].index(True)
    assert {a.interface for a in asked[first_others:][:1]} == {"modbus_map"} and first_others >= len(declared) - 1


def test_over_the_network_a_gauge_speaks_modbus():
    assert [attempt.interface for attempt in attempts("tcp://127.0.0.1:502")] == ["modbus_map"]


@pytest.mark.parametrize("attempt", attempts(PORT)[:30], ids=lambda a: f"{a.interface} {a.line} {a.sends}")
def test_only_requests_are_sent(attempt):
    script = Script(host_of(attempt.gauges, attempt.sends, 0.3))
    assert script.sent == b""  # what a conversation opens with is ignored
    for _ in range(20):
        script.wake() if script.step.wake_ns is not None else None
        script.receive(b"\x00garbage\r\n+1.2", script.now_ns + 50_000_000)
    for setting in (b"OUT0", b"OUT1", b"OUTPUT"):
        assert setting not in script.sent
    if attempt.sends == "nothing":
        assert script.sent == b""


def test_a_named_instrument_is_spoken_to_as_rigd_would():
    tried = named_attempts({"interface": "micro_epsilon_ild1420", "port": PORT, "range_mm": 25})
    assert str(tried[0].line) == "921600 8N1" and tried[0].sends == "all" and len(tried) > 5
    assert Script(host_of(tried[0].gauges, "all", 0.3)).sent == b"OUTPUT RS422\n"
    (only,) = named_attempts({"interface": "tesa_tt", "port": PORT, "line": "9600 8N1"})
    assert str(only.line) == "9600 8N1"


def test_a_named_instrument_needs_its_keys():
    with pytest.raises(ValidationError, match="range_mm"):
        named_attempts({"interface": "micro_epsilon_ild1420", "port": PORT})
    with pytest.raises(ValidationError):
        named_attempts({"interface": "no such", "port": PORT})
    assert missing_keys("micro_epsilon_ild1420") == ["range_mm"]


def test_an_attempt_that_hears_nothing_ends():
    (first, *_) = [attempt for attempt in attempts(PORT) if attempt.interface == "tesa_tt"]
    script = Script(host_of(first.gauges, first.sends, 0.3))
    for _ in range(5):
        if script.step.hang_up:
            break
        script.wake()
    assert script.step.hang_up and script.sent == b"?\r"
