"""What a robot program says about targets, in terms that all dialects share: points, their numbers in the text,
moves."""

from __future__ import annotations

import re
from bisect import bisect_left
from dataclasses import dataclass, replace
from typing import Literal

from analysis.kinematics.arm import Array
from rigs.schema.vocabulary import Maker

Form = Literal[
    "joints_rad", "joints_deg", "pulses", "rotation_vector", "roll_pitch_yaw", "yaw_pitch_roll", "quaternion"
]
"""What the numbers of a target are: joint angles 1 to 6, pulses, or a place followed by an orientation."""
JOINT_FORMS: tuple[Form, ...] = ("joints_rad", "joints_deg", "pulses")
Way = Literal["joint", "line"]
Reason = Literal[
    "relative",
    "computed",
    "not_literal",
    "changed",
    "offset",
    "unused",
    "external_axes",
    "incomplete",
    "no_scale",
    "several_frames",
    "unknown_tool",
    "unknown_frame",
    "no_posture",
    "ambiguous",
    "other_flags",
    "two_postures",
    "unreachable",
    "beyond_limits",
    "singular",
    "too_large",
    "changes_flags",
]
WHY: dict[Reason, str] = {
    "relative": "is a relative move",
    "computed": "is computed by the program",
    "not_literal": "is not a point with numbers in this program",
    "changed": "is also used, or assigned, elsewhere in the program",
    "offset": "is an offset from a point: it moves with the point's correction and has none of its own",
    "unused": "is not the target of any move that was understood",
    "external_axes": "has external axes, or a second group",
    "incomplete": "does not have all six numbers",
    "no_scale": "is in pulses: give --scale with the counts per degree of each axis",
    "several_frames": "is used with several tools or frames",
    "unknown_tool": "is in a tool that is not known: give --tool",
    "unknown_frame": "is in a frame that is not known: give --frame",
    "no_posture": "has no posture that is certain: nothing before it in the same block says how the arm stands",
    "ambiguous": "can be reached in several postures, and the program does not say clearly which",
    "other_flags": "has flags of posture that no solution of the nominal arm has",
    "two_postures": "is reached in two postures, which need two corrections",
    "unreachable": "is out of the nominal arm's reach",
    "beyond_limits": "is, or would be, beyond a joint's limits",
    "singular": "is at a singularity or at a limit, where no correction exists",
    "too_large": "would move by more than is plausible for a correction",
    "changes_flags": "would get another posture or turn than its flags say: touch it up by hand",
}
"""Completes a sentence whose subject is the target."""

NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"
_NUMBER = re.compile(NUMBER)
_FILLED = re.compile(r"[^\n]")


@dataclass(frozen=True)
class Number:
    """A number and its place in the text, from the character `begin` up to `end`."""

    begin: int
    end: int
    value: float


@dataclass(frozen=True)
class Flags:
    """Which of the arm's solutions a target means, in a maker's words:

    fanuc: flip, up, front, turns of axes 4, 5 and 6; yaskawa: RCONF's first six; kuka: S and T; abb: cf1, cf4, cf6,
    cfx.
    """

    maker: Maker
    values: tuple[int, ...]


@dataclass(frozen=True)
class Target:
    """A target with numbers. `file` counts the program's files; `numbers` stand in the order of the form, whatever
    their order in the text. `tool` and `frame` are frames (4, 4) in mm, or the program's name for one; `near` (6,) rad
    are joint angles beside which the program says that the solution lies."""

    name: str
    file: int
    line: int
    form: Form
    numbers: tuple[Number, ...]
    tool: Array | str = ""
    frame: Array | str = ""
    flags: Flags | None = None
    near: tuple[float, ...] | None = None

    @property
    def joints(self) -> bool:
        """Whether the target is a set of joint angles; otherwise it is a pose."""
        return self.form in JOINT_FORMS


@dataclass(frozen=True)
class Left:
    """What was left as it stood: its place in the program, a name, and why."""

    file: int
    line: int
    name: str
    reason: Reason


@dataclass(frozen=True)
class Step:
    """A move to a target, given by its place in the list, or None: after it nothing is known of where the arm
    stands."""

    target: int | None
    way: Way = "joint"


@dataclass(frozen=True)
class Parsed:
    """The targets of a program, its moves in the order of the text, and what cannot be corrected."""

    targets: tuple[Target, ...]
    steps: tuple[Step, ...]
    left: tuple[Left, ...]


def numbers_in(text: str, begin: int, end: int, most: int = 64) -> tuple[Number, ...] | None:
    """Return the numbers of a list "n, n, n" in the text from `begin` to `end`, or None where anything else stands
    there."""
    found, at = [], begin
    for part in text[begin:end].split(",", most):
        match = _NUMBER.fullmatch(part.strip())
        if not match:
            return None
        start = at + len(part) - len(part.lstrip())
        found.append(Number(start, start + len(match[0]), float(match[0])))
        at += len(part) + 1
    return tuple(found)


