"""The dialects by the suffix of a file, and reading the files of a program."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from analysis.correction.programs import abb, fanuc, kuka, ur, yaskawa
from analysis.correction.programs.numbers import Decimals
from analysis.correction.programs.target import Parsed, Texts
from rigs.errors import FileError
from rigs.files import read_bytes
from rigs.schema.vocabulary import Maker

_MOST_BYTES = 10_000_000
"""A program with a hundred thousand targets is below it; controllers hold less."""
_MOST_BESIDE = 500
"""Programs of a controller's backup are some hundred."""
_ENCODING = "latin-1"
"""Every byte is a character of it and back, whatever the file's own encoding: what is not touched stays as it was."""
_KNOWN = "give a program .script or .urscript (UR), .ls (FANUC), .src (KUKA), .mod (ABB) or .jbi (Yaskawa)"


@dataclass(frozen=True)
class Dialect:
    """parse: the targets of the texts of a program; null: the tool and the frame that are nothing, by their names;
    beside: the suffixes of files in the directory whose routines and data a program can use."""

    maker: Maker
    parse: Callable[[Texts], Parsed]
    decimals: Decimals
    null_tools: tuple[str, ...] = ()
    null_frames: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()


_UR = Dialect("ur", ur.parse, ur.DECIMALS, (), ("base",))
_BY_SUFFIX = {
    ".script": _UR,
    ".urscript": _UR,
    ".ls": Dialect("fanuc", fanuc.parse, fanuc.DECIMALS, ("0",), ("0",), (".ls",)),
    ".src": Dialect("kuka", kuka.parse, kuka.DECIMALS, ("0",), ("0",), (".src", ".dat", ".sub")),
    ".mod": Dialect("abb", abb.parse, abb.DECIMALS, beside=(".mod", ".sys")),
    ".jbi": Dialect("yaskawa", yaskawa.parse, yaskawa.DECIMALS, (), ("base",), (".jbi",)),
}


def read_program(path: Path) -> tuple[Dialect, Texts]:
    """Return the dialect and the texts of a program's files, of a KUKA with its .dat where there is one, and of those
    beside it. Raises FileError for what is no program, and where too much stands beside it to be read."""
    dialect = _BY_SUFFIX.get(path.suffix.lower())
    if dialect is None:
        raise FileError(str(path), "is no robot program that is known here", _KNOWN)
    files = {path.name: _text(path)}
    if dialect.maker == "kuka":
        for data in (path.with_suffix(suffix) for suffix in (".dat", ".DAT", ".Dat")):
            if data.exists():
                files[data.name] = _text(data)
                break
    others = _beside(path, dialect, set(files))
    return dialect, Texts((*files, *others), (*files.values(), *others.values()), len(files))


def _beside(path: Path, dialect: Dialect, names: set[str]) -> dict[str, str]:
    """Return the texts of the files beside a program by their names."""
    if not dialect.beside:
        return {}
    others = [
        file
        for file in sorted(path.resolve().parent.iterdir())
        if file.suffix.lower() in dialect.beside and file.name not in names and file.is_file()
    ]
    if len(others) > _MOST_BESIDE or sum(file.stat().st_size for file in others) > _MOST_BYTES:
        raise FileError(
            str(path.parent),
            f"has more than {_MOST_BESIDE} files, or {_MOST_BYTES // 1_000_000} MB, that the program could use",
            "put the program with the files that it uses into a directory of its own",
        )
    data = {file.name: read_bytes(file, _MOST_BYTES) for file in others}
    return {name: content.decode(_ENCODING) for name, content in data.items() if b"\0" not in content}


def as_bytes(text: str) -> bytes:
    """Return the bytes of a program's text."""
    return text.encode(_ENCODING)


def _text(path: Path) -> str:
    try:
        data = read_bytes(path, _MOST_BYTES)
    except OSError as error:
        raise FileError(str(path), error.strerror or str(error), "check the path and its permissions") from None
    if b"\0" in data:
        raise FileError(
            str(path), "is a binary file or UTF-16 text", "give the program as ASCII, Latin-1 or UTF-8 text"
        )
    return data.decode(_ENCODING)
