import contextlib
import os
import socket
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

from daq import clock
from daq.acquisition.reader import StreamReader
from daq.acquisition.stream_buffer import StreamBuffer
from daq.acquisition.streams import Stream, streams_of
from daq.emulators.simulated_clock import SimulatedClock
from daq.store import read_run
from daq.wire.links import LinkLost, open_link
from rigs.load import parse
from rigs.schema.links import Line
from tests.support.bench import PATIENCE_S, Bench, rig_text
from tests.support.drivers import OPC_UA
from tests.support.refusals import refused

LINE = Line(baud=9600, bits=8, parity="N", stop=1)


def _robot(**feedback: object) -> Stream:
    data = yaml.safe_load(rig_text())
    data["feedback"] = feedback
    return streams_of(parse(yaml.safe_dump(data), "bench"))[-1]


def _until(so: Callable[[], Any]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not so():
        assert time.monotonic() < deadline
        time.sleep(0.01)


@contextlib.contextmanager
def _reading(stream: Stream) -> Iterator[Callable[[str], int]]:
    buffer = StreamBuffer(stream.name, stream.columns)
    reader = StreamReader(stream, buffer, stream.open())
    reader.start()
    try:
        yield lambda kind: buffer.state().counters.get(kind, 0)
    finally:
        reader.stop()
        reader.join(5)


# --- TCP ---


class _Silent:
    """Links to a peer that accepts a connection and sends nothing. Each counts as lost after 0.2 s."""

    def __init__(self) -> None:
        self.opened_s: list[float] = []
        self.closed_s: list[float] = []

    def open(self, *_: object, **__: object) -> Any:
        self.opened_s.append(clock.now_s())
        return self

    def read(self, timeout_s: float) -> bytes:
        clock.sleep(timeout_s)
        if clock.now_s() > self.opened_s[-1] + 0.2:
            raise LinkLost("nothing arrived")
        return b""

    def close(self) -> None:
        self.closed_s.append(clock.now_s())

    def write(self, data: bytes) -> None: ...
    def set_dtr(self, on: bool) -> None: ...
    def note_items(self, items: object) -> None: ...
    def take_ignored(self) -> list[Any]:
        return []


@pytest.mark.parametrize("interface", ["line_feed", "ur_rtde"])
def test_accepting_silent_peer_is_closed_and_called_again(interface):
    peer = _Silent()
    with SimulatedClock(1).running():
        stream = replace(_robot(interface=interface, port="tcp://127.0.0.1:1", timeout_s=0.1), opening=peer.open)
        with _reading(stream) as count:
            clock.sleep(30)
        counts = {kind: count(kind) for kind in ("disconnected", "silent", "samples")}
    pauses_s = [after - before for before, after in zip(peer.closed_s, peer.opened_s[1:], strict=False)]
    assert pauses_s == pytest.approx([0.2, 0.4, 0.8, 1.6, 3.2, 5.0, 5.0, 5.0, 5.0], abs=0.01)
    assert counts == {"disconnected": len(pauses_s) + 1, "silent": len(pauses_s) + 1, "samples": 0}


def test_a_connection_that_brings_something_now_and_then_is_not_dead(monkeypatch):
    now_s = 100.0
    monkeypatch.setattr("daq.wire.links.clock", SimpleNamespace(now_s=lambda: now_s))
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = open_link("robot", f"tcp://127.0.0.1:{server.getsockname()[1]}", LINE, dead_s=0.5)
        sock, _ = server.accept()
        with sock, contextlib.closing(link):
            for _ in range(8):
                sock.sendall(b"x")
                assert link.read(PATIENCE_S) == b"x"
                now_s += 0.4
                assert link.read(0.0) == b""
            now_s += 0.2
            with pytest.raises(LinkLost, match="arrived"):
                link.read(0.0)


def test_silent_tcp_peer_gets_keepalive_probes():
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = open_link("robot", f"tcp://127.0.0.1:{server.getsockname()[1]}", LINE, dead_s=10)
        with contextlib.closing(link), socket.socket(fileno=os.dup(link.fileno())) as sock:
            assert sock.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE) == 1
            names = (socket.TCP_KEEPIDLE, socket.TCP_KEEPINTVL, socket.TCP_KEEPCNT)
            idle_s, every_s, times = (sock.getsockopt(socket.IPPROTO_TCP, name) for name in names)
            assert idle_s + every_s * times < 10
            assert sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) < 10_000


