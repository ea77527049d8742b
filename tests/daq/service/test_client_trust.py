import json
import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import daq.service.client
from daq import clock
from daq.service.client import Client
from daq.service.trust import InstanceLock
from rigs.errors import CellError
from tests.support.command_line import ran
from tests.support.hostile_peers import serving
from tests.support.refusals import refused

SOMEBODY = 12345
"""A user who is not the one that runs the tests."""
ROOT_ONLY = pytest.mark.skipif(os.geteuid() != 0, reason="only root can be two users")


@contextmanager
def answering(path: Path, *pieces: bytes, pause_s: float = 0.0) -> Iterator[Path]:
    """Serve a socket that answers the first line of each connection with these bytes, repeating the last ones."""

    def answer(sock: socket.socket) -> None:
        if not sock.recv(1 << 16):
            return
        for piece in pieces:
            sock.sendall(piece)
        while pause_s:
            time.sleep(pause_s)
            sock.sendall(pieces[-1])

    with serving(path, answer):
        yield path


STATUS: dict[str, Any] = {
    "ok": True,
    "rig": "cell",
    "baseline_mm": 70.0,
    "streams": {
        "g1": {
            "port": "/dev/ttyUSB0",
            "connected": True,
            "rate_hz": 10.0,
            "counters": {"samples": 3, "garbled": 1},
            "last": {"g1_mm": 0.5},
            "age_s": {"g1_mm": 0.1},
            "last_fault": "ERR",
            "waiting": 0,
        }
    },
    "automatic": {"waits_for": ["signal"], "why_not": "no"},
    "recording": None,
    "last_end": "complete",
}


def without(key: str) -> dict[str, Any]:
    return {name: value for name, value in STATUS.items() if name != key}


@pytest.mark.parametrize(
    "line",
    [
        b"{}\n",
        b"[]\n",
        b"null\n",
        b"not json\n",
        b"\xff\xfe\n",
        b"[" * 200_000 + b"\n",
        b'{"ok": ' + b"9" * 100_000 + b"}\n",
        b'{"ok": false}\n',
        b'{"ok": true}\n',
        *(json.dumps(without(key)).encode() + b"\n" for key in ("rig", "streams", "automatic", "recording")),
    ],
)
def test_an_answer_that_is_not_rigds_is_one_line(tmp_path, line):
    with answering(tmp_path / "rigd" / "cell.sock", line):
        for command in (["status"], ["live"]):
            done = ran(*command, XDG_RUNTIME_DIR=str(tmp_path))
            assert done.returncode == 4 and done.stdout == "", done.stdout
            told = done.stderr.splitlines()
            assert len(told) == 1 and "than rigd" in told[0] and told[0].isprintable(), told


def test_an_endless_line_is_given_up_on_with_little_memory(tmp_path):
    with (
        answering(tmp_path / "rigd" / "cell.sock", b"x" * (1 << 20), pause_s=1e-6) as path,
        Client(path) as client,
        pytest.raises(CellError, match="exceeds 1048576 bytes"),
    ):
        client.ask("status")


def test_an_answer_in_drops_is_not_waited_for_longer_than_any(tmp_path, monkeypatch):
    monkeypatch.setattr(daq.service.client, "ANSWERS_S", 0.5)
    with (
        answering(tmp_path / "rigd" / "cell.sock", b" ", pause_s=0.05) as path,
        Client(path) as client,
        refused("daemon.silent"),
    ):
        client.ask("status")


def test_writable_directory_is_refused_for_a_socket(tmp_path):
    outer = tmp_path / "outer"
    outer.mkdir()
    with answering(outer / "rigd" / "cell.sock", json.dumps(STATUS).encode() + b"\n") as path:
        outer.chmod(0o777)
        with refused("daemon.refused", "outer can be written by other"), Client(path):
            pass
        outer.chmod(0o1777)  # as /tmp: nobody can replace what is another's
        with Client(path) as client:
            assert client.ask("status")["rig"] == "cell"
        outer.chmod(0o700)
        path.chmod(0o666)
        with refused("daemon.refused", "allows every user of this computer"), Client(path):
            pass


