"""What a robot program says about targets, in terms that all dialects share: points, their numbers in the text,
moves."""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from analysis.apps.makers.program_machine import Unknown
from analysis.correction.reasons import Reason
from analysis.robot.kinematics.arm import Arm, Array, Mask

Form = Literal[
    "joints_rad", "joints_deg", "pulses", "rotation_vector", "roll_pitch_yaw", "yaw_pitch_roll", "quaternion"
]
"""What the numbers of a target are: joint angles 1 to 6, pulses, or a place followed by an orientation."""
JOINT_FORMS: tuple[Form, ...] = ("joints_rad", "joints_deg", "pulses")
Way = Literal["joint", "line"]
NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"
_NUMBER = re.compile(NUMBER)
_MARK = "\xef\xbb\xbf"
"""The byte order mark of UTF-8, read as Latin-1."""
_FILLED = re.compile(r"[^\n]")


@dataclass(frozen=True)
class Number:
    """A number and its place in the text, from the character `begin` up to `end`."""

    begin: int
    end: int
    value: float


Agreeing = Callable[[Arm, Array, tuple[int, ...], float], Mask]
"""Which of the solutions q (n, 6) rad, n at least 1, agree with the values of flags, as (n,); the last is by how many
rad an angle may stand beyond its sign, quadrant or turn."""


@dataclass(frozen=True)
class Flags:
    """Which of the arm's solutions a target means: values in the words of a maker, who says which solutions agree."""

    values: tuple[int, ...]
    agreeing: Agreeing


@dataclass(frozen=True)
class Target:
    """A target with numbers. `file` counts the program's files; `numbers` stand in the order of the form, whatever
    their order in the text. `tool` and `frame` are frames (4, 4) in mm, or the program's name for one; `near` (6,) rad
    are joint angles beside which the program says that the solution lies. A target with an `offset` stands at another
    one, number `of`, with that added: in the frame, or in the tool, as a frame (4, 4) in mm."""

    name: str
    file: int
    line: int
    form: Form
    numbers: tuple[Number, ...]
    tool: Array | str = ""
    frame: Array | str = ""
    flags: Flags | None = None
    near: tuple[float, ...] | None = None
    offset: tuple[str, Array] | None = None
    of: int | None = None
    external: tuple[tuple[str, float], ...] = ()
    """The coordinates of external axes that the target names; an axis that it does not name stays."""

    @property
    def joints(self) -> bool:
        """Return whether the target is a set of joint angles; otherwise it is a pose."""
        return self.form in JOINT_FORMS


@dataclass(frozen=True)
class Left:
    """What was left as it stood: its place in the program, a name, why, and the places that make it so."""

    file: int
    line: int
    name: str
    reason: Reason
    because: tuple[Unknown, ...] = ()


AT_BEGIN = -1
"""Index for the position of the arm at the start of the program."""


@dataclass(frozen=True)
class Arc:
    """An arc that turns the tool with its tangent: the places of the targets from which it can start, of the one
    through which it passes and of its end, None for a place that is not certain."""

    starts: frozenset[int | None]
    through: int | None
    end: int | None


@dataclass(frozen=True)
class Step:
    """A move to a target, given by its place in the list, from any of others, None for where the arm stands at no
    certain place, AT_BEGIN for where it stands at the beginning; in the posture that the target says, or else in the
    one in which the arm comes. `arc` is None if the orientation of the target is the one that is reached."""

    target: int
    comes_from: frozenset[int | None]
    way: Way = "joint"
    by_flags: bool = True
    arc: Arc | None = None


@dataclass(frozen=True)
class Notice:
    """A fact at a place in the program that a person should know, and that leaves no target."""

    file: int
    line: int
    text: str


@dataclass(frozen=True)
class Parsed:
    """The targets of a program, its moves, and what cannot be corrected. `next_to_left` are the targets that are next
    to a point that is left, one for each such move; `sets` are the tools and frames to which the program itself gives
    numbers, `named` those of any move that a person can state, by kind and name in lower case."""

    targets: tuple[Target, ...]
    steps: tuple[Step, ...]
    left: tuple[Left, ...]
    next_to_left: tuple[int, ...] = ()
    sets: tuple[Named, ...] = ()
    notices: tuple[Notice, ...] = ()
    named: frozenset[tuple[str, str]] = frozenset()


