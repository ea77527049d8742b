"""The client of a running daemon's control socket, as `rig record`, `rig status` and `rig live` use it."""

from __future__ import annotations

import contextlib
import json
import socket
from pathlib import Path
from typing import Any

from daq.service.control import ANSWERS_S, connect, socket_directory
from rigs.errors import CellError, RigError

_KNOCK_S = 1.0


class Client:
    """A connection to one daemon; use it in a `with` statement."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._sock = connect(path)
        self._file = self._sock.makefile("rwb")

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(OSError):
            self._file.close()  # sends what is left, where the daemon is gone
        self._sock.close()

    def ask(self, command: str, **fields: Any) -> dict[str, Any]:
        """Return the daemon's answer. Raises the daemon's own RigError, or CellError if the daemon is gone."""
        try:
            self._file.write(json.dumps({"command": command, **fields}).encode() + b"\n")
            self._file.flush()
            answer = json.loads(self._file.readline() or b"null")
        except TimeoutError:
            what = f"rigd has not answered for {ANSWERS_S:.0f} s"
            raise CellError(str(self._path), what, "its disk may be slow: see rig status, and its log") from None
        except (OSError, ValueError):
            answer = None
        if not isinstance(answer, dict):
            raise CellError(str(self._path), "rigd closed the connection", "see its log, then start it again: rigd RIG")
        if not answer.pop("ok"):
            error = RigError(answer["where"], answer["what"], answer["remedy"])
            error.exit_code = answer["exit_code"]
            raise error
        return answer


def find_socket(rig: str | None = None) -> Path:
    """Return the socket of the running daemon, or of the one for `rig`. Raises CellError for none or several.

    A daemon that was killed leaves its socket behind, where nothing answers any more.
    """
    places = [socket_directory(), *Path("/run").glob("rigd-*")]
    found = sorted({path for place in places for path in place.glob("*.sock") if rig in (None, path.stem)})
    found = [path for path in found if _is_served(path)]
    if len(found) == 1:
        return found[0]
    if not found:
        whom = f" for {rig}" if rig else ""
        raise CellError("rigd", f"no daemon runs{whom} that this user can see", "start it: rigd RIG")
    names = ", ".join(path.stem for path in found)
    raise CellError("rigd", f"several daemons run ({names})", "say which: --rig NAME")


def _is_served(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX) as sock, contextlib.suppress(PermissionError, TimeoutError, BlockingIOError):
        sock.settimeout(_KNOCK_S)
        try:
            sock.connect(str(path))
        except (ConnectionRefusedError, FileNotFoundError):
            return False
    return True
