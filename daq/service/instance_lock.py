"""One daemon for each rig: a lock beside its socket, in a directory that no other user can write.

Somebody else's directory could hold a symbolic link by the lock's name, and opening it would spoil what it points to.

A socket can be given any name, so the rig file itself is locked as well, and in a directory of runs each rig: two
daemons would ask the same instruments, and record the same lap twice. The system gives up every lock with its process,
so none stays behind.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import stat
from pathlib import Path

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
            what = "is a symbolic link" if path.is_symlink() else error.strerror or str(error)
            raise CellError(str(path), what, "give another --socket") from None
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
        found = os.fstat(self._fd)
        if not stat.S_ISREG(found.st_mode) or found.st_nlink != 1 or found.st_size > _LONGEST_ID:
            raise CellError(str(path), "exists already and is not the lock of a rigd", "give another --socket")
        try:
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            holder = os.pread(self._fd, _LONGEST_ID, 0).decode("ascii", "replace").strip() or "unknown"
            what = f"another rigd (process {holder}) serves this rig"
            raise CellError(rig, what, "stop that one, or talk to it with rig status") from None
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


def _hold_private(directory: Path) -> None:
    """Raise CellError if another user may put files into a directory."""
    found = directory.stat()
    if found.st_uid not in (os.geteuid(), 0):
        raise CellError(str(directory), "belongs to another user", "set XDG_RUNTIME_DIR, or give another --socket")
    if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        what = "can be written by other users, who could put a file in the place of rigd's"
        raise CellError(str(directory), what, "give --socket in a directory of your own, or chmod go-w it")
