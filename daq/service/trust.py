"""Locations, owners and locks of daemon sockets. A client trusts only a daemon of the same user or of the system.

A user who can write to a directory in the path could place a socket there and imitate rigd, so the owner and
permissions of each directory are checked. A directory created by the system for a service, such as /run/rigd-cell, is
trusted with its owner.

Each rig has one daemon, by a lock next to the socket. The port of each gauge is also locked: otherwise two daemons
could poll the same instruments and record the same lap twice.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import socket
import stat
import struct
from pathlib import Path

from rigs.errors import CellError

_CREDENTIALS = struct.Struct("3i")
"""Process, user and group of a peer: struct ucred of unix(7)."""
_REMEDY = "remove the directory, or set XDG_RUNTIME_DIR to a private directory"


def socket_directory() -> Path:
    """systemd's runtime directory, otherwise a directory of the user."""
    if directory := os.environ.get("RUNTIME_DIRECTORY"):
        return Path(directory.split(":")[0])
    if directory := os.environ.get("XDG_RUNTIME_DIR"):
        return Path(directory) / "rigd"
    return Path(f"/tmp/rigd-{os.getuid()}")  # noqa: S108 - made with mode 0700, and refused if another's


def require_trusted_owner(path: Path) -> frozenset[int]:
    """Trusted owners of a socket path. Refuses a socket that an untrusted user could have created."""
    owners = {0, os.geteuid()}
    open_to_all = False  # True if other users can add entries to the parent directory
    for place in (*reversed(path.absolute().parents), path.absolute()):
        status = place.lstat()
        if status.st_uid not in owners and open_to_all:
            problem = f"{place} belongs to a different user (number {status.st_uid})"
            raise CellError(str(path), problem, _REMEDY, code="daemon.untrusted")
        owners.add(status.st_uid)
        if stat.S_ISLNK(status.st_mode):
            return require_trusted_owner(place.resolve() / path.absolute().relative_to(place))
        if place == path.absolute():
            break
        writable = bool(status.st_mode & (stat.S_IWGRP | stat.S_IWOTH))
        open_to_all = writable and bool(status.st_mode & stat.S_ISVTX)
        if writable and not open_to_all:
            raise CellError(
                str(path), f"{place} can be written by other users", f"chmod go-w {place}", code="daemon.untrusted"
            )
    if not stat.S_ISSOCK(status.st_mode):
        raise CellError(str(path), "is not a socket", _REMEDY, code="daemon.socket")
    if status.st_mode & stat.S_IWOTH:
        problem = "allows every user of this computer to control rigd"
        raise CellError(str(path), problem, f"chmod o-rwx {path}", code="daemon.untrusted")
    return frozenset(owners)


def peer_user(connection: socket.socket) -> int:
    """User id of the peer of a local connection."""
    size = _CREDENTIALS.size
    _, user, _ = _CREDENTIALS.unpack(connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, size))
    return int(user)


_LONGEST_ID = 20
"""Characters of a process id. A file with more content is not a lock file."""


class InstanceLock:
    """Ensures a single daemon per rig, by an flock, which the system releases with the process."""

    @classmethod
    def take(cls, rig: str, path: Path) -> InstanceLock:
        """Take the lock of a rig."""
        try:
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            status = path.parent.stat()
            if status.st_uid not in (os.geteuid(), 0):
                remedy = "set XDG_RUNTIME_DIR, or choose a different --socket"
                raise CellError(str(path.parent), "belongs to a different user", remedy, code="lock.untrusted")
            if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
                problem = "is writable for other users, who could replace the socket of rigd"
                remedy = "give --socket in a private directory, or chmod go-w this directory"
                raise CellError(str(path.parent), problem, remedy, code="daemon.untrusted")
            fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o600)
        except OSError as error:
            problem = "is a symbolic link" if path.is_symlink() else error.strerror or str(error)
            raise CellError(str(path), problem, "choose a different --socket", code="daemon.socket") from None
        lock = cls(fd)
        try:
            lock._hold(rig, path)
        except BaseException:
            lock.release()
            raise
        return lock

    def __init__(self, fd: int) -> None:
        self._fd = fd

    def _hold(self, rig: str, path: Path) -> None:
        status = os.fstat(self._fd)
        if not stat.S_ISREG(status.st_mode) or status.st_nlink != 1 or status.st_size > _LONGEST_ID:
            problem = "already exists and is not a lock file of rigd"
            raise CellError(str(path), problem, "choose a different --socket", code="lock.foreign_file")
        try:
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            holder = os.pread(self._fd, _LONGEST_ID, 0).decode("ascii", "replace").strip() or "unknown"
            problem = f"a different rigd (process {holder}) serves this rig"
            remedy = "stop that daemon, or query it with rig status"
            raise CellError(rig, problem, remedy, code="daemon.second") from None
        with contextlib.suppress(OSError):  # informative only: a full disk must not prevent the start
            os.ftruncate(self._fd, 0)
            os.write(self._fd, str(os.getpid()).encode())

    @classmethod
    def take_gauge(cls, name: str, port: str) -> InstanceLock:
        """Lock the port of a gauge for the daemons of this user, independent of rig file and name.

        Two daemons would receive each other's answers.
        """
        # Canonical name of a port: the device for a serial port, lower case for an address. The path of a
        # pseudo-terminal is unchanged, because its number is reused after closing.
        canonical = port.casefold().replace("//localhost:", "//127.0.0.1:")
        if port.startswith("/"):
            device = os.path.realpath(port)
            canonical = str(Path(port).absolute()) if device.startswith("/dev/pts/") else device
        key = hashlib.sha256(canonical.encode()).hexdigest()[:16]
        address = f"\0rigd-{os.geteuid()}-{key}"
        lock = socket.socket(socket.AF_UNIX)
        try:
            lock.bind(address)
            lock.listen()
        except OSError:
            lock.close()
            if _is_of_this_user(address):  # locks of other users are ignored, because they could hold them forever
                problem = f"a different rigd reads the gauge at {port}"
                remedy = "stop that rigd, or correct the port in the rig file"
                raise CellError(name, problem, remedy, code="gauge.in_use") from None
            return cls(-1)
        return cls(lock.detach())

    def release(self) -> None:
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1


def _is_of_this_user(address: str) -> bool:
    """True if a program of this user or of root listens at an abstract address."""
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX) as probe:
        probe.settimeout(1.0)
        probe.connect(address)
        return peer_user(probe) in (0, os.geteuid())
    return False
