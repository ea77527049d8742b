"""A directory that is there whole or not at all: it is filled under a hidden name, and gets its own at the end.

A command that was interrupted while it wrote left half a run, which was neither a run nor free for the next try. What
is hidden is no run to any command. It is removed where the command fails or is interrupted, and also where a signal
ends it. What SIGKILL or a power cut leaves of it is removed by the next command that writes beside it: a command that
fills such a directory holds a lock on it, which the system gives up with the process.
"""

from __future__ import annotations

import errno
import os
import re
import secrets
import shutil
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from daq.store import durable

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

_OURS = re.compile(rf"\.[0-9a-f]{{16}}{re.escape(durable.TEMPORARY)}")
"""The name of a hidden directory."""
_TRIES = 3
"""Between the making of a directory and its lock there are microseconds, in which another command may look."""
_ENDS = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]


@contextmanager
def new_directory(path: Path) -> Iterator[Path]:
    """Give a hidden directory beside `path`, which has that name once the block has ended.

    Raises FileExistsError where something has the name, and any other OSError of a disk that refuses.
    """
    _hold_free(path)
    durable.make_directories(path.parent)
    with _hidden(path.parent) as made:
        yield made
        durable.sync_directory(made)
        _hold_free(path)
        durable.rename(made, path)
        durable.sync_directory(path.parent)


@contextmanager
def files_into(directory: Path, *, over: bool = False) -> Iterator[Path]:
    """Give a hidden directory whose files are in `directory` once the block has ended: all of them, or none.

    over: they take the place of files that are there; then each is the old one or the new one, whole. Raises
    FileExistsError with the path of a file that is there otherwise, and any other OSError of a disk that refuses.
    """
    if not os.path.lexists(directory):
        with new_directory(directory) as made:
            yield made
        return
    with _hidden(directory) as made:
        yield made
        names = sorted(file.name for file in made.iterdir())
        try:
            for name in names:
                if not over:
                    _hold_free(directory / name)
                durable.rename(made / name, directory / name)
        except BaseException:
            for name in names if not over else ():
                if not (made / name).exists():
                    with suppress(OSError):
                        durable.remove(directory / name)
            raise
        durable.sync_directory(directory)


def surely(remove: Callable[[], object]) -> None:
    """Remove what is left over, and once more where Ctrl-C comes just then."""
    try:
        remove()
    except BaseException:
        remove()
        raise


@contextmanager
def removed_at_signals(directory: str | Path, before: Callable[[], None] = lambda: None) -> Iterator[None]:
    """Signals that end this process at once remove a directory first, unless they are handled or ignored already.

    before: called first, by this process alone and not by one that was forked of it.
    """
    owner = os.getpid()

    def leave(number: int, _: object) -> None:
        # No exception does this: one that is raised within a fork is ignored, and the signal would be lost.
        if os.getpid() == owner:  # and not a process that was forked, which shares the directory
            before()
            shutil.rmtree(directory, ignore_errors=True)
        signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)

    is_main = threading.current_thread() is threading.main_thread()  # no other may handle signals
    numbers = [number for number in _ENDS if is_main and signal.getsignal(number) is signal.SIG_DFL]
    try:
        for number in numbers:
            signal.signal(number, leave)
        yield
    finally:
        for number in numbers:
            signal.signal(number, signal.SIG_DFL)


@contextmanager
def _hidden(parent: Path) -> Iterator[Path]:
    _remove_left_over(parent)
    made, fd = _locked_directory(parent)
    try:
        with removed_at_signals(made):
            yield made
    finally:
        surely(lambda: shutil.rmtree(made, ignore_errors=True))
        if fd is not None:
            os.close(fd)


def _locked_directory(parent: Path) -> tuple[Path, int | None]:
    """Make a hidden directory that no other command removes; the lock is None where the disk has none."""
    for _ in range(_TRIES):
        made = parent / f".{secrets.token_hex(8)}{durable.TEMPORARY}"
        durable.make_directory(made)
        fd = _lock_of(made)
        if fd is not None and os.path.lexists(made):
            break
        if fd is not None:  # another command took it for left over, just before the lock
            os.close(fd)
    return made, fd


def _lock_of(directory: Path) -> int | None:
    """Return a descriptor that locks a directory, None where another process does, or there are no locks."""
    if fcntl is None:
        return None
    try:
        fd = os.open(directory, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        return None
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(fd)
        return None
    return fd


def _remove_left_over(parent: Path) -> None:
    """Remove the hidden directories of processes that were killed while they filled them."""
    for directory in parent.glob(f".*{durable.TEMPORARY}"):
        if not _OURS.fullmatch(directory.name) or directory.is_symlink():
            continue
        fd = _lock_of(directory)
        if fd is not None:
            shutil.rmtree(directory, ignore_errors=True)
            os.close(fd)


def _hold_free(path: Path) -> None:
    if os.path.lexists(path):
        raise FileExistsError(errno.EEXIST, "exists already", str(path))