@ROOT_ONLY
def test_socket_of_another_user_is_refused(tmp_path):
    tmp_path.chmod(0o1777)
    with answering(tmp_path / "rigd" / "cell.sock", json.dumps(STATUS).encode() + b"\n") as path:
        os.chown(path.parent, SOMEBODY, SOMEBODY)
        with pytest.raises(CellError, match=rf"belongs to a different user \(number {SOMEBODY}\)"), Client(path):
            pass
        link = tmp_path / "link"
        link.symlink_to(path.parent)
        for made in (path.parent, link):
            os.chown(made, 0, 0, follow_symlinks=False)
        with Client(link / "cell.sock") as client:
            assert client.ask("status")["rig"] == "cell"
        os.chown(link, SOMEBODY, SOMEBODY, follow_symlinks=False)
        with refused("daemon.refused", "link belongs to a different user"), Client(link / "cell.sock"):
            pass


@ROOT_ONLY
def test_service_directory_of_the_system_is_trusted_with_its_user(tmp_path):
    with answering(tmp_path / "rigd" / "cell.sock", json.dumps(STATUS).encode() + b"\n") as path:
        os.chown(path.parent, SOMEBODY, SOMEBODY)
        os.chown(path, SOMEBODY, SOMEBODY)
        with Client(path) as client:
            assert client.ask("status")["rig"] == "cell"


@ROOT_ONLY
def test_a_program_of_another_user_behind_a_trusted_name_is_refused(tmp_path):
    folder = tmp_path / "rigd"
    folder.mkdir()
    os.chown(folder, SOMEBODY, SOMEBODY)
    (ready, is_ready), (may_end, end) = os.pipe(), os.pipe()
    if not (poser := os.fork()):
        os.close(end)
        os.chdir(folder)
        os.setuid(SOMEBODY)
        with socket.socket(socket.AF_UNIX) as listener:
            listener.bind("s")
            listener.listen()
            os.write(is_ready, b".")
            os.read(may_end, 1)
        os._exit(0)
    try:
        assert os.read(ready, 1)
        for place in (folder, folder / "s"):
            os.chown(place, 0, 0)
        with (
            pytest.raises(CellError, match=rf"a program of a different user \(number {SOMEBODY}\) answers here"),
            Client(folder / "s"),
        ):
            pass
    finally:
        os.close(end)
        os.waitpid(poser, 0)
        for fd in (ready, is_ready, may_end):
            os.close(fd)


@pytest.mark.parametrize("mode", [0o770, 0o707, 0o1777])
def test_lock_is_in_a_private_directory(tmp_path, mode):
    place = tmp_path / "shared"
    place.mkdir()
    place.chmod(mode)
    with refused("daemon.refused", "writable for other users, who could"):
        InstanceLock.take("cell", place / "cell.sock")
    assert not list(place.iterdir())


@pytest.mark.parametrize(
    ("port", "same"),
    [("tcp://localhost:15021", "tcp://127.0.0.1:15021"), ("tcp://Gauge.example:1", "TCP://gauge.EXAMPLE:1")],
)
def test_one_daemon_reads_a_gauge_however_its_port_is_written(port, same):
    first = InstanceLock.take_gauge("g1", port)
    with refused("port.in_use", "reads the gauge at"):
        InstanceLock.take_gauge("g1", same)
    InstanceLock.take_gauge("g1", f"{port}0").release()
    first.release()
    InstanceLock.take_gauge("g1", same).release()


def test_a_serial_port_is_one_under_all_its_names(tmp_path):
    (tmp_path / "tty").write_bytes(b"")
    (tmp_path / "by-id").symlink_to(tmp_path / "tty")
    first = InstanceLock.take_gauge("g1", str(tmp_path / "tty"))
    with refused("port.in_use", "reads the gauge at"):
        InstanceLock.take_gauge("g1", str(tmp_path / "by-id"))
    first.release()


def test_lock_that_is_bound_and_listens_a_moment_later_is_held(monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr(socket.socket, "listen", lambda _: None)
        first = InstanceLock.take_gauge("g1", "tcp://gauge:1")
    # private: the socket of the lock
    monkeypatch.setattr(clock, "sleep", lambda _: first._socket.listen())
    with refused("port.in_use", "reads the gauge at tcp"):
        InstanceLock.take_gauge("g1", "tcp://gauge:1")
    first.release()
