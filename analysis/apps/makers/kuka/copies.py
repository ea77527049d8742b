"""Copies of points in KRL: POS=XP1 and POS.Z=POS.Z+350, the usual form of an approach and of a pallet.

A move to a copy reaches the point with an offset. A variable counts as a copy only if every mention of it in its module
assigns a single point to it, shifts a position of it by a constant, or moves to it.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.apps.makers.points import as_value
from analysis.apps.makers.program_machine import ComputedValue, Set, Unknown, Value
from analysis.apps.makers.target import NUMBER

_SHIFT = re.compile(
    rf"\s*(?P<left>\w+)\.(?P<axis>[XYZ])\s*=\s*(?P<from>\w+)\.(?P=axis)\s*(?P<sign>[-+])\s*(?P<by>{NUMBER}|[A-Z_]\w*)\s*",
    re.IGNORECASE,
)
_WHOLE = re.compile(r"\s*(?P<left>[A-Z_]\w*)\s*=\s*(?P<from>[A-Z_]\w*)\s*", re.IGNORECASE)
_DECLARED = re.compile(r"\s*(?:DECL\s+)?E6POS\s+[\w\s,]+", re.IGNORECASE)
_MOVE = re.compile(r"\s*S?(?:PTP|LIN)\s+(\w+)\b", re.IGNORECASE)
_WORD = re.compile(r"[A-Za-z_]\w*")
_CONSTANT = re.compile(rf"\s*(?:DECL\s+)?(?:REAL\s+|INT\s+)?([A-Z_]\w*)\s*=\s*({NUMBER})\s*", re.IGNORECASE)
_WRITTEN = re.compile(r"(?<![\w$.])([A-Z_]\w*)\s*=(?!=)", re.IGNORECASE)
_HANDED = re.compile(r"\(([^()]*)\)")


@dataclass(frozen=True)
class Copy:
    """The statement of a line about a copy, with the value that it gives to the part of the state.

    name: of the variable, in upper case. sources: columns of the mentioned points, which the line only reads.
    """

    name: str
    value: Value | ComputedValue
    sources: tuple[int, ...] = ()


def part_of(module: str, name: str) -> str:
    """Return the name of the part of the state with the offset of a copy from its point."""
    return f"copy {module}:{name}"


def copies_in(lines: Sequence[str], points: frozenset[str]) -> dict[str, str]:
    """Return the copies in the lines of a module with their points, both in upper case."""
    found: dict[str, set[str]] = {}
    declared: set[str] = set()
    for line in lines:
        if whole := _WHOLE.fullmatch(line):
            if whole["from"].upper() in points and whole["left"].upper() not in points:
                found.setdefault(whole["left"].upper(), set()).add(whole["from"].upper())
        elif _DECLARED.fullmatch(line):
            declared.update(word.upper() for word in _WORD.findall(line))
    single = {name: next(iter(of)) for name, of in found.items() if len(of) == 1 and name in declared}
    for line in lines:
        for name in {word.upper() for word in _WORD.findall(line)} & single.keys():
            if not _is_about_copy(line, name, single[name]):
                del single[name]
    return single


def _is_about_copy(line: str, name: str, point: str) -> bool:
    """Return whether a line that mentions a copy is one of the understood forms."""
    if (whole := _WHOLE.fullmatch(line)) and whole["left"].upper() == name:
        return whole["from"].upper() == point
    if shift := _SHIFT.fullmatch(line):
        return shift["left"].upper() == name and shift["from"].upper() in (name, point)
    if move := _MOVE.match(line):
        return move[1].upper() == name and name not in {word.upper() for word in _WORD.findall(line[move.end() :])}
    return bool(_DECLARED.fullmatch(line))


def constants_in(lines: Sequence[str]) -> dict[str, float]:
    """Return the variables of a module, in upper case, to which it assigns a single number and nothing else."""
    written = Counter(name.upper() for line in lines for name in _WRITTEN.findall(line))
    handed = {word.upper() for line in lines for inside in _HANDED.findall(line) for word in _WORD.findall(inside)}
    numbers = {match[1].upper(): float(match[2]) for line in lines if (match := _CONSTANT.fullmatch(line))}
    return {name: number for name, number in numbers.items() if written[name] == 1 and name not in handed}


def read_copy(
    line: str, copies: dict[str, str], constants: dict[str, float], module: str, why: Unknown
) -> Iterator[Copy]:
    """Yield the statement of a line about a copy, if it is one."""
    if (whole := _WHOLE.fullmatch(line)) and whole["left"].upper() in copies:
        yield Copy(whole["left"].upper(), as_value(np.eye(4)), (whole.start("from"),))
    elif (shift := _SHIFT.fullmatch(line)) and shift["left"].upper() in copies:
        name, by = shift["left"].upper(), shift["by"]
        number = float(by) if re.fullmatch(NUMBER, by) else constants.get(by.upper())
        sources = (shift.start("from"),) if shift["from"].upper() != name else ()
        if number is None:
            yield Copy(name, why, sources)
            return
        at, size = 4 * "XYZ".index(shift["axis"].upper()) + 3, number if shift["sign"] == "+" else -number

        def shifted(values: tuple[Value, ...]) -> Value:
            before = values[0]
            if not isinstance(before, tuple):
                return why if not isinstance(before, Unknown) else before
            start = 0.0 if sources else before[at]
            return (*before[:at], start + size, *before[at + 1 :])

        yield Copy(name, ComputedValue((part_of(module, name),), shifted), sources)


def set_copy(copy: Copy, module: str) -> Set:
    """Return the assignment of the offset of a copy."""
    return Set(part_of(module, copy.name), copy.value)
