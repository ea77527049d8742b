"""The files of a robot program: which language they are in, finding one by its name, and running them on a machine."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from analysis.emulation import fanuc_tp, inform, krl, rapid, urscript
from analysis.emulation.machine import Machine, ProgramError
from rigs.errors import FileError
from rigs.files import read_bytes
from rigs.schema.part import Maker

_MAKERS: dict[str, Maker] = {
    ".script": "ur",
    ".urscript": "ur",
    ".ls": "fanuc",
    ".src": "kuka",
    ".mod": "abb",
    ".jbi": "yaskawa",
}
"""The makers by the suffix of the file that has the motion."""
_MOST_BYTES = 10_000_000
"""A program with a hundred thousand targets is below it; controllers hold less."""
_SHORTEST = 8
"""A name that was cut to what a controller takes has more characters: the test and the direction stand in it."""


@dataclass(frozen=True)
class ProgramFiles:
    """A program: the file with its motion, the controller's maker, and the texts of its files by name."""

    path: Path
    maker: Maker
    texts: Mapping[str, str]


def find_program(directory: Path, name: str) -> ProgramFiles:
    """Return a program by the name of its file, with or without suffix, by the name that `rig program` prints, or by a
    path. Raises FileError where there is none, several, or one that cannot be read."""
    return _read(_found(directory, name.strip()))


def interpret(maker: Maker, texts: Mapping[str, str], machine: Machine) -> None:
    """Drive a machine with the texts of a program's files, by their names. Raises ProgramError for one that is
    refused."""
    name = next(name for name in texts if Path(name).suffix.lower() in _MAKERS)
    try:
        match maker:
            case "ur":
                urscript.run(texts[name], machine)
            case "fanuc":
                fanuc_tp.run(texts[name], machine)
            case "kuka":
                krl.run(texts[name], _data_list(texts), machine)
            case "abb":
                rapid.run(texts[name], machine)
            case "yaskawa":
                inform.run(texts[name], machine)
    except (LookupError, ValueError, TypeError, AttributeError, ArithmeticError, RecursionError) as error:
        raise ProgramError(f"it is not understood ({type(error).__name__}: {error})") from error


def _data_list(texts: Mapping[str, str]) -> str:
    found = [text for name, text in texts.items() if name.lower().endswith(".dat")]
    if not found:
        raise ProgramError("its data list, the .dat beside it, is missing")
    return found[0]


def _found(directory: Path, name: str) -> Path:
    given = Path(name)
    if given.parent != Path() and given.suffix.lower() in _MAKERS:
        return given
    try:
        files = sorted(path for path in directory.iterdir() if path.suffix.lower() in _MAKERS)
    except OSError as error:
        raise FileError(str(directory), error.strerror or str(error), "give a directory of programs") from None
    wanted = _plain(given.stem if given.suffix.lower() in _MAKERS else name)
    found = [path for path in files if path.name == name] or [path for path in files if wanted in _names(path)]
    # A controller's longest name cuts that of the program.
    found = found or [path for path in files if any(_cut(wanted, one) for one in _names(path))]
    if len(found) == 1:
        return found[0]
    if found:
        raise FileError(repr(name), f"is {' and '.join(path.name for path in found)}", "give the name of the file")
    there = ", ".join(path.name for path in files[:8]) + (" …" if len(files) > 8 else "")
    what = f"is none of the programs in {directory}"
    raise FileError(repr(name), what, f"give one of {there}" if files else "write programs there with rig program")


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


def _names(path: Path) -> tuple[str, ...]:
    """The names of a program; the module of an ABB has two characters more than its procedure."""
    name = _plain(path.stem)
    return (name, name.removesuffix("_m")) if path.suffix.lower() == ".mod" else (name,)


def _cut(wanted: str, name: str) -> bool:
    return len(name) >= _SHORTEST and wanted.startswith(name)


def _read(path: Path) -> ProgramFiles:
    maker = _MAKERS[path.suffix.lower()]
    texts = {path.name: _text(path)}
    if maker == "kuka":
        beside = [path.with_suffix(suffix) for suffix in (".dat", ".DAT", ".Dat")]
        texts |= {data.name: _text(data) for data in beside[:1] if data.exists()} or {
            data.name: _text(data) for data in beside[1:] if data.exists()
        }
    return ProgramFiles(path, maker, texts)


def _text(path: Path) -> str:
    try:
        return read_bytes(path, _MOST_BYTES).decode("latin-1")
    except OSError as error:
        raise FileError(str(path), error.strerror or str(error), "check the path and its permissions") from None
