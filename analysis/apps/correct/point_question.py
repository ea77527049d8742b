"""The question whether the points of programs were computed or taught, with hints from their texts."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from analysis.apps.correct.stated_points import KINDS
from analysis.apps.makers.reading import program_texts, programs_at
from analysis.apps.report.texts import ENGLISH
from analysis.cli.dialogue import Dialogue
from analysis.correction.point_origins import PointKind
from rigs.errors import UseError

_SYSTEMS = (
    "RoboDK", "RobotStudio", "Process Simulate", "Robcad", "Delmia", "Robotmaster", "Delfoi", "KUKA.Sim", "RoboGuide",
    "MotoSim", "SprutCAM", "Visual Components", "PowerMill", "Mastercam", "Fusion 360", "Grasshopper", "RoboSim",
)  # fmt: skip
"""Systems of offline programming and CAM that name themselves in the programs they write."""
_BY_SYSTEM = re.compile("|".join(re.escape(name).replace(r"\ ", r"\s?") for name in _SYSTEMS), re.IGNORECASE)
_BY_HAND = re.compile(
    r"(?<=[;!#'(\"])[^\n;!#'(\"]*\b(?:touch(?:ed)?[- ]?up|taught|teach(?:ed|-?in)?|(?:nach)?geteacht)\b[^\n]*"
    r"|^;FOLD (?:PTP|LIN|CIRC)\b.*%\{PE\}",
    re.IGNORECASE | re.MULTILINE,
)
"""Remarks on a touch-up, and the inline forms that the pendant of a KUKA writes."""


@dataclass(frozen=True)
class Hint:
    """A text in a program that suggests an origin of its points. It decides nothing."""

    file: str
    line: int
    kind: PointKind
    text: str

    @property
    def words(self) -> str:
        return ENGLISH(f"points_hint_{self.kind}", hint=self)


def hints_in(paths: Sequence[Path]) -> list[Hint]:
    """The first hint at each origin in each file. Raises FileError for a file that is no robot program."""
    texts = [(name, text) for path in paths for program in programs_at(path) for name, text in _texts(program)]
    return [hint for name, text in texts for hint in _hints(name, text)]


def _texts(program: Path) -> Iterator[tuple[str, str]]:
    yield from program_texts(program)[1].items()


def _hints(name: str, text: str) -> Iterator[Hint]:
    for kind, pattern in (("computed", _BY_SYSTEM), ("taught", _BY_HAND)):
        if found := pattern.search(text):
            yield Hint(name, text.count("\n", 0, found.start()) + 1, kind, " ".join(found[0].split())[:40])  # type: ignore[arg-type]


def ask_points(dialogue: Dialogue, hints: Sequence[Hint]) -> tuple[PointKind, Path | None]:
    """Ask for the origin of the points and the file of changes since then."""
    lines = [ENGLISH("points_asked"), *(f"  {ENGLISH(f'points_choice_{key}')}" for key in _CHOICES)]
    lines += [hint.words for hint in hints[:_SHOWN_HINTS]]
    return dialogue.ask("\n".join([*lines, ENGLISH("points_answer")]), "--points", _read_answer)


_CHOICES = ("computed", "taught", "entered", "changed")
_SHOWN_HINTS = 3


def _read_answer(text: str) -> tuple[PointKind, Path | None]:
    kind, _, file = text.strip().partition(" ")
    file = file.strip().removeprefix("since ").removeprefix("--since ").strip()
    for known in KINDS:
        if kind.lower() == known and not (file and known == "computed"):
            path = Path(file).expanduser() if file else None
            if path is None or path.is_file():
                return known, path
            raise UseError(file, "is not a file", "give an existing file", code="answer.missing")
    raise UseError(repr(text), "is no answer", "type computed, taught, or taught FILE", code="answer.missing")


def refuse_unstated(command: Sequence[str], hints: Sequence[Hint]) -> UseError:
    """Error for programs whose points the user did not state. command: the words after `rig`."""
    calls = [shlex.join(["rig", *command, "--points", kind]) for kind in KINDS]
    about = "".join(f"; {hint.words}" for hint in hints[:1])
    problem = (
        f"is missing: computed points ({KINDS['computed']}) are corrected, taught points are right as they are{about}"
    )
    return UseError("--points", problem, f"run {calls[0]}  or  {calls[1]}", code="answer.missing")
