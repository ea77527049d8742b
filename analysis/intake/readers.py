"""Readers of files that contain several recorded streams, such as ROS 2 bags.

A package offers each reader as an entry point `rig.readers`: a module with the functions of `StreamReader`. Rig's own
reader is offered in the same way, so that the import of tables does not depend on its libraries.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Protocol, cast

from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.vocabulary import TestName


@dataclass(frozen=True)
class StandTable:
    """Table of the stationary poses in a file as text, the topic it was made from, and doubts as text."""

    text: bytes
    topic: str
    doubts: tuple[str, ...]


class StreamReader(Protocol):
    """Reader of one file format, loaded from a module."""

    def is_own(self, data: bytes) -> bool:
        """True if a file has the format of this reader, by its first bytes or all bytes."""

    def file_of(self, path: Path) -> Path:
        """File to be read in a directory made by a recorder; any other path unchanged. Raises FileError."""

    def size_remedy(self, data: bytes) -> str:
        """Remedy for a large file, by the first bytes; empty if the format is unknown."""

    def table_of(self, data: bytes, where: str, rig: Rig, test: TestName) -> tuple[bytes, tuple[str, ...]]:
        """CSV of a circle, and doubts in words. Raises FileError."""

    def stands_of(self, data: bytes, where: str, rig: Rig, topic: str) -> StandTable:
        """Stationary poses of the robot as a table. topic: topic of the poses; if empty, the only one.
        Raises FileError.
        """


@cache
def readers() -> tuple[StreamReader, ...]:
    return tuple(map(_loaded, sorted(entry_points(group="rig.readers"))))


def _loaded(offer: EntryPoint) -> StreamReader:
    try:
        return cast("StreamReader", offer.load())
    except Exception as reason:
        problem = f"{offer.value}, which a package offers, cannot be used: {reason}"
        remedy = "install a different version of that package, or uninstall the package"
        raise FileError(f"reader {offer.name}", problem, remedy, code="reader.unusable") from reason


def reader_of(data: bytes) -> StreamReader | None:
    """Reader of a file by its first bytes or all bytes; None for any other format."""
    return next((reader for reader in readers() if reader.is_own(data)), None)


def file_of(path: Path) -> Path:
    """File to be read in a directory made by a recorder; any other path unchanged. Raises FileError."""
    for reader in readers():
        path = reader.file_of(path)
    return path
