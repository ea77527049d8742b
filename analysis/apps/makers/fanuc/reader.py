"""Reader of targets in listings of FANUC's teach pendant language (.LS): P[n] with joints, or a pose with CONFIG.

Source: FANUC, R-30iB Operator's Manual (Basic Operation) B-83284EN, chapter 4, and public backups in .LS. UF 0 is the
world, assumed to be the robot's base as in the arms of the library, and UT 0 is the flange. A listing is a single
program; others in its directory are read for calls. The arm is motion group 1. Other groups (guns, positioners) matter
only if a move is coordinated with them (COORD).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from analysis.apps.makers.configuration import agreeing, turns
from analysis.apps.makers.fanuc.backup import ARM, FRAMES, frames_in, other_arm
from analysis.apps.makers.fanuc.instructions import INSIDE, NOTHING, OPTIONS, SEARCH, switch_by
from analysis.apps.makers.numbers import Decimals, frame_of, is_frame
from analysis.apps.makers.points import as_value, is_moved
from analysis.apps.makers.program_machine import (
    OFF,
    ComputedValue,
    Elsewhere,
    End,
    ForgetFamily,
    Jump,
    JumpTarget,
    Move,
    Needs,
    Ref,
    Set,
    Setting,
    Unknown,
    Value,
    called_routines,
)
from analysis.apps.makers.program_parser import NUMBER, ProgramParser, arguments, number_at
from analysis.apps.makers.program_reader import ProgramReader, Remark
from analysis.apps.makers.target import Flags, Form, Notice, Parsed, ProgramTexts, Target
from analysis.correction.reasons import Reason
from analysis.robot.kinematics.arm import Arm, Array, Mask

_DECIMALS = Decimals(place=(3, 7), turn=(3, 9))
"""A controller prints three decimals; whether it accepts more is unknown, so none are added."""
_BLANK = re.compile(
    r"(?<=:)[ \t]*(?:!|//|--eg:)[^\n]*|^[ \t]*(?:\d+[ \t]*)?:[ \t]*(?:!|//)[^\n]*|\"[^\"\n]*\"|MESSAGE\[[^\n]*",
    re.MULTILINE,
)
_LINE = re.compile(r"^[ \t]*+(?:(?P<number>\d+)?[ \t]*+:(?P<body>[^\n]*)|(?P<dashes>-{4,}))", re.MULTILINE)
_POINT = re.compile(r"(?<![A-Z])P\[\s*(\d{1,6})\s*(?::[^\]\n]{0,40})?\]")
_ANY_POINT = re.compile(r"(?<![A-Z])P\[\s*(?:(\d{1,6})\b|[^\]\n]{0,60})")
_POSITION = re.compile(r"\bP\[\s*(\d{1,6})\s*(?::(?P<remark>[^\]\n]{0,40}))?\]\s*\{(?P<numbers>[^{}]*)\}")
_MOVE = re.compile(
    rf"(?P<kind>[JLCAS])\s+(?P<point>PR?{INSIDE}|PAL_\w+{INSIDE})\s*(?P<second>PR?{INSIDE})?(?P<rest>.*)"
)
_OFFSET = re.compile(r"\b(?:Tool_)?Offset\b(?:\s*,\s*PR\[[^\]]*\])?|\bVOFFSET\b(?:\s*,\s*VR\[[^\]]*\])?", re.IGNORECASE)
_SKIP = re.compile(
    r"\bSkip\s*,\s*LBL\[\s*([^\]:]*)[^\]]*\](?:\s*,\s*(?P<register>PR\[.*?\]\s*=\s*[LJ]POS))?", re.IGNORECASE
)
_TOUCHES = re.compile(r"\bSearch\s*\[[^\]]*\]", re.IGNORECASE)
_ALONG = re.compile(
    r"\b(?:TA|TB|DB|TIME\s+(?:BEFORE|AFTER))\s+[^,;]*,\s*"
    rf"(?P<action>P-SPS|POINT_LOGIC|CALL\s+[\w-]+(?:\s*\([^)]*\))?|[A-Z]+{INSIDE}\s*=\s*\S+)",
    re.IGNORECASE,
)
"""An action at a time or distance before or after the arrival. Other options can follow it."""
_LOGIC = re.compile(r"\b(?:P-SPS|POINT_LOGIC)\b", re.IGNORECASE)
"""An action of several lines, which follow the move up to a line of dashes."""
_SELECTED = re.compile(r"(UFRAME_NUM|UTOOL_NUM)\s*(?:\[\s*GP1\s*\])?\s*=\s*(.*)", re.IGNORECASE)
"""Selection of a frame. UF and UT of a position have to agree with it: a controller checks that (INTP-250 to 253),
unless a system variable disables the check ($FRM_CHKTYP, $MCR.$UFRCHK)."""
_FRAME = re.compile(r"(UFRAME|UTOOL)\s*\[\s*(?:GP\d\s*:\s*)?(.*?)\]\s*=.*", re.IGNORECASE)
_REGISTER = re.compile(r"PR\[\s*(?:GP1\s*:\s*)?((?:[^\[\]]|\[[^\[\]]*\])*)\]\s*=\s*(.*)")
_WHOLE = re.compile(r"PR\[\s*(?:GP1\s*:\s*)?(\d+)\s*(?::[^\]]*)?\]")
_CALL = re.compile(r"CALL\s+([\w-]+)\s*(?:\(.*\))?", re.IGNORECASE)
_RUN = re.compile(r"(?:RUN\s+|MONITOR\s+(?!END)|ERROR_PROG\s*=\s*|RESUME_PROG[^=]*=\s*)([\w-]+)", re.IGNORECASE)
_SYSTEM_FRAMES = re.compile(r"\$(?:MNUFRAME|MNUTOOL)", re.IGNORECASE)
_CONDITION = re.compile(r"(TOOL_)?OFFSET\s+CONDITION\b\s*(.*)", re.IGNORECASE)
_EXTERNAL_TCP = re.compile(r"\bRTCP\b", re.IGNORECASE)
_COORDINATED = re.compile(r"\bCOORD\b(?:\[[^\]]*\])?", re.IGNORECASE)
_TRACKING = re.compile(r"\bLINE_TRACK|\bTRACK\b|TRACK_SCHEDULE")
_SCHEDULE = re.compile(r"TRACK_SCHEDULE_NUM\w*\s*:\s*(\w+)")
"""The conveyor of a listing, 0 for none: controllers with the option write this header for each listing."""
_FRAMES = re.compile(r"UF\s*:\s*(\w+)\s*,\s*UT\s*:\s*(\w+)")
_CONFIG = re.compile(r"CONFIG\s*:\s*'\s*([FN])?\s*([UD])?\s*([TB])?\s*,\s*(-?\d+)\s*,\s*(-?\d+)\s*,\s*(-?\d+)\s*'")
_JOINT = re.compile(rf"\bJ([1-6])\s*=\s*({NUMBER})\s*deg")
_AXIS = re.compile(rf"\b([XYZWPR])\s*=\s*({NUMBER})\s*(?:mm|deg)")
_REMOTE = re.compile(rf"\bR[XYZWPR]\s*=\s*{NUMBER}")
"""Coordinates of a workpiece in the hand, relative to a tool that stands beside the arm."""
_OTHER_AXIS = re.compile(rf"\b(E\d|J[7-9])\s*=\s*({NUMBER})")
_GROUP = re.compile(r"\bGP(\d)\s*:")
_GROUPS = re.compile(r"^DEFAULT_GROUP\s*=\s*([1*])", re.MULTILINE)
"""The first motion group of a listing, the arm: 1 if it moves it, * if not."""
_ELBOW_RAD = np.radians(67.5)
"""Middle of the range of J2 + J3, the angle of the elbow: -70° to 205° of an LR Mate 200iD (ros-industrial/fanuc,
lrmate200id_macro.xacro). No source states the range of other arms."""


@dataclass(frozen=True)
class _Line:
    text: str
    at: int
    last: int
    """Position of the last line of the statement."""
    logic: tuple[_Line, ...] = ()


@dataclass(frozen=True)
class _Way:
    kind: str
    options: str
    offsets: Sequence[str]
    arc: str = ""
    through: bool = False


class _TpReader(ProgramParser):
    """Only the positions of the program itself are points."""

    def __init__(self, program: ProgramTexts) -> None:
        super().__init__(program, _BLANK)
        together = "\n".join(self.texts)
        self.stated = frames_in(program.tables)
        self.raw = program.texts
        """Texts with remarks, which `texts` lacks."""
        self.labels: tuple[str, ...] = ()
        self.scope = ""
        """Prefix of the labels in the logic along a move, which can repeat those of the listing."""
        self.logics = 0
        self.registers = {int(register[1]) for register in _WHOLE.finditer(together)}
        self.conditions = frozenset(re.findall(r"\bOFFSET\s+CONDITION\s+PR\[\s*(\w+)", together))
        """Numbers of the registers in OFFSET CONDITION of any listing."""
        for file, text in enumerate(self.texts):
            named = re.search(r"^/PROG\s+([\w-]+)", text, re.MULTILINE)
            for name in {self.names[file].rpartition(".")[0].upper(), *((named[1].upper(),) if named else ())}:
                if self.defined.get(name) != ["0"]:  # The program itself has priority.
                    self.defined.setdefault(name, []).append(str(file))
            self.file = file
            for position in _POSITION.finditer(text, _section(text, "POS", len(text))):
                self._position(position, is_own=file == 0)

    def _position(self, position: re.Match[str], *, is_own: bool) -> None:
        name, begin, body = f"P[{position[1]}]", position.start("numbers"), position["numbers"]
        reason: Reason | None = None
        if groups := [*_GROUP.finditer(body)]:
            ends = [*(group.start() for group in groups[1:]), len(body)]
            arm = [(group.end(), end) for group, end in zip(groups, ends, strict=True) if group[1] == "1"]
            begin, body = (begin + arm[0][0], body[slice(*arm[0])]) if arm else (begin, "")
            reason = None if arm else "other_robot"
        external = tuple((axis[1], float(axis[2])) for axis in _OTHER_AXIS.finditer(body))
        self.points.axes |= {axis for axis, coordinate in external if is_moved(coordinate)}
        if not is_own:
            return
        joints = {int(joint[1]): number_at(joint, 2, begin) for joint in _JOINT.finditer(body)}
        axes = {"XYZWPR".index(axis[1]): number_at(axis, 2, begin) for axis in _AXIS.finditer(body)}
        numbers = tuple(number for _, number in sorted((joints or axes).items()))
        count = len((_JOINT if joints else _AXIS).findall(body))
        frames, config, flags = _FRAMES.search(body), _CONFIG.search(body), None
        if config and all(config[k] for k in (1, 2, 3)):
            letters = config[1] == "F", config[2] == "U", config[3] == "T"
            flags = Flags((*map(int, letters), *(int(config[k][:6]) for k in (4, 5, 6))), _agreeing)
        frame, tool = (frames[1], frames[2]) if frames else ("F", "F")
        form: Form = "joints_deg" if joints or reason else "roll_pitch_yaw"
        line = self.line(position.start())
        remark = self.raw[self.file][slice(*position.span("remark"))] if position["remark"] else ""
        target = Target(name, 0, line, form, numbers, tool, frame, flags, external=external, remark=remark)
        if _REMOTE.search(body):
            reason = "external_tcp"
        self.points.declare(position[1], target, reason or (None if len(numbers) == count == 6 else "incomplete"))

    def read(self, file: int) -> None:
        self.file, text = file, self.texts[file]
        middle = _section(text, "POS", len(text))
        begin = _section(text, "MN", 0, middle)
        self.begin_routine(str(file))
        self.labels = tuple(re.findall(r"\bLBL\[\s*(\d+)", text[begin:middle]))
        schedule = _SCHEDULE.search(text, 0, begin)
        if _TRACKING.search(text, 0, begin) and not (schedule and schedule[1] == "0"):
            self.set("tracking", "on")
        self.at = 0
        self._forget_conditions("no line of this listing sets the offset")
        for line in _lines(text, begin, middle):
            self.at = line.at
            self._statement(line.text, line.last, line.logic)
        self.end_routine()

    def add_background(self) -> None:
        """Add what listings without the arm's motion group set, if no listing calls them.

        Background logic, or a task started by a signal or another controller, runs them at any moment.
        """
        called = called_routines(self.routines.values()) | {call.name for call in self.beside}
        for file in range(self.own, len(self.texts)):
            groups = _GROUPS.search(self.texts[file])
            if str(file) in called or groups is None or groups[1] == "1":
                continue
            why = Unknown(file, 1, f"{self.names[file]} may run at any moment: no listing calls it")
            sets = [one for one in self.routines.get(str(file), ()) if isinstance(one, Set | ForgetFamily)]
            self.concurrently(why, partial(self.add, *sets))

    def _statement(self, text: str, last: int, logic: tuple[_Line, ...] = ()) -> None:
        if move := _MOVE.fullmatch(text):
            self._move(move, last, logic)
            return
        self._mentioned(text)
        if not text or text.upper() in self.neutral or self._flow(text, last) or self._sets(text):
            return
        if switch := switch_by(text):
            self.set(*switch)
        elif SEARCH.fullmatch(text):
            self._forget_registers()
        elif not _POINT.match(text) and not NOTHING.fullmatch(text):
            self.not_known(text, may_be_neutral=True)
            if "LBL[" in text:
                self.add(Jump(self.labels, falls=True))

    def _flow(self, text: str, last: int) -> bool:
        """Parse an instruction of flow control; False for any other instruction."""
        word = (re.match(r"[A-Za-z_]+", text) or [""])[0].upper()
        if word == "FOR":
            self.blocks.keyword("while")
        elif word == "ELSE" and "," not in text:
            self.blocks.keyword("else")
        elif word in ("IF", "ELSEIF", "SELECT", "ELSE") or text.startswith("="):
            if re.search(r"\bTHEN$", text, re.IGNORECASE):
                self.blocks.keyword("case" if word == "ELSEIF" else "if")
            else:  # IF …, action; and the lines of SELECT
                action = arguments(text, 0, len(text))[1:2]
                self.blocks.keyword("if")
                self._statement(text[action[0][0] :] if action else "", last)
                self.blocks.close()
        elif word in ("ENDIF", "ENDFOR"):
            self.blocks.close()
        elif label := re.match(r"LBL\[\s*(\d+)", text):
            self.add(JumpTarget(self.scope + label[1]))
        elif word in ("JMP", "WAIT", "VISION") and "LBL[" in text:
            self.add(Jump(self._labels(text), falls=word != "JMP"))
        elif word in ("END", "ABORT"):
            self.add(End(halts=word == "ABORT"))
        elif call := _CALL.fullmatch(text):
            self.add(self.call_of(call[1]))
            self._forget_conditions("a listing that is called may set the offset")
        elif run := _RUN.match(text):
            self.runs_beside(run[1])
        else:
            return False
        return True

    def _labels(self, text: str) -> tuple[str, ...]:
        """Labels of a jump: all if the number is in a register."""
        named = tuple(re.findall(r"\bLBL\[\s*(\d+)\s*[\]:]", text))
        labels = self.labels if re.search(r"\bLBL\[\s*[A-Za-z]", text) else named
        return tuple(dict.fromkeys((*labels, *(self.scope + label for label in labels))))

    def _sets(self, text: str) -> bool:
        """Parse an instruction that sets a frame, a register or a mode; False for any other instruction."""
        why = self.why(f"{text} sets it")
        if selected := _SELECTED.fullmatch(text):
            number = selected[2].strip()
            self.set(selected[1].upper(), str(int(number)) if number.isdigit() else why)
        elif frame := _FRAME.fullmatch(text):
            family, number = frame[1].upper(), frame[2].split(":")[0].strip()
            if number.isdigit():
                self.set(f"{family}[{int(number)}]", _register(text.partition("=")[2], why))
            else:
                self.forget(family, why)
        elif register := _REGISTER.fullmatch(text):
            self._set_register(register)
        elif _SYSTEM_FRAMES.match(text):
            for family in ("UFRAME", "UTOOL"):
                self.forget(family, why)
                self.set(f"{family}_NUM", why)
        elif condition := _CONDITION.fullmatch(text):
            self.set(f"{(condition[1] or '').upper()}OFFSET CONDITION", _register(condition[2], why))
        else:
            return False
        return True

    def _set_register(self, assignment: re.Match[str]) -> None:
        index, _, axis = assignment[1].partition(",")
        # The remark follows the last number: PR[5:base], PR[5,1:base]
        number, axis = (text.partition(":")[0].strip() for text in (index, axis))
        right = assignment[2].strip()
        right = right[1:-1].strip() if right.startswith("(") else right
        why = self.why(f"{assignment[0]} sets it")
        if not number.isdigit():
            self._forget_registers()
            return
        register, copied = f"PR{int(number)}", _WHOLE.fullmatch(right)
        if number in self.conditions:  # No manual states when the controller reads the register.
            self._forget_conditions(f"{assignment[0]} sets it")
        if axis.isdigit():
            self.set(f"{register}[{axis}]", right if re.fullmatch(NUMBER, right) else why)
            return
        self.forget(register, why)
        self.set(f"{register}[form]", self._form(right, why))
        for k in range(1, 7):
            if re.fullmatch(r"LPOS\s*-\s*LPOS", right):
                self.set(f"{register}[{k}]", "0")
            elif copied and copied[1] != number:
                self.set(f"{register}[{k}]", Ref(f"PR{int(copied[1])}[{k}]"))

    def _form(self, text: str, why: Unknown) -> Setting:
        """The form of a register after an assignment: six joint angles are no frame."""
        if copied := _WHOLE.fullmatch(text):
            return Ref(f"PR{int(copied[1])}[form]")
        point = _POINT.fullmatch(text)
        declared = self.points.declared.get(point[1]) if point and self.is_own else None
        if declared:
            return why if declared.target.joints else OFF
        return OFF if re.fullmatch(r"LPOS(?:\s*-\s*LPOS)?", text) else why

    def _forget_registers(self) -> None:
        why = self.why("the line may set any position register")
        for register in self.registers:
            self.forget(f"PR{register}", why)
        self._forget_conditions("the line may set any position register")

    def _forget_conditions(self, fact: str) -> None:
        """Make the offsets of OFFSET CONDITION unknown, if a listing sets them."""
        for variable in ("OFFSET CONDITION", "TOOL_OFFSET CONDITION") if self.conditions else ():
            self.set(variable, self.why(fact))

    def _mentioned(self, text: str) -> None:
        """Mark the points in an instruction as changed: all if the number is in a register."""
        for mention in _ANY_POINT.finditer(text) if self.is_own else ():
            for key in [mention[1]] if mention[1] else list(self.points.declared):
                self.change(key)

    def _move(self, move: re.Match[str], last: int, logic: tuple[_Line, ...]) -> None:
        offsets, options = _OFFSET.findall(move["rest"]), _OFFSET.sub("", move["rest"])
        at, along, touches = self.at, _ALONG.search(options), _TOUCHES.search(options)
        options = _TOUCHES.sub("", _ALONG.sub("", options, count=1))
        if skip := _SKIP.search(options):
            options = options[: skip.start()] + options[skip.end() :]
        # An action along the way may happen before or after the arm reaches the target.
        self._action(along, last, logic)
        self.at = at
        arc = f"arc at {at}" if move["second"] else ""
        self._target(move["point"], at, _Way(move["kind"], options, offsets, arc, through=True))
        if move["second"]:
            through = move["second"] == move["point"]
            self._target(move["second"], last, _Way(move["kind"], options, offsets, arc, through))
        if skip:
            if register := _REGISTER.fullmatch(skip["register"] or ""):
                self._set_register(register)
            self.add(Elsewhere(), Jump(self._labels(skip[0]), falls=True))
        elif touches:  # The arm stops where it touches something.
            self.add(Elsewhere())
        self._action(along, last, logic)

    def _action(self, along: re.Match[str] | None, last: int, logic: tuple[_Line, ...]) -> None:
        """Parse the action along a move, which may happen before or after it."""
        if along is None:
            return
        self.blocks.keyword("if")
        if _LOGIC.fullmatch(along["action"]):
            self.logics += 1
            self.scope = f"{self.logics}:"
            for row in logic:
                self.at = row.at
                self._statement(row.text, row.last)
            self.scope = ""
        else:
            self._statement(along["action"].strip(), last)
        self.blocks.close()

    def _target(self, text: str, at: int, way: _Way) -> None:
        point, line = _POINT.fullmatch(text), self.line(at)
        is_relative = re.search(r"\bINC\b", way.options, re.IGNORECASE) is not None
        if point is None or not self.is_own or point[1] not in self.points.declared:
            if point is None and text.startswith("P[") and self.is_own:
                self._any_target(at, way)
            self.leave("not_literal" if point and self.is_own else "computed", text, at, relative=is_relative)
            return
        if is_relative:
            self._mentioned(text)
            self.leave("relative", text, at)
            return
        unknown = OPTIONS.sub("", _COORDINATED.sub("", _EXTERNAL_TCP.sub("", way.options))).strip(", ")
        target = self.points.declared[point[1]].target
        tool, frame = (
            str(name) if name == "0" or not str(name).isdigit() else Ref(f"{family}[{name}]")
            for family, name in (("UTOOL", target.tool), ("UFRAME", target.frame))
        )
        # A joint move to joint angles depends neither on tools, frames and registers nor on the position of the arm.
        is_free = target.joints and way.kind == "J"
        tracking, shift = (
            ComputedValue((name,), _unless_lost) if is_free else Ref(name) for name in ("tracking", "shift")
        )
        needs: Needs = (
            ("tracked", tracking),
            ("displaced", shift),
            ("not_understood", self.why(f"{unknown} is unknown here") if unknown else OFF),
            ("external_tcp", "on" if _EXTERNAL_TCP.search(way.options) else OFF),
            ("coordinated", "on" if _COORDINATED.search(way.options) else OFF),
        )
        for variable, number in () if target.joints else (("UFRAME_NUM", target.frame), ("UTOOL_NUM", target.tool)):
            needs += (("selected", ComputedValue((variable,), partial(_selected, str(number)))),)
        offset = self._offset(way.offsets)
        kind = "joint" if way.kind == "J" else "line"
        key, base = (f"{point[1]}@{line}", point[1]) if offset else (point[1], "")
        self.add(
            Move(key, kind, 0, line, tool, frame, needs, offset=offset, base=base, arc=way.arc, through=way.through)
        )

    def _offset(self, texts: Sequence[str]) -> tuple[str, Value | ComputedValue] | None:
        """Kind and frame of the offset of a move; None if there is none."""
        if not texts:
            return None
        if len(texts) > 1:
            return "frame", self.why("the move has several offsets")
        why = self.why("the offset is stored in the controller")
        register = re.fullmatch(r"(Tool_)?Offset(?:\s*,\s*(.*))?", texts[0], re.IGNORECASE)
        if register is None:
            return "frame", why
        kind = "tool" if register[1] else "frame"
        if register[2]:
            return kind, _register(register[2], why)
        condition = f"{'TOOL_' if register[1] else ''}OFFSET CONDITION"
        return kind, ComputedValue((condition,), lambda values: why if values[0] == OFF else values[0])

    def _any_target(self, at: int, way: _Way) -> None:
        """Parse a move to a point selected by a register, which can be any."""
        self.blocks.keyword("switch")
        for key in tuple(self.points.declared):
            self.blocks.keyword("case")
            self._target(f"P[{key}]", at, way)
        self.blocks.close()

    def initial(self, variable: str) -> Value:
        family, _, number = variable.partition("[")
        if variable in self.stated:
            return self.stated[variable]
        if variable in ("UFRAME_NUM", "UTOOL_NUM"):
            return Unknown(0, 0, f"no line selects {variable}")
        return number.rstrip("]") if family in ("UFRAME", "UTOOL") else OFF


def parse(program: ProgramTexts) -> Parsed:
    reader = _TpReader(program)
    for file in range(len(program.texts)):
        reader.read(file)
    reader.add_background()
    if reader.stated:
        reader.points.notices.append(Notice(0, 1, f"tools and user frames are those of {FRAMES.upper()} beside it"))
    return reader.points.parsed(reader.program(kept=("UFRAME[", "UTOOL[")))


def _section(text: str, name: str, otherwise: int, end: int | None = None) -> int:
    section = re.compile(rf"^/{name}\b", re.MULTILINE).search(text, 0, len(text) if end is None else end)
    return section.start() if section else otherwise


def _agreeing(arm: Arm, q: Array, values: tuple[int, ...], slack_rad: float) -> Mask:
    """Check flip, up, front and the turns of axes 4 to 6. CONFIG lacks the turn of J3, which can exceed a full turn."""
    mask = agreeing(arm, q, values[:3], dict(zip((3, 4, 5), values[3:], strict=True)), turns, slack_rad)
    if arm.coupling[2, 1]:  # J3 is measured from the horizontal.
        mask &= np.abs(q[:, 1] + q[:, 2] - _ELBOW_RAD) <= np.pi
    return mask


def _lines(text: str, begin: int, end: int) -> list[_Line]:
    rows: list[_Line] = []
    for match in _LINE.finditer(text, begin, end):
        body = (match["body"] or match["dashes"] or "").strip()
        if rows and match["body"] and not match["number"] and not rows[-1].text.endswith(";"):
            rows[-1] = replace(rows[-1], text=f"{rows[-1].text} {body}", last=match.start())
        else:
            rows.append(_Line(body, match.start(), match.start()))
    lines: list[_Line] = []
    in_logic = False
    for row in (replace(row, text=row.text.rstrip("; ")) for row in rows):
        move = _MOVE.fullmatch(row.text)
        if in_logic and not move:
            lines[-1] = replace(lines[-1], logic=(*lines[-1].logic, row))
            in_logic = not row.text.startswith("----")
        else:
            lines.append(row)
            in_logic = move is not None and _LOGIC.search(row.text) is not None
    return lines


def _register(text: str, why: Unknown) -> Value | ComputedValue:
    """Frame in a position register; unknown unless the program has set all six numbers."""
    whole = _WHOLE.fullmatch(text.strip())
    if whole is None:
        return why

    def frame_from(values: tuple[Value, ...]) -> Value:
        *values_of_axes, form = values
        if form != OFF:
            return form if isinstance(form, Unknown) else why
        values = tuple(values_of_axes)
        numbers = [float(value) for value in values if isinstance(value, str) and re.fullmatch(NUMBER, value)]
        if len(numbers) < len(values) or not is_frame("roll_pitch_yaw", numbers):
            return min((value for value in values if isinstance(value, Unknown)), default=why)
        return as_value(frame_of("roll_pitch_yaw", numbers))

    return ComputedValue(tuple(f"PR{int(whole[1])}[{part}]" for part in (*range(1, 7), "form")), frame_from)


def _unless_lost(values: tuple[Value, ...]) -> Value:
    return OFF if isinstance(values[0], Unknown) and values[0].everything else values[0]


def _selected(number: str, values: tuple[Value, ...]) -> Value:
    selected = values[0]
    return OFF if number in ("F", selected) else selected


READER = ProgramReader(
    parse,
    _DECIMALS,
    Remark("{:4d}:  !", " ;", 32, {".ls": re.compile(rb"^/POS\b", re.MULTILINE)}),
    null_tools=("0",),
    null_frames=("0",),
    beside=(".ls",),
    tables=(FRAMES, ARM),
    other_arm=other_arm,
    empty="/PROG  {0}\n/MN\n/POS\n/END\n",
)
"""Remarks have at most 32 characters (B-83284EN, 4.13)."""
