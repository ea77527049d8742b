"""Output of a fitted test: printed as a block of a rig file, or written into the file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Literal

from analysis.cli.console import say, say_json
from rigs.edit import Values, block_of, with_test
from rigs.errors import CellError, FileError, RigError, UseError
from rigs.files import read_bytes
from rigs.load import find, load, parse, shipped
from rigs.rig import Rig

_MOST_BYTES = 1_000_000
"""Upper limit for the size of a rig file (`rigs.load`)."""
_DIRECTIONS = ("normal", "zero")
"""Keys of unit vectors. Their uncertainty is an angle."""
_LEAST = 0.0005
"""Half of the last digit of a length."""


@dataclass(frozen=True)
class RigFile:
    """A rig with the text of its file; path is None if it comes from a run or a daemon."""

    rig: Rig
    text: str
    path: Path | None


@dataclass(frozen=True)
class FittedTest:
    test: Literal["circle", "hemisphere"]
    values: Values
    u: Mapping[str, Sequence[float]]
    """Standard uncertainties of each value, in degrees for directions, otherwise in mm."""
    used: str
    """Description of the data."""
    doubts: Sequence[str]


def rig_file_to_write(name: str | None, write: bool) -> RigFile | None:
    if name is None:
        if write:
            remedy = "give the rig file with --rig FILE"
            raise UseError("--write", "needs the rig file to write", remedy, code="usage")
        return None
    path = find(name)
    if write and path.resolve() in {example.resolve() for example in shipped().values()}:
        remedy = "copy it with rig example DIR, and use the copy"
        raise FileError(name, "is a shipped rig, which is read-only", remedy, code="output.not_writable")
    rig, text = load(path)
    return RigFile(rig, text, path)


def print_or_write(fitted: FittedTest, to: RigFile, *, write: bool, as_json: bool) -> None:
    where = str(to.path or to.rig.name)
    text = with_test(to.text, fitted.test, fitted.values, where)
    doubts = [*fitted.doubts, *_not_drivable(parse(text, where))] if fitted.test == "circle" else list(fitted.doubts)
    # Write first: an error is printed as a single line.
    if not (write and to.path):
        done = f"the rig file is unchanged: paste this, or give {'--write' if to.path else '--rig FILE --write'}"
    elif text == to.text:
        done = f"{to.path} already has these values"
    else:
        kept = _replace(to.path, to.text, text)
        done = f"wrote {to.path}; backup: {kept}; a running rigd uses the old file until it is restarted"
    for doubt in doubts:
        say(doubt, err=True)
    if as_json:
        u = dict[str, float | list[float]]()
        for key, values in fitted.u.items():
            rounded = [float(f"{value:.2g}") for value in values]
            u[f"{key}_deg" if key in _DIRECTIONS else key] = rounded if len(rounded) > 1 else rounded[0]
        say_json({"test": fitted.test, **fitted.values, "u": u, "used": fitted.used, "doubts": doubts})
    else:
        say("tests:")
        first, *lines = block_of(fitted.test, fitted.values, 2).rstrip("\n").split("\n")
        say(f"{first} # from {fitted.used}")
        for line, key in zip(lines, fitted.values, strict=True):
            unit = "°" if key in _DIRECTIONS else " mm"
            say(f"{line} # u {u_written(fitted.u[key], unit)}" if key in fitted.u else line)
    say(done, err=True)


def u_written(u: Sequence[float], unit: str) -> str:
    """Uncertainties with two digits and the unit; below the last digit of a length as a bound."""
    if max(u) < _LEAST:
        return f"< {_LEAST:g}{unit}"
    return ", ".join(f"{value:.2g}" if value > _LEAST else f"< {_LEAST:g}" for value in u) + unit


def _not_drivable(rig: Rig) -> list[str]:
    from analysis.robot.geometry.driven_programs import circle_program

    try:
        circle_program(rig, "acw")
    except RigError as error:
        return [f"the robot cannot drive a program of this circle: {error.what}; {error.remedy}"]
    return []


def _replace(path: Path, old: str, new: str) -> Path:
    from daq.store import durable

    path = path.resolve()  # keep a symbolic link
    try:
        if read_bytes(path, _MOST_BYTES) != old.encode():
            problem = "was changed by a different program meanwhile"
            raise FileError(str(path), problem, "repeat the command", code="file.invalid")
        mode = path.stat().st_mode
        if not mode & 0o222:  # a rename would replace the file nevertheless
            remedy = "make the file writable with chmod u+w, or paste the printed block"
            raise FileError(str(path), "is read-only", remedy, code="output.not_writable")
        copies = (path.with_name(f"{path.name}.{number}") for number in count(1))
        kept = next(copy for copy in copies if not copy.exists())
        for file, text in ((kept, old), (path, new)):
            durable.replace(file, text.encode())
            file.chmod(mode & 0o777)
    except OSError as error:
        remedy = "check the permissions and the free space of the directory"
        raise CellError.of_os(path, error, remedy, code="output.not_writable") from None
    return kept
