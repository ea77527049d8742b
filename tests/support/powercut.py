"""A disk that loses unsynced data: all changes made by the store in order, and the possible states after a power cut.

`watched` replaces `os` in `daq.store.durable`, the only module of the store that changes files, by a logging version.
`survivors` then creates a possible state of the file system after a cut, with only the guarantees of POSIX. Synced
bytes and names are present. Any subset of other bytes may be present, in sectors, in any order, with zeros or rubbish
between them, and the file may have any size. Each unsynced change of a name may be lost independently of the others.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from random import Random
from types import SimpleNamespace
from typing import Any

from daq.store import durable

ROOT = 0
"""Node of the watched directory. Nodes are files and directories by number, independent of their names."""
BLOCK = 4096
_KEPT = (0.0, 0.1, 0.5, 0.9, 1.0)


@dataclass(frozen=True)
class Link:
    """Creation of a file or directory under a name."""

    directory: int
    name: str
    node: int
    is_directory: bool


@dataclass(frozen=True)
class Rename:
    directory: int
    old: str
    new: str
    node: int


@dataclass(frozen=True)
class Unlink:
    directory: int
    name: str


@dataclass(frozen=True)
class Write:
    node: int
    offset: int
    data: bytes


@dataclass(frozen=True)
class Cut:
    """Truncation of a file to a length."""

    node: int
    size: int


@dataclass(frozen=True)
class Sync:
    """Sync of the bytes of a file or the names of a directory."""

    node: int


@dataclass(frozen=True)
class Mark:
    """A statement of the store at this point, to be checked by a test."""

    said: Any


Change = Link | Rename | Unlink | Write | Cut | Sync | Mark


@dataclass
class IoWorker:
    """State of a disk. names: directory → its entries; data: file → its bytes."""

    names: dict[int, dict[str, int]] = field(default_factory=lambda: {ROOT: {}})
    data: dict[int, bytearray] = field(default_factory=dict)

    @classmethod
    def read(cls, root: Path) -> IoWorker:
        """Current content of a directory."""
        disk = cls()
        places = {root: ROOT}
        for number, path in enumerate(sorted(root.rglob("*")), start=1):
            disk.names[places[path.parent]][path.name] = number
            if path.is_dir():
                places[path], disk.names[number] = number, {}
            else:
                disk.data[number] = bytearray(path.read_bytes())
        return disk

    def copy(self) -> IoWorker:
        names = {node: dict(entries) for node, entries in self.names.items()}
        return IoWorker(names, {node: bytearray(data) for node, data in self.data.items()})

    def make(self, link: Link) -> None:
        """Add a new node that has no name yet."""
        if link.is_directory:
            self.names[link.node] = {}
        else:
            self.data[link.node] = bytearray()

    def put(self, root: Path, directory: int = ROOT) -> None:
        """Write this state below root."""
        root.mkdir(parents=True, exist_ok=True)
        for name, node in self.names[directory].items():
            if node in self.names:
                self.put(root / name, node)
            else:
                (root / name).write_bytes(self.data[node])

    def tree(self, directory: int = ROOT) -> dict[str, Any]:
        """Contents of a directory as nested dictionaries: bytes by file name, and directories by name."""
        return {
            name: self.tree(node) if node in self.names else bytes(self.data[node])
            for name, node in self.names[directory].items()
        }


class Watched:
    """Replacement of `os` that logs all changes below root, on a disk with a capacity in bytes; before: initial
    content.
    """

    def __init__(self, root: Path, capacity: int = 1 << 40) -> None:
        self.before = IoWorker.read(root)
        self.log: list[Change] = []
        self.capacity, self.peak = capacity, 0
        self._nodes = {str(root): ROOT}
        self._find(root, ROOT)
        self._blocks = {node: _blocks(len(data)) for node, data in self.before.data.items()}
        self._open: dict[int, int] = {}
        self._next = 1 + max([*self.before.data, *self.before.names])

    def _find(self, root: Path, directory: int) -> None:
        for name, node in self.before.names[directory].items():
            self._nodes[str(root / name)] = node
            if node in self.before.names:
                self._find(root / name, node)

    def __getattr__(self, name: str) -> Any:
        return getattr(os, name)

    @property
    def used(self) -> int:
        """Used bytes in complete blocks."""
        return sum(self._blocks.values()) * BLOCK

    def mark(self, said: Any) -> None:
        """Log a statement of the store."""
        self.log.append(Mark(said))

    def limit(self, bytes_: int) -> None:
        """Set a quota that is not visible in statvfs."""
        self.capacity, self.statvfs = bytes_, os.statvfs  # type: ignore[method-assign]

    def statvfs(self, path: Path) -> SimpleNamespace:
        return SimpleNamespace(f_bavail=(self.capacity - self.used) // BLOCK, f_frsize=BLOCK)

    def open(self, path: Path, flags: int, mode: int = 0o777) -> int:
        new = bool(flags & os.O_CREAT) and not path.exists()
        fd = os.open(path, flags, mode)
        if new:
            self._link(path, is_directory=False)
        self._open[fd] = self._nodes[str(path)]
        return fd

    def dup(self, fd: int) -> int:
        other = os.dup(fd)
        self._open[other] = self._open[fd]
        return other

    def mkdir(self, path: Path) -> None:
        path.mkdir()
        self._link(path, is_directory=True)

    def _link(self, path: Path, *, is_directory: bool) -> None:
        self._nodes[str(path)] = self._next
        self._blocks[self._next] = int(is_directory)
        self.log.append(Link(self._nodes[str(path.parent)], path.name, self._next, is_directory))
        self._next += 1

    def pwrite(self, fd: int, data: memoryview, offset: int) -> int:
        """Write as many bytes as fit, like a real disk, and fail if there is no space."""
        node = self._open[fd]
        end = (self._blocks[node] + self.capacity // BLOCK - self.used // BLOCK) * BLOCK
        if end <= offset:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written = os.pwrite(fd, data[: end - offset], offset)
        self._blocks[node] = _blocks(os.fstat(fd).st_size)
        self.peak = max(self.peak, self.used)
        self.log.append(Write(node, offset, bytes(data[:written])))
        return written

    def ftruncate(self, fd: int, size: int) -> None:
        os.ftruncate(fd, size)
        self._blocks[self._open[fd]] = _blocks(size)
        self.log.append(Cut(self._open[fd], size))

    def fsync(self, fd: int) -> None:
        """Log the sync without syncing the real disk, because the loss is simulated here."""
        self.log.append(Sync(self._open[fd]))

    def replace(self, old: Path, new: Path) -> None:
        old.replace(new)
        if str(new) in self._nodes:
            del self._blocks[self._nodes[str(new)]]
        node = self._nodes[str(new)] = self._nodes.pop(str(old))
        self.log.append(Rename(self._nodes[str(old.parent)], old.name, new.name, node))

    def unlink(self, path: Path) -> None:
        path.unlink()
        del self._blocks[self._nodes.pop(str(path))]
        self.log.append(Unlink(self._nodes[str(path.parent)], path.name))


def _blocks(size: int) -> int:
    return -(-size // BLOCK)


@contextmanager
def watched(root: Path, capacity: int = 1 << 40) -> Iterator[Watched]:
    """Log all changes of the store below root within the context."""
    watch = Watched(root, capacity)
    durable.os = watch  # type: ignore[assignment]
    try:
        yield watch
    finally:
        durable.os = os


def survivors(before: IoWorker, log: list[Change], random: Random | None) -> IoWorker:
    """A state after a power cut that follows these changes; with random=None, the state without any loss."""
    synced = {change.node: index for index, change in enumerate(log) if isinstance(change, Sync)}
    keep_names, keep_bytes = (random.choice(_KEPT), random.choice(_KEPT)) if random else (1.0, 1.0)
    disk, pending = before.copy(), dict[int, list[Write | Cut]]()
    for index, change in enumerate(log):
        if isinstance(change, Write | Cut):
            if random is None or index < synced.get(change.node, -1):
                _write(disk.data[change.node], change)
            else:
                pending.setdefault(change.node, []).append(change)
        elif isinstance(change, Link | Rename | Unlink):
            sure = random is None or index < synced.get(change.directory, -1)
            if isinstance(change, Link):
                disk.make(change)
            if sure or (random and random.random() < keep_names):
                torn = not sure and random.random() < 0.1
                _name(disk.names[change.directory], change, torn)
    for node, changes in pending.items():
        assert random is not None
        _scatter(disk.data[node], changes, keep_bytes, random)
    return disk


def _name(names: dict[str, int], change: Link | Rename | Unlink, torn: bool) -> None:
    """Apply a change of a name. torn: a rename of which only the new name reached the disk."""
    if isinstance(change, Link):
        names[change.name] = change.node
    elif isinstance(change, Unlink):
        names.pop(change.name, None)
    else:
        names[change.new] = change.node
        if not torn:
            names.pop(change.old, None)


def _write(data: bytearray, change: Write | Cut) -> None:
    if isinstance(change, Cut):
        del data[change.size :]
        data.extend(bytes(change.size - len(data)))
    else:
        data.extend(bytes(max(0, change.offset - len(data))))
        data[change.offset : change.offset + len(change.data)] = change.data


def _scatter(data: bytearray, changes: list[Write | Cut], keep: float, random: Random) -> None:
    """Apply some sectors of some changes in random order. Parts never synced may contain rubbish, and the size may
    be arbitrary.
    """
    safe, sector = len(data), random.choice((512, 4096))
    for change in random.sample(changes, len(changes)) if random.random() < 0.5 else changes:
        pieces = [change] if isinstance(change, Cut) else list(_sectors(change, sector))
        for piece in pieces:
            if random.random() < keep:
                _write(data, piece)
            elif isinstance(piece, Write) and piece.offset >= safe and random.random() < 0.1:
                _write(data, Write(piece.node, piece.offset, random.randbytes(len(piece.data))))
    longest = max([len(data), *(c.offset + len(c.data) for c in changes if isinstance(c, Write))])
    size = random.choice((len(data), longest, random.randint(min(safe, len(data)), longest)))
    _write(data, Cut(changes[0].node, size))


def _sectors(change: Write, sector: int) -> Iterator[Write]:
    start, end = change.offset, change.offset + len(change.data)
    edges = [start, *range((start // sector + 1) * sector, end, sector), end]
    for a, b in pairwise(edges):
        yield Write(change.node, a, change.data[a - start : b - start])
