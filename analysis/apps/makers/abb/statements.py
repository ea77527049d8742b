"""Statements of RAPID as statements of the state machine; `instructions` has the effect of each instruction.

PDispOn and PDispSet displace poses, not joint angles. Handlers (ERROR, UNDO) and traps may run at any moment, and a
handler may end its routine at any statement.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np

from analysis.apps.makers.abb.instructions import EFFECT, FUNCTIONS, MOVE, SETTINGS, SWITCHES, TOOL_THIRD, WRITES
from analysis.apps.makers.abb.offsets import OFFSET, RapidOffsets
from analysis.apps.makers.configuration import beyond_stretch, wrist_in_front
from analysis.apps.makers.numbers import frame_of, is_frame
from analysis.apps.makers.points import as_value
from analysis.apps.makers.program_machine import (
    EXTERNAL,
    Call,
    Elsewhere,
    End,
    ForgetAll,
    Jump,
    JumpTarget,
    Move,
    Needs,
    Ref,
    Setting,
    Unknown,
    Value,
)
from analysis.apps.makers.program_parser import NUMBER, arguments, brackets, number_at
from analysis.apps.makers.target import Flags, ProgramTexts, Target
from analysis.robot.kinematics.arm import Arm, Array, Mask

WORD = re.compile(r"[a-z]\w*")
_CALL = re.compile(r"(?<![\w\\])([a-z]\w*)\s*\(")
_DEFINED = re.compile(r"\b(local\s+)?(?:proc|func\s+\w+)\s+(\w+)\s*\(")
_WOBJ = re.compile(r"\\\s*wobj\s*(?P<given>:=|\?)\s*(?P<name>[^\\,;]+)")
_TRACKED = re.compile(r"\\\s*(?:corr|track)\b")
_ASSIGNED = re.compile(
    r"\s*(?P<name>[a-z]\w*)(?P<part>\s*(?:\{[^{};]*\}|\.\w+)(?:\s*\{[^{};]*\}|\.\w+)*)?\s*:=(?P<right>.*)", re.DOTALL
)
_INSTRUCTION = re.compile(r"\s*(?P<name>[a-z]\w*)(?P<rest>.*)", re.DOTALL)
_DATA = re.compile(r"\s*(?:(?:local|task)\s+)?(?:const|pers|var)\b")
_HANDED = re.compile(r"\[\s*\[[^\[\]]*\](?:\s*,\s*\[[^\[\]]*\])+\s*\]")
EXTERNAL_AXES = tuple("abcdef")
NO_AXIS = 8.9e9
"""The value 9E9 for an axis not present."""
_INDEXED = re.compile(r"(\w+)\s*\{([^{},]*)\}")
_HEAD = re.compile(
    r"\s*(?:(?P<routine>(?:local\s+)?(?:proc|func\s+\w+|trap))\s+(?P<name>\w+)"
    r"|(?P<word>if|elseif|else|endif|while|endwhile|for|endfor|test|case|default|endtest|endproc|endfunc|endtrap|"
    r"module|endmodule|error|undo|backward|record)\b(?!\s*:=)|(?P<label>[a-z]\w*)\s*:(?!=))"
)
_UNTIL = {
    **dict.fromkeys(("if", "elseif"), re.compile(r"\bthen\b|;")),
    **dict.fromkeys(("while", "for"), re.compile(r"\bdo\b|;")),
    "test": re.compile(r"(?=\bcase\b|\bdefault\b|\bendtest\b|;)"),
    "case": re.compile(r":(?!=)|;"),
    "default": re.compile(r":|;"),
    "module": re.compile(r"\n|\)"),
    "record": re.compile(r"\bendrecord\b"),
}
_FLOW = {
    "if": "if", "test": "switch", "elseif": "case", "case": "case", "else": "else", "default": "else",
    "while": "while", "for": "while", **dict.fromkeys(("endif", "endtest", "endwhile", "endfor"), "end"),
}  # fmt: skip
_AFTER_CONDITION = re.compile(
    r"(?:(?<=[)\]}\"])|(?<=\w)(?<!\bif)(?<!\band)(?<!\bor)(?<!\bxor)(?<!\bnot)(?<!\bdiv)(?<!\bmod)(?=\s))\s*"
    r"(?!(?:and|or|xor|div|mod)\b)(?=[a-z])"
)
"""Between condition and statement of `IF condition statement;`: a name directly after a value."""


def _form(text: str) -> re.Pattern[str]:
    """Pattern of a literal: n is a number, and spaces may be anywhere."""
    parts = (rf"({NUMBER})" if part == "n" else re.escape(part) for part in re.findall(r"\w+|.", text))
    return re.compile(r"\s*".join(["", *parts, ""]))


_POSE = "[[n,n,n],[n,n,n,n]]"
_FRAMES = {
    "tooldata": _form(f"[true,{_POSE},[n,[n,n,n],[n,n,n,n],n,n,n]]"),
    "wobjdata": _form(f'[false,true,"",{_POSE},{_POSE}]'),
}
_TARGETS = {
    "robtarget": _form("[[n,n,n],[n,n,n,n],[n,n,n,n],[n,n,n,n,n,n]]"),
    "jointtarget": _form("[[n,n,n,n,n,n],[n,n,n,n,n,n]]"),
}


def literal_frames(kind: str, text: str) -> Array | None:
    """Frame (4, 4) in mm of a literal of tooldata or wobjdata; None for any other text."""
    literal = _FRAMES[kind].fullmatch(text)
    values = [float(number) for number in literal.groups()] if literal else []
    poses = [values[:7]] if kind == "tooldata" else [values[:7], values[7:]]
    if not values or not all(is_frame("quaternion", pose) for pose in poses):
        return None
    first, *second = (frame_of("quaternion", pose) for pose in poses)
    return first @ second[0] if second else first


class RapidStatements(RapidOffsets):
    def __init__(self, program: ProgramTexts) -> None:
        super().__init__(program)
        self.arrays: dict[str, list[str]] = {}
        """The keys of the elements of arrays of points."""
        self.shared: set[str] = set()
        """Points that all modules see, unless they declare the name themselves."""
        self.declares: list[set[str]] = []
        self.frames: set[str] = set()
        self.shadowed: dict[str, Unknown] = {}
        """Tools and work objects whose name has a different meaning in a routine."""
        self.by_name: Unknown | None = None
        """The place at which the program writes data selected by a name in a string."""
        for file, text in enumerate(self.texts):
            self.file = file
            for routine in _DEFINED.finditer(text):
                own, everywhere = self.scopes(routine[2])
                for scope in (own,) if routine[1] else (own, everywhere):
                    self.defined.setdefault(scope, []).append(own)

    def scopes(self, name: str) -> tuple[str, ...]:
        return f"{self.file}:{name}", name

    def read_module(self, file: int) -> None:
        self.file = file
        for begin, end, head in _statements(self.texts[file]):
            self.at = begin
            if head and head["routine"]:
                self.begin_routine(f"{file}:{head['name']}")
                self.numbers.loops.clear()
                if head["routine"].endswith("trap"):
                    why = self.why(f"the trap {head['name']} may run", head.start("name"))
                    self.beside.append(Call(str(self.routine), why))
            elif self.routine is None:
                continue
            elif head and head["label"]:
                self.add(JumpTarget(head["label"]))
            elif head:
                self._flow(head["word"], head.end(), end)
            else:
                self._statement(begin, end)
        self.end_routine()

    def _flow(self, word: str, begin: int, end: int) -> None:
        """Parse a block header with its condition in [begin, end), or a keyword that ends a block or begins a handler.

        A handler may run at any moment, and the routine may then continue anywhere.
        """
        self.at = begin
        if word == "if" and self.text[end - 1 : end] == ";":  # IF condition statement;
            statement = _AFTER_CONDITION.search(self.text, begin, end)
            start = statement.end() if statement else end
            self._functions(begin, start)
            self.blocks.keyword("if")
            self._statement(start, end - 1)
            self.blocks.close()
        elif word in ("endproc", "endfunc", "endtrap", "endmodule"):
            self.end_routine()
        elif word in ("error", "undo", "backward"):
            routine = str(self.routine).partition(" ")[0]
            self.begin_routine(f"{routine} handler {len(self.routines)}")
            why = self.why(f"the handler {word.upper()} may run")
            self.beside.append(Call(str(self.routine), why))
            self.broken.append(Call(routine, why))
        else:
            if word == "for":
                self.numbers.enter(self.text[begin:end])
            elif word == "endfor" and self.numbers.loops:
                self.numbers.loops.pop()
            self.blocks.keyword(_FLOW.get(word, ""), partial(self._functions, begin, end))

    def _functions(self, begin: int, end: int) -> None:
        closes = brackets(self.text, begin, end)
        for call in _CALL.finditer(self.text, begin, end):
            is_own = bool(self.named(call[1])) or call[1] not in FUNCTIONS
            if is_own:
                self.blocks.evaluated(self.text[begin : call.start()], self.call_of(call[1], call.start()))
            if is_own or call[1] in WRITES:
                self._handed(call[1], call.end(), closes.get(call.end() - 1, end))

    def _handed(self, name: str, begin: int, end: int) -> None:
        """Parse the arguments of a routine or instruction: tools and frames that it may set, and targets."""
        for handed in _HANDED.finditer(self.text, begin, end):
            if any(self.literal(kind, *handed.span(), "") for kind in _TARGETS):
                self.list_left("handed", handed[0], handed.start())
        for word in WORD.finditer(self.text, begin, end):
            for variable in (f"tool {word[0]}", f"frame {word[0]}"):
                if variable in self.frames:
                    self.set(variable, self.why(f"{word[0]} is passed to {name}", begin))

    def _statement(self, begin: int, end: int) -> None:
        inside = self.text[begin:end]
        self.at = begin = begin + len(inside) - len(inside.lstrip())
        if _DATA.match(self.text, begin, end) or not inside.strip():
            self._functions(begin, end)
        elif assigned := _ASSIGNED.fullmatch(self.text, begin, end):
            self._functions(assigned.start("right"), end)
            self._assigned(assigned)
        elif instruction := _INSTRUCTION.fullmatch(self.text, begin, end):
            self._functions(instruction.start("rest"), end)
            self._instruction(instruction)
        else:
            self.not_known(inside)

    def _instruction(self, instruction: re.Match[str]) -> None:
        name, rest = instruction["name"], instruction["rest"]
        if self.named(name):
            self.add(self.call_of(name))
            self._handed(name, *instruction.span("rest"))
        elif move := MOVE.fullmatch(name):
            self._move(instruction, move)
        elif name in SWITCHES:
            self.set(*SWITCHES[name])
        elif name in SETTINGS:
            variable, option, otherwise, chosen = SETTINGS[name]
            self.set(variable, chosen if re.search(rf"\\\s*{option}\b", rest) else otherwise)
        elif name == "goto":
            self.add(Jump((rest.strip(),)))
        elif name in ("return", "exit", "exitcycle"):
            self.add(End(halts=name != "return"))
        else:
            self._handed(name, *instruction.span("rest"))  # Incr, UnpackRawBytes, WaitWObj write.
            self._apply(name)

    def _apply(self, name: str) -> None:
        match EFFECT.get(name, "nothing" if name in FUNCTIONS else None):
            case "arm":
                self.add(Elsewhere())
            case "external":
                self.forget(EXTERNAL, self.why(f"{name} moves external axes"))
            case "program":
                self.add(ForgetAll(self.why(f"{name} may load or select another program")))
            case "data by name":
                self.by_name = self.why("data are written by a name in a string")
                self.add(ForgetAll(self.by_name))
            case None:
                self.not_known(name)

    def _assigned(self, assignment: re.Match[str]) -> None:
        """Parse an assignment to a tool or a work object. Assigned points are detected elsewhere, by name."""
        name, part, right = assignment["name"], assignment["part"], assignment["right"].strip()
        for kind, data in (("tool", "tooldata"), ("frame", "wobjdata")):
            if f"{kind} {name}" not in self.frames:
                continue
            frame, value = literal_frames(data, right), self.why(f"{name} is assigned there")
            if frame is not None and not part:
                self.set(f"{kind} {name}", as_value(frame))
            elif f"{kind} {right}" in {*self.frames, "tool tool0", "frame wobj0"} and not part:
                self.set(f"{kind} {name}", Ref(f"{kind} {right}"))
            else:
                self.set(f"{kind} {name}", value)

    def _move(self, instruction: re.Match[str], move: re.Match[str]) -> None:
        text, name, rest = self.text, instruction["name"], instruction.span("rest")
        kind = next(found for found in move.groups() if found)
        places = [place for place in arguments(text, *rest) if not text.startswith("\\", place[0])]  # \Conc, \WObj
        may_stop, count = move["search"] or move["contact"], 2 if kind == "c" else 1
        if move["search"]:  # The signal and the found point come first.
            places = places[2:]
        if len(places) < count + (2 if may_stop else 3):
            self._leave(self.at, "computed", instruction[0])
            return
        of_tool = places[count + 2 if TOOL_THIRD.fullmatch(name) else -1]
        tool = self._active("tool", text[slice(*of_tool)].partition("\\")[0].strip())
        wobj = _WOBJ.search(text, *rest)
        frame = self._active("frame", wobj["name"].strip() if wobj else "wobj0")
        if wobj and wobj["given"] == "?":
            frame = self.why(f"{wobj['name'].strip()} may be passed to a routine")
        tracked: Setting = "on" if move["egm"] or _TRACKED.search(text, *rest) else Ref("tracking")
        way, trusts = ("closest", Ref("conf j")) if kind in ("j", "absj") else ("line", Ref("conf l"))
        needs: Needs = (("displaced", Ref("shift")), ("tracked", tracked), ("switched", Ref("switch")))
        if kind == "c":
            needs += (("switched", Ref("switch arcs")),)
        arc = f"arc at {self.file}:{self.at}" if kind == "c" else ""
        for place, (begin, end) in enumerate(places[:count]):
            line = self.line(begin)
            state = Move("", way, self.file, line, tool, frame, needs, trusts, arc=arc, through=place == 0)
            self._target(begin, end, state, "jointtarget" if kind == "absj" else "robtarget", name)
        if may_stop:
            self.add(Elsewhere())
        if name.endswith("sync"):
            self.add(ForgetAll(self.why(f"{name} runs a procedure named in a string")))

    def _active(self, family: str, name: str) -> Unknown | Ref:
        if not WORD.fullmatch(name):  # Parts of records and elements of arrays are not tracked.
            return self.why(f"{name} is a part of other data")
        variable = f"{family} {name}"
        return self.shadowed.get(variable) or Ref(variable)

    def _target(self, begin: int, end: int, move: Move, kind: str, instruction: str) -> None:
        name = self.text[begin:end]
        name = name if OFFSET.match(name) else name.partition("\\")[0].strip()
        reached = self.reached(begin, end)
        if reached.offsets is None:
            offsets: list[tuple[str, Value]] = [("frame", self.why("the offset is not known from the texts", begin))]
        else:
            offsets = [(of, as_value(T)) for of, T in reached.offsets]
        key, begin, end = reached.point, reached.begin, reached.end
        if self.text.startswith("[", begin) and self.is_own:
            target = self.literal(kind, begin, end if offsets else begin + len(name), instruction)
            key = f"[{self.file}:{begin}"
            if target:
                self.points.declare(key, target)
        of_array, keys = self._elements(key)
        visible = self.is_own or (of_array in self.shared and of_array not in self.declares[self.file])
        if not visible or not self.points.declared.keys() >= {*keys}:
            self._leave(begin, "not_literal" if WORD.fullmatch(name) else "computed", name)
            return
        if not key.startswith("["):
            self.spent.add((self.file, begin))
        if self.points.declared[keys[0]].target.joints:
            move = replace(move, needs=())
        place = f"{self.file}:{begin}"
        self.blocks.add_one_of(
            [
                replace(move, key=f"{of}@{place}#{k}", base=of, offset=offset) if offset else replace(move, key=of)
                for of in keys
                for k, offset in enumerate(offsets or [None])
            ]
        )

    def _elements(self, key: str) -> tuple[str, list[str]]:
        """Name of a point or array, and the keys of the points it may mean: all if the index is unknown."""
        indexed = _INDEXED.fullmatch(key)
        elements = self.arrays.get(indexed[1]) if indexed else None
        if indexed is None or elements is None:
            return key, [key]
        values = [value for (value,) in self.numbers.every_value([indexed[2]], corners=False)]
        places = [int(value) - 1 for value in values if value.is_integer() and 0 < value <= len(elements)]
        known = len(places) == len(values) > 0
        return indexed[1], [elements[place] for place in places] if known else elements

    def _leave(self, at: int, reason: Literal["computed", "not_literal"], name: str) -> None:
        self.leave(reason, name, at, relative=re.search(r"\bcrobt\b", name) is not None)

    def literal(self, kind: str, begin: int, end: int, name: str) -> Target | None:
        """Target written as [[…],[…]…]; None for other text."""
        if not (literal := _TARGETS[kind].fullmatch(self.text, begin, end)):
            return None
        numbers, name = tuple(number_at(literal, k + 1) for k in range(len(literal.groups()))), self.as_written(name)
        line = self.line(self.text.index("[", begin))
        named = zip(EXTERNAL_AXES, (number.value for number in numbers[-6:]), strict=True)
        external = tuple((axis, coordinate) for axis, coordinate in named if coordinate < NO_AXIS)
        if kind == "jointtarget":
            return Target(name, self.file, line, "joints_deg", numbers[:6], external=external)
        values = tuple(int(max(-99, min(99, number.value))) for number in numbers[7:11])
        flags = Flags(values, agrees_with_confdata, quadrants, numbers[7:11])
        return Target(name, self.file, line, "quaternion", numbers[:7], flags=flags, external=external)


def _statements(text: str) -> Iterator[tuple[int, int, re.Match[str] | None]]:
    at = 0
    while at < len(text):
        head = _HEAD.match(text, at)
        if head is None:
            end = text.find(";", at)
            end = len(text) if end < 0 else end
            if text[at:end].strip():
                yield at, end, None
            at = end + 1
            continue
        end = head.end()
        if head["routine"]:
            opening = re.compile(r"\s*\(").match(text, end)
            end = max(end, text.find(")", end) + 1) if opening else end
        elif head["word"] and (until := _UNTIL.get(head["word"])):
            ended = until.search(text, end)
            end = max(end, ended.end()) if ended else len(text)
        yield at, end, head
        at = end


def agrees_with_confdata(arm: Arm, q: Array, values: tuple[int, ...], slack_rad: float) -> Mask:
    """Check the quadrants of axes 1, 4 and 6 of confdata, and cfx if several solutions agree.

    Some arms do not use cfx and show 0. It is the sum of 4 for a wrist behind axis 1, 2 for a wrist behind the lower
    arm, and 1 for a negative axis 5.
    """
    low = np.array(values[:3]) * np.pi / 2
    turned = q[:, [0, 3, 5]]
    good: Mask = np.all((turned > low - slack_rad) & (turned < low + np.pi / 2 + slack_rad), axis=1)
    if good.sum() > 1 or values[3]:
        good &= 4 * ~wrist_in_front(arm, q) + 2 * ~beyond_stretch(arm, q) + (q[:, 4] < 0) == values[3]
    return good


def quadrants(_arm: Arm, q: Array) -> tuple[int, ...]:
    return tuple(np.floor(q[[0, 3, 5]] / (np.pi / 2)).astype(int).tolist())
