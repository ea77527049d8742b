"""Local control socket, with a line of JSON per request and answer. There is no network listener.

Only the user and group of the daemon have access. Clients cannot exhaust the server, and thereby the recorder: at the
limit a new connection replaces the longest silent one. docs/decisions/0018-one-gate-for-text.md explains the numbers.
"""

from __future__ import annotations

import contextlib
import errno
import json
import logging
import os
import resource
import socket
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from daq.recording.warnings import RateLimitedLog
from daq.service.answers import LONGEST_ANSWER
from rigs.errors import CellError, RigError

log = logging.getLogger("rigd")
Answer = Callable[[dict[str, Any]], dict[str, Any]]
LONGEST_REQUEST = 65536
"""A label with all fields has 2 kB."""
_LAST_ANSWERS_S = 15.0
"""Time limit of pending answers when the daemon ends. Closing a long recording takes seconds."""
_MOST = 64
_RESERVED = 256
"""Descriptors reserved for ports and run files. A cell with three streams uses 25 while recording."""
_IDLE_S = 30.0
"""Time without data after which a connection is closed. rig live sends ten requests a second."""
_SEND_S = 5.0
_ROOM_S = 0.5
_ACCEPT_S, _ASK_S = 0.001, 0.02
"""Pauses after a connection and after an answer, which leave time to the readers during a flood."""
_BACK_OFF_S = 0.2


class ControlServer:
    def __init__(self, path: Path, answer: Answer) -> None:
        self._path, self._answer = path, answer
        limit, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
        self._most = max(1, min(_MOST, limit - _RESERVED)) if limit != resource.RLIM_INFINITY else _MOST
        """Connections that leave enough descriptors for the recorder."""
        self._open: set[socket.socket] = set()
        self._silent: dict[socket.socket, None] = {}
        """Open connections without a pending answer, the longest silent first."""
        self._changed = threading.Condition()
        self._closing = threading.Event()
        self._warnings = RateLimitedLog()
        self._thread = threading.Thread(target=self._accept_all, name="control", daemon=True)
        self._listener: socket.socket

    def start(self) -> None:
        listener = socket.socket(socket.AF_UNIX)
        before = os.umask(0o117)
        try:
            if os.path.lexists(self._path) and (self._path.is_symlink() or not self._path.is_socket()):
                raise FileExistsError(errno.EEXIST, "exists already and is not a socket")
            self._path.unlink(missing_ok=True)  # left by a daemon that has ended, as the lock proves
            listener.bind(str(self._path))
            listener.listen(_MOST)
        except OSError as error:
            listener.close()
            problem, remedy = error.strerror or str(error), "choose a different --socket"
            raise CellError(str(self._path), problem, remedy, code="daemon.refused") from None
        finally:
            os.umask(before)
        self._listener = listener
        self._thread.start()

    def close(self) -> None:
        self._closing.set()
        _shut_down(self._listener, socket.SHUT_RDWR)  # ends the wait in accept
        self._thread.join(_LAST_ANSWERS_S)
        self._listener.close()
        self._path.unlink(missing_ok=True)
        with self._changed:
            for sock in self._open:
                _shut_down(sock, socket.SHUT_RD)
            self._changed.wait_for(lambda: not self._open, _LAST_ANSWERS_S)

    def _accept_all(self) -> None:
        while not self._closing.is_set():
            try:
                self._admit(self._listener.accept()[0])
                self._closing.wait(_ACCEPT_S)
            except (OSError, RuntimeError) as error:  # the system has no descriptor or no thread
                if not self._closing.is_set():
                    self._warnings.warn("control socket", "limit", f"connections cannot be accepted: {error}")
                self._closing.wait(_BACK_OFF_S)

    def _admit(self, sock: socket.socket) -> None:
        """Serve a connection. At the limit it replaces the longest silent one; if all are busy, it is refused."""
        with self._changed:
            if len(self._open) >= self._most and self._silent:
                oldest = next(iter(self._silent))
                del self._silent[oldest]
                _shut_down(oldest, socket.SHUT_RDWR)
                self._changed.wait_for(lambda: len(self._open) < self._most, _ROOM_S)
            if len(self._open) >= self._most:
                busy = CellError(
                    "rigd", "all connections are busy with other requests", "retry later", code="daemon.busy"
                )
                with contextlib.suppress(OSError), sock:
                    sock.setblocking(False)
                    sock.sendall(_encoded(_as_answer(busy)))
                return
            self._open.add(sock)
            self._silent[sock] = None
        try:
            threading.Thread(target=self._serve, args=(sock,), name="control connection", daemon=True).start()
        except RuntimeError:
            self._close_connection(sock)
            raise

    def _serve(self, sock: socket.socket) -> None:
        try:
            with contextlib.suppress(OSError), sock.makefile("rb") as lines:  # OSError: gone, or too slow
                sock.settimeout(_IDLE_S)
                while not self._closing.is_set() and (line := lines.readline(LONGEST_REQUEST + 1)):
                    if not self._reply(sock, line):
                        return
        except Exception:
            log.exception("a request could not be answered")
        finally:
            self._close_connection(sock)

    def _reply(self, sock: socket.socket, line: bytes) -> bool:
        """Answer a request. False if the connection is over: it was replaced, or its line has no end."""
        with self._changed:
            if sock not in self._silent:
                return False
            del self._silent[sock]
        answer = _encoded(reply(line, self._answer))
        sock.settimeout(_SEND_S)
        sock.sendall(answer)
        sock.settimeout(_IDLE_S)
        with self._changed:
            self._silent[sock] = None
        self._closing.wait(_ASK_S)
        return len(line) <= LONGEST_REQUEST

    def _close_connection(self, sock: socket.socket) -> None:
        with self._changed:
            sock.close()
            self._open.discard(sock)
            self._silent.pop(sock, None)
            self._changed.notify_all()


def _shut_down(sock: socket.socket, how: int) -> None:
    with contextlib.suppress(OSError):
        sock.shutdown(how)


def reply(line: bytes, answer: Answer) -> dict[str, Any]:
    request, problem = None, f"a request is a single line of at most {LONGEST_REQUEST} bytes"
    if len(line) <= LONGEST_REQUEST:
        try:
            request, problem = json.loads(line), "a request is a JSON object"
        except (ValueError, RecursionError):
            problem = "not JSON"
    if not isinstance(request, dict):
        return _as_answer(CellError("control socket", problem, 'send {"command": "status"}', code="request.invalid"))
    try:
        return {"ok": True, **answer(request)}
    except RigError as error:
        return _as_answer(error)


def _as_answer(error: RigError) -> dict[str, Any]:
    return {"ok": False, **error.to_dict()}


def _encoded(answer: dict[str, Any]) -> bytes:
    line = json.dumps(answer).encode() + b"\n"
    if len(line) <= LONGEST_ANSWER:
        return line
    problem = f"the answer has {len(line)} bytes, more than a client accepts"
    return _encoded(_as_answer(CellError("rigd", problem, "see the log", code="request.invalid")))