# --- A TCP port of ours ---

LISTED = b"1000,1,2,3,4,5,6\n"


def _lines(**changes: object) -> Stream:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = f"tcp://127.0.0.1:{server.getsockname()[1]}"
    return _robot(**{"interface": "line_feed", "port": port, "listens": True, "timeout_s": 0.2} | changes)


def _caller(stream: Stream) -> socket.socket:
    sock = socket.create_connection(("127.0.0.1", int(stream.port.rpartition(":")[2])), PATIENCE_S)
    sock.settimeout(PATIENCE_S)
    return sock


def test_a_program_that_connects_is_read_and_a_second_one_refused():
    stream = _lines(timeout_s=5)
    with _reading(stream) as count, _caller(stream) as program:
        program.sendall(LISTED)
        _until(lambda: count("samples") == 1)
        with _caller(stream) as second:
            assert second.recv(1) == b""  # hung up on
            _until(lambda: count("stranger") == 1)
        program.sendall(LISTED)
        _until(lambda: count("samples") == 2)
        assert count("disconnected") == count("garbled") == 0


def test_port_without_a_program_stays_open_and_silent():
    stream = _lines()
    with _reading(stream) as count:
        _until(lambda: count("silent") >= 2)
        with _caller(stream) as program:
            program.sendall(LISTED)
            _until(lambda: count("samples") == 1)
        assert count("disconnected") <= 1


def test_a_program_that_is_started_again_leaves_no_half_line_behind():
    stream = _lines(timeout_s=5)
    with _reading(stream) as count:
        for turn in (1, 2, 3):
            _until(lambda: _connected(stream, LISTED + b"10"))
            _until(lambda turn=turn: count("disconnected") == turn)
            assert count("samples") == turn and count("garbled") == 0


def _connected(stream: Stream, sent: bytes) -> bool:
    try:
        with _caller(stream) as program:
            program.sendall(sent)
    except ConnectionRefusedError:
        return False
    return True


@pytest.mark.parametrize("babble", [b"", b"GET / HTTP/1.0\r\n\r\n"])
def test_one_that_sends_nothing_readable_makes_room_for_the_next(babble):
    stream = replace(_lines(timeout_s=5), dead_s=10 * PATIENCE_S)
    with _reading(stream) as count, _caller(stream) as first:
        first.sendall(babble)
        _until(lambda: count("garbled") == babble.count(b"\n"))
        _until(lambda: count("samples") or not _connected(stream, LISTED))
        _until(lambda: _connected(stream, LISTED) and count("samples"))
        assert first.recv(1) == b""


def test_a_program_that_vanishes_is_left():
    stream = replace(_lines(timeout_s=0.1), dead_s=0.3)
    with _reading(stream) as count, _caller(stream) as gone:
        gone.sendall(LISTED)
        _until(lambda: count("disconnected") == 1)
        _until(lambda: _connected(stream, LISTED))
        _until(lambda: count("samples") == 2)


# --- UDP ---


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        return int(sock.getsockname()[1])


def _rob(ipoc: int) -> bytes:
    joints = " ".join(f'A{axis}="{axis}.5"' for axis in range(1, 7))
    return f'<Rob Type="KUKA"><AIPos {joints}/><IPOC>{ipoc}</IPOC></Rob>'.encode()


def _sender(port: int) -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.connect(("127.0.0.1", port))
    sock.settimeout(PATIENCE_S)
    return sock


def test_a_second_sender_is_counted_and_neither_read_nor_answered():
    port = _free_port()
    stream = _robot(interface="kuka_rsi", port=f"udp://127.0.0.1:{port}", timeout_s=3)
    with _sender(port) as robot, _sender(port) as stranger, _reading(stream) as count:
        stranger.send(b"scan")
        _until(lambda: count("garbled") == 1)
        robot.send(_rob(4))
        assert robot.recv(100) == b'<Sen Type="ImFree"><IPOC>4</IPOC></Sen>'  # nonsense made nobody the peer
        stranger.send(_rob(999))
        _until(lambda: count("stranger") == 1)
        robot.send(_rob(8))
        assert robot.recv(100) == b'<Sen Type="ImFree"><IPOC>8</IPOC></Sen>'
        _until(lambda: count("samples") == 2)
        stranger.setblocking(False)
        with pytest.raises(BlockingIOError):
            stranger.recv(100)


