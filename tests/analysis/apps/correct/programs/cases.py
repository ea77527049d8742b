"""Programs with the places that stay uncorrected, read from the files in `cases`, one file for each maker.

A case begins with a line `=== name`, followed by the program of the cell. A line `--- part` begins another part: a
file beside the program, a part named in `_program`, `neutral` (routines stated as neutral) or `start` (joint angles in
degrees), or `directory` (the directory is corrected, and not only the program). `<<< reason` at the end of a line
lists what stays uncorrected there. For FANUC and Yaskawa, whose positions belong to the cell, a line `>>> name reason`
lists it. All other targets have to be corrected. {tcp}, {other} and {head} are lines of `cells`; a program of LinuxCNC
follows the head there. A listing of FANUC selects frame and tool before each line, except in a part `as it stands`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path, PurePath

import numpy as np

from analysis.apps.correct.corrected_program import CorrectedProgram
from rigs.rig import Rig
from tests.analysis.apps.correct.programs.cells import (
    BARE,
    HEAD,
    LINUXCNC_HEAD,
    OTHER,
    STATED,
    TCP,
    Files,
    abb_files,
    corrected_files,
    fanuc_files,
    job_of,
    kuka_files,
    linuxcnc_files,
    listing,
    module_of,
    selecting,
    ur_files,
    yaskawa_files,
)

FOLDER = Path(__file__).parent / "cases"
BY_NAME = ("fanuc", "yaskawa")


@dataclass(frozen=True)
class Case:
    maker: str
    rig: Rig
    files: Files
    left: list[tuple[str, str]]
    """File and line, or name, of each place that stays uncorrected, and the reason."""
    neutral: tuple[str, ...]
    start: tuple[float, ...] | None
    is_directory: bool

    def corrected(self, directory: Path, ends: str = "\n") -> CorrectedProgram:
        options = {"ends": ends, "start": self.start, "neutral": self.neutral}
        return corrected_files(
            self.rig, directory, self.files, *STATED.get(self.maker, ()), is_directory=self.is_directory, **options
        )

    def left_in(self, found: CorrectedProgram) -> list[tuple[str, str]]:
        return sorted(
            (one.name if self.maker in BY_NAME else f"{found.sources[one.file]}:{one.line}", one.reason)
            for one in found.left
            if one.reason != "unused"
        )


def cases_of(maker: str) -> Files:
    """The texts of the cases of a maker, by name."""
    _, *texts = re.split(r"^=== ", (FOLDER / f"{maker}.txt").read_text(), flags=re.MULTILINE)
    return {name: text for name, _, text in (text.partition("\n") for text in texts)}


def case_of(maker: str, text: str) -> Case:
    left = re.findall(r"^>>> (\S+) (\w+)\n", text, flags=re.MULTILINE)
    first, *others = re.split(r"^--- (.*)\n", re.sub(r"^>>> .*\n", "", text, flags=re.MULTILINE), flags=re.MULTILINE)
    parts = dict(zip(others[::2], others[1::2], strict=True))
    neutral, start = tuple(parts.pop("neutral", "").splitlines()), parts.pop("start", "")
    is_directory = parts.pop("directory", None) is not None
    rig, files = _program(maker, first, parts)
    for name, program in files.items():
        for number, line in enumerate(program.split("\n"), start=1):
            left += [(f"{name}:{number}", why) for why in line.partition("<<<")[2].split()]
    plain = {name: re.sub(r"[ \t]*<<<.*", "", program) for name, program in files.items()}
    angles = tuple(np.radians([float(angle) for angle in start.split(",")]).tolist()) if start else None
    return Case(maker, rig, plain, sorted(left), neutral, angles, is_directory)


def _program(maker: str, text: str, parts: Files) -> tuple[Rig, Files]:
    def others(listed: Callable[..., str], **options: str) -> Files:
        return {
            name: part if part[0] == "/" else listed(*part.splitlines(), name=PurePath(name).stem.upper(), **options)
            for name, part in parts.items()
        }

    match maker:
        case "ur":
            return ur_files({"a.script": text.replace("{tcp}\n", TCP).replace("{other}\n", OTHER)})
        case "kuka":
            return kuka_files({"a.src": text.replace("{head}\n", HEAD), **parts})
        case "linuxcnc":
            return linuxcnc_files({"a.ngc": LINUXCNC_HEAD + text})
        case "abb":
            data, rest = parts.pop("data", "").rstrip("\n"), parts.pop("routines", "")
            return abb_files((module_of(text, rest, data) if text else {}) | parts)
        case "fanuc":
            plain = parts.pop("as it stands", "")
            lines = plain.splitlines() if plain[:1] != "/" else []
            first = selecting(*text.splitlines(), head=parts.pop("header", ""))
            first = listing(*lines) if lines else plain or first
            return fanuc_files({"a.ls": first, **others(listing)})
        case _:
            positions, second = parts.pop("positions", ""), parts.pop("job B", "")
            first = job_of(*text.splitlines()) + (job_of(*second.splitlines(), name="B") if second else "")
            return yaskawa_files({"a.jbi": first, **others(job_of, pos=BARE)}, positions)
