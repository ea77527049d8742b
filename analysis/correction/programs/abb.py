"""Targets in RAPID: jointtarget in degrees, robtarget in mm with a quaternion, declared or within a move.

Source: ABB, Technical reference manual, RAPID Instructions, Functions and Data types (3HAC050917). Confdata says the
posture, unless ConfL\\Off or ConfJ\\Off: then lines, or joint moves, keep the one in which the arm stands. tool0 and
wobj0 are the flange and the world, which is taken for the robot's base. Offs and RelTool move with their point.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from analysis.correction.programs.numbers import Decimals, frame_of, is_frame
from analysis.correction.programs.target import (
    NUMBER,
    Flags,
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

DECIMALS = Decimals(place=(4, 7), turn=(8, 12))
"""0.1 µm and 1e-8 of a quaternion or of a degree: a num has about seven digits."""
_BLANK = re.compile(r"\"[^\"\n]*\"|![^\n]*|%%%[^%]*%%%")
_FLOW = (
    "IF|ELSEIF|ELSE|ENDIF|WHILE|ENDWHILE|FOR|ENDFOR|TEST|CASE|DEFAULT|ENDTEST|PROC|ENDPROC|FUNC|ENDFUNC|TRAP|ENDTRAP|"
    "MODULE|ENDMODULE|ERROR|UNDO|BACKWARD|RECORD|ENDRECORD"
)
_HEADER = re.compile(rf"\s*\b(?:{_FLOW})\b[^\n;]*", re.IGNORECASE)
_EVENT = re.compile(
    r"\s*(?:(?:LOCAL\s+|TASK\s+)?(?:CONST|PERS|VAR)\s+(?P<kind>\w+)\s+(?P<name>\w+)\s*(?P<array>\{[^{};]*\}\s*)?"
    r"(?P<value>:=[^;]*)?;"
    r"|Conf(?P<conf>[LJ])\s*\\\s*(?P<switch>On|Off)\s*;"
    r"|Move(?P<move>AbsJ|[JLC])(?:DO|AO|GO|Sync)?\s(?P<given>[^;]*);"
    r"|(?P<word>[A-Za-z]\w*)(?P<rest>[^;]*);)",
    re.IGNORECASE,
)
_STANDS = re.compile(
    r"(?:Set\w*|Reset|Pulse\w*|Wait\w*|TP\w*|AccSet|VelSet|PathAccLim|CirPathMode|SingArea|GripLoad|Stop|EGM\w*|Clk\w*|"
    r"ErrWrite|Write\w*|ActUnit|DeactUnit|ConfL|ConfJ)\b",
    re.IGNORECASE,
)
"""Instructions after which the arm stands where it stood; an assignment is another."""
_NUMBER = re.compile(NUMBER)
_WORD = re.compile(r"[A-Za-z]\w*")
_OFFSET = re.compile(r"(?:Offs|RelTool)\s*\(\s*(\w+)\s*,", re.IGNORECASE)
_SHAPE = {"robtarget": (3, 4, 4, 6), "jointtarget": (6, 6)}
_NO_AXIS = 8.9e9
"""9E9 stands for an axis that is not there."""


@dataclass
class _Reader:
    text: str
    lines: Lines
    gathered: Gathered = field(default_factory=Gathered)
    tools: dict[str, Array] = field(default_factory=lambda: {"tool0": np.eye(4)})
    frames: dict[str, Array] = field(default_factory=lambda: {"wobj0": np.eye(4)})
    spent: set[int] = field(default_factory=set)
    keeps: frozenset[str] = frozenset()
    """The kinds of moves, L and J, for which confdata does not count."""

    def left(self, place: int, reason: Reason, name: str) -> Left:
        return Left(0, self.lines.at(place), " ".join(name.split())[:60], reason)


def parse(texts: tuple[str, ...]) -> Parsed:
    """Return the targets of a module."""
    text = blanked(texts[0], _BLANK)
    reader = _Reader(text, lines_of(text))
    events = list(_statements(text))
    reader.keeps = frozenset(
        event["conf"].upper() for event in events if event and event["conf"] and event["switch"].upper() == "OFF"
    )
    for event in events:
        if event and event["kind"]:
            _declare(reader, event)
    for event in events:
        if event is None:
            reader.gathered.stop()
        elif event["move"]:
            _move(reader, event)
        elif event["word"] and not (_STANDS.match(event["word"]) or event["rest"].lstrip().startswith(":=")):
            reader.gathered.stop()
    for word in _WORD.finditer(text):
        key = word[0].lower()
        if reader.gathered.knows(key) and word.start() not in reader.spent:
            reader.gathered.change(key)
    return reader.gathered.parsed()


def _statements(text: str) -> Iterator[re.Match[str] | None]:
    """Yield the statements of a module, and None where a block begins or ends, or something is not understood."""
    end = 0
    while (mark := text.find(";", end)) >= 0:
        at, end = end, mark + 1
        while header := _HEADER.match(text, at, end):
            yield None
            at = header.end()
        yield _EVENT.match(text, at, end)
    yield None


def _declare(reader: _Reader, event: re.Match[str]) -> None:
    kind, name = event["kind"].lower(), event["name"]
    if event["value"] is None or kind not in ("robtarget", "jointtarget", "tooldata", "wobjdata"):
        return
    begin, end = event.start("value") + 2, event.end("value")
    if kind in _SHAPE and not event["array"]:
        target, reason = _literal(reader, kind, begin, end, name)
        if target:
            reader.spent.add(event.start("name"))
            reader.gathered.declare(name.lower(), target, reason)
    elif kind == "tooldata" and (frame := _frame(reader.text[begin:end], "[TRUE,[[000],[0000]],[0,[000],[0000],000]]")):
        reader.tools[name.lower()] = frame[0]
    elif kind == "wobjdata" and (
        frame := _frame(reader.text[begin:end], '[FALSE,TRUE,"",[[000],[0000]],[[000],[0000]]]')
    ):
        reader.frames[name.lower()] = frame[0] @ frame[1]


def _frame(text: str, shape: str) -> list[Array] | None:
    """Return the frames (4, 4) of a literal of this shape, or None where it has another one."""
    if re.sub(r"\s", "", _NUMBER.sub("0", text)).replace("0,0", "00").replace("0,0", "00").upper() != shape:
        return None
    values = [float(found[0]) for found in _NUMBER.finditer(text)]
    sets = [values[k : k + 7] for k in range(0, 7 * shape.count("[[000],[0000]]"), 7)]
    return [frame_of("quaternion", one) for one in sets] if all(is_frame("quaternion", one) for one in sets) else None


def _literal(reader: _Reader, kind: str, begin: int, end: int, name: str) -> tuple[Target | None, Reason | None]:
    """Return the target of [[…],[…]…], with the reason why it cannot be corrected; None for what is no such literal."""
    text = reader.text
    groups = list(re.compile(r"\[([^\[\]]*)\]").finditer(text, begin, end))
    outside = re.sub(r"\s", "", re.sub(r"\[[^\[\]]*\]", "g", text[begin:end]))
    if outside != "[" + ",".join("g" * len(_SHAPE[kind])) + "]":
        return None, None
    numbers: list[Number] = []
    for group, count in zip(groups, _SHAPE[kind], strict=True):
        places = arguments(text, group.start(1), group.end(1))
        found = [(_NUMBER.fullmatch(text, *place), place) for place in places]
        if len(found) != count or not all(match for match, _ in found):
            return None, None
        numbers += [Number(*place, float(match[0])) for match, place in found if match]
    line = reader.lines.at(begin)
    reason: Reason | None = "external_axes" if any(one.value < _NO_AXIS for one in numbers[-6:]) else None
    if kind == "jointtarget":
        return Target(name, 0, line, "joints_deg", tuple(numbers[:6])), reason
    flags = Flags("abb", tuple(int(max(-99, min(99, one.value))) for one in numbers[7:11]))
    return Target(name, 0, line, "quaternion", tuple(numbers[:7]), flags=flags), reason


def _move(reader: _Reader, event: re.Match[str]) -> None:
    text, move = reader.text, event["move"].upper()
    places = arguments(text, event.start("given"), event.end("given"))
    if text[places[0][0] : places[0][1]].startswith("\\"):  # \Conc
        places = places[1:]
    count = 2 if move == "C" else 1
    if len(places) < count + 3:
        reader.gathered.leave(reader.left(event.start(), "computed", event[0]))
        return
    tool, frame = _frames(reader, text[slice(*places[count + 2])])
    way: Way = "joint" if move in ("J", "ABSJ") else "line"
    by_flags = ("J" if way == "joint" else "L") not in reader.keeps
    for begin, end in places[:count]:
        name = text[begin:end].partition("\\")[0].strip()
        key = name.lower()
        left = reader.left(begin, "not_literal" if _WORD.fullmatch(name) else "computed", name)
        if offset := _OFFSET.match(text, begin, end):
            reader.spent.add(offset.start(1))
            reader.gathered.offset(offset[1].lower(), reader.left(begin, "offset", name))
            continue
        if name.startswith("["):
            kind = "jointtarget" if move == "ABSJ" else "robtarget"
            target, reason = _literal(reader, kind, begin, begin + len(name), f"Move{event['move']}")
            key = f"[{begin}"
            if target:
                reader.gathered.declare(key, target, reason)
        elif reader.gathered.knows(key):
            reader.spent.add(begin)
        reader.gathered.move(key, way, left, tool=tool, frame=frame, by_flags=by_flags)


def _frames(reader: _Reader, text: str) -> tuple[Array | str, Array | str]:
    """Return the tool and the work object of the last argument of a move."""
    tool, *options = (part.strip() for part in text.split("\\"))
    frame = "wobj0"
    for option in options:
        name, _, value = option.partition(":=")
        if name.strip().lower() == "wobj":
            frame = value.strip()
    return reader.tools.get(tool.lower(), tool), reader.frames.get(frame.lower(), frame)
