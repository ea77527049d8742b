"""Points and frames of KRL: written in place, by the names that a module sees, and as copies of points.

POS=XP1 and POS.Z=POS.Z+350 is the usual form of an approach and of a pallet. A variable counts as a copy if its module
only assigns a single point to it, shifts it by constants, and moves to it.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from functools import partial

import numpy as np

from analysis.apps.makers.configuration import beyond_stretch, wrist_in_front
from analysis.apps.makers.kuka.backup import foot_of
from analysis.apps.makers.numbers import frame_of, is_frame
from analysis.apps.makers.points import as_value, is_moved
from analysis.apps.makers.program_machine import ComputedValue, Ref, Unknown, Value
from analysis.apps.makers.program_parser import NUMBER, UPPER_CASE, ProgramParser
from analysis.apps.makers.target import Flags, Form, Number, ProgramTexts, Target
from analysis.correction.reasons import Reason
from analysis.robot.kinematics.arm import Arm, Array, Mask

_BLANK = re.compile(r"\"[^\"\n]*\"|;[^\n]*|^[ \t]*&[^\n]*", re.MULTILINE)
_AXES = tuple(f"A{axis}" for axis in range(1, 7))
_POSE = ("X", "Y", "Z", "A", "B", "C")
EXTERNAL_AXES = tuple(f"E{axis}" for axis in range(1, 7))
_TYPE = re.compile(r"^\s*(?:E6POS|POS|FRAME|E6AXIS|AXIS)\s*:")
_COMPONENT = re.compile(rf"\s*([A-Z]\w*)\s+({NUMBER}|'B[01]{{1,16}}'|'H[0-9A-F]{{1,8}}')\s*")
BY_NUMBER = re.compile(r"(TOOL_DATA|BASE_DATA)\s*\[\s*(\d+)\s*\]")
_SHIFT = re.compile(
    rf"\s*(?P<left>\w+)\.(?P<axis>[XYZ])\s*=\s*(?P<from>\w+)\.(?P=axis)\s*(?P<sign>[-+])\s*(?P<by>{NUMBER}|[A-Z_]\w*)\s*"
)
_WHOLE = re.compile(r"\s*(?P<left>[A-Z_]\w*)\s*=\s*(?P<from>[A-Z_]\w*)\s*")
_DECLARED = re.compile(r"\s*(?:DECL\s+)?E6POS\s+[\w\s,]+")
_MOVE = re.compile(r"\s*S?(?:PTP|LIN)\s+(\w+)\b")
_WORD = re.compile(r"[A-Z_]\w*")
_CONSTANT = re.compile(rf"\s*(?:DECL\s+)?(?:REAL\s+|INT\s+)?([A-Z_]\w*)\s*=\s*({NUMBER})\s*")
_WRITTEN = re.compile(r"(?<![\w$.])([A-Z_]\w*)\s*=(?!=)")
_HANDED = re.compile(r"\(([^()]*)\)")


class KrlPositions(ProgramParser):
    """A program in KRL, in upper case, because KRL ignores the case."""

    def __init__(self, program: ProgramTexts) -> None:
        super().__init__(program, _BLANK, UPPER_CASE)
        self.modules = [name.rpartition(".")[0].upper() for name in self.names]
        """The module of each file: its path without suffix."""
        self.copies: dict[str, str] = {}
        """Points of the copies in the current module."""
        self.constants: dict[str, float] = {}
        self.foot = foot_of(self.names, self.texts)
        """Foot of the robot in the world, in which bases are stated."""

    @property
    def module(self) -> str:
        return self.modules[self.file]

    def scopes(self, name: str) -> tuple[str, ...]:
        return f"{self.module}:{name}", name

    def key(self, name: str) -> str | None:
        return next(filter(self.points.declared.__contains__, self.scopes(name)), None)

    def _components(self, text: str, start: int) -> dict[str, Number] | None:
        """Numbers of "X 1, Y 2, …" in the current line from the column `start`; None for any other text."""
        text, at = _TYPE.sub(lambda of: " " * len(of[0]), text), self.at + start
        parts: dict[str, Number] = {}
        for part in text.split(",", 32):
            if not (component := _COMPONENT.fullmatch(part)):
                return None
            place = (at + component.start(2), at + component.end(2))
            digits = component[2]
            is_pattern = digits[0] == "'"  # 'B010' or 'H1A'
            value = float(int(digits[2:-1], 2 if digits[1] == "B" else 16)) if is_pattern else float(digits)
            parts[component[1]] = Number(*place, value)
            at += len(part) + 1
        return parts

    def literal(self, text: str, start: int, name: str) -> tuple[Target | None, Reason | None]:
        """Target of "X 1, Y 2, …", and the reason if it cannot be corrected; None for any other text."""
        parts = self._components(text, start) or {}
        names = _AXES if parts.keys() & _AXES else _POSE
        numbers = tuple(parts[axis] for axis in names if axis in parts)
        begin = self.at + start
        if not numbers or any(text[number.begin - begin] == "'" for number in numbers):
            return None, None  # Bit patterns are not coordinates, and could not be written back.
        stated = {letter: parts[letter].value for letter in "ST" if letter in parts}
        bits = {letter: int(value) for letter, value in stated.items() if 0 <= value < 1 << 16}
        flags = Flags(tuple(bits.values()), partial(_agreeing, "".join(bits))) if bits else None
        external = tuple((axis, parts[axis].value) for axis in EXTERNAL_AXES if axis in parts)
        form: Form = "joints_deg" if names == _AXES else "yaw_pitch_roll"
        target = Target(
            self.as_written(name), self.file, self.line(begin), form, numbers, flags=flags, external=external
        )
        if len(numbers) < 6:
            return target, "incomplete"
        return target, "external_axes" if any(is_moved(coordinate) for _, coordinate in external) else None

    def frame(self, text: str) -> Array | None:
        """Frame (4, 4) in mm of {X …} or {FRAME: X …}; None unless all six numbers are present."""
        inside = text.strip()
        if (
            not (inside.startswith("{") and inside.endswith("}"))
            or (parts := self._components(inside[1:-1], 0)) is None
        ):
            return None
        values = [parts[axis].value if axis in parts else np.nan for axis in _POSE]
        return frame_of("yaw_pitch_roll", values) if is_frame("yaw_pitch_roll", values) else None

    def place(self, text: str) -> Value | Ref:
        """Value assigned to $TOOL or $BASE; "0" is the null frame."""
        right = text.strip()
        if by_number := BY_NUMBER.fullmatch(right):
            return Ref(f"{by_number[1]}[{int(by_number[2])}]") if int(by_number[2]) else "0"
        if right in ("$NULLFRAME", "$WORLD"):
            return "0"
        if right == "$ROBROOT":
            return as_value(np.eye(4)) if self.foot is None else self.foot
        frame = self.frame(right)
        if frame is not None:
            return as_value(frame)
        return self.why(f"{right} is computed" if right else "nothing is assigned")

    def find_copies(self, lines: Sequence[str]) -> None:
        """Find the copies of points, and the variables assigned a single number and nothing else, in a module."""
        points = frozenset(name for line in lines for name in _WORD.findall(line) if self.key(name))
        found: dict[str, set[str]] = {}
        for whole in filter(None, map(_WHOLE.fullmatch, lines)):
            if whole["from"] in points and whole["left"] not in points:
                found.setdefault(whole["left"], set()).add(whole["from"])
        declared = {word for line in lines if _DECLARED.fullmatch(line) for word in _WORD.findall(line)}
        self.copies = {name: next(iter(of)) for name, of in found.items() if len(of) == 1 and name in declared}
        for line in lines:
            for name in self.copies.keys() & _WORD.findall(line):
                if not _is_understood(line, name, self.copies[name]):
                    del self.copies[name]
        written = Counter(name for line in lines for name in _WRITTEN.findall(line))
        handed = {word for line in lines for inside in _HANDED.findall(line) for word in _WORD.findall(inside)}
        constants = ((match[1], float(match[2])) for match in filter(None, map(_CONSTANT.fullmatch, lines)))
        self.constants = {name: value for name, value in constants if written[name] == 1 and name not in handed}

    def variable_of(self, copy: str) -> str:
        """State variable with the offset of a copy from its point."""
        return f"copy {self.module}:{copy}"

    def is_copy(self, line: str) -> bool:
        """Parse a line about a copy; False for any other line."""
        if (whole := _WHOLE.fullmatch(line)) and whole["left"] in self.copies:
            self.spent.add((self.file, self.at + whole.start("from")))
            self.set(self.variable_of(whole["left"]), as_value(np.eye(4)))
            return True
        shift = _SHIFT.fullmatch(line)
        if shift is None or (name := shift["left"]) not in self.copies:
            return False
        part, by, why = self.variable_of(name), shift["by"], self.why(f"{line.strip()} is computed")
        number = float(by) if re.fullmatch(NUMBER, by) else self.constants.get(by)
        from_point = shift["from"] != name
        if from_point:
            self.spent.add((self.file, self.at + shift.start("from")))
        if number is None:
            self.set(part, why)
            return True
        at, size = 4 * "XYZ".index(shift["axis"]) + 3, number if shift["sign"] == "+" else -number

        def shifted(values: tuple[Value, ...]) -> Value:
            before = values[0]
            if not isinstance(before, tuple):
                return before if isinstance(before, Unknown) else why
            return (*before[:at], (0.0 if from_point else before[at]) + size, *before[at + 1 :])

        self.set(part, ComputedValue((part,), shifted))
        return True


def _is_understood(line: str, name: str, point: str) -> bool:
    if (whole := _WHOLE.fullmatch(line)) and whole["left"] == name:
        return whole["from"] == point
    if shift := _SHIFT.fullmatch(line):
        return shift["left"] == name and shift["from"] in (name, point)
    if move := _MOVE.match(line):
        return move[1] == name and name not in _WORD.findall(line, move.end())
    return bool(_DECLARED.fullmatch(line))


def _agreeing(letters: str, arm: Arm, q: Array, values: tuple[int, ...], slack_rad: float) -> Mask:
    """Check the stated parts of Status (S) and Turn (T); a missing part depends on the moves before.

    Source: KUKA, Expert Programming. Bit 0 of Status is the side of axis 1 on which the wrist is, bit 1 the side of the
    outstretched arm on which axis 3 is. The sense of bit 2 differs between arms. Turn has the signs of all axes.
    """
    stated, good = dict(zip(letters, values, strict=True)), np.full(len(q), fill_value=True)
    if "S" in stated:
        good &= wrist_in_front(arm, q) == (not stated["S"] & 1)
        good &= beyond_stretch(arm, q) == bool(stated["S"] >> 1 & 1)
    if "T" in stated:
        negative = (stated["T"] >> np.arange(6)) & 1 == 1
        good &= np.all(np.where(negative, q < slack_rad, q > -slack_rad), axis=1)
    return good
