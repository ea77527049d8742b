"""Reading a file that somebody else made: a regular file only, and no more of it than such a file has.

A FIFO would be waited for without end, `/dev/zero` read until the memory is full.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

from pydantic import ValidationError

from rigs.errors import FileError

_REMEDY = "check the path and its permissions"
_POSIX = ("O_NONBLOCK", "O_NOCTTY", "O_CLOEXEC")
_FLAGS = os.O_RDONLY | sum(getattr(os, name, 0) for name in _POSIX) | getattr(os, "O_BINARY", 0)
"""Without waiting for the other end of a FIFO; Windows has none of the former, and changes line ends without the
latter."""


def read_bytes(path: Path, most: int) -> bytes:
    """Return the bytes of a regular file.

    most: the size in bytes beyond which it is not such a file. Raises OSError, or FileError for anything but a regular
    file, for a larger one, and where the memory does not hold it.
    """
    data, _ = read_from(path, 0, most + 1)
    if len(data) > most:
        size = f"{most / 1e6:g} MB" if most < 1e9 else f"{most / 1e9:g} GB"
        raise FileError(str(path), f"is larger than {size}, which no such file is", "give the file itself")
    return data


def read_from(path: Path, begin: int, most: int) -> tuple[bytes, int]:
    """Return at most so many bytes of a regular file, from the byte `begin` on, and the size of the file in bytes.

    Raises OSError, or FileError for anything but a regular file, and where the memory does not hold it.
    """
    try:
        fd = os.open(path, _FLAGS)
    except ValueError as error:  # a zero byte in its name
        raise FileError(str(path), str(error), _REMEDY) from None
    with os.fdopen(fd, "rb") as file:
        status = os.fstat(fd)
        if not stat.S_ISREG(status.st_mode):
            problem = "is a directory" if stat.S_ISDIR(status.st_mode) else "is not a regular file"
            raise FileError(str(path), problem, "give a file")
        file.seek(begin)
        try:
            return file.read(most), status.st_size
        except MemoryError:
            raise out_of_memory(path) from None


def read_text(path: Path, most: int) -> str:
    """Return the text of a regular file. Raises as `read_bytes` does, and FileError where it is not UTF-8."""
    try:
        return read_bytes(path, most).decode()
    except UnicodeDecodeError as error:
        raise FileError(str(path), f"is not UTF-8 at byte {error.start}", "save it as UTF-8") from None


def out_of_memory(path: Path) -> FileError:
    """Return the error for a file that may be good, and that this computer has no memory for."""
    return FileError(str(path), "cannot be read: not enough memory", "close other programs, or read it elsewhere")


def of_newer_rig(where: str, error: ValidationError, field: str = "version") -> FileError | None:
    """Return the error for a file of a version that this rig does not know, whatever else it has that is unknown; None
    where its version, a number in `field`, is not what is wrong.

    What every file of before 1.0 and of 1.x is read by: docs/decisions/0031-compatibility.md.
    """
    for detail in error.errors(include_url=False, include_context=False):
        if detail["loc"] == (field,) and isinstance(detail["input"], int):
            problem = f"has {field} {detail['input']}, which this rig does not know: a newer one wrote it"
            return FileError(where, problem, "install the newest rig on this computer, or use it where it was made")
    return None
