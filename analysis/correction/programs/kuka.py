"""Targets in KUKA's language: E6AXIS and AXIS in degrees, E6POS, POS and FRAME in mm and degrees, in a .src or its
.dat.

Source: KUKA System Software 8.x, Operating and Programming Instructions for System Integrators, and public programs
with the inline forms of the pendant (FDAT_ACT = F…, PTP X…, SLIN … WITH $TOOL = STOOL2(F…)). The numbers of a tool and
of a base stand in $config.dat, which a person states. $NULLFRAME and base 0 are $WORLD, which is taken for the robot's
foot where the arm of the rig file stands upright, as KUKA delivers it ($ROBROOT zero).
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from analysis.correction.programs.numbers import Decimals, frame_of, is_frame
from analysis.correction.programs.target import (
    NUMBER,
    Flags,
    Form,
    Gathered,
    Left,
    Lines,
    Number,
    Parsed,
    Reason,
    Target,
    Way,
    arguments,
    blanked,
    lines_of,
)
from analysis.kinematics.arm import Array

DECIMALS = Decimals(place=(4, 7), turn=(6, 9))
"""0.1 µm, and 1e-6°, which is 0.02 µm at 1 m: a REAL of KRL has about seven digits."""
_BLANK = re.compile(r"\"[^\"\n]*\"|;[^\n]*|^[ \t]*&[^\n]*", re.MULTILINE)
_COMPONENT = re.compile(rf"\s*([A-Z]\w*)\s+({NUMBER})\s*", re.IGNORECASE)
_DECLARED = re.compile(
    r"\s*(?:DECL\s+)?(?:GLOBAL\s+)?(?:CONST\s+)?(?:(E6POS|POS|FRAME|E6AXIS|AXIS)\s+)?(\w+)\s*=\s*\{([^{}]*)\}\s*",
    re.IGNORECASE,
)
_FDAT = re.compile(r"\s*(?:DECL\s+)?(?:GLOBAL\s+)?FDAT\s+(\w+)\s*=\s*\{([^{}]*)\}?", re.IGNORECASE)
_MOVE = re.compile(r"\s*S?(PTP|LIN|CIRC)(_REL)?\s+(?!=)(.+)", re.IGNORECASE)
_PLACE = re.compile(r"\s*\$(TOOL|BASE)\s*=(.+)", re.IGNORECASE)
_BY_NUMBER = re.compile(r"(?:TOOL_DATA|BASE_DATA)\s*\[\s*(\d+)\s*\]", re.IGNORECASE)
_ACTIVE = re.compile(r"\s*FDAT_ACT\s*=\s*(\w+)\s*", re.IGNORECASE)
_CALLED = re.compile(r"\s*BAS\s*\(\s*#(TOOL|BASE)\s*,\s*(\d+)\s*\)\s*", re.IGNORECASE)
_WITH = re.compile(r"\sWITH\s(.*)", re.IGNORECASE)
_WITH_FDAT = re.compile(r"\$(TOOL|BASE)\s*=\s*S(?:TOOL2?|BASE)\s*\(\s*(\w+)", re.IGNORECASE)
_WITH_PLACE = re.compile(
    r"\$(TOOL|BASE)\s*=\s*((?:TOOL_DATA|BASE_DATA)\s*\[\s*\d+\s*\]|\$NULLFRAME|\$ROBROOT)", re.IGNORECASE
)
_ENDS = re.compile(r"\s(?:C_DIS|C_PTP|C_VEL|C_ORI|C_SPL)\b.*", re.IGNORECASE)
_STANDS = re.compile(
    r"\s*(?:(?:DECL|WAIT|HALT|PULSE|BAS|CONTINUE|ANOUT|INT|REAL|BOOL|CHAR|EXT|SIGNAL|E6POS|E6AXIS|FRAME|POS|AXIS)\b.*"
    r"|[$\w.\[\]]+\s*=[^=].*|)",
    re.IGNORECASE,
)
"""Statements after which the arm stands where it stood: assignments, declarations, waiting."""
_WORD = re.compile(r"[A-Za-z_]\w*")
_AXES = tuple(f"A{axis}" for axis in range(1, 7))
_POSE = ("X", "Y", "Z", "A", "B", "C")
_EXTERNAL = tuple(f"E{axis}" for axis in range(1, 7))


@dataclass
class _Reader:
    texts: tuple[str, ...]
    lines: tuple[Lines, ...]
    gathered: Gathered = field(default_factory=Gathered)
    fdat: dict[str, tuple[str, str]] = field(default_factory=dict)
    spent: set[tuple[int, int]] = field(default_factory=set)
    tool: Array | str = "unset"
    base: Array | str = "unset"

    def left(self, place: int, reason: Reason, name: str) -> Left:
        return Left(0, self.lines[0].at(place), name[:60], reason)


def parse(texts: tuple[str, ...]) -> Parsed:
    """Return the targets of a .src and, if it is given as the second text, of its .dat."""
    blank = tuple(blanked(text, _BLANK) for text in texts)
    reader = _Reader(blank, tuple(map(lines_of, blank)))
    for file in reversed(range(len(blank))):
        for begin, line in _lines(blank[file]):
            _declare(reader, file, begin, line)
    fixed = {kind: _only(reader, kind) for kind in ("TOOL", "BASE")}
    for begin, line in _lines(blank[0]):
        _read(reader, begin, line, fixed)
    for file, text in enumerate(blank):
        for word in _WORD.finditer(text):
            key = word[0].upper()
            if reader.gathered.knows(key) and (file, word.start()) not in reader.spent:
                reader.gathered.change(key)
    return reader.gathered.parsed()


def _lines(text: str) -> list[tuple[int, str]]:
    found, at = [], 0
    for line in text.split("\n"):
        found.append((at, line.rstrip("\r")))
        at += len(line) + 1
    return found


def _declare(reader: _Reader, file: int, begin: int, line: str) -> None:
    if fdat := _FDAT.match(line):
        numbers = {key: re.search(rf"{key}\s+(\d+)", fdat[2], re.IGNORECASE) for key in ("TOOL_NO", "BASE_NO")}
        reader.fdat[fdat[1].upper()] = tuple(one[1] if one else "?" for one in numbers.values())  # type: ignore[assignment]
        return
    found = _DECLARED.fullmatch(line)
    if not found:
        return
    key = found[2].upper()
    target, reason = _literal(reader, file, begin + found.start(3), found[3], found[2])
    if target:
        reader.spent.add((file, begin + found.start(2)))
        reader.gathered.declare(key, target, reason)


def _literal(reader: _Reader, file: int, begin: int, text: str, name: str) -> tuple[Target | None, Reason | None]:
    """Return the target of "X 1, Y 2, …", with the reason why it cannot be corrected; None for what is no target."""
    parts: dict[str, Number] = {}
    at = begin
    for part in text.split(",", 32):
        found = _COMPONENT.fullmatch(part)
        if not found:
            return None, None
        parts[found[1].upper()] = Number(at + found.start(2), at + found.end(2), float(found[2]))
        at += len(part) + 1
    joints = any(axis in parts for axis in _AXES)
    if not joints and not any(axis in parts for axis in _POSE):
        return None, None
    names = _AXES if joints else _POSE
    numbers = tuple(parts[axis] for axis in names if axis in parts)
    form: Form = "joints_deg" if joints else "yaw_pitch_roll"
    flags = None
    if "S" in parts and "T" in parts and all(0 <= parts[one].value < 1 << 16 for one in "ST"):
        flags = Flags("kuka", (int(parts["S"].value), int(parts["T"].value)))
    target = Target(name, file, reader.lines[file].at(begin), form, numbers, flags=flags)
    if len(numbers) < 6:
        return target, "incomplete"
    return target, "external_axes" if any(axis in parts and parts[axis].value for axis in _EXTERNAL) else None


def _place(given: str) -> Array | str:
    """Return the frame of the right side of $TOOL = … or $BASE = …, or its name; "0" is the null frame."""
    text = given.strip()
    if by_number := _BY_NUMBER.fullmatch(text):
        return by_number[1]
    if text.upper() in ("$NULLFRAME", "$WORLD"):
        return "0"
    if text.upper() == "$ROBROOT":
        return np.eye(4)
    if text.startswith("{"):
        parts = {found[1].upper(): float(found[2]) for found in _COMPONENT.finditer(text)}
        values = [parts.get(axis, 0.0) for axis in _POSE]
        if set(_POSE) <= set(parts) and is_frame("yaw_pitch_roll", values):
            return frame_of("yaw_pitch_roll", values)
    return text[:60]


def _only(reader: _Reader, kind: str) -> Array | str | None:
    """Return the tool or base that a program sets, if it sets just one."""
    found: set[str] = set()
    for _, line in _lines(reader.texts[0]):
        if _ACTIVE.fullmatch(line):
            return None
        if (place := _PLACE.fullmatch(line)) and place[1].upper() == kind:
            found.add(place[2].strip())
        if (called := _CALLED.fullmatch(line)) and called[1].upper() == kind:
            found.add(f"{kind}_DATA[{called[2]}]")
    return _place(found.pop()) if len(found) == 1 else None


def _read(reader: _Reader, begin: int, line: str, fixed: dict[str, Array | str | None]) -> None:
    if move := _MOVE.fullmatch(line):
        _move(reader, begin, line, move, fixed)
    elif place := _PLACE.fullmatch(line):
        _set(reader, place[1], _place(place[2]))
    elif called := _CALLED.fullmatch(line):
        _set(reader, called[1], called[2])
    elif active := _ACTIVE.fullmatch(line):
        reader.tool, reader.base = reader.fdat.get(active[1].upper(), ("unset", "unset"))
    elif not _STANDS.fullmatch(line):
        reader.gathered.stop()
        reader.tool = reader.base = "unset"


def _set(reader: _Reader, kind: str, place: Array | str) -> None:
    if kind.upper() == "TOOL":
        reader.tool = place
    else:
        reader.base = place


def _move(reader: _Reader, begin: int, line: str, move: re.Match[str], fixed: dict[str, Array | str | None]) -> None:
    tool = reader.tool if fixed["TOOL"] is None else fixed["TOOL"]
    base = reader.base if fixed["BASE"] is None else fixed["BASE"]
    end = move.end(3)
    if suffix := _WITH.search(line, move.start(3)):
        for kind, name in _WITH_FDAT.findall(suffix[1]):
            numbers = reader.fdat.get(name.upper(), ("unset", "unset"))
            tool, base = (numbers[0], base) if kind.upper() == "TOOL" else (tool, numbers[1])
        for kind, text in _WITH_PLACE.findall(suffix[1]):
            tool, base = (_place(text), base) if kind.upper() == "TOOL" else (tool, _place(text))
        end = suffix.start()
    if zone := _ENDS.search(line, move.start(3), end):
        end = zone.start()
    places = arguments(line, move.start(3), end)
    if move[2]:
        reader.gathered.leave(reader.left(begin, "relative", line[places[0][0] : end]))
        return
    way: Way = "joint" if move[1].upper() == "PTP" else "line"
    turned = len(places) > (2 if move[1].upper() == "CIRC" else 1)
    for start, stop in places[: 2 if move[1].upper() == "CIRC" else 1]:
        text = line[start:stop]
        key = text.upper()
        left = reader.left(begin, "not_literal" if _WORD.fullmatch(text) else "computed", text)
        if turned:  # an arc of CA degrees does not end at its target
            reader.gathered.leave(reader.left(begin, "computed", text))
            continue
        if text.startswith("{") and text.endswith("}"):
            target, reason = _literal(reader, 0, begin + start + 1, text[1:-1], move[1].upper())
            key = f"{{{begin + start}"
            if target:
                reader.gathered.declare(key, target, reason)
        elif reader.gathered.knows(key):
            reader.spent.add((0, begin + start))
        # A line or an arc keeps the posture at its start; the flags of a taught point are those that it had there.
        reader.gathered.move(key, way, left, tool=tool, frame=base)
