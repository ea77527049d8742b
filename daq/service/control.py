"""The local control socket: one line of JSON asks, one line answers. Nothing listens on the network.

The socket belongs to the daemon's user and group only. An error crosses it as its parts, so that the
client raises what the daemon raised.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import logging
import os
import socket
import socketserver
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rigs.errors import CellError, RigError

log = logging.getLogger("rigd")
Answer = Callable[[dict[str, Any]], dict[str, Any]]
_LONGEST_REQUEST = 65536
ANSWERS_S = 30.0
"""A client waits this long for an answer."""
_LAST_ANSWERS_S = 15.0
"""The limit for answers that are under way when the daemon ends: a long recording takes seconds to close."""


def socket_directory() -> Path:
    """Return the directory for sockets of this user's daemons: systemd's runtime directory, else the user's own."""
    if given := os.environ.get("RUNTIME_DIRECTORY"):
        return Path(given.split(":")[0])
    if given := os.environ.get("XDG_RUNTIME_DIR"):
        return Path(given) / "rigd"
    return Path(f"/tmp/rigd-{os.getuid()}")  # noqa: S108 - made with mode 0700, and refused if another's


class InstanceLock:
    """Ensures one daemon for each rig, by an flock that the system releases whatever happens to the daemon."""

    def __init__(self, rig: str, path: Path) -> None:
        try:
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            if path.parent.stat().st_uid not in (os.getuid(), 0):
                raise CellError(str(path.parent), "belongs to another user", "set XDG_RUNTIME_DIR")
            self._file = path.open("a+")
        except OSError as error:
            raise CellError(str(path), error.strerror or str(error), "give another --socket") from None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._file.seek(0)
            holder = self._file.read().strip() or "unknown"
            self._file.close()
            raise CellError(
                rig,
                f"another rigd (process {holder}) serves this rig",
                "stop that one, or talk to it with rig status",
            ) from None
        with contextlib.suppress(OSError):  # for people only: a full disk does not prevent a start
            os.ftruncate(self._file.fileno(), 0)
            os.write(self._file.fileno(), str(os.getpid()).encode())

    def release(self) -> None:
        """Release the lock, so that another daemon can start."""
        self._file.close()


class ControlServer:
    """Serves the socket in threads of its own until it is closed."""

    def __init__(self, path: Path, answer: Answer) -> None:
        self._path = path
        _clear(path)

        class Handler(socketserver.StreamRequestHandler):
            def handle(self) -> None:
                with contextlib.suppress(OSError):
                    while line := self.rfile.readline(_LONGEST_REQUEST):
                        self.wfile.write(json.dumps(reply(line, answer)).encode() + b"\n")

        before = os.umask(0o117)
        try:
            self._server = _Server(str(path), Handler)
        except OSError as error:
            raise CellError(str(path), error.strerror or str(error), "give another --socket") from None
        finally:
            os.umask(before)
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.1,), name="control", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Accept no more requests, finish the answers that are under way, and remove the socket."""
        self._server.shutdown()
        self._server.server_close()
        with contextlib.suppress(FileNotFoundError):
            self._path.unlink()
        self._server.hang_up(_LAST_ANSWERS_S)


def _clear(path: Path) -> None:
    """Remove the socket of a daemon that died, as the lock shows. Raises CellError for anything but a socket."""
    try:
        if path.exists() and not path.is_socket():
            raise CellError(str(path), "exists already and is not a socket", "give another --socket")
        path.unlink(missing_ok=True)
    except OSError as error:
        raise CellError(str(path), error.strerror or str(error), "give another --socket") from None


class _Server(socketserver.ThreadingUnixStreamServer):
    """Serves each connection in a thread, and keeps a list of those that are open."""

    daemon_threads = True

    def __init__(self, path: str, handler: type[socketserver.BaseRequestHandler]) -> None:
        super().__init__(path, handler)
        self._open: set[Any] = set()

    def process_request(self, request: Any, client_address: Any) -> None:
        self._open.add(request)
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        super().shutdown_request(request)
        self._open.discard(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        log.exception("a request could not be answered")

    def hang_up(self, patience_s: float) -> None:
        """Read nothing more from any client, and wait until each connection has had its last answer."""
        for connection in list(self._open):
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RD)
        until = time.monotonic() + patience_s
        while self._open and time.monotonic() < until:
            time.sleep(0.01)


def reply(line: bytes, answer: Answer) -> dict[str, Any]:
    """Return the answer to one request line; an error is an answer too."""
    try:
        return {"ok": True, **answer(_request(line))}
    except RigError as error:
        parts = {"where": error.where, "what": error.what, "remedy": error.remedy}
        return {"ok": False, "exit_code": error.exit_code, **parts}


def _request(line: bytes) -> dict[str, Any]:
    try:
        request = json.loads(line)
    except (ValueError, RecursionError):
        request, what = None, "not JSON"
    else:
        what = "a request is a JSON object"
    if isinstance(request, dict):
        return request
    raise CellError("control socket", what, 'send {"command": "status"}')


def connect(path: Path) -> socket.socket:
    """Connect to a daemon's socket. Raises CellError."""
    sock = socket.socket(socket.AF_UNIX)
    sock.settimeout(ANSWERS_S)
    try:
        sock.connect(str(path))
    except PermissionError:
        sock.close()
        raise CellError(str(path), "permission denied", "join the group of rigd, or use sudo") from None
    except BlockingIOError:
        sock.close()
        what = "rigd does not answer: other clients are waiting already"
        raise CellError(str(path), what, "see its log, then start it again: rigd RIG") from None
    except OSError:
        sock.close()
        raise CellError(str(path), "no rigd answers here", "start it: rigd RIG") from None
    return sock
