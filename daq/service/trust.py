"""Where a daemon's socket is, and whose: a client talks to a daemon of its own user or of the system, and to no other
program that poses as one.

Where another user can write a directory on the way, that user can put a socket there and answer as rigd would. So each
directory from the root on is looked at: who owns it, and who may put entries into it. A directory that the system
made for a service, as /run/rigd-cell, is trusted with its owner.
"""

from __future__ import annotations

import contextlib
import grp
import os
import pwd
import socket
import stat
import struct
import sys
from pathlib import Path

from rigs.errors import CellError

_CREDENTIALS = struct.Struct("3i")
"""Process, user and group of a peer: struct ucred of unix(7)."""
_UID = 7
"""Column of the user in /proc/net/tcp (proc(5))."""
_REMEDY = "remove it, or set XDG_RUNTIME_DIR to a directory of your own"


def socket_directory() -> Path:
    """Return the directory for sockets of this user's daemons: systemd's runtime directory, else the user's own."""
    if directory := os.environ.get("RUNTIME_DIRECTORY"):
        return Path(directory.split(":")[0])
    if directory := os.environ.get("XDG_RUNTIME_DIR"):
        return Path(directory) / "rigd"
    return Path(f"/tmp/rigd-{os.getuid()}")  # noqa: S108 - made with mode 0700, and refused if another's


def hold_trusted(path: Path) -> frozenset[int]:
    """Return the users whom a socket may belong to. Raises CellError where another user could have put it there.

    Raises FileNotFoundError, or another OSError, where it is not there or cannot be seen.
    """
    owners = {0, os.geteuid()}
    open_to_all = False  # whether the directory above lets other users put entries into it
    for place in (*reversed(path.absolute().parents), path.absolute()):
        status = place.lstat()
        if status.st_uid not in owners and open_to_all:
            raise CellError(str(path), f"{place} belongs to another user (number {status.st_uid})", _REMEDY)
        owners.add(status.st_uid)
        if stat.S_ISLNK(status.st_mode):
            return hold_trusted(place.resolve() / path.absolute().relative_to(place))
        if place == path.absolute():
            break
        writable = bool(status.st_mode & (stat.S_IWGRP | stat.S_IWOTH))
        open_to_all = writable and bool(status.st_mode & stat.S_ISVTX)
        if writable and not open_to_all:
            raise CellError(str(path), f"{place} can be written by other users", f"chmod go-w {place}")
    if not stat.S_ISSOCK(status.st_mode):
        raise CellError(str(path), "is not a socket", _REMEDY)
    if status.st_mode & stat.S_IWOTH:
        raise CellError(str(path), "lets every user of this computer control rigd", f"chmod o-rwx {path}")
    return frozenset(owners)


def peer_user(connection: socket.socket) -> int:
    """Return the number of the user at the other end of a local connection."""
    size = _CREDENTIALS.size
    _, user, _ = _CREDENTIALS.unpack(connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, size))
    return int(user)


def tcp_user(client: tuple[str, int], port: int, table: Path = Path("/proc/net/tcp")) -> int | None:
    """Return the number of the user of this computer who has connected from `client` to a port here; None where the
    connection comes from elsewhere, or cannot be seen. Of addresses of version 6, those of version 4 within them."""
    try:
        packed = socket.inet_aton(client[0].removeprefix("::ffff:"))
    except OSError:
        return None
    address = f"{int.from_bytes(packed, sys.byteorder):08X}:{client[1]:04X}"
    with contextlib.suppress(OSError):
        for line in table.read_text("ascii", "replace").splitlines()[1:]:
            columns = line.split()
            if len(columns) > _UID and columns[1] == address and columns[2].endswith(f":{port:04X}"):
                return int(columns[_UID])
    return None


def may_use(user: int, path: Path) -> bool:
    """Return whether a user may connect to a daemon's socket: root, its owner, or a member of its group."""
    try:
        status = path.stat()
    except OSError:
        return user in (0, os.geteuid())
    if user in (0, status.st_uid):
        return True
    with contextlib.suppress(KeyError):
        person = pwd.getpwuid(user)
        return person.pw_gid == status.st_gid or person.pw_name in grp.getgrgid(status.st_gid).gr_mem
    return False
