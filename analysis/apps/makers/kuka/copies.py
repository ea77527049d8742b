"""Copies of points in KRL: POS=XP1 and POS.Z=POS.Z+350, the usual form of an approach and of a pallet.

A move to a copy reaches the point with an offset. A variable counts as a copy only if its module does nothing with it
but to assign a single point, to shift it by a constant, and to move to it.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

import numpy as np

from analysis.apps.makers.kuka.literals import KrlLiterals
from analysis.apps.makers.points import as_value
from analysis.apps.makers.program_machine import ComputedValue, Unknown, Value
from analysis.apps.makers.program_parser import NUMBER
from analysis.apps.makers.target import ProgramTexts

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


class KrlCopies(KrlLiterals):
    def __init__(self, program: ProgramTexts) -> None:
        super().__init__(program)
        self.copies: dict[str, str] = {}
        self.constants: dict[str, float] = {}

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
