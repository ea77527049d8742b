"""A test that was fitted, as the block of a rig file with its uncertainties: printed, or written into the file."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from analysis.cli.console import say, say_json
from rigs.edit import Values, block_of, with_test
from rigs.errors import CellError, FileError, RigError
from rigs.files import read_bytes
from rigs.load import find, load, parse, shipped
from rigs.rig import Rig

_MOST_BYTES = 1_000_000
"""No rig file is larger (`rigs.load`)."""


@dataclass(frozen=True)
class RigFile:
    """A rig with the text of its file; path: None where it came with a run or from a daemon, and cannot be written."""

    rig: Rig
    text: str
    path: Path | None


@dataclass(frozen=True)
class FittedTest:
    """A test's values; u: the standard uncertainty of each as text; used: what they were fitted to; doubts in words."""

    test: Literal["circle", "hemisphere"]
    values: Values
    u: Mapping[str, str]
    used: str
    doubts: Sequence[str]


def rig_file_to_write(name: str | None, write: bool) -> RigFile | None:
    """The rig file that --rig names. Raises FileError where --write has none, or one that is shipped."""
    if name is None:
        if write:
            raise FileError("--write", "needs the rig file that it writes", "give it with --rig FILE")
        return None
    path = find(name)
    if write and path.resolve() in {one.resolve() for one in shipped().values()}:
        raise FileError(
            name, "is a shipped rig, which stays as it is", "copy it with rig example DIR, and give the copy"
        )
    rig, text = load(path)
    return RigFile(rig, text, path)


def give(fitted: FittedTest, to: RigFile, *, write: bool, as_json: bool) -> None:
    """Print the block, write it if asked to, and say what the new rig file can do. Raises FileError, CellError."""
    where = str(to.path or to.rig.name)
    text = with_test(to.text, fitted.test, fitted.values, where)
    doubts = [*fitted.doubts, *_not_drivable(parse(text, where))] if fitted.test == "circle" else list(fitted.doubts)
    done = _written(to, text, write=write)  # first of all, since an error is one line alone
    for doubt in doubts:
        say(doubt, err=True)
    if as_json:
        say_json({"test": fitted.test, **fitted.values, "u": fitted.u, "used": fitted.used, "doubts": doubts})
    else:
        _print_block(fitted)
    say(done, err=True)


def _print_block(fitted: FittedTest) -> None:
    say("tests:")
    first, *lines = block_of(fitted.test, fitted.values, 2).rstrip("\n").split("\n")
    say(f"{first} # by {fitted.used}")
    for line, key in zip(lines, fitted.values, strict=True):
        say(f"{line} # u {fitted.u[key]}" if key in fitted.u else line)


def _written(to: RigFile, text: str, *, write: bool) -> str:
    """What was done with the rig file, in words: it is written where that is asked for and changes it."""
    if not (write and to.path):
        return f"nothing is written: paste this, or give {'--write' if to.path else '--rig FILE --write'}"
    if text == to.text:
        return f"{to.path} has these values already"
    return f"wrote {to.path}; as it was: {_replace(to.path, to.text, text)}"


def _not_drivable(rig: Rig) -> list[str]:
    from analysis.geometry.programs import circle_program  # noqa: PLC0415 - slow to import, needed here only

    try:
        circle_program(rig, "acw")
    except RigError as error:
        return [f"the robot cannot drive a program of this circle: {error.what}; {error.remedy}"]
    return []


def _replace(path: Path, old: str, new: str) -> Path:
    """Put a new text under the file's name, durably; the old one stays beside it under a name that was free."""
    from daq.store import durable  # noqa: PLC0415 - not on every system

    path = path.resolve()  # a link stays one
    try:
        if read_bytes(path, _MOST_BYTES) != old.encode():
            raise FileError(str(path), "was changed by another program meanwhile", "run the command again")
        mode = path.stat().st_mode
        number = 1
        while True:
            kept = path.with_name(f"{path.name}.{number}")
            with contextlib.suppress(FileExistsError):
                fd = durable.create(kept, old.encode())
                break
            number += 1
        durable.sync(fd)
        durable.close(fd)
        durable.replace(path, new.encode())
        for file in (path, kept):
            file.chmod(mode & 0o777)
    except OSError as error:
        raise CellError(str(path), error.strerror or str(error), "check the directory's permissions and disk") from None
    return kept
