"""Emulated hostile daemon and hostile journal, for tests of every command."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def hostile_peer(path: Path, evil: str) -> Iterator[None]:
    """Serve a socket whose answers contain a text in every possible position."""
    stream = {
        "port": evil,
        "connected": True,
        "rate_hz": 1.0,
        "counters": {evil: 1, "samples": 1},
        "last": {evil: 1.0},
        "age_s": {evil: 0.1},
        "last_fault": evil,
        "waiting": 0,
    }
    answer = {
        "ok": True,
        "rig": evil,
        "baseline_mm": 70.0,
        "streams": {evil: stream},
        "host": {},
        "last_end": evil,
        "automatic": {"waits_for": [evil], "why_not": evil},
        "recording": None,
        "waiting": evil,
        "missed": {evil: 1},
        "run": evil,
        "counters": {evil: {evil: 1}},
        "text": f"rig_up{{a={evil!r}}} 1\n",
    }

    def answer_all(sock: socket.socket) -> None:
        while sock.recv(1 << 16):
            sock.sendall(json.dumps(answer).encode() + b"\n")

    with serving(path, answer_all):
        yield


@contextmanager
def serving(path: Path, answer: Callable[[socket.socket], None]) -> Iterator[None]:
    """Serve a socket like that of a daemon; `answer` handles one connection after another."""
    path.parent.mkdir(exist_ok=True, mode=0o700)
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(path))
        path.chmod(0o660)
        listener.listen()

        def serve() -> None:
            with suppress(OSError):
                while True:
                    sock, _ = listener.accept()
                    with sock, suppress(OSError):
                        answer(sock)

        server = threading.Thread(target=serve)
        server.start()
        try:
            yield
        finally:
            listener.shutdown(socket.SHUT_RDWR)
            server.join(10)


def hostile_journal(folder: Path, evil: str) -> Path:
    """Create a directory with a program `journalctl` whose entries contain a text."""
    programs = folder / "bin"
    programs.mkdir()
    entry = {
        "MESSAGE": evil,
        "_PID": "2",
        "_SYSTEMD_UNIT": f"rigd@{evil}.service",
        "__REALTIME_TIMESTAMP": "1790000000000000",
        "PRIORITY": "3",
    }
    (programs / "entries").write_text(json.dumps(entry) + "\n")
    program = programs / "journalctl"
    program.write_text(f"#!/bin/sh\ncat '{programs}/entries'\n")
    program.chmod(0o755)
    return programs
