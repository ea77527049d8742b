"""Local control socket, with a line of JSON per request and answer. There is no network listener.

Only the user and group of the daemon have access. Clients cannot exhaust the server, and thereby the recorder: the
number of connections, and the size and duration of requests and answers are bounded. At the limit a new connection
replaces the longest silent one. docs/decisions/0018-one-gate-for-text.md explains the numbers.
"""

from __future__ import annotations

import contextlib
import errno
import json
import logging
import os
import resource
import select
import socket
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from daq import clock
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
"""Connections. A user needs few: rig live, and one per running command."""
_RESERVED = 256
"""Descriptors reserved for ports and run files. A cell with three streams uses 25 while recording."""
_IDLE_S = 30.0
"""Idle time after which a connection is closed. rig live sends ten requests a second."""
_LINE_S = 5.0
"""Time limit from the first byte of a request to its end, and for accepting an answer."""
_ACCEPT_S, _ASK_S = 0.001, 0.02
"""Pauses after a connection and after an answer, which leave time to the readers during a flood."""
_BACK_OFF_S = (0.05, 1.0)
"""First and longest pause after the system has refused a connection."""
_ROOM_S = 0.5
"""Time limit for the end of a silent connection after the shutdown."""
_NO_ROOM = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)


def most_connections() -> int:
    """Number of connections that leaves enough descriptors for the recorder."""
    limit, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return max(1, min(_MOST, limit - _RESERVED)) if limit != resource.RLIM_INFINITY else _MOST


@dataclass(eq=False)
class _Connection:
    """Connection of a client."""

    sock: socket.socket
    silent_since_s: float
    """Monotonic time of the last answer."""
    busy: bool = False
    """True while an answer is pending."""
    ended: bool = False
    """True after the server ended it."""

    def hang_up(self, how: int = socket.SHUT_RDWR) -> None:
        with contextlib.suppress(OSError):
            self.sock.shutdown(how)


class ControlServer:
    """Serves the socket with a thread per connection, from `start` to `close`."""

    def __init__(self, path: Path, answer: Answer) -> None:
        self._path, self._answer = path, answer
        self._most = most_connections()
        self._open: set[_Connection] = set()
        self._changed = threading.Condition()
        self._closing = threading.Event()
        self._warnings = RateLimitedLog()
        self._thread = threading.Thread(target=self._accept_all, name="control", daemon=True)
        self._listener: socket.socket

    def start(self) -> None:
        """Listen and accept connections."""
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
            raise CellError(str(self._path), problem, remedy, code="daemon.socket") from None
        finally:
            os.umask(before)
        self._listener = listener
        self._thread.start()

    def close(self) -> None:
        """Refuse further requests, complete pending answers, and remove the socket."""
        self._closing.set()
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)  # ends the wait in accept
        self._thread.join(_LAST_ANSWERS_S)
        self._listener.close()
        with contextlib.suppress(FileNotFoundError):
            self._path.unlink()
        with self._changed:
            for connection in self._open:
                connection.hang_up(socket.SHUT_RD)
            self._changed.wait_for(lambda: not self._open, _LAST_ANSWERS_S)

    def _accept_all(self) -> None:
        pause_s = _BACK_OFF_S[0]
        waiting = select.poll()
        waiting.register(self._listener, select.POLLIN)
        while not self._closing.is_set():
            waiting.poll()  # accept allocates a descriptor before waiting, and fails immediately if none is available
            try:
                sock, _ = self._listener.accept()
            except OSError as error:
                if self._closing.is_set():
                    return
                self._warn(f"connections cannot be accepted: {error.strerror or error}")
                if error.errno in _NO_ROOM:
                    with self._changed:
                        self._make_room()
                self._closing.wait(pause_s)
                pause_s = min(2 * pause_s, _BACK_OFF_S[1])
            else:
                self._admit(_Connection(sock, clock.now_s()))
                pause_s = _BACK_OFF_S[0]
                self._closing.wait(_ACCEPT_S)

    def _warn(self, problem: str) -> None:
        self._warnings.warn("control socket", "limit", problem)

    def _admit(self, new: _Connection) -> None:
        """Serve a connection. At the limit, replace an idle connection, or refuse the new one if all are busy."""
        with self._changed:
            if len(self._open) >= self._most and not self._make_room():
                busy = "all connections are busy with other requests"
                refusal = _as_answer(CellError("rigd", busy, "retry later", code="daemon.busy"))
                with contextlib.suppress(OSError):
                    new.sock.setblocking(False)
                    new.sock.sendall(_encoded(refusal))
                new.sock.close()
                return
            self._open.add(new)
        try:
            threading.Thread(target=self._serve, args=(new,), name="control connection", daemon=True).start()
        except RuntimeError as error:  # the system refuses further threads
            self._warn(f"a connection cannot be served: {error}")
            self._close_connection(new)

    def _make_room(self) -> bool:
        """End the longest silent connection. True if it has ended."""
        silent = [connection for connection in self._open if not connection.busy]
        if not silent:
            return False
        oldest = min(silent, key=lambda connection: connection.silent_since_s)
        oldest.ended = True
        oldest.hang_up()
        return self._changed.wait_for(lambda: oldest not in self._open, _ROOM_S)

    def _serve(self, connection: _Connection) -> None:
        try:
            with contextlib.suppress(OSError):  # gone, or too slow
                unread = b""
                while not self._closing.is_set():
                    line, unread = _next_line(connection.sock, unread)
                    if not line:
                        return
                    self._reply(connection, line)
        except Exception:
            log.exception("a request could not be answered")
        finally:
            self._close_connection(connection)

    def _reply(self, connection: _Connection, line: bytes) -> None:
        with self._changed:
            if connection.ended:  # the client cannot receive the answer
                return
            connection.busy = True
        answered = _encoded(reply(line, self._answer))
        connection.sock.settimeout(_LINE_S)
        connection.sock.sendall(answered)
        connection.busy, connection.silent_since_s = False, clock.now_s()
        self._closing.wait(_ASK_S)

    def _close_connection(self, connection: _Connection) -> None:
        with self._changed:
            connection.sock.close()
            self._open.discard(connection)
            self._changed.notify_all()


