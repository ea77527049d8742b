"""Silent, slow and numerous connections: none of them delays other pages."""

from __future__ import annotations

import socket
import time
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest

from analysis.apps.window import serve as run
from analysis.apps.window import watcher
from tests.support.windows import PATIENCE_S, Served, served, told

EVENTS = b"GET /events HTTP/1.0\r\nHost: 127.0.0.1\r\n\r\n"
"""By the older version, in which a stream comes as it is, without the sizes of its parts."""


def heard(one: Served, count: int = 3) -> float:
    """Return the time in s until a reading browser has received this number of events."""
    begun_s = time.monotonic()
    with one.raw(EVENTS) as sock:
        data = ""
        while len(told(data, "now")) < count:
            received = sock.recv(65536)
            assert received, data
            data += received.decode("utf-8", "replace")
    return time.monotonic() - begun_s


def ended(sock: socket.socket) -> bool:
    """Whether the other side has closed a connection."""
    sock.settimeout(PATIENCE_S)
    with suppress(ConnectionResetError):
        while sock.recv(65536):
            pass
    return True


def test_silent_connections_make_room_and_are_closed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "HEAD_S", 2.0)
    with served(tmp_path) as one, ExitStack() as stack:
        silent = [stack.enter_context(one.raw()) for _ in range(3 * run.MOST_CONNECTIONS)]
        heard(one)
        assert one.ask("/").status == 200
        assert all(ended(sock) for sock in silent)


def test_a_head_that_comes_drop_by_drop_is_not_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "HEAD_S", 0.3)
    with served(tmp_path) as one, one.raw(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: ") as sock:
        assert ended(sock)
        with one.raw(b"GET /static/icon.svg HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n") as second:
            assert second.recv(15) == b"HTTP/1.1 200 OK"
            second.sendall(b"GET /")
            assert ended(second)


def test_a_reader_that_takes_nothing_is_dropped_and_starves_nobody(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "SLOW_S", 0.5)
    with served(tmp_path) as one, ExitStack() as stack:
        slow = []
        for _ in range(5):
            sock = stack.enter_context(socket.socket())
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            sock.connect(("127.0.0.1", one.port))
            sock.sendall(EVENTS)
            slow.append(sock)
        ballast, number = "x" * 60_000, 0
        end_s = time.monotonic() + PATIENCE_S
        while one.window.watcher.board.viewers < len(slow) and time.monotonic() < end_s:
            time.sleep(0.01)
        assert one.window.watcher.board.viewers == len(slow)
        while one.window.watcher.board.viewers and time.monotonic() < end_s:
            number += 1
            one.window.watcher.board.post("ballast", {"number": number, "text": ballast})
            time.sleep(0.02)
        assert one.window.watcher.board.viewers == 0
        assert heard(one) < 10


def test_pages_beyond_the_most_are_told_to_come_later(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("analysis.apps.window.app.MOST_VIEWERS", 3)
    assert watcher.MOST_VIEWERS >= 10
    with served(tmp_path) as one, ExitStack() as stack:
        for _ in range(3):
            stack.enter_context(one.raw(EVENTS)).recv(100)
        refused = one.ask("/events")
        assert refused.status == 503 and refused.headers["retry-after"]


@pytest.mark.parametrize(
    "data",
    [
        b"\x00" * 100,
        b"GET / HTTP/9.9\r\n\r\n",
        b"GET " + b"/" * 20_000 + b" HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nHost: evil\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: -1\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n" + b"X: y\r\n" * 5000 + b"\r\n",
        b"POST /login HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 99999999999999999999\r\n\r\n",
        b"GET /events HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
    ],
)
def test_nonsense_ends_nothing(tmp_path: Path, data: bytes) -> None:
    with served(tmp_path) as one:
        with one.raw(data) as sock:
            sock.settimeout(0.3)
            with suppress(TimeoutError, ConnectionResetError):
                sock.recv(1000)
        assert one.ask("/").status == 200


def test_a_browser_that_goes_is_forgotten(tmp_path: Path) -> None:
    with served(tmp_path) as one:
        with one.raw(EVENTS) as sock:
            sock.recv(100)
            assert one.window.watcher.board.viewers == 1
        end_s = time.monotonic() + PATIENCE_S
        while one.window.watcher.board.viewers:
            assert time.monotonic() < end_s
            time.sleep(0.02)


def test_a_port_that_is_taken_is_said(tmp_path: Path) -> None:
    from rigs.errors import CellError  # noqa: PLC0415

    with served(tmp_path) as one, pytest.raises(CellError, match="cannot be used for listening"):
        run.listening("127.0.0.1", one.port)
