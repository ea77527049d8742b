import contextlib
import errno
import json
import os
import resource
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

import daq.service.client
from daq.service import control
from daq.service.client import Client, find_socket
from daq.service.control import ControlServer, reply
from daq.service.trust import InstanceLock
from tests.support.refusals import refused


def test_other_file_in_place_of_the_socket_stays(tmp_path):
    file, folder = tmp_path / "notes.txt", tmp_path / "folder"
    file.write_text("precious")
    folder.mkdir()
    for path in (file, folder):
        with refused("daemon.refused", "exists already and is not a"):
            ControlServer(path, lambda _: {}).start()
    assert file.read_text() == "precious"


def test_an_error_in_the_program_is_no_mistake_of_who_asked():
    def fails(_: object) -> dict[str, object]:
        raise ValueError("unforeseen")

    with pytest.raises(ValueError, match="unforeseen"):  # logged with its traceback
        reply(b"{}", fails)
    assert "not JSON" in reply(b"{", fails)["what"] and "a JSON object" in reply(b"[]", fails)["what"]


def test_a_socket_has_one_daemon(tmp_path):
    lock = InstanceLock.take("cell", tmp_path / "cell.sock")
    with refused("daemon.busy", "a different rigd"):
        InstanceLock.take("cell", tmp_path / "cell.sock")
    InstanceLock.take("cell", tmp_path / "other.sock").release()
    lock.release()
    InstanceLock.take("cell", tmp_path / "cell.sock").release()


def test_hanging_daemon_is_distinguished_from_none(tmp_path, monkeypatch):
    """The daemon accepts a few connections and answers none, until the system refuses more."""
    monkeypatch.setattr(daq.service.client, "socket_directory", lambda: tmp_path)
    monkeypatch.setattr(daq.service.client, "ANSWERS_S", 0.1)
    # private: the real limit is seconds
    monkeypatch.setattr(daq.service.client, "_CONNECT_S", 0.1)
    path = tmp_path / "hanging.sock"
    with socket.socket(socket.AF_UNIX) as hanging:
        hanging.bind(str(path))
        hanging.listen(0)
        with Client(path) as client:
            with refused("daemon.silent", "rigd has not answered for"):
                client.ask("status")
            assert find_socket("hanging") == path
            with refused("daemon.busy", "too many clients are waiting"), Client(path):
                pass


PATIENCE_S = 60.0


@contextlib.contextmanager
def served(path: Path, answer: Callable[[dict[str, Any]], dict[str, Any]] = lambda _: {}) -> Iterator[Path]:
    server = ControlServer(path, answer)
    server.start()
    try:
        yield path
    finally:
        server.close()


def connected(path: Path) -> socket.socket:
    sock = socket.socket(socket.AF_UNIX)
    sock.connect(str(path))  # waits for its turn, which one with a time-out does not
    sock.settimeout(PATIENCE_S)
    return sock


def asked(sock: socket.socket, request: bytes = b"{}\n") -> dict[str, Any]:
    """The answer to a request; {} where the connection ends without one."""
    with contextlib.suppress(BrokenPipeError, ConnectionResetError):
        sock.sendall(request)
    answer = b""
    with contextlib.suppress(ConnectionResetError):
        while not answer.endswith(b"\n") and (received := sock.recv(1 << 16)):
            answer += received
    found: dict[str, Any] = json.loads(answer or b"{}")
    return found


def descriptors() -> int:
    return len(os.listdir("/proc/self/fd"))  # noqa: PTH208


def test_silent_connections_block_nobody(tmp_path):
    with served(tmp_path / "socket") as path, ExitStack() as opened:
        before, threads = descriptors(), threading.active_count()
        silent = [opened.enter_context(connected(path)) for _ in range(300)]
        for _ in range(20):
            with connected(path) as sock:
                assert asked(sock) == {"ok": True}
        assert descriptors() - before - len(silent) < 70
        assert threading.active_count() - threads < 70
        assert asked(silent[0]) == {}  # the one that was silent longest has gone


def test_full_server_refuses_new_connections_and_keeps_old_ones(tmp_path, monkeypatch):
    # private _MOST, _IDLE_S, _SEND_S: the real limits are many connections and half a minute
    monkeypatch.setattr(control, "_MOST", 3)
    begun, may_answer = threading.Semaphore(0), threading.Event()

    def slow(_: object) -> dict[str, Any]:
        begun.release()
        return {"answered": may_answer.wait(PATIENCE_S)}

    with served(tmp_path / "socket", slow) as path, ExitStack() as opened:
        busy = [opened.enter_context(connected(path)) for _ in range(3)]
        for sock in busy:
            sock.sendall(b"{}\n")
            assert begun.acquire(timeout=PATIENCE_S)
        with connected(path) as refused:
            assert "busy" in asked(refused, b"")["what"]
        may_answer.set()
        assert [asked(sock, b"") for sock in busy] == [{"ok": True, "answered": True}] * 3


def test_who_asks_nothing_is_hung_up_on(tmp_path, monkeypatch):
    monkeypatch.setattr(control, "_IDLE_S", 0.2)
    with served(tmp_path / "socket") as path, connected(path) as silent:
        assert silent.recv(1) == b""


def test_who_reads_no_answer_is_hung_up_on(tmp_path, monkeypatch):
    monkeypatch.setattr(control, "_SEND_S", 0.2)
    big = "x" * 500_000  # more than a local socket holds for a reader who does not come
    with served(tmp_path / "socket", lambda _: {"big": big}) as path, connected(path) as reads_nothing:
        reads_nothing.sendall(b"{}\n" * 3)
        time.sleep(1.0)
        received = b""
        with contextlib.suppress(ConnectionResetError):
            while piece := reads_nothing.recv(1 << 20):
                received += piece
        assert len(received) < len(big)


def test_requests_and_answers_have_a_longest_size(tmp_path):
    with served(tmp_path / "socket", lambda asked: {"big": "x" * asked["size"]}) as path:
        with connected(path) as sock:
            assert "65536 bytes" in asked(sock, b" " * 100_000 + b"{}\n")["what"]
        with connected(path) as sock:
            assert "more than a client accepts" in asked(sock, b'{"size": 2000000}\n')["what"]
            assert asked(sock, b'{"size": 3}\n') == {"ok": True, "big": "xxx"}


def test_several_requests_at_once_are_answered_in_order(tmp_path):
    with served(tmp_path / "socket", lambda request: request) as path, connected(path) as sock:
        assert asked(sock, b'{"a": 1}\n{"a": 2}\n{"a"') == {"ok": True, "a": 1}
        assert asked(sock, b"") == {"ok": True, "a": 2}
        assert asked(sock, b": 3}\n") == {"ok": True, "a": 3}


def test_exhausted_descriptors_are_reported_once(tmp_path, caplog):
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    with served(tmp_path / "socket") as path, socket.socket(socket.AF_UNIX) as sock:
        sock.settimeout(PATIENCE_S)
        resource.setrlimit(resource.RLIMIT_NOFILE, (descriptors() + 100, hard))
        taken = fill()
        try:
            sock.connect(str(path))
            until_s = time.monotonic() + PATIENCE_S
            while os.strerror(errno.EMFILE) not in caplog.text and time.monotonic() < until_s:
                time.sleep(0.01)
            time.sleep(0.5)
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
            for fd in taken:
                os.close(fd)
        assert caplog.text.count(os.strerror(errno.EMFILE)) == 1
        assert asked(sock) == {"ok": True}


def fill() -> list[int]:
    taken: list[int] = []
    with contextlib.suppress(OSError):
        while True:
            taken.append(os.dup(0))
    return taken
