"""Readers of files with several recorded streams, such as ROS 2 bags.

A package offers a module with the functions of `StreamReader` as an entry point `rig.readers`; rig itself does so too,
because the import of tables must not depend on its libraries.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Protocol

from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.vocabulary import ENTRY_POINTS, TestName


@dataclass(frozen=True)
class StandTable:
    """CSV of the stationary poses in a file, the topic it was made from, and doubts as text."""

    text: bytes
    topic: str
    doubts: tuple[str, ...]


class StreamReader(Protocol):
    def is_own(self, data: bytes) -> bool:
        """True if a file has the format of this reader, by its first bytes or all bytes."""

    def file_of(self, path: Path) -> Path:
        """File to be read in a directory made by a recorder; any other path unchanged."""

    def size_remedy(self, data: bytes) -> str:
        """Remedy for a large file, by the first bytes; empty if the format is unknown."""

    def table_of(self, data: bytes, where: str, rig: Rig, test: TestName) -> tuple[bytes, tuple[str, ...]]:
        """CSV of a circle, and doubts in words."""

    def stands_of(self, data: bytes, where: str, rig: Rig, topic: str) -> StandTable:
        """Stationary poses of the robot. topic: topic of the poses; if empty, the only one."""


@cache
def readers() -> tuple[StreamReader, ...]:
    loaded: list[StreamReader] = []
    for offer in sorted(ENTRY_POINTS.select(group="rig.readers")):
        try:
            loaded.append(offer.load())
        except Exception as reason:
            problem = f"{offer.value}, which a package offers, cannot be used: {reason}"
            remedy = "install a different version of that package, or uninstall the package"
            raise FileError(f"reader {offer.name}", problem, remedy, code="package.missing") from reason
    return tuple(loaded)


def reader_of(data: bytes) -> StreamReader | None:
    """Reader of a file by its first bytes or all bytes; None for any other format."""
    return next((reader for reader in readers() if reader.is_own(data)), None)


def file_of(path: Path) -> Path:
    """File to be read in a directory made by a recorder; any other path unchanged."""
    for reader in readers():
        path = reader.file_of(path)
    return path
