"""Statements of KRL, and what each can change: the closed list of the dialect, with the names in `closed_lists`.

BAS(#PTP_PARAMS), BAS(#CP_PARAMS) and BAS(#FRAMES) use tool, base and interpolation frame of FDAT_ACT; BAS(#TOOL, n) and
BAS(#BASE, n) use the lists. BAS(#INITMOV) sets the values in the controller's bas.src.
"""

from __future__ import annotations

import re
from functools import partial
from typing import Literal

from analysis.apps.makers.kuka.closed_lists import CORRECTIONS, NOTHING, SYSTEM, effect_of
from analysis.apps.makers.kuka.positions import BY_NUMBER, KrlPositions
from analysis.apps.makers.points import as_value
from analysis.apps.makers.program_machine import (
    EXTERNAL,
    OFF,
    ComputedValue,
    Elsewhere,
    ForgetAll,
    Jump,
    JumpTarget,
    Move,
    Needs,
    Ref,
    Setting,
    Value,
)
from analysis.apps.makers.program_parser import arguments, brackets, word_set
from analysis.apps.makers.target import NamedFrame, Notice, ProgramTexts
from analysis.robot.kinematics.arm import Array

CORRECTION = "correction of bas.src"
"""State variable, off unless TOOL_CORR or BASE_CORR displaces tools and bases of inline forms."""
_WORD = re.compile(r"[A-Za-z_]\w*")
_CALL = re.compile(r"(?<![\w$.#])([A-Za-z_]\w*)\s*\(")
_MOVE = re.compile(r"\s*(?P<kind>S?PTP|S?LIN|S?CIRC|SPL)(?P<relative>_REL)?(?:\s+(?!=)|(?=\{))(?P<rest>.+)")
_WITH = re.compile(r"\sWITH\s(.*)")
_SPLINE = re.compile(r"\s*(?:PTP_SPLINE|SPLINE|ENDSPLINE)\b")
_WITH_PART = re.compile(r"\$(TOOL|BASE|IPO_MODE)\s*=\s*((?:[^,()]|\([^()]*\))*)")
_WITH_FDAT = re.compile(r"S(?:TOOL2?|BASE|IPO_MODE)\s*\(\s*(\w+)(?:\.\w+)?\s*\)")
_ENDS = re.compile(r"\s(?:C_DIS|C_PTP|C_VEL|C_ORI|C_SPL)\b.*")
_CONSTANT = re.compile(r"\bORI_TYPE?\s*=?\s*#CONST")
"""Pattern of a line that keeps the orientation at the start, regardless of the target."""
_STAYS = re.compile(r"\$(?:AXIS|POS)_ACT(?:_MES)?\s*(?:C_\w+\s*)*")
ELEMENT = re.compile(r"\s*\[\s*(\d+)\s*\]")
_INDEX = r"\[(?:[^\[\]]|\[[^\[\]]*\])*\]"
_ASSIGNED = re.compile(rf"\s*(?P<left>\$?[A-Za-z_][\w$]*(?:\s*{_INDEX})?(?:\.\w+(?:{_INDEX})?)*)\s*=(?!=)(?P<right>.*)")
_CYCLICAL = re.compile(r"\s*\$CYCFLAG\b")
"""Variables whose right side is evaluated repeatedly in the background."""
_AGGREGATE = re.compile(r"\{([^{}]*)\}")
_HANDED = re.compile(r"\b(?:TOOL_DATA|BASE_DATA|FDAT_ACT)\b|\$(?:TOOL|BASE|IPO_MODE|ORI_TYPE)\b(?!\s*=(?!=))")
"""The motion settings that a call may write to if they are passed to it."""
_OF_FDAT = {"TOOL": "fdat tool", "BASE": "fdat base", "IPO_MODE": "fdat ipo"}
_PARTS_OF = {
    "$TOOL": ("tool",), "$BASE": ("base",), "$IPO_MODE": ("external_tcp",), "$ORI_TYPE": ("switch",),
    "FDAT_ACT": (*_OF_FDAT.values(), "tool", "base"),
}  # fmt: skip
_BAS = re.compile(r"\s*BAS\s*\(\s*#(\w+)\s*(?:,([^()]*))?\)\s*")
_BAS_NOTHING = word_set(
    "VEL_PTP VEL_CP ACC_PTP ACC_CP ACC_GLUE PTP_DAT CP_DAT OUT_SYNC OUT_ASYNC NONE INIT VEL_ACC GROUP"
)
ROUTINE = re.compile(r"\s*(GLOBAL\s+)?(?:DEF|DEFFCT\s+\w+(?:\s*\[[^\]]*\])?)\s+(\w+)\s*\(")
_BESIDE = re.compile(r"\s*(?:(?:GLOBAL\s+)?INTERRUPT\s+DECL\b|TRIGGER\s+WHEN\b).*?\bDO\b(.*)")
_LABEL = re.compile(r"\s*([A-Za-z_]\w*)\s*:\s*")
_DECLARATION = re.compile(
    r"\s*(?:(?:DECL|INT|REAL|BOOL|CHAR|E6POS|E6AXIS|FRAME|POS|AXIS|STRUC|ENUM|SIGNAL|EXT|EXTFCT|EXTP|IMPORT|CHANNEL|"
    r"GLOBAL|CONST|DEFDAT|ENDDAT)\b.*|)"
)
_FLOW = {
    "IF": "if", "SWITCH": "switch", "CASE": "case", "ELSE": "else", "DEFAULT": "else", "FOR": "while", "WHILE": "while",
    "LOOP": "loop", "REPEAT": "loop", "UNTIL": "until", "EXIT": "break", "RETURN": "return",
    **dict.fromkeys(("ENDIF", "ENDSWITCH", "ENDLOOP", "ENDFOR", "ENDWHILE"), "end"),
}  # fmt: skip


