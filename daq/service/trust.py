"""Locations, owners and locks of daemon sockets. A client trusts only a daemon of the same user or of the system.

A user who can write to a directory in the path could place a socket there and imitate rigd, so the owner and
permissions of each directory are checked. A directory created by the system for a service is trusted with its owner.
"""

from __future__ import annotations

import hashlib
import os
import socket
import stat
import struct
from os import geteuid, getuid  # refuses other systems than POSIX, like an import of fcntl
from pathlib import Path

from daq import clock
from rigs.errors import CellError

_CREDENTIALS = struct.Struct("3i")
"""Process, user and group of a peer: struct ucred of unix(7)."""
_LISTENS_S = 0.01
"""Time after which a daemon that has bound its lock also listens at it."""
_REMEDY = "remove the directory, or set XDG_RUNTIME_DIR to a private directory"


def socket_directory() -> Path:
    if directory := os.environ.get("RUNTIME_DIRECTORY"):
        return Path(directory.split(":")[0])
    if directory := os.environ.get("XDG_RUNTIME_DIR"):
        return Path(directory) / "rigd"
    return Path(f"/tmp/rigd-{getuid()}")  # noqa: S108 - made with mode 0700, and refused if another's


def require_trusted_owner(path: Path) -> frozenset[int]:
    """Trusted owners of a socket path. Refuses a socket that an untrusted user could have created."""
    owners = {0, geteuid()}
    open_to_all = False  # True if other users can add entries to the parent directory
    for place in (*reversed(path.absolute().parents), path.absolute()):
        status = place.lstat()
        if status.st_uid not in owners and open_to_all:
            problem = f"{place} belongs to a different user (number {status.st_uid})"
            raise CellError(str(path), problem, _REMEDY, code="daemon.refused")
        owners.add(status.st_uid)
        if stat.S_ISLNK(status.st_mode):
            return require_trusted_owner(place.resolve() / path.absolute().relative_to(place))
        if place == path.absolute():
            break
        writable = bool(status.st_mode & (stat.S_IWGRP | stat.S_IWOTH))
        open_to_all = writable and bool(status.st_mode & stat.S_ISVTX)
        if writable and not open_to_all:
            raise CellError(
                str(path), f"{place} can be written by other users", f"chmod go-w {place}", code="daemon.refused"
            )
    if not stat.S_ISSOCK(status.st_mode):
        raise CellError(str(path), "is not a socket", _REMEDY, code="daemon.refused")
    if status.st_mode & stat.S_IWOTH:
        problem = "allows every user of this computer to control rigd"
        raise CellError(str(path), problem, f"chmod o-rwx {path}", code="daemon.refused")
    return frozenset(owners)


def peer_user(connection: socket.socket) -> int:
    return _peer(connection)[1]


def _peer(connection: socket.socket) -> tuple[int, int]:
    size = _CREDENTIALS.size
    process, user, _ = _CREDENTIALS.unpack(connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, size))
    return process, user


class InstanceLock:
    """Lock on a name for the daemons of a user: an abstract socket, which the system releases with the process."""

    @classmethod
    def take(cls, rig: str, socket_path: Path) -> InstanceLock:
        """Make this process the only daemon of a socket, in a directory that no other user can change."""
        directory = socket_path.parent
        try:
            directory.mkdir(mode=0o700, parents=True, exist_ok=True)
            status = directory.stat()
        except OSError as error:
            remedy = "choose a different --socket"
            raise CellError(str(directory), error.strerror or str(error), remedy, code="daemon.refused") from None
        if status.st_uid not in (geteuid(), 0):
            remedy = "set XDG_RUNTIME_DIR, or choose a different --socket"
            raise CellError(str(directory), "belongs to a different user", remedy, code="daemon.refused")
        if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            problem = "is writable for other users, who could replace the socket of rigd"
            remedy = "give --socket in a private directory, or chmod go-w this directory"
            raise CellError(str(directory), problem, remedy, code="daemon.refused")
        lock = cls(str(directory.resolve() / socket_path.name))
        if lock.holder is not None:
            problem = f"a different rigd (process {lock.holder}) serves this rig"
            remedy = "stop that daemon, or query it with rig status"
            raise CellError(rig, problem, remedy, code="daemon.busy")
        return lock

    @classmethod
    def take_gauge(cls, name: str, port: str) -> InstanceLock:
        """Lock the port of a gauge, for any rig file and name: two daemons would receive each other's answers."""
        # Canonical name of a port: the device for a serial port, lower case for an address. The path of a
        # pseudo-terminal is unchanged, because its number is reused after closing.
        canonical = port.casefold().replace("//localhost:", "//127.0.0.1:")
        if port.startswith("/"):
            device = os.path.realpath(port)
            canonical = str(Path(port).absolute()) if device.startswith("/dev/pts/") else device
        lock = cls(canonical)
        if lock.holder is not None:
            problem = f"a different rigd (process {lock.holder}) reads the gauge at {port}"
            remedy = "stop that rigd, or correct the port in the rig file"
            raise CellError(name, problem, remedy, code="port.in_use")
        return lock

    def __init__(self, name: str) -> None:
        address = f"\0rigd-{geteuid()}-{hashlib.sha256(os.fsencode(name)).hexdigest()[:16]}"
        self.holder: str | None = None
        """Process of this user or of root that holds the lock, possibly "unknown"; None if no such process does.

        Other users are ignored, because they could hold it forever.
        """
        self._socket = socket.socket(socket.AF_UNIX)
        try:
            self._socket.bind(address)
            self._socket.listen()
        except OSError:
            self.release()
            clock.sleep(_LISTENS_S)
            self.holder = _listening_process(address)

    def release(self) -> None:
        self._socket.close()


def _listening_process(address: str) -> str | None:
    """Process of this user or of root that listens at an abstract address; unknown if its queue is full."""
    with socket.socket(socket.AF_UNIX) as probe:
        probe.setblocking(False)
        try:
            probe.connect(address)
            process, user = _peer(probe)
        except BlockingIOError:
            return "unknown"
        except OSError:
            return None
    return str(process) if user in (0, geteuid()) else None
