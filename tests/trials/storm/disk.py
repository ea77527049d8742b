"""The disk of a world: it syncs in its own time, fills up, fails, and may forget at a power cut what was not synced."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from random import Random
from types import SimpleNamespace
from typing import Any

from daq import clock
from tests.support.powercut import Watched, survivors

_CHANGES = ("open", "pwrite", "fsync", "ftruncate", "replace", "unlink", "mkdir", "rmdir")
_SYNC_S = (0.0005, 0.004)
"""As of an SSD."""
_FREE = SimpleNamespace(f_bavail=1 << 20, f_frsize=1 << 20)
_FULL = SimpleNamespace(f_bavail=1, f_frsize=1 << 20)


class Disk:
    """In the place of `os` in `daq.store.durable`, the only module of the store that changes files.

    syncs_s: what a sync takes; failing: calls that fail, and how; full: whether it shows no room; gone: whether the
    process that calls was killed.
    """

    def __init__(self, root: Path, dice: Random, *, forgets: bool) -> None:
        self.syncs_s, self.failing, self.full, self.gone = 0.0, dict[str, int](), False, False
        self.refused = 0
        """Calls that failed."""
        self._root, self._dice, self._forgets = root, dice, forgets
        self._below: Any = Watched(root) if forgets else os

    def __getattr__(self, name: str) -> Any:
        call = getattr(self._below, name)
        return self._guarded(name, call) if name in _CHANGES else call

    def statvfs(self, path: Path) -> SimpleNamespace:
        return _FULL if self.full else _FREE

    def fsync(self, fd: int) -> None:
        """Nobody may hold a lock here, since it takes time; no real disk is waited for."""
        self._refuse("fsync")
        clock.sleep(self.syncs_s or self._dice.uniform(*_SYNC_S))
        self._refuse("fsync")
        if self._forgets:
            self._below.fsync(fd)

    def heal(self) -> None:
        """Work well from now on."""
        self.syncs_s, self.full = 0.0, False
        self.failing.clear()

    def cut_power(self) -> None:
        """Leave on the disk what a power cut might."""
        left = survivors(self._below.before, self._below.log, self._dice)
        for path in sorted(self._root.rglob("*"), reverse=True):
            path.rmdir() if path.is_dir() else path.unlink()
        left.put(self._root)
        self._below = Watched(self._root)

    def _guarded(self, name: str, call: Any) -> Any:
        def guarded(*arguments: Any, **options: Any) -> Any:
            if name != "open" or arguments[1] & (os.O_RDWR | os.O_CREAT):
                self._refuse(name)
            return call(*arguments, **options)

        return guarded

    def _refuse(self, name: str) -> None:
        number = errno.EIO if self.gone else self.failing.get(name)
        if number is not None:
            self.refused += 1
            raise OSError(number, os.strerror(number))