def blanked(text: str, pattern: re.Pattern[str]) -> str:
    """Return a text of the same length with spaces in place of comments and of what stands between quotes."""

    def spaces(match: re.Match[str]) -> str:
        found = match[0]
        if found[0] in "\"'" and len(found) > 1 and found[-1] == found[0]:
            return found[0] + " " * (len(found) - 2) + found[0]
        return _FILLED.sub(" ", found)

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
    return [_stripped(text, *place) for place in places]


def _stripped(text: str, begin: int, end: int) -> tuple[int, int]:
    inside = text[begin:end]
    return begin + len(inside) - len(inside.lstrip()), end - len(inside) + len(inside.rstrip())


@dataclass
class _Point:
    """A declared point and how the program uses it."""

    target: Target | None
    left: Left
    uses: int = 0
    offsets: int = 0
    changed: bool = False
    by_flags: bool = False
    places: frozenset[str] = frozenset()


class Gathered:
    """The points and moves of a program while it is read; points of one name are one target, however often used."""

    def __init__(self) -> None:
        self._points: dict[str, _Point] = {}
        self._steps: list[tuple[str | None, Way]] = []
        self._left: list[Left] = []

    def declare(self, key: str, target: Target, reason: Reason | None = None) -> None:
        """Take a point; with a reason it can be moved to, and cannot be corrected."""
        left = Left(target.file, target.line, target.name, reason or "unused")
        if key in self._points:
            self._points[key].changed = True
        else:
            self._points[key] = _Point(None if reason else target, left)

    def knows(self, key: str) -> bool:
        """Whether there is a point of this name."""
        return key in self._points

    def change(self, key: str) -> None:
        """State that the program uses a point otherwise than as a target."""
        self._points[key].changed = True

    def move(
        self,
        key: str,
        way: Way,
        left: Left,
        *,
        tool: Array | str | None = None,
        frame: Array | str | None = None,
        near: tuple[float, ...] | None = None,
        by_flags: bool = True,
    ) -> None:
        """Take a move to a point. `left` is what is listed where there is no such point. `tool` and `frame` are those
        (4, 4) of this move, where the point does not name them itself; without `by_flags` its flags do not count."""
        point = self._points.get(key)
        if point is None:
            self.leave(left)
            return
        point.uses += 1
        point.by_flags |= by_flags
        if point.target:
            old = point.target
            target = replace(
                old,
                tool=old.tool if tool is None else tool,
                frame=old.frame if frame is None else frame,
                near=old.near if near is None else near,
            )
            # Frames are compared as text, since an array has no order and no single truth.
            point.places |= {repr((_shown(target.tool), _shown(target.frame)))}
            point.target = target
        self._steps.append((key, way))

    def offset(self, key: str, left: Left) -> None:
        """Take a move to a place that is given by a point and an offset."""
        if key in self._points:
            self._points[key].offsets += 1
        self.leave(left)

    def leave(self, left: Left) -> None:
        """List a move that cannot be corrected; after it the arm stands anywhere."""
        self._left.append(left)
        self.stop()

    def stop(self) -> None:
        """State that the arm may stand anywhere from here on: a jump, a call, another block."""
        if not self._steps or self._steps[-1][0] is not None:
            self._steps.append((None, "joint"))

    def parsed(self, silent: frozenset[str] = frozenset()) -> Parsed:
        """Return the result; unused points of the names `silent` are not listed."""
        targets: list[Target] = []
        places: dict[str, int] = {}
        for key, point in self._points.items():
            target = point.target
            reason = _why_left(point)
            if target and not reason:
                places[key] = len(targets)
                targets.append(target if point.by_flags else replace(target, flags=None))
            elif point.uses or point.offsets or (point.left.reason != "unused") or key not in silent:
                self._left.append(replace(point.left, reason=reason or point.left.reason))
        steps = tuple(Step(None if key is None else places.get(key), way) for key, way in self._steps)
        return Parsed(tuple(targets), steps, tuple(sorted(self._left, key=lambda one: (one.file, one.line))))


def _why_left(point: _Point) -> Reason | None:
    if point.target is None:
        return point.left.reason
    if point.changed:
        return "changed"
    if not point.uses:
        return "offset" if point.offsets else "unused"
    if len(point.places) > 1 and not point.target.joints:
        return "several_frames"
    return None


def _shown(frame: Array | str) -> str:
    return frame if isinstance(frame, str) else repr(frame.tolist())


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
