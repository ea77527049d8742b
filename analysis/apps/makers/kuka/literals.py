"""Points and frames of KRL written in place, and the names that a module sees.

Source: KUKA System Software 8.x, Operating and Programming Instructions for System Integrators.
"""

from __future__ import annotations

import re

import numpy as np

from analysis.apps.makers.external_axes import is_moved
from analysis.apps.makers.kuka.posture import agreeing, agreeing_status, agreeing_turn
from analysis.apps.makers.numbers import frame_of, is_frame
from analysis.apps.makers.points import as_value
from analysis.apps.makers.program_machine import Ref, Value
from analysis.apps.makers.program_parser import NUMBER, ProgramParser
from analysis.apps.makers.target import Agreeing, Flags, Form, Number, ProgramTexts, Target
from analysis.correction.reasons import Reason
from analysis.robot.kinematics.arm import Array

_BLANK = re.compile(r"\"[^\"\n]*\"|;[^\n]*|^[ \t]*&[^\n]*", re.MULTILINE)
_AGREEING: dict[str, Agreeing] = {"ST": agreeing, "S": agreeing_status, "T": agreeing_turn}
"""Flags by the stated parts. The controller takes the stated part; the other part depends on the moves before, so a
target with one part is corrected only if this part identifies the solution."""
_AXES = tuple(f"A{axis}" for axis in range(1, 7))
_POSE = ("X", "Y", "Z", "A", "B", "C")
EXTERNAL_AXES = tuple(f"E{axis}" for axis in range(1, 7))
_TYPE = re.compile(r"^\s*(?:E6POS|POS|FRAME|E6AXIS|AXIS)\s*:", re.IGNORECASE)
"""The type before the numbers of an aggregate, {E6POS: X …}."""
_COMPONENT = re.compile(rf"\s*([A-Z]\w*)\s+({NUMBER}|'B[01]{{1,16}}'|'H[0-9A-F]{{1,8}}')\s*", re.IGNORECASE)
BY_NUMBER = re.compile(r"(TOOL_DATA|BASE_DATA)\s*\[\s*(\d+)\s*\]", re.IGNORECASE)


class KrlLiterals(ProgramParser):
    """A program in KRL during parsing, with names in upper case."""

    def __init__(self, program: ProgramTexts) -> None:
        super().__init__(program, _BLANK)
        self.modules = [name.rpartition(".")[0].upper() for name in self.names]
        """The module of each file: its path without suffix."""

    @property
    def module(self) -> str:
        return self.modules[self.file]

    def scopes(self, name: str) -> tuple[str, ...]:
        return f"{self.module}:{name.upper()}", name.upper()

    def key(self, name: str) -> str | None:
        """The key of the point that a name refers to."""
        return next(filter(self.points.knows, self.scopes(name)), None)

    def _components(self, text: str, start: int) -> dict[str, Number] | None:
        """Return the numbers of "X 1, Y 2, …" in the current line from the column `start`; None for any other text."""
        text, at = _TYPE.sub(lambda of: " " * len(of[0]), text), self.at + start
        parts: dict[str, Number] = {}
        for part in text.split(",", 32):
            if not (component := _COMPONENT.fullmatch(part)):
                return None
            place = (at + component.start(2), at + component.end(2))
            parts[component[1].upper()] = Number(*place, _value(component[2]))
            at += len(part) + 1
        return parts

    def literal(self, text: str, start: int, name: str) -> tuple[Target | None, Reason | None]:
        """Return the target of "X 1, Y 2, …", and the reason if it cannot be corrected; None for any other text."""
        parts = self._components(text, start) or {}
        names = _AXES if parts.keys() & _AXES else _POSE
        numbers = tuple(parts[axis] for axis in names if axis in parts)
        begin = self.at + start
        if not numbers or any(text[number.begin - begin] == "'" for number in numbers):
            return None, None  # Bit patterns are not coordinates, and could not be written back.
        stated = "".join(letter for letter in "ST" if letter in parts and 0 <= parts[letter].value < 1 << 16)
        flags = Flags(tuple(int(parts[letter].value) for letter in stated), _AGREEING[stated]) if stated else None
        external = tuple((axis, parts[axis].value) for axis in EXTERNAL_AXES if axis in parts)
        form: Form = "joints_deg" if names == _AXES else "yaw_pitch_roll"
        target = Target(name, self.file, self.line(begin), form, numbers, flags=flags, external=external)
        if len(numbers) < 6:
            return target, "incomplete"
        return target, "external_axes" if any(is_moved(coordinate) for _, coordinate in external) else None

    def frame(self, text: str) -> Array | None:
        """Return the frame (4, 4) in mm of {X …} or {FRAME: X …}, or None unless all six numbers are present."""
        inside = text.strip()
        if (
            not (inside.startswith("{") and inside.endswith("}"))
            or (parts := self._components(inside[1:-1], 0)) is None
        ):
            return None
        values = [parts[axis].value if axis in parts else np.nan for axis in _POSE]
        return frame_of("yaw_pitch_roll", values) if is_frame("yaw_pitch_roll", values) else None

    def place(self, text: str) -> Value | Ref:
        """Return the value assigned to $TOOL or $BASE; "0" is the null frame."""
        right = text.strip()
        if by_number := BY_NUMBER.fullmatch(right):
            return Ref(f"{by_number[1].upper()}[{int(by_number[2])}]") if int(by_number[2]) else "0"
        if right.upper() in ("$NULLFRAME", "$WORLD"):
            return "0"
        if right.upper() == "$ROBROOT":
            return as_value(np.eye(4))
        frame = self.frame(right)
        if frame is not None:
            return as_value(frame)
        return self.why(f"{right} is computed" if right else "nothing is assigned")


def _value(text: str) -> float:
    """Return a number from decimal, binary ('B010') or hexadecimal ('H1A') text."""
    return float(int(text[2:-1], 2 if text[1] in "Bb" else 16)) if text[0] == "'" else float(text)