@dataclass(frozen=True)
class Named:
    """A tool or frame that the program gives the numbers of a frame (4, 4) in mm, under the name with which a person
    could state it."""

    name: str
    kind: Literal["tool", "frame"]
    file: int
    line: int
    value: tuple[float, ...]


@dataclass(frozen=True)
class Texts:
    """The texts of a program's files with their names; the first `own` are corrected, the others stand beside them in
    the directory, and are read for what they do."""

    names: tuple[str, ...]
    texts: tuple[str, ...]
    own: int = 1


def numbers_in(text: str, begin: int, end: int, most: int = 64) -> tuple[Number, ...] | None:
    """Return the numbers of a list "n, n, n" in the text from `begin` to `end`, or None where anything else stands
    there."""
    numbers, at = [], begin
    for part in text[begin:end].split(",", most):
        match = _NUMBER.fullmatch(part.strip())
        if not match:
            return None
        start = at + len(part) - len(part.lstrip())
        numbers.append(Number(start, start + len(match[0]), float(match[0])))
        at += len(part) + 1
    return tuple(numbers)


def blanked(text: str, pattern: re.Pattern[str]) -> str:
    """Return a text of the same length with spaces in place of comments and of what stands between quotes."""

    def spaces(match: re.Match[str]) -> str:
        matched = match[0]
        if matched[0] in "\"'" and len(matched) > 1 and matched[-1] == matched[0]:
            return matched[0] + " " * (len(matched) - 2) + matched[0]
        return _FILLED.sub(" ", matched)

    return pattern.sub(spaces, text)


def brackets(text: str) -> dict[int, int]:
    """Return where each bracket that opens in a text closes; those that never close are left out."""
    open_at: list[int] = []
    closes: dict[int, int] = {}
    for match in re.finditer(r"[()\[\]{}]", text):
        if match[0] in "([{":
            open_at.append(match.start())
        elif open_at:
            closes[open_at.pop()] = match.start()
    return closes


def in_one_line(text: str, closes: dict[int, int]) -> str:
    """Return a text of the same length in which what stands in brackets, which close there, is one line."""
    parts, at = [], 0
    for opening in sorted(closes):
        if opening >= at:
            parts += [text[at:opening], text[opening : closes[opening]].replace("\n", " ")]
            at = closes[opening]
    return "".join((*parts, text[at:]))


def arguments(text: str, begin: int, end: int) -> list[tuple[int, int]]:
    """Return the places of what commas outside of brackets separate, without the spaces around it."""
    places, depth, start = [], 0, begin
    for match in re.compile(r"[()\[\]{},]").finditer(text, begin, end):
        if match[0] == "," and depth == 0:
            places.append((start, match.start()))
            start = match.end()
        elif match[0] != ",":
            depth += 1 if match[0] in "([{" else -1
    places.append((start, end))
    stripped = []
    for first, stop in places:
        inside = text[first:stop]
        stripped.append((first + len(inside) - len(inside.lstrip()), stop - len(inside) + len(inside.rstrip())))
    return stripped


@dataclass(frozen=True)
class Lines:
    """The line numbers of places in a text, from 1; `ends` are where its lines end."""

    ends: tuple[int, ...]

    def at(self, place: int) -> int:
        """Return the number of the line in which the character `place` stands."""
        return bisect_left(self.ends, place) + 1


def lines_of(text: str) -> Lines:
    """Return the lines of a text."""
    return Lines(tuple(match.start() for match in re.finditer("\n", text)))


def words(text: str) -> frozenset[str]:
    """Return the words of a closed list."""
    return frozenset(text.split())


def with_newlines(text: str) -> str:
    """Return a text of the same length whose lines end in a newline alone, whatever they end in: a return before a
    newline becomes a space, and so does the mark of UTF-8 at the beginning."""
    if text.startswith(_MARK):
        text = " " * len(_MARK) + text[len(_MARK) :]
    return text.replace("\r\n", " \n").replace("\r", "\n")