def test_after_a_silence_another_may_speak():
    port = _free_port()
    stream = _robot(interface="kuka_rsi", port=f"udp://127.0.0.1:{port}", timeout_s=0.2)
    with _sender(port) as robot, _sender(port) as again, _reading(stream) as count:
        robot.send(_rob(4))
        _until(lambda: count("silent"))
        again.send(_rob(400_000))
        assert again.recv(100) == b'<Sen Type="ImFree"><IPOC>400000</IPOC></Sen>'
        _until(lambda: count("samples") == 2)
        assert count("stranger") == count("skipped") == count("disconnected") == 0


def test_only_the_called_controller_is_heard():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as controller:
        controller.bind(("127.0.0.1", 0))
        controller.settimeout(PATIENCE_S)
        port = f"udp://127.0.0.1:{controller.getsockname()[1]}"
        with _reading(_robot(interface="fanuc_stream_motion", port=port, version=1)) as count:
            asked, host = controller.recvfrom(100)
            assert asked == bytes.fromhex("00000000 00000001")
            with _sender(host[1]) as stranger:
                stranger.send(bytes(132))
                _until(lambda: count("stranger") == 1)
            controller.sendto(bytes(132), host)
            _until(lambda: count("samples") == 1)


@pytest.mark.parametrize(
    ("address", "code"),
    [
        ("tcp://203.0.113.7", "port.refused"),
        ("udp://203.0.113.7", "port.refused"),
        ("tcp://127.0.0.1", "port.refused"),  # taken
        ("udp://127.0.0.1", "port.refused"),
        (f"udp://{'a' * 64}", "address.invalid"),
    ],
)
def test_an_address_that_cannot_be_ours_is_refused(address, code):
    kind = socket.SOCK_STREAM if address.startswith("tcp") else socket.SOCK_DGRAM
    with socket.socket(socket.AF_INET, kind) as other:
        other.bind(("127.0.0.1", 0))
        with refused(code):
            open_link("robot", f"{address}:{other.getsockname()[1]}", LINE, listens=True)


# --- through the real daemon ---

RESTARTED = [
    ("disconnected", "ros2_joint_states", "tcp://192.168.1.5:9090", {"joints": [f"joint_{k}" for k in range(1, 7)]}),
    pytest.param(
        *("disconnected", "opc_ua_robotics", "tcp://192.168.1.5:4840", {}),
        marks=pytest.mark.skipif(not OPC_UA, reason="no asyncua"),
    ),
    ("disconnected", "line_feed", "tcp://192.168.1.5:9000", {"listens": True}),
    ("silent", "line_feed", "udp://192.168.1.5:9000", {"listens": True}),
    ("silent", "kuka_rsi", "udp://192.168.1.5:49152", {}),
    ("silent", "abb_egm", "udp://192.168.1.5:6510", {}),
    ("silent", "fanuc_stream_motion", "udp://192.168.1.100:60015", {}),
]


@pytest.mark.parametrize(("ended", "interface", "port", "keys"), RESTARTED)
def test_recording_survives_a_restart_of_the_controller(ended, interface, port, keys, tmp_path):
    data = yaml.safe_load(rig_text())
    data["feedback"] = {"interface": interface, "port": port, "timeout_s": 0.5} | keys
    with Bench(tmp_path, yaml.safe_dump(data)) as bench:
        bench.start().all_reading()
        path = bench.record()
        bench.recorded(20)
        bench.cell.hang_up("robot")
        state = bench.until(lambda state: ended in state["streams"]["robot"]["counters"])
        bench.recorded(state["samples"]["robot"] + 20)
        assert bench.run("rig", "record", "stop").returncode == 0
        assert bench.run("rig", "verify", path).returncode == 0
        run = read_run(path)
        robot = run.streams["robot"]
        for axis, angle in enumerate(bench.motion.deg, 1):
            assert np.allclose(robot[f"q{axis}_deg"], angle, atol=1e-5)
        assert "garbled" not in run.manifest.counters["robot"]
        if port.startswith("udp") and interface != "line_feed":
            assert np.isfinite(robot["device_time_s"]).all() and (robot["requested_ns"] == -1).all()