def _next_line(sock: socket.socket, unread: bytes) -> tuple[bytes, bytes]:
    """Next line, empty at the end, and the data after it.

    An excessively long line is truncated, and therefore invalid JSON.
    """
    until_s = None if not unread else clock.now_s() + _LINE_S
    while b"\n" not in unread and len(unread) <= LONGEST_REQUEST:
        left_s = _IDLE_S if until_s is None else until_s - clock.now_s()
        if left_s <= 0:
            raise TimeoutError
        sock.settimeout(left_s)
        received = sock.recv(LONGEST_REQUEST)
        if not received:
            return unread, b""
        until_s = until_s or clock.now_s() + _LINE_S
        unread += received
    line, _, following = unread.partition(b"\n")
    return line + b"\n", following


def reply(line: bytes, answer: Answer) -> dict[str, Any]:
    """Answer to a request line, which may be an error."""
    request, problem = None, f"a request is a single line of at most {LONGEST_REQUEST} bytes"
    if len(line) <= LONGEST_REQUEST:
        try:
            request, problem = json.loads(line), "a request is a JSON object"
        except (ValueError, RecursionError):
            problem = "not JSON"
    if not isinstance(request, dict):
        return _as_answer(CellError("control socket", problem, 'send {"command": "status"}', code="daemon.bad_request"))
    try:
        return {"ok": True, **answer(request)}
    except RigError as error:
        return _as_answer(error)


def _as_answer(error: RigError) -> dict[str, Any]:
    return {"ok": False, **error.to_dict()}


def _encoded(answer: dict[str, Any]) -> bytes:
    """An answer as a line. An oversized answer becomes an error."""
    line = json.dumps(answer).encode() + b"\n"
    if len(line) <= LONGEST_ANSWER:
        return line
    problem = f"the answer has {len(line)} bytes, more than a client accepts"
    return _encoded(_as_answer(CellError("rigd", problem, "see the log", code="daemon.answer_too_large")))