class KrlStatements(KrlPositions):
    def __init__(self, program: ProgramTexts) -> None:
        super().__init__(program)
        self.fdat: dict[str, str] = {}
        self.fdat_written: set[str] = set()
        self._spline: dict[str, Setting] = {}
        self._may_keep_orientation = any(_CONSTANT.search(text) for text in self.texts)

    def statement(self, line: str) -> None:
        move, word = _MOVE.fullmatch(line), (_WORD.match(line.strip()) or [""])[0]
        if routine := ROUTINE.match(line):
            self.begin_routine(f"{self.module}:{routine[2]}")
        elif self.routine is None:
            if move:  # The line is outside all routines, so the time of execution is unknown.
                self.list_left("not_understood", line)
        elif word in ("END", "ENDFCT"):
            self.end_routine()
        elif word == "GOTO":
            self.add(Jump((line.split()[1] if len(line.split()) > 1 else "",)))
        elif move:
            self._functions(line)
            self._move(line, move)
        elif action := _BESIDE.match(line):  # of an interrupt or a trigger
            if _ASSIGNED.match(action[1]):
                text = re.sub(r"\bPRIO\s*=.*", "", action[1])
                why = self.why("an interrupt may set the value at any moment")
                self.concurrently(why, partial(self._other, text))
            else:
                self._calls_concurrently(action[1])
        elif word in _FLOW:
            self.blocks.keyword(_FLOW[word], partial(self._functions, line))
        elif label := _LABEL.fullmatch(line):
            self.add(JumpTarget(label[1]))
        else:
            self._other(line)

    def submit(self, line: str) -> None:
        """Parse a line of a submit program, which runs in parallel: it may set tools and bases."""
        why = self.why(f"{self.names[self.file]} runs in parallel and may set the value at any moment")
        if (assigned := _ASSIGNED.fullmatch(line)) and _HANDED.search(assigned["left"]):
            self.concurrently(why, partial(self._assigned, assigned["left"], assigned["right"]))
        for call in _CALL.finditer(line):
            if self.named(call[1]) or effect_of(call[1], "") != "nothing":
                self.concurrently(why, partial(self._written_by, call[1], line[call.end() :]))

    def _functions(self, line: str) -> None:
        """Parse the function calls in a line. Arguments may be written, and may be targets."""
        closes = brackets(line)
        for call in _CALL.finditer(line):
            end = closes.get(call.end() - 1, len(line))
            effect = None if self.named(call[1]) else effect_of(call[1], line[call.end() : end], self.texts)
            if effect == "nothing":
                continue
            if effect is None:
                self.blocks.evaluated(line[: call.start()], self.call_of(call[1]))
                for handed in _AGGREGATE.finditer(line, call.end(), end):
                    if self.literal(handed[1], 0, "")[0]:
                        self.list_left("handed", handed[0])
            if effect in ("arm", "base"):
                self.add(Elsewhere())
            if effect == "base":
                why = self.why(f"{call[1]} may correct the base")
                self.set("base", why)
                self.set(CORRECTION, why)
                self.forget("BASE_DATA", why)
            self._written_by(call[1], line[call.end() :])

    def _written_by(self, name: str, after: str) -> None:
        """Forget the motion settings that a call may write to, given the text with the arguments."""
        for argument in dict.fromkeys(match[0] for match in _HANDED.finditer(after)):
            why = self.why(f"{name} receives {argument} and may change the value")
            for variable in _PARTS_OF.get(argument, ()):
                self.set(variable, why)
            if argument not in _PARTS_OF:
                self.forget(argument, why)

    def _calls_concurrently(self, text: str) -> None:
        for call in _CALL.finditer(text):
            after = text[call.end() :]
            effect = None if self.named(call[1]) else effect_of(call[1], after, self.texts)
            if effect not in ("nothing", "arguments"):
                self.runs_beside(call[1])
            if effect != "nothing":
                why = self.why(f"{call[1]} may run at any moment")
                self.concurrently(why, partial(self._written_by, call[1], after))

    def _other(self, line: str) -> None:
        text = line.strip()
        if (bas := _BAS.fullmatch(line)) and not self.named("BAS"):
            self._bas(bas[1], (bas[2] or "").strip())
        elif self.is_copy(line):
            return
        elif assigned := _ASSIGNED.fullmatch(line):
            self._functions(assigned["right"])
            if _CYCLICAL.match(line):
                self._calls_concurrently(assigned["right"])
            self._assigned(assigned["left"], assigned["right"])
        elif not _DECLARATION.fullmatch(line):
            if _SPLINE.match(line):
                suffix = _WITH.search(line)
                self._spline = self._with(suffix[1]) if suffix else {}
            if NOTHING.fullmatch(line) or _CALL.match(text):
                self._functions(line)
            elif text == "RESUME":  # It leaves the interrupted routines, wherever they are.
                self.add(ForgetAll(self.why("RESUME ends the interrupted routines at any statement")))
            else:
                self.not_known(text)

    def _bas(self, command: str, argument: str) -> None:
        match command:
            case "TOOL" | "BASE":
                computed = self.why(f"{command} {argument} is computed")
                number = _by_number(f"{command}_DATA", int(argument)) if argument.isdigit() else computed
                self.set(command.lower(), number)
            case "PTP_PARAMS" | "CP_PARAMS" | "FRAMES":
                self.set("tool", Ref("fdat tool"))
                self.set("base", Ref("fdat base"))
                if command == "CP_PARAMS" and self._may_keep_orientation:
                    self.set("switch", self.why("motion data may keep the orientation"))
                self.set("external_tcp", Ref("fdat ipo"))
            case "INITMOV":
                why = self.why("BAS(#INITMOV) sets the controller's defaults")
                self.set("tool", why)
                self.set("base", why)
                for variable in ("external_tcp", "switch", CORRECTION):
                    self.set(variable, OFF)
            case _ if command not in _BAS_NOTHING:
                self.not_known(f"BAS(#{command})")

    def _assigned(self, left: str, right: str) -> None:
        """Parse an assignment. Assigned points and variables are detected elsewhere, by name."""
        left, value = re.sub(r"\s", "", left), right.strip()
        name = re.split(r"[.\[]", left)[0]
        match name:
            case "$TOOL" | "$BASE":
                part = self.why(f"only a part of {name} is set")
                self.set(name[1:].lower(), self.place(right) if left == name else part)
            case "$IPO_MODE":
                self.set("external_tcp", OFF if value == "#BASE" else "on")
            case "$ORI_TYPE":
                modes: dict[str, Value] = {"#VAR": OFF, "#JOINT": OFF, "#CONSTANT": "on"}
                self.set("switch", modes.get(value, self.why("$ORI_TYPE is computed")))
            case "TOOL_DATA" | "BASE_DATA":
                self._data(left, right)
            case "FDAT_ACT":
                for part_of_fdat, of in self._fdat(value if left == name else "a part of FDAT_ACT").items():
                    self.set(_OF_FDAT[part_of_fdat], of)
                why = self.why("FDAT_ACT is set, but not used by BAS")
                self.set("tool", why)
                self.set("base", why)
            case _ if CORRECTIONS.fullmatch(name) and value not in ("FALSE", "$NULLFRAME"):
                self.set(CORRECTION, self.why(f"{left} corrects the tool or base"))
            case _ if name.startswith("$") and not SYSTEM.fullmatch(name):
                self.not_known(left)

    def _data(self, left: str, right: str) -> None:
        family, number = left[:9], re.match(r"\w+\[(\d+)\](\.?)", left)
        if number is None or (not number[2] and number.end() < len(left)):
            self.forget(family, self.why(f"{left} is set"))
            return
        frame, value = self.frame(right), self.why(f"{left} is {'set' if number[2] else 'computed'}")
        variable = f"{family}[{int(number[1])}]"
        if number[2]:
            self.set(variable, value)
        elif frame is not None:
            self.state(family, number[1], frame)
            self.set(variable, as_value(frame))
        else:
            self.set(variable, self.place(right) if BY_NUMBER.fullmatch(right.strip()) else value)

    def state(self, family: str, number: str, frame: Array) -> None:
        kind: Literal["tool", "frame"] = "tool" if family == "TOOL_DATA" else "frame"
        self.points.sets.append(NamedFrame(number, kind, self.file, self.line(), as_value(frame)))

    def _fdat(self, right: str) -> dict[str, Setting]:
        name = next((scope for scope in self.scopes(right) if scope in self.fdat), "")
        text = right[1:-1] if right.startswith("{") and right.endswith("}") else self.fdat.get(name)
        if text is None or name in self.fdat_written:
            return dict.fromkeys(_OF_FDAT, self.why(f"{right} is unknown here"))
        outside = re.search(r"\bIPO_FRAME\s+#(?!BASE\b)", text)
        settings: dict[str, Setting] = {"IPO_MODE": "on" if outside else OFF}
        for family in ("TOOL", "BASE"):
            number = re.search(rf"\b{family}_NO\s+(\d+)", text)
            absent = self.why(f"{right} has no {family}_NO")
            settings[family] = _by_number(f"{family}_DATA", int(number[1])) if number else absent
        return settings

    def _with(self, text: str) -> dict[str, Setting]:
        """Tool, base and mode given after WITH for a motion or a spline."""
        state: dict[str, Setting] = {}
        for name, stated in _WITH_PART.findall(text):
            part, value = name, stated.strip()
            if fdat := _WITH_FDAT.fullmatch(value):
                state[part] = self._fdat(fdat[1])[part]
            elif part == "IPO_MODE":
                state[part] = OFF if value == "#BASE" else "on"
            else:
                state[part] = self.place(value)
        if _CONSTANT.search(text):
            state["ORI_TYPE"] = "on"
        elif re.search(r"\bSORI_TYP\b", text) and self._may_keep_orientation:
            state["ORI_TYPE"] = self.why("motion data may keep the orientation")
        return state

    def _move(self, line: str, move: re.Match[str]) -> None:
        kind, end = move["kind"].lstrip("S"), move.end("rest")
        active = {"TOOL": "tool", "BASE": "base", "IPO_MODE": "external_tcp", "ORI_TYPE": "switch"}
        state: dict[str, Setting] = {name: Ref(part) for name, part in active.items()} | self._spline
        if suffix := _WITH.search(line, move.start("rest")):
            end = suffix.start()
            state |= self._with(suffix[1])
        if zone := _ENDS.search(line, move.start("rest"), end):
            end = zone.start()
        if _STAYS.fullmatch(line[move.start("rest") : end].strip()):
            return
        places = arguments(line, move.start("rest"), end)
        if move["relative"]:
            self.leave("relative", line[places[0][0] : end], relative=True)
            return
        count = 2 if kind == "CIRC" else 1
        for place, (start, stop) in enumerate(places[:count]):
            text = line[start:stop]
            if len(places) > count:
                # An arc of CA degrees does not end at the target, and keeps the posture at the start.
                self.list_left("arc", text)
                fact = "an arc of a given angle may end at different coordinates of the external axes"
                self.forget(EXTERNAL, self.why(fact))
            elif not self.is_own and self.literal(text[1:-1], 0, "")[1] == "incomplete":
                self.add(Elsewhere(self.why(text)))  # {Z 100} keeps the other coordinates of the arm.
            else:
                arc = f"arc at {self.file}:{self.at}" if count > 1 else ""
                self._target(text, start, kind, state, arc, through=place == 0)

    def _target(self, text: str, start: int, kind: str, state: dict[str, Setting], arc: str, *, through: bool) -> None:
        copied = self.copies.get(text)
        key = self._point(copied or text, start, kind)
        if key is None:
            self.leave("not_literal" if _WORD.fullmatch(text) else "computed", text)
            return
        is_line, point = kind != "PTP", self.points.declared[key].target
        needs: Needs = (("external_tcp", state["IPO_MODE"]), ("switched", state["ORI_TYPE"]))
        needs = () if point.joints else needs[: 1 + is_line]
        # A line or an arc keeps the configuration at the start and ignores the flags, so the path has to lead to the
        # same configuration. A single flag is not compared.
        of_lines = "checked" if point.flags and len(point.flags.values) == 2 else OFF
        moved_to, base, offset = key, "", None
        if copied:
            moved_to, base = f"{key} copied at {self.file}:{self.at}", key
            offset = "frame", ComputedValue((self.variable_of(text),), lambda values: values[0])
        self.add(
            Move(
                moved_to, "line" if is_line else "joint", self.file, self.line(), state["TOOL"], state["BASE"], needs,
                of_lines if is_line else "on", base=base, offset=offset, arc=arc, through=through,
            )
        )  # fmt: skip

    def _point(self, text: str, start: int, kind: str) -> str | None:
        if text.startswith("{") and text.endswith("}"):
            target, reason = self.literal(text[1:-1], start + 1, kind)
            if target is None:
                return None
            self.points.declare(key := f"{{{self.file}:{self.at + start}", target, reason)
            return key
        element = ELEMENT.search(text)
        if element and element.end() == len(text):
            text = f"{text[: element.start()].strip()}[{int(element[1])}]"
        if (found := self.key(text)) is None:
            return None
        self.spent.add((self.file, self.at + start))
        of_file = self.points.declared[found].target.file
        if of_file >= self.own > self.file:
            fact = f"{text} is a point of {self.names[of_file]}, which this program shares: its numbers stay"
            if not any(notice.text == fact for notice in self.points.notices):
                self.points.notices.append(Notice(self.file, self.line(), fact))
        return found


def _by_number(family: str, number: int) -> ComputedValue:
    """Tool or base of the lists as BAS and the inline forms select it, with the corrections of bas.src."""

    def make(values: tuple[Value, ...]) -> Value:
        correction, value = values[0], values[1] if number else "0"
        return value if correction == OFF else correction

    return ComputedValue((CORRECTION, *([f"{family}[{number}]"] if number else [])), make)
