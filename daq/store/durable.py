"""Files that are on the disk when the call returns, and the lock that says who is writing.

A file is durable when its bytes and its directory's entry for it are both synced; replacing one goes
through a temporary name, so that every name always holds a whole file, the old or the new.
Nothing else changes a file while a run is recorded or recovered: who wraps this module's `os` sees every
change in order, as `scripts/dev powercut` does. Raises plain OSError: the callers turn it into a message for people.

On Windows runs are read, imported and simulated, and never recorded. What it lacks are locks of this kind, which only a
daemon and its helpers need there, and directories that can be synced, which only a power cut would miss.
"""

from __future__ import annotations

import errno
import os
import shutil
from contextlib import suppress
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

TEMPORARY = ".tmp"
"""Ending of a file that is being written; one that is left over holds nothing that counts."""
LOCK = ".lock"
_BINARY = getattr(os, "O_BINARY", 0)
"""Without it Windows writes each line feed as two characters."""
_AS_IT_IS = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0)
"""A lock that is a link or a FIFO, in a run from elsewhere, is neither followed nor waited for."""


def remedy(error: Exception, otherwise: str) -> str:
    """Return what to do about an error: where no descriptor is left, a lock is a link, or a file is where a directory
    is wanted, the disk is not at fault."""
    if isinstance(error, OSError) and error.errno in (errno.EMFILE, errno.ENFILE):
        return "close what holds file descriptors (connections, other programs), or raise their limit (LimitNOFILE)"
    if isinstance(error, OSError) and error.errno == errno.ELOOP:
        return "remove that link"
    if isinstance(error, NotADirectoryError):
        return "choose another directory"
    return otherwise


def free_bytes(path: Path) -> int:
    """Return the bytes that this user still has free on the disk of path."""
    if not hasattr(os, "statvfs"):
        return shutil.disk_usage(path).free
    disk = os.statvfs(path)
    return disk.f_bavail * disk.f_frsize


def make_directories(path: Path) -> None:
    """Make a directory and those above it that are missing, durably."""
    if path.is_dir():
        return
    make_directories(path.parent)
    with suppress(FileExistsError):  # another daemon may share it and be faster
        os.mkdir(path)  # noqa: PTH102 - through os, like every change in here
    sync_directory(path.parent)


def make_directory(path: Path) -> None:
    """Make one directory; durable when its parent is synced. Raises FileExistsError."""
    os.mkdir(path)  # noqa: PTH102


def discard(path: Path) -> None:
    """Delete a directory of files in which nothing was recorded, as far as the disk allows it.

    With a single descriptor, since the lack of others may be why nothing was recorded.
    """
    with suppress(OSError):
        for file in path.iterdir():
            remove(file)
    with suppress(OSError):
        os.rmdir(path)  # noqa: PTH106 - through os, like every change in here


def sync_directory(path: Path) -> None:
    """Make the entries of a directory durable."""
    if not hasattr(os, "O_DIRECTORY"):
        return
    fd = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)


def sync(fd: int) -> None:
    """Make the bytes of a file durable."""
    os.fsync(fd)


def persist(path: Path) -> None:
    """Make a file that is complete durable, and its name with it."""
    fd = reopen(path)
    try:
        sync(fd)
    finally:
        close(fd)
    sync_directory(path.parent)


def again(fd: int) -> int:
    """Return another descriptor of an open file, which stays valid after the first is closed."""
    return os.dup(fd)


def truncate(fd: int, size: int) -> None:
    """Cut a file."""
    os.ftruncate(fd, size)


def close(fd: int) -> None:
    """Close a file or a lock. Errors at this point do not concern what was synced, and are ignored."""
    with suppress(OSError):
        os.close(fd)


def rename(old: Path, new: Path) -> None:
    """Give a file another name, instead of a file that has it; durable when the directory is synced."""
    os.replace(old, new)  # noqa: PTH105


def remove(path: Path) -> None:
    """Delete a file; durable when its directory is synced."""
    os.unlink(path)  # noqa: PTH108


def write_at(fd: int, data: bytes, offset: int) -> None:
    """Write all of data: a disk that fills up takes a part of it first and refuses only then."""
    write = os.pwrite if hasattr(os, "pwrite") else _seek_and_write
    remaining = memoryview(data)
    while remaining:
        written = write(fd, remaining, offset)
        remaining, offset = remaining[written:], offset + written


def _seek_and_write(fd: int, data: memoryview, offset: int) -> int:
    os.lseek(fd, offset, os.SEEK_SET)
    return os.write(fd, data)


def create(path: Path, data: bytes, mode: int = 0o644) -> int:
    """Create a file that begins with data, and return its descriptor; no file is left if this fails.

    mode: its permissions, as far as the umask grants them. Raises FileExistsError if the name is taken.
    """
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
    """Open a file that is there, to read and to go on writing it."""
    return os.open(path, os.O_RDWR)


def read(fd: int) -> bytes:
    """Return all bytes of an open file, also of one whose name is gone."""
    data = b""
    while piece := os.pread(fd, os.fstat(fd).st_size - len(data), len(data)):
        data += piece  # a second piece only where a single read may not be as large as a chunk
    return data


def is_named(fd: int, path: Path) -> bool:
    """Return whether an open file is still the one of this name."""
    try:
        status = os.stat(path)  # noqa: PTH116 - through os, as everything here
    except (FileNotFoundError, NotADirectoryError):
        return False
    return os.path.samestat(status, os.fstat(fd))


def replace(path: Path, data: bytes, mode: int = 0o644) -> None:
    """Put data under a name, durably and all at once, and prove that the file holds it; mode: as for `create`."""
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
            remove(temporary)  # on a full disk every byte counts
        raise
    sync_directory(path.parent)


def lock(run: Path) -> int:
    """Take the writer's lock of a run, as the descriptor that holds it.

    Waits: on a fresh run no process holds it for longer than a look (`is_locked`) takes.
    """
    fd = os.open(run / LOCK, os.O_RDWR | os.O_CREAT | _AS_IT_IS, 0o644)
    _flock(fd, wait=True)
    return fd


def try_lock(run: Path) -> int | None:
    """Take the writer's lock of a run, None when a process is writing it."""
    fd = os.open(run / LOCK, os.O_RDWR | os.O_CREAT | _AS_IT_IS, 0o644)
    try:
        _flock(fd)
    except BlockingIOError:
        os.close(fd)
        return None
    return fd


def is_locked(run: Path) -> bool:
    """Whether a process is writing this run. Looks only; works on a read-only disk."""
    try:
        fd = os.open(run / LOCK, os.O_RDONLY | _AS_IT_IS)
    except FileNotFoundError:
        return False
    try:
        _flock(fd, shared=True)
    except BlockingIOError:
        return True
    finally:
        os.close(fd)
    return False


def may_be_locked(run: Path) -> bool:
    """Whether a process may be writing this run: it may where this user has no right to look."""
    try:
        return is_locked(run)
    except OSError:
        return True


def _flock(fd: int, *, shared: bool = False, wait: bool = False) -> None:
    """Lock an open file; where the system lacks such locks, every one is granted. Raises BlockingIOError."""
    if fcntl is not None:
        fcntl.flock(fd, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | (0 if wait else fcntl.LOCK_NB))
