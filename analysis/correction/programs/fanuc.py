"""Targets in a listing of FANUC's teach pendant language (.LS): P[n] with joints, or with a pose and its CONFIG.

Source: FANUC, R-30iB Operator's Manual (Basic Operation) B-83284EN, chapter 4, and public backups in .LS. A position
names its user frame UF and its tool frame UT; UF 0 is the world, taken for the robot's base as the library's arms have
it, and UT 0 the flange. INC makes a move relative; Offset and Tool_Offset add a register.
"""

from __future__ import annotations

import re

from analysis.correction.programs.numbers import Decimals
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
    blanked,
    lines_of,
)

DECIMALS = Decimals(place=(3, 7), turn=(3, 9))
"""A controller prints three decimals; whether it takes more is not known, so no decimals are added."""
_BLANK = re.compile(
    r"(?<=:)[ \t]*(?:!|//|--eg:)[^\n]*|^[ \t]*(?:\d+[ \t]*)?:[ \t]*(?:!|//)[^\n]*|\"[^\"\n]*\"|MESSAGE\[[^\n]*",
    re.MULTILINE,
)
_LINE = re.compile(r"^[ \t]*(?:\d+[ \t]*)?:(?P<body>[^\n]*)", re.MULTILINE)
_POINT = re.compile(r"P\[\s*(\d{1,6})\s*(?::[^\]\n]{0,40})?\]")
_POSITION = re.compile(r"\bP\[\s*(\d{1,6})\s*(?::[^\]\n]{0,40})?\]\s*\{([^{}]*)\}")
_MOVE = re.compile(r"([JLCAS])\s+(P|PR)\[[^\]]*\](.*)")
_VIA = re.compile(r"(P|PR)\[[^\]]*\](?!\s*=)(.*)")
_OFFSET = re.compile(r"\b(?:Tool_)?Offset\b|\bVOFFSET\b|\bRTCP\b", re.IGNORECASE)
_STANDS = re.compile(
    r"(?:(?:DO|RO|GO|AO|SO|R|PR|AR|F|UTOOL|UFRAME|TIMER)\[|UFRAME_NUM|UTOOL_NUM|WAIT|PAUSE|OVERRIDE|PAYLOAD|UALM|LINE|\$)"
)
"""Instructions after which the arm stands where it stood."""
_FRAMES = re.compile(r"UF\s*:\s*(\w+)\s*,\s*UT\s*:\s*(\w+)")
_CONFIG = re.compile(r"CONFIG\s*:\s*'\s*([FN])?\s*([UD])?\s*([TB])?\s*,\s*(-?\d+)\s*,\s*(-?\d+)\s*,\s*(-?\d+)\s*'")
_JOINT = re.compile(rf"\bJ([1-6])\s*=\s*({NUMBER})\s*deg")
_AXIS = re.compile(rf"\b([XYZWPR])\s*=\s*({NUMBER})\s*(?:mm|deg)")
_OTHERS = re.compile(r"\bGP[2-9]\b|\bE\d\s*=|\bJ[7-9]\s*=")


def parse(texts: tuple[str, ...]) -> Parsed:
    """Return the targets of a listing."""
    text = blanked(texts[0], _BLANK)
    lines, gathered = lines_of(text), Gathered()
    start = re.compile(r"^/POS\b", re.MULTILINE).search(text)
    middle = start.start() if start else len(text)
    for found in _POSITION.finditer(text, middle):
        target, reason = _position(found, lines)
        gathered.declare(found[1], target, reason)
    begin = re.compile(r"^/MN\b", re.MULTILINE).search(text, 0, middle)
    for line in _LINE.finditer(text, begin.end() if begin else 0, middle):
        _read(line, lines, gathered)
    return gathered.parsed()


def _position(found: re.Match[str], lines: Lines) -> tuple[Target, Reason | None]:
    number, body, begin = found[1], found[2], found.start(2)
    joints = [(int(one[1]), _number(one, begin)) for one in _JOINT.finditer(body)]
    axes = [("XYZWPR".index(one[1]) + 1, _number(one, begin)) for one in _AXIS.finditer(body)]
    form: Form = "joints_deg" if joints else "roll_pitch_yaw"
    given = dict(joints or axes)
    numbers = tuple(given[axis] for axis in sorted(given))
    frames, config = _FRAMES.search(body), _CONFIG.search(body)
    flags = None
    if config and all(config[k] for k in (1, 2, 3)):
        letters = config[1] == "F", config[2] == "U", config[3] == "T"
        flags = Flags("fanuc", (*map(int, letters), *(int(config[k][:6]) for k in (4, 5, 6))))
    frame, tool = (frames[1], frames[2]) if frames else ("F", "F")
    target = Target(f"P[{number}]", 0, lines.at(found.start()), form, numbers, tool, frame, flags)
    if _OTHERS.search(body):
        return target, "external_axes"
    return target, None if len(numbers) == 6 and len(joints or axes) == 6 else "incomplete"


def _number(found: re.Match[str], begin: int) -> Number:
    return Number(begin + found.start(2), begin + found.end(2), float(found[2]))


def _read(line: re.Match[str], lines: Lines, gathered: Gathered) -> None:
    body = line["body"].strip()
    place = lines.at(line.start("body"))
    move, via = _MOVE.match(body), _VIA.match(body)
    if not (move or via):
        for other in _POINT.finditer(body):
            if gathered.knows(other[1]) and (
                other.start() == 0 or body[other.start() - 1] not in "ABCDEFGHIJKLMNOPQRSTUVWXYZ"
            ):
                gathered.change(other[1])
        if body not in ("", ";") and not _STANDS.match(body):
            gathered.stop()
        return
    # A line that begins with a point continues an arc.
    way: Way = "joint" if move and move[1] == "J" else "line"
    rest = move[3] if move else via[2] if via else ""
    point = _POINT.search(body)
    name = body[: body.find("]") + 1]
    name = name[name.find("P") :]
    if point is None or (move and move[2] == "PR") or body.startswith("PR"):
        gathered.leave(Left(0, place, name[:60], "computed"))
    elif re.search(r"\bINC\b", rest):
        if gathered.knows(point[1]):
            gathered.change(point[1])
        gathered.leave(Left(0, place, name[:60], "relative"))
    elif _OFFSET.search(rest):
        gathered.offset(point[1], Left(0, place, name[:60], "offset"))
    else:
        gathered.move(point[1], way, Left(0, place, name[:60], "not_literal"))
