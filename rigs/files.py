"""Safe reading of foreign files: only regular files, up to a size limit.

A FIFO would block forever, and `/dev/zero` would fill the memory.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

from pydantic import ValidationError

from rigs.errors import FileError

_REMEDY = "check the path and the permissions"
_POSIX = ("O_NONBLOCK", "O_NOCTTY", "O_CLOEXEC")
_FLAGS = os.O_RDONLY | sum(getattr(os, name, 0) for name in _POSIX) | getattr(os, "O_BINARY", 0)
"""Open flags: do not wait for the other end of a FIFO (not on Windows), and keep line ends (only on Windows)."""


def read_bytes(path: Path, most: int) -> bytes:
    """Bytes of a regular file.

    most: size limit in bytes. Raises OSError, or FileError for a special or oversized file or insufficient memory.
    """
    data, _ = read_from(path, 0, most + 1)
    if len(data) > most:
        size = f"{most / 1e6:g} MB" if most < 1e9 else f"{most / 1e9:g} GB"
        raise FileError(
            str(path), f"is larger than {size}, the limit for such files", "give the file itself", code="file.too_large"
        )
    return data


def read_from(path: Path, begin: int, most: int) -> tuple[bytes, int]:
    """At most `most` bytes of a regular file, starting at the byte `begin`, and the size of the file in bytes.

    Raises OSError, or FileError for a special file or insufficient memory.
    """
    try:
        fd = os.open(path, _FLAGS)
    except ValueError as error:  # a zero byte in the name
        raise FileError(str(path), str(error), _REMEDY, code="file.unreadable") from None
    with os.fdopen(fd, "rb") as file:
        status = os.fstat(fd)
        if not stat.S_ISREG(status.st_mode):
            problem = "is a directory" if stat.S_ISDIR(status.st_mode) else "is not a regular file"
            raise FileError(str(path), problem, "give a file", code="file.invalid")
        file.seek(begin)
        try:
            return file.read(most), status.st_size
        except MemoryError:
            raise out_of_memory(path) from None


def read_text(path: Path, most: int) -> str:
    """Text of a regular file. Raises the errors of `read_bytes`, and FileError if it is not UTF-8."""
    try:
        return read_bytes(path, most).decode()
    except UnicodeDecodeError as error:
        raise FileError(
            str(path), f"is not UTF-8 at byte {error.start}", "save it as UTF-8", code="file.invalid"
        ) from None


def out_of_memory(path: Path) -> FileError:
    return FileError(
        str(path),
        "cannot be read: not enough memory",
        "close other programs, or use a different computer",
        code="computer.unsuitable",
    )


def of_newer_rig(where: str, error: ValidationError, field: str = "version") -> FileError | None:
    """Error for a file of a newer version; None if the version is supported.

    Any other unknown content is ignored. field: name of the version number. Used for all files of versions before 1.0
    and of 1.x: docs/decisions/0031-compatibility.md.
    """
    for detail in error.errors(include_url=False, include_context=False):
        if detail["loc"] == (field,) and isinstance(detail["input"], int):
            problem = f"has {field} {detail['input']}, unknown to this rig: the file is from a newer version"
            return FileError(
                where,
                problem,
                "install the newest rig on this computer, or use the original computer",
                code="file.invalid",
            )
    return None
