"""Client of a daemon's control socket, for `rig record`, `rig status` and `rig live`.

The responding program may not be rigd, so the owner of the socket is checked before data is sent, and answers are
limited in size, time and form.
"""

from __future__ import annotations

import contextlib
import json
import socket
import struct
from pathlib import Path
from typing import Any

from daq import clock
from daq.service.answers import LONGEST_ANSWER, read_answer
from daq.service.trust import peer_user, require_trusted_owner, socket_directory
from rigs.errors import CellError, RigError

ANSWERS_S = 30.0
"""Closing a recording may take as long (TimeoutStopSec of the unit)."""
_CONNECT_S = 3.0
_TIMEVAL = struct.Struct("ll")
_KNOCK_S = 1.0
_RESTART = "see the log, then restart it: rigd RIG"


class Client:
    def __init__(self, path: Path) -> None:
        self._path = path
        self._sock: socket.socket
        self._unread = b""

    def __enter__(self) -> Client:
        sock = socket.socket(socket.AF_UNIX)
        try:
            owners = require_trusted_owner(self._path)
            # A blocking connect keeps its position in the system's queue. Repeated attempts might never succeed.
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, _TIMEVAL.pack(*divmod(int(_CONNECT_S * 1e6), 10**6)))
            sock.connect(str(self._path))
            if (user := peer_user(sock)) not in owners:
                problem = f"a program of a different user (number {user}) answers here"
                raise CellError(str(self._path), problem, "stop it, then restart rigd: rigd RIG", code="daemon.refused")
        except BaseException as error:
            sock.close()
            if isinstance(error, BlockingIOError):
                problem = "rigd does not answer: too many clients are waiting"
                raise CellError(str(self._path), problem, _RESTART, code="daemon.busy") from None
            if isinstance(error, PermissionError):
                remedy = "join the group of rigd, or use sudo"
                raise CellError(str(self._path), "permission denied", remedy, code="daemon.refused") from None
            if isinstance(error, OSError):
                problem = "rigd does not answer here"
                raise CellError(str(self._path), problem, "start rigd: rigd RIG", code="daemon.silent") from None
            raise
        self._sock = sock
        return self

    def __exit__(self, *_: object) -> None:
        self._sock.close()

    def ask(self, command: str, **fields: Any) -> dict[str, Any]:
        """Send a request and return the answer. Raises the daemon's RigError, or CellError if the daemon is gone."""
        until_s = clock.now_s() + ANSWERS_S
        try:
            self._sock.settimeout(ANSWERS_S)
            # Data that rigd sent before closing can still be read.
            with contextlib.suppress(BrokenPipeError):
                self._sock.sendall(json.dumps({"command": command, **fields}).encode() + b"\n")
            line = self._line(until_s)
        except TimeoutError:
            problem = f"rigd has not answered for {ANSWERS_S:.0f} s"
            remedy = "the disk may be slow: see rig status, and the log"
            raise CellError(str(self._path), problem, remedy, code="daemon.silent") from None
        except OSError:
            line = b""
        if not line:
            raise CellError(str(self._path), "rigd closed the connection", _RESTART, code="daemon.silent")
        try:
            answer = read_answer(command, line)
        except ValueError as error:
            problem, remedy = (
                f"a program other than rigd answers here: {error}",
                "restart rigd in this version: rigd RIG",
            )
            raise CellError(str(self._path), problem, remedy, code="daemon.refused") from None
        if not answer.pop("ok"):
            refusal = RigError(answer["where"], answer["what"], answer["remedy"], code=answer.get("code", ""))
            refusal.exit_code = answer["exit_code"]
            raise refusal
        return answer

    def _line(self, until_s: float) -> bytes:
        while b"\n" not in self._unread:
            if len(self._unread) > LONGEST_ANSWER:
                problem = f"the answer exceeds {LONGEST_ANSWER} bytes, so this program is not rigd"
                raise CellError(str(self._path), problem, _RESTART, code="daemon.refused")
            self._sock.settimeout(max(0.001, until_s - clock.now_s()))
            received = self._sock.recv(65536)
            if not received:
                return b""
            self._unread += received
            if clock.now_s() > until_s:
                raise TimeoutError
        line, _, self._unread = self._unread.partition(b"\n")
        return line


def find_socket(rig: str | None = None) -> Path:
    served = [path for path in sockets() if rig in (None, path.stem) and _is_served(path)]
    if len(served) == 1:
        return served[0]
    if not served:
        whom = f" for {rig}" if rig else ""
        raise CellError(
            "rigd", f"no daemon{whom} is visible to this user", "start rigd: rigd RIG", code="daemon.silent"
        )
    names = ", ".join(path.stem for path in served)
    raise CellError("rigd", f"several daemons are running ({names})", "say which: --rig NAME", code="answer.missing")


def sockets() -> list[Path]:
    places = [socket_directory(), *Path("/run").glob("rigd-*")]
    return sorted({path for place in places for path in place.glob("*.sock")})


def _is_served(path: Path) -> bool:
    """False for the socket of a killed daemon, which has no listener."""
    with socket.socket(socket.AF_UNIX) as sock, contextlib.suppress(PermissionError, TimeoutError, BlockingIOError):
        sock.settimeout(_KNOCK_S)
        try:
            sock.connect(str(path))
        except (ConnectionRefusedError, FileNotFoundError):
            return False
    return True
