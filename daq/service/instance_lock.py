"""One daemon for each rig: a lock beside its socket, in a directory that no other user can write.

Somebody else's directory could hold a symbolic link by the lock's name, and opening it would spoil what it points to.

A socket can be given any name, so the rig file itself is locked as well, in a directory of runs each rig, and each
gauge by its port: two daemons would ask the same instruments, and record the same lap twice. The system gives up every
lock with its process, so none stays behind.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import socket
import stat
from pathlib import Path

from daq.service.trust import peer_user
from rigs.errors import CellError

_LONGEST_ID = 20
"""Characters of a process id, more than any has: what is longer is not a lock file."""


class InstanceLock:
    """Ensures one daemon for each rig, by an flock that the system releases whatever happens to the daemon."""

    @classmethod
    def take(cls, rig: str, path: Path) -> InstanceLock:
        """Raises CellError if another daemon holds it, or if the place is not safe."""
        try:
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            _hold_private(path.parent)
            fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o600)
        except OSError as error:
            problem = "is a symbolic link" if path.is_symlink() else error.strerror or str(error)
            raise CellError(str(path), problem, "give another --socket") from None
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
            raise CellError(str(path), "exists already and is not the lock of a rigd", "give another --socket")
        try:
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            holder = os.pread(self._fd, _LONGEST_ID, 0).decode("ascii", "replace").strip() or "unknown"
            problem = f"another rigd (process {holder}) serves this rig"
            raise CellError(rig, problem, "stop that one, or talk to it with rig status") from None
        with contextlib.suppress(OSError):  # for people only: a full disk does not prevent a start
            os.ftruncate(self._fd, 0)
            os.write(self._fd, str(os.getpid()).encode())

    @classmethod
    def take_rig_file(cls, rig_file: Path) -> InstanceLock:
        """Lock a rig file. Raises CellError if another daemon serves it."""
        return cls._held(rig_file, os.O_RDONLY, "another rigd serves this rig file")

    @classmethod
    def take_runs(cls, rig: str, runs: Path) -> InstanceLock:
        """Lock a directory of runs for a rig: rigs may share one. Raises CellError if another daemon records this rig
        there."""
        path = runs / f".rigd-{rig}.lock"
        return cls._held(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, f"another rigd records {rig} in this directory")

    @classmethod
    def take_gauge(cls, name: str, port: str) -> InstanceLock:
        """Lock the port of a gauge for this user's daemons, by whatever rig file and name it is reached: two would each
        take answers of the other. Raises CellError if another daemon reads it.

        The lock is an abstract socket, which is in no directory that a service has for itself alone.
        """
        key = hashlib.sha256(_same_port(port).encode()).hexdigest()[:16]
        address = f"\0rigd-{os.geteuid()}-{key}"
        lock = socket.socket(socket.AF_UNIX)
        try:
            lock.bind(address)
            lock.listen()
        except OSError:
            lock.close()
            if _is_of_this_user(address):  # and of nobody who holds it for ever
                remedy = "stop that one, or correct the port in the rig file"
                raise CellError(name, f"another rigd reads the gauge at {port}", remedy) from None
            return cls(-1)
        return cls(lock.detach())

    @classmethod
    def take_cell(cls, directory: Path) -> InstanceLock:
        """Lock the directory of an emulated or replayed cell. Raises CellError if another serves in it."""
        refusal = "another rig emulate or rig replay serves a cell in this directory"
        return cls._held(directory, os.O_RDONLY, refusal, "stop that one, or give another --output")

    @classmethod
    def _held(
        cls, path: Path, flags: int, refusal: str, remedy: str = "stop that one, or talk to it with rig status"
    ) -> InstanceLock:
        """Lock a file. Where it cannot be opened, or its disk has no locks, there is none: what follows from that is
        reported by those who need the file."""
        try:
            fd = os.open(path, flags | os.O_NONBLOCK | os.O_CLOEXEC, 0o644)
        except OSError:
            return cls(-1)
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(fd)
            raise CellError(str(path), refusal, remedy) from None
        except OSError:
            os.close(fd)
            return cls(-1)
        return cls(fd)

    def release(self) -> None:
        """Release the lock, so that another daemon can start."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1


def _same_port(port: str) -> str:
    """Return one name for a port, however it is written: of a serial port the device, of an address small letters.
    A pseudo-terminal goes by the path given: its number is another's as soon as it closes."""
    if port.startswith("/"):
        device = os.path.realpath(port)
        return str(Path(port).absolute()) if device.startswith("/dev/pts/") else device
    return port.casefold().replace("//localhost:", "//127.0.0.1:")


def _is_of_this_user(address: str) -> bool:
    """Return whether a program of this user or of root listens at an abstract address."""
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX) as probe:
        probe.settimeout(1.0)
        probe.connect(address)
        return peer_user(probe) in (0, os.geteuid())
    return False


def _hold_private(directory: Path) -> None:
    """Raise CellError if another user may put files into a directory."""
    status = directory.stat()
    if status.st_uid not in (os.geteuid(), 0):
        raise CellError(str(directory), "belongs to another user", "set XDG_RUNTIME_DIR, or give another --socket")
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        problem = "can be written by other users, who could put a file in the place of rigd's"
        raise CellError(str(directory), problem, "give --socket in a directory of your own, or chmod go-w it")
