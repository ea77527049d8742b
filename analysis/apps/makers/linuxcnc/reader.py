"""Reader of targets in G-code of LinuxCNC for arms with genserkins.

Source: LinuxCNC 2.9, G-code reference, O-codes and Switchable Kinematics. A target is a G0 or G1, or a G2 or G3 with R,
with all of X Y Z A B C as numbers. A word that a line omits keeps its value: a target is not corrected if a later line
takes words from it. A work offset adds to A, B and C, which is no rotation of a frame: only shifts are known frames.

Poses and work offsets are in the unit of G20 or G21. Joint moves are in the unit of the machine, so they are joint
angles only if the program has selected this unit.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from analysis.apps.makers.numbers import Decimals
from analysis.apps.makers.points import as_value
from analysis.apps.makers.program_machine import (
    OFF,
    Call,
    ComputedValue,
    Elsewhere,
    End,
    ForgetAll,
    Move,
    Needs,
    Ref,
    Unknown,
    Value,
    usages_of,
)
from analysis.apps.makers.program_parser import NUMBER, ProgramParser, brackets, number_at
from analysis.apps.makers.program_reader import ProgramReader, Remark
from analysis.apps.makers.target import Form, NamedFrame, Number, Parsed, ProgramTexts, Target, Way
from analysis.correction.reasons import Reason
from rigs.schema.probe import MM_PER_UNIT

_DECIMALS = Decimals(place=(4, 7), turn=(5, 9))
_BLANK = re.compile(r";[^\n]*|\([^()\n]*\)|^[ \t]*%[^\n]*", re.MULTILINE)
_FLOW = re.compile(r"[oO]\s*(?P<name>\d+|<[^>]*>|\[[^\n]*?\]|#\S+?)\s*(?P<word>[a-zA-Z]+)(?P<rest>.*)")
_WORD = re.compile(rf"(?P<letter>[a-zA-Z])[ \t]*(?:(?P<number>{NUMBER})|(?P<computed>[-+]?(?:\[|#)))")
_EXPRESSION = re.compile(r"[-+]?(?:(?P<parameter>#+(?:<[^>]*>|\d+))|#?(?=\[))")
_VALUE = rf"[-+]?\s*(?:{NUMBER}|#+\s*(?:\d+|<[^>]*>))"
_ASSIGNED = re.compile(rf"(?:#\s*(?:\d+|<[^>]*>)\s*=\s*{_VALUE}\s*)+")
_BRACKETS = re.compile(r"(?:\b[a-zA-Z]{2,6}\s*)?\[[^\[\]]*\](?:\s*/\s*\[[^\[\]]*\])?")
"""An expression without brackets inside, with its function."""
_SYSTEM = re.compile(r"#\s*(?:0*5[0-9]{3}|#|\[)[^=]*=")
"""Assignment to a parameter of the interpreter (work offsets: 5221 to 5390), or to a computed one."""
_TURNS = re.compile(r"([ABC])\[360 \* ROUND\[[^\n]*?\] / 360\]\]")
"""Whole turns as the offset of an angle, as `rig program` writes them."""
_AXES, _OTHERS = "XYZABC", "UVW"
_SYSTEMS = {54: 1, 55: 2, 56: 3, 57: 4, 58: 5, 59: 6, 59.1: 7, 59.2: 8, 59.3: 9}
_SYSTEM_NAMES = tuple(f"G{code:g}" for code in _SYSTEMS)
_NOTHING_G = {4, 17, 18, 19, 61, 61.1, 64, 80, 90.1, 91.1, 93, 94, 95, 96, 97, 98, 99, 28.1, 30.1}
_NOTHING_M = {0, 1, 3, 4, 5, 7, 8, 9, 19, 48, 49, 50, 51, 52, 53, 60, 61, 62, 63, 64, 65, 66, 70, 71}
"""Codes that change neither the position nor the meaning of numbers."""
_SWITCHES: dict[float, tuple[str, Value]] = {
    20: ("switch units", "inch"), 21: ("switch units", OFF), 90: ("switch distance", OFF),
    91: ("switch distance", "relative"), 40: ("shift radius", OFF), 41: ("shift radius", "on"),
    41.1: ("shift radius", "on"), 42: ("shift radius", "on"), 42.1: ("shift radius", "on"), 43: ("shift tool", "on"),
    43.1: ("shift tool", "on"), 43.2: ("shift tool", "on"), 49: ("shift tool", OFF), 92: ("shift G92", "on"),
    92.1: ("shift G92", OFF), 92.2: ("shift G92", OFF), 92.3: ("shift G92", "on"), 52: ("shift G92", "on"),
    7: ("shift diameter", "on"), 8: ("shift diameter", OFF),
}  # fmt: skip
_LATER = {
    "shift radius": r"G\s*4[12]", "shift tool": r"G\s*43", "shift G92": r"G\s*(?:52|92(?!\.[12]))",
    "shift diameter": r"G\s*0*7(?![\d.])",
    "switch poses": r"E\s*\+?0*3(?!\d)|E\s*[-+]?[#\[]|M\s*(?:128|129|130|428|429|430)|G\s*1[23]\.1",
}  # fmt: skip
"""Codes that make the initial value of a variable unknown: the controller keeps values between programs."""
_POSES, _JOINTS = "switch poses", "switch joints"
_LAST = {28, 30, 10, 52, 92, 92.1, 92.2, 92.3}
"""Codes that LinuxCNC executes after the other G codes of a line, which select the unit."""
_MOVES = {0, 1, 2, 3}
_FLOW_WORDS = {
    "if": "if", "elseif": "case", "else": "else", "break": "break", "continue": "continue", "return": "return",
    **dict.fromkeys(("while", "repeat"), "while"), **dict.fromkeys(("endif", "endwhile", "endrepeat"), "end"),
}  # fmt: skip


def _selected(values: tuple[Value, ...]) -> Value:
    system, *offsets = values
    return offsets[_SYSTEM_NAMES.index(system)] if isinstance(system, str) else system


_SYSTEM_FRAME = ComputedValue(("system", *(f"offset[{name}]" for name in _SYSTEM_NAMES)), _selected)


@dataclass(frozen=True)
class _Words:
    g: tuple[float, ...]
    m: tuple[float, ...]
    values: dict[str, Number | None]
    """Numbers of the other letters, None if computed."""


class _GCodeReader(ProgramParser):
    def __init__(self, program: ProgramTexts) -> None:
        super().__init__(program, _BLANK)
        self.motion: float | None = None
        """Code of the last move; None if unknown."""
        self.is_relative = self.joints = False
        """Meaning of the numbers: distances, or joint angles."""
        self.partial: set[str] = set()
        """Keys of moves that take words from the previous position."""
        self.centred: set[str] = set()
        """Keys of arcs with a centre, which is relative to the start."""
        self.inches = False
        """True if the last unit that a line selected is inch."""
        self.machine_unit = program.machine_unit
        self.uncertain = {part for part, codes in _LATER.items() if re.search(codes, self.texts[0], re.IGNORECASE)}

    def read(self, line: str) -> None:
        text = line.strip()
        if flow := _FLOW.fullmatch(text):
            self._flow(flow["name"].lower(), flow["word"].lower(), flow["rest"])
        elif text.startswith("/"):
            self.blocks.keyword("if")
            self.read(" " * (line.index("/") + 1) + text[1:])
            self.blocks.close()
        elif text.startswith("#"):
            if _SYSTEM.search(text) or not _ASSIGNED.fullmatch(_without_brackets(text)):
                self.not_known(text)
        elif text:
            self._codes(line)

    def _flow(self, name: str, word: str, rest: str) -> None:
        """Parse an o-word. The modal motion is unknown after it, because paths join."""
        self.motion = None
        is_bare_loop = word in ("while", "repeat") and not rest.strip()
        is_stray_end = word.startswith("end") and not self.blocks.open
        if word == "sub":
            self.open_routine(name)
        elif word == "endsub" and self.around:
            self.close_routine()
        elif word == "call":
            self.add(Call(name, self.why(f"o{name} is called")))
        elif word in _FLOW_WORDS and not (is_bare_loop or is_stray_end):
            self.blocks.keyword(_FLOW_WORDS[word])
        else:  # the loop do … while has its condition at the end
            self.broken.append(Call("\0", self.why(f"{word} is unknown here")))

    def end(self) -> None:
        if self.around or self.blocks.open:
            self.broken.append(Call("\0", self.why("a block does not end")))
        while self.around:
            self.close_routine()
        self.end_routine()

    def _codes(self, line: str) -> None:
        """Parse a line of codes: first the changes of the state, then the motion."""
        words = _words(line, self.at)
        if words is None:
            self.not_known(line)
            return
        for code in words.m:  # in the order in which LinuxCNC executes the codes of a line
            if code in (67, 68):
                self._analog_output(words, waits=code == 67)
            elif code == 73:  # the end of the routine restores the codes
                self.broken.append(Call("\0", self.why("M73 restores codes at the end of the routine")))
            elif code == 6:
                self.add(Elsewhere())
            elif code not in _NOTHING_M | {2, 30}:
                self.not_known(f"M{code:g}")
        for code in sorted(words.g, key=_LAST.__contains__):
            self._g_code(code, words)
        if moves := [code for code in words.g if code in _MOVES]:
            self.motion = moves[0]
        elif 80 in words.g:
            self.motion = None
        has_axes = any(letter in words.values for letter in _AXES + _OTHERS)
        if has_axes and not {10, 92, 28, 30, 28.1, 30.1, 52, 43.1} & {*words.g}:
            self._motion(words)
        if 2 in words.m or 30 in words.m:
            self.add(End(halts=True))

    def _g_code(self, code: float, words: _Words) -> None:
        if code in _SWITCHES:
            self.is_relative = code == 91 if code in (90, 91) else self.is_relative
            self.inches = code == 20 if code in (20, 21) else self.inches
            self.set(*_SWITCHES[code])
        elif code in _SYSTEMS:
            self.set("system", f"G{code:g}")
        elif code == 10:
            self._offset(words)
        elif code in (28, 30, 38.2, 38.3, 38.4, 38.5):
            self.add(Elsewhere())
        elif code not in _NOTHING_G | _MOVES | {53}:
            self.not_known(f"G{code:g}")

    def _analog_output(self, words: _Words, *, waits: bool) -> None:
        """Parse an analog output, which may switch the kinematics. M67 waits for the next move, which the interpreter
        has then already computed with the old kinematics."""
        output, value = words.values.get("E"), words.values.get("Q")
        if output and output.value != 3:
            return
        if output is None or value is None or value.value not in (0, 1) or waits:
            cause = (
                "M67 switches the kinematics at the next move"
                if waits
                else "the kinematics are computed, or of the user"
            )
            self.add(ForgetAll(self.why(cause)))
            return
        self.joints = value.value == 1
        self.set(_POSES, "on" if self.joints else OFF)
        self.set(_JOINTS, OFF if self.joints else "on")

    def _offset(self, words: _Words) -> None:
        """Parse the work offset set by G10 L2, known if all numbers are given and it only shifts.

        L1, L10 and L11 write the tool table, which the program uses only under G43.
        """
        kind, system = words.values.get("L"), words.values.get("P")
        if kind and kind.value in (1, 10, 11):
            return
        if not kind or kind.value not in (2, 20):
            self.add(ForgetAll(self.why("G10 sets offsets that rig does not follow")))
            return
        if not system or system.value not in _SYSTEMS.values():
            self.forget("offset", self.why("G10 sets the offset of a system that the line does not name"))
            return
        name = next(f"G{code:g}" for code, number in _SYSTEMS.items() if number == system.value)
        given = [words.values.get(letter) for letter in (*_AXES, "R")]
        value: Value = self.why("G10 sets an offset that is computed or does not only shift")
        if kind.value == 20:
            value = self.why("G10 L20 sets an offset by the position of the arm")
        elif all(given) and not any(number.value for number in given[3:] if number):
            shift = [number.value for number in given[:3] if number]
            self.set(f"offset[{name}]", ComputedValue(("switch units",), partial(_shifted, shift)))
            known = _shifted(shift, ("inch" if self.inches else OFF,))
            assert isinstance(known, tuple)  # noqa: S101 - of a known unit
            self.points.sets.append(NamedFrame(name, "frame", 0, self.line(), known))
            return
        self.set(f"offset[{name}]", value)

    def _motion(self, words: _Words) -> None:
        values, numbers = words.values, [words.values.get(letter) for letter in _AXES]
        reasons: dict[Reason, bool] = {
            "not_understood": self.motion is None,
            "external_axes": any(letter in values for letter in _OTHERS),
            "relative": self.is_relative,
            "computed": any(letter in values and values[letter] is None for letter in _AXES),
            "incomplete": not all(numbers),
            "arc_centre": self.motion in (2, 3) and "R" not in values,
        }
        reason = next((reason for reason, applies in reasons.items() if applies), None)
        line, joints = self.line(), self.joints
        key, name = f"line {line}", "G?" if self.motion is None else f"G{self.motion:g}"
        pose: Form = "inch_roll_pitch_yaw" if self.inches else "roll_pitch_yaw"
        form: Form = "joints_deg" if joints else pose
        self.points.declare(key, Target(name, 0, line, form, tuple(filter(None, numbers)), "flange", "G54"), reason)
        if reason in ("incomplete", "relative", "computed"):
            self.partial.add(key)
        elif reason == "arc_centre":
            self.centred.add(key)
        inches = self.machine_unit == "inch" if joints else self.inches
        switches = ("switch distance", _JOINTS if joints else _POSES)
        needs: Needs = tuple(("switched", Ref(variable)) for variable in switches)
        needs += (("switched", ComputedValue(("switch units",), partial(_other_unit, "inch" if inches else OFF))),)
        needs += tuple(("displaced", Ref(variable)) for variable in _LATER if variable.startswith("shift"))
        way: Way = "joint" if joints else "line"
        frame = "G53" if 53 in words.g else _SYSTEM_FRAME
        self.add(Move(key, way, 0, line, "flange", frame, needs, "on" if joints else OFF))

    def change_sources(self) -> None:
        """Mark the points from which a line takes words, and the starts of arcs with a centre."""
        sources: dict[str, set[str]] = {}
        for usage in usages_of(self.program(kept=_KEPT, starts="")):
            sources.setdefault(usage.move.key, set()).update(key for key in usage.comes_from if key)
        for first in sorted(self.partial | self.centred):
            todo, seen = [first], set[str]()
            while todo:
                for source in sources.get(todo.pop(), ()):
                    if source in self.points.declared and source not in seen:
                        seen.add(source)
                        self.points.change(source, 0, self.points.declared[first].target.line)
                        todo += [source] if source in self.partial else []

    def initial(self, variable: str) -> Value:
        if variable in ("switch units", "switch distance"):
            return Unknown(0, 0, f"no line before selects the {variable.removeprefix('switch ')}")
        if variable == "system":
            return "G54"  # each program starts with it
        if variable in self.uncertain:
            return Unknown(0, 0, "a previous program may have left it on")
        family, _, number = variable.partition("[")
        return number.rstrip("]") if family == "offset" else "on" if variable == _JOINTS else OFF


def _without_brackets(text: str) -> str:
    """An assignment with a number in place of each expression."""
    while (flat := _BRACKETS.sub("0", text)) != text:
        text = flat
    return text


def _shifted(shift: Sequence[float], selected: tuple[Value, ...]) -> Value:
    """Frame in mm of a work offset in the selected unit, which is unknown with it. G91 does not concern it."""
    (unit,) = selected
    if isinstance(unit, Unknown):
        return unit
    T = np.eye(4)
    T[:3, 3] = np.asarray(shift) * (MM_PER_UNIT["inch"] if unit == "inch" else 1.0)
    return as_value(T)


def _other_unit(wanted: str, selected: tuple[Value, ...]) -> Value:
    """`off` if a unit is selected in which the numbers of a move are meant."""
    (unit,) = selected
    return unit if isinstance(unit, Unknown) else OFF if unit == wanted else "on"


_KEPT = ("offset[",)


def parse(program: ProgramTexts) -> Parsed:
    reader = _GCodeReader(program)
    reader.begin_routine("")
    for line in reader.lines(0):
        reader.read(line)
    reader.end()
    reader.change_sources()
    return reader.points.parsed(reader.program(kept=_KEPT, starts=""))


def _words(line: str, begin: int) -> _Words | None:
    plain = _TURNS.sub(lambda turns: f"{turns[1]}0" + " " * (len(turns[0]) - 2), line)
    codes: dict[str, list[float]] = {"G": [], "M": []}
    values: dict[str, Number | None] = {}
    at = 0
    while plain[at:].strip():
        if plain[at].isspace():
            at += 1
            continue
        if not (word := _WORD.match(plain, at)):
            return None
        letter, at = word["letter"].upper(), word.end()
        if word["computed"]:
            values[letter] = None
            expression = _EXPRESSION.match(plain, word.start("computed"))
            if expression is None:
                return None
            at = expression.end()
            if not expression["parameter"] and (at := brackets(plain, at).get(at, -1) + 1) == 0:
                return None
        elif letter in codes:
            codes[letter].append(float(word["number"]))
        else:
            values[letter] = number_at(word, "number", begin)
    return _Words(tuple(codes["G"]), tuple(codes["M"]), values)


READER = ProgramReader(parse, _DECIMALS, Remark("; "), null_tools=("flange",), null_frames=("G53",), shifts_only=True)
