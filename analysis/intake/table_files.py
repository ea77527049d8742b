"""Files of tables: their content, first bytes and header."""

from __future__ import annotations

import re
from pathlib import Path

from analysis.intake.converted import csv_of, is_convertible
from analysis.intake.readers import reader_of
from rigs.errors import FileError
from rigs.files import read_bytes, read_from

MOST_BYTES = 256_000_000


def read_whole(path: Path) -> bytes:
    try:
        return read_bytes(path, MOST_BYTES)
    except IsADirectoryError:
        raise FileError(
            str(path), "is a directory", "give a file; of a bag the .mcap or .db3 file in it", code="file.invalid"
        ) from None
    except OSError as error:
        raise FileError.of_os(path, error, "check the path and the permissions", code="file.unreadable") from None
    except FileError:
        if path.is_file() and path.stat().st_size > MOST_BYTES:
            head = read_from(path, 0, _HEAD_BYTES)[0]
            if (reader := reader_of(head)) and (remedy := reader.size_remedy(head)):
                raise FileError(
                    str(path), f"is a bag of more than {MOST_BYTES / 1e6:g} MB", remedy, code="file.too_large"
                ) from None
        raise


_HEAD_BYTES = 100_000
"""Number of bytes at the start of a file that contain any header and the signature of a bag."""


def read_text(path: Path) -> bytes:
    """Content of a table, as CSV if it is in another format that is converted."""
    return csv_of(read_whole(path), str(path))


_LAST_CELL = re.compile(rb"[0-9.]+(?=[^0-9.]*$)")
_FEWEST_ROWS = 3
"""Smallest number of other rows whose number of digits shows the format of a column."""
_SAMPLED_BYTES = 100_000


def cut_off_doubts(text: bytes) -> tuple[str, ...]:
    """Doubt about a table whose last number lacks the line break and has fewer digits than the others in its column."""
    if not text[-1:].isdigit() and text[-1:] != b".":
        return ()
    lines = text[-_SAMPLED_BYTES:].splitlines()[1:]  # without the header, or the rest of a line
    *others, last = [match[0] for line in lines if (match := _LAST_CELL.search(line))] or [b""]
    if len(others) < _FEWEST_ROWS or not all(_digits(last) < _digits(other) for other in others):
        return ()
    problem = f"the last line ends with {last.decode()}, without a line break and with fewer digits than all others"
    return (f"{problem}: the file may be cut off; compare it with the original",)


def _digits(cell: bytes) -> int:
    """Number of digits that a cut changes: decimals, which count more than all digits of an integer, or digits."""
    whole, point, decimals = cell.partition(b".")
    return 100 + len(decimals) if point else len(whole)


def read_head(path: Path) -> bytes:
    """First bytes of a table as in `read_text`."""
    try:
        head = read_from(path, 0, _HEAD_BYTES)[0]
    except (OSError, FileError):
        head = read_whole(path)[:_HEAD_BYTES]  # raises the error with the reason
    return read_text(path)[:_HEAD_BYTES] if is_convertible(head) else head


def header_names(head: bytes) -> set[str]:
    line = head.split(b"\n")[0].decode("utf-8-sig", "replace")
    return {name.strip().strip('"') for name in line.split(",")}
