"""The fsspec protocol `trial` for tests: a local directory with errors on demand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import fsspec
from fsspec.implementations.local import LocalFileSystem

DENIED, LOST, GROWN = ("denied", "lost+found"), "vanished", "grown"
"""Parts of paths that cause errors: access denied, connection lost, and size different from the listing."""

_TOP = "trial://here"


class TrialStore(LocalFileSystem):
    """Local files. The listing of a directory also contains the names in its file `.names`."""

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
    """Register the protocol with fsspec and return the URL of a directory."""
    fsspec.register_implementation("trial", TrialStore, clobber=True)
    return f"{_TOP}{path}"
