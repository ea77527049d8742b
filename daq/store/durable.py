"""Durable file operations, and the lock of the writing process. Functions raise plain OSError.

A file is durable if its bytes and its directory entry are synced. No other code changes files during recording or
recovery: a wrapper around this module's `os` observes all changes in order, as in `tests/support/powercut.py`. Windows
has neither the locks nor directory syncs, so runs cannot be recorded there.
"""

from __future__ import annotations

import errno
import os
import shutil
from contextlib import suppress
from pathlib import Path

from rigs.signals import COMPLETED

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

TEMPORARY = ".tmp"
"""Suffix of a temporary file, which may remain after a crash."""
LOCK = ".lock"
_BINARY = getattr(os, "O_BINARY", 0)
"""Flag that prevents Windows from converting line feeds."""
_AS_IT_IS = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0)
"""Flags for opening a lock: a link in another user's run is not followed, and a FIFO does not block."""


def remedy(error: Exception, otherwise: str) -> str:
    if isinstance(error, OSError) and error.errno in (errno.EMFILE, errno.ENFILE):
        return "close programs or connections with open files, or raise the limit of file descriptors (LimitNOFILE)"
    if isinstance(error, OSError) and error.errno == errno.ELOOP:
        return "remove that link"
    if isinstance(error, NotADirectoryError):
        return "choose a different directory"
    return otherwise


def free_bytes(path: Path) -> int:
    if not hasattr(os, "statvfs"):
        return shutil.disk_usage(path).free
    disk = os.statvfs(path)
    return disk.f_bavail * disk.f_frsize


def make_directories(path: Path) -> None:
    if path.is_dir():
        return
    make_directories(path.parent)
    with suppress(FileExistsError):  # a second daemon may create it at the same time
        os.mkdir(path)  # noqa: PTH102 - through os, like every change in here
    sync_directory(path.parent)


def make_directory(path: Path) -> None:
    """Create a directory, durable after a sync of the parent."""
    os.mkdir(path)  # noqa: PTH102


def discard(path: Path) -> None:
    """Delete a directory of files without recorded data, ignoring errors of the disk, with a single descriptor."""
    with suppress(OSError):
        for file in path.iterdir():
            remove(file)
    with suppress(OSError):
        os.rmdir(path)  # noqa: PTH106 - through os, like every change in here


def sync_directory(path: Path) -> None:
    if not hasattr(os, "O_DIRECTORY"):
        return
    fd = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)


def sync(fd: int) -> None:
    os.fsync(fd)


def persist(path: Path) -> None:
    fd = reopen(path)
    try:
        sync(fd)
    finally:
        close(fd)
    sync_directory(path.parent)


def again(fd: int) -> int:
    return os.dup(fd)


def truncate(fd: int, size: int) -> None:
    os.ftruncate(fd, size)


def close(fd: int) -> None:
    """Close a file or lock. Errors are ignored, because they do not affect synced data."""
    with suppress(OSError):
        os.close(fd)


def rename(old: Path, new: Path) -> None:
    """Rename a file, replacing an existing one. Durable after a sync of the directory."""
    os.replace(old, new)  # noqa: PTH105
    COMPLETED.append(new)


def remove(path: Path) -> None:
    """Delete a file. Durable after a sync of the directory."""
    os.unlink(path)  # noqa: PTH108


def write_at(fd: int, data: bytes, offset: int) -> None:
    """Write all data at an offset. A full disk may accept the first part and refuse only the rest."""
    write = os.pwrite if hasattr(os, "pwrite") else _seek_and_write
    remaining = memoryview(data)
    while remaining:
        written = write(fd, remaining, offset)
        remaining, offset = remaining[written:], offset + written


def _seek_and_write(fd: int, data: memoryview, offset: int) -> int:
    os.lseek(fd, offset, os.SEEK_SET)
    return os.write(fd, data)


def create(path: Path, data: bytes, mode: int = 0o644) -> int:
    fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | _BINARY, mode)
    try:
        write_at(fd, data, 0)
    except OSError:
        close(fd)
        with suppress(OSError):
            remove(path)
        raise
    return fd


def reopen(path: Path) -> int:
    return os.open(path, os.O_RDWR)


def read_all(fd: int) -> bytes:
    """All bytes of an open file, even if its name was removed."""
    data = b""
    while piece := os.pread(fd, os.fstat(fd).st_size - len(data), len(data)):
        data += piece  # a second read is needed only if the first returns less than the file
    return data


def is_named(fd: int, path: Path) -> bool:
    try:
        status = os.stat(path)  # noqa: PTH116 - through os, as everything here
    except (FileNotFoundError, NotADirectoryError):
        return False
    return os.path.samestat(status, os.fstat(fd))


def replace(path: Path, data: bytes, mode: int = 0o644) -> None:
    temporary = path.with_name(path.name + TEMPORARY)
    try:
        with suppress(FileNotFoundError):
            remove(temporary)
        fd = create(temporary, data, mode)
        try:
            sync(fd)
        finally:
            close(fd)
        if temporary.read_bytes() != data:
            raise OSError(errno.EIO, "reads back differently from what was written")
        rename(temporary, path)
    except BaseException:
        with suppress(OSError):
            remove(temporary)  # frees space on a full disk
        raise
    sync_directory(path.parent)


def lock(run: Path) -> int:
    """Take the writer's lock of a new run, waiting for processes that are just in `is_locked`."""
    fd = os.open(run / LOCK, os.O_RDWR | os.O_CREAT | _AS_IT_IS, 0o644)
    if fcntl is not None:
        fcntl.flock(fd, fcntl.LOCK_EX)
    return fd


def try_lock(run: Path) -> int | None:
    """Take the writer's lock of a run. None if a process is writing the run."""
    return _try_flock(run / LOCK, os.O_RDWR | os.O_CREAT)


def lock_directory(directory: Path) -> int | None:
    """Lock a directory itself, without a file in it. None if it is locked, or if locks are not supported."""
    try:
        return None if fcntl is None else _try_flock(directory, os.O_RDONLY | os.O_DIRECTORY)
    except OSError:
        return None


def is_locked(run: Path) -> bool:
    """True if a process is writing this run. The disk may be read-only."""
    try:
        fd = _try_flock(run / LOCK, os.O_RDONLY, shared=True)
    except FileNotFoundError:
        return False
    if fd is not None:
        os.close(fd)
    return fd is None


def may_be_locked(run: Path) -> bool:
    """True if a process may be writing this run, also if this user is not permitted to check."""
    try:
        return is_locked(run)
    except OSError:
        return True


def _try_flock(path: Path, flags: int, *, shared: bool = False) -> int | None:
    """Open and lock a file. None if another process has locked it; a system without locks always succeeds."""
    fd = os.open(path, flags | _AS_IT_IS, 0o644)
    try:
        if fcntl is not None:
            fcntl.flock(fd, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(fd)
        return None
    except OSError:
        os.close(fd)
        raise
    return fd
