"""A protocol of fsspec for tests, `trial`: a directory of this computer whose store fails where a test wants it to."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import fsspec
from fsspec.implementations.local import LocalFileSystem

DENIED, LOST, GROWN = ("denied", "lost+found"), "vanished", "grown"
"""What paths contain that may not be read, over which the connection ends, and whose size is not as it was listed."""

_TOP = "trial://here"


class TrialStore(LocalFileSystem):
    """Local files; a directory with a file `.names` is listed with the names in it besides."""

    protocol = "trial"
    cachable = False

    @classmethod
    def _strip_protocol(cls, path: str) -> str:
        # private: fsspec has file systems override it
        return str(LocalFileSystem._strip_protocol(path.removeprefix(_TOP) or "/"))

    def ls(self, path: str, detail: bool = False, **options: Any) -> Any:
        _fail(path)
        found = super().ls(path, detail=True, **options)
        foreign = Path(path, ".names")
        if foreign.exists():
            found += [found[0] | {"name": name} for name in foreign.read_text().split()]
        return [one | {"size": one["size"] + (GROWN in path)} for one in found]

    def get_file(self, rpath: str, lpath: str, **options: Any) -> None:
        _fail(rpath)
        super().get_file(rpath, lpath, **options)


def _fail(path: str) -> None:
    if any(name in path for name in DENIED):
        raise PermissionError(13, "Permission denied", path)
    if LOST in path:
        raise ConnectionResetError(104, "Connection reset by peer")


def url_of(path: Path) -> str:
    """The URL of a directory, after the protocol is made known to fsspec."""
    fsspec.register_implementation("trial", TrialStore, clobber=True)
    return f"{_TOP}{path}"
