"""The one rule for files that are there already: docs/decisions/0034-existing-files.md.

What records or decides something is never replaced. What only shows runs, pages, pictures and tables of figures, is
made again under its name, where rig made what is there.
"""

from __future__ import annotations

import os
from pathlib import Path

from rigs.errors import FileError
from rigs.files import read_from

_ENDS = 65536
"""Bytes at either end of a file by which it is known: the schema of the widest table that is written has 3 kB."""
_MARKS: dict[str, tuple[bytes, tuple[bytes, ...]]] = {
    ".html": (b"<!doctype html>", (b"content=\"default-src 'none'; base-uri 'none'; form-action 'none'",)),
    ".pdf": (b"%PDF-", (b"WeasyPrint",)),
    ".png": (b"\x89PNG\r\n", (b"Matplotlib",)),
    ".parquet": (b"PAR1", (b"started_utc", b"standing")),
}
"""What a file begins with, by its ending, and what such files of rig hold near their begin or end."""


def refuse_existing(path: Path, option: str = "--output") -> None:
    """Raise FileError where something has the name of a file that records or decides something, before anything is
    computed. option: what gives it another name."""
    if os.path.lexists(path):
        raise FileError(str(path), "exists already", f"give another {option}, or remove it first")


def refuse_foreign(path: Path, option: str = "--output") -> None:
    """Raise FileError where something has the name of a page, a picture or a table of figures that rig did not make."""
    try:
        begin, size = read_from(path, 0, _ENDS)
        end = begin if size <= _ENDS else read_from(path, size - _ENDS, _ENDS)[0]
    except FileNotFoundError:
        return
    except FileError as error:  # no regular file
        raise FileError(error.where, error.what, f"give another {option}") from None
    except OSError as error:
        raise FileError(str(path), error.strerror or str(error), f"give another {option}") from None
    if size and not _is_of_rig(path, begin, end):
        what = "exists already, and rig did not make it"
        raise FileError(str(path), what, f"give another {option}, or remove it first")


def _is_of_rig(path: Path, begin: bytes, end: bytes) -> bool:
    suffix = {".htm": ".html"}.get(path.suffix.lower(), path.suffix.lower())
    first, marks = _MARKS.get(suffix, _MARKS[".parquet"])  # a table may have any name
    return begin.lstrip().startswith(first) and all(mark in begin or mark in end for mark in marks)
