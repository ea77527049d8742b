"""Interpreter of KRL modules (.src and .dat), written from KUKA's programming manuals.

$TOOL and $BASE are global. A, B, C are rotations about z, the new y, and the new x. A PTP uses Status and Turn; a LIN
keeps the posture. With $IPO_MODE = #TCP the tool is stationary in $BASE and the workpiece is at $TOOL. Missing
components keep their values.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from tests.worlds.languages.arms import Array, cell, chain
from tests.worlds.languages.execution import (
    Branch,
    Do,
    Ended,
    Goto,
    Label,
    Leave,
    Line,
    LineBlocks,
    Loop,
    Place,
    Step,
    Ways,
    World,
    copied,
    first_word,
    steps_of,
)
from tests.worlds.languages.expressions import KRL, NotUnderstood, Tree, arithmetic
from tests.worlds.languages.frames import angles_of, inverted, moved, of_angles, shifted
from tests.worlds.languages.machines import NOWHERE, Value, ValueMachine

_STATE = ("$TOOL", "$BASE", "$IPO_MODE")
_FRAMES = {"$NULLFRAME", "$WORLD", "$ROBROOT"}
_WITHOUT_MOTION = """
WAIT HALT ON_ERROR_PROCEED SIGNAL DECL INT REAL BOOL CHAR FRAME POS E6POS AXIS E6AXIS ENUM STRUC EXT
EXTFCT EXTP IMPORT BRAKE RESUME CONTINUE PULSE SREAD SWRITE CWRITE CREAD COPEN CCLOSE ANIN ANOUT DIGIN
MSGNOTIFY MSGSTATE MSGQUIT USERSPOT VARSTATE RSI_CREATE RSI_DELETE EKI_INIT EKI_OPEN EKI_CLOSE EKI_SEND
GLOBAL CONST INIT RET SET_CD_PARAMS USE_CM_PRO_VALUES
ABS SQRT SIN COS ROUND ATAN2 SVEL_CP SVEL_JOINT SLOAD SAPO FORWARD INVERSE
"""
_STILL = frozenset(_WITHOUT_MOTION.split())


_GIVES_BACK = ("EKI_GETFRAME", "EKI_GETREAL", "STRTOFRAME", "STRTOREAL")
"""System functions that return a value in their last argument."""


@dataclass
class _Routine:
    parameters: tuple[str, ...]
    steps: list[Step]
    returned: tuple[bool, ...] = ()
    """True for each output parameter."""


def _lines(name: str, text: str) -> list[Line]:
    lines = []
    for number, raw in enumerate(re.split(r"\r\n|\r|\n", text), start=1):
        bare = "".join(part[0] for part in re.finditer(r'"[^"]*"|;.*|[^";]+|"', raw) if part[0][0] != ";").strip()
        if bare and not bare.startswith("&"):
            lines.append(Line((name, number), bare))
    return lines


class Program(LineBlocks):
    """The modules of a cell: routines of the .src, data of the .dat."""

    def __init__(self, files: Mapping[str, str], main: str) -> None:
        self.routines: dict[str, _Routine] = {}
        self.written: dict[str, set[Place]] = {}
        self.data: list[Line] = []
        self.made: dict[int, dict[str, Value]] = {}
        """Data by world. Statements replace values and never modify them."""
        self.main = ""
        every = "\n".join(files.values())
        self.has_rail = bool(re.search(r"(?i)\bE1\s+0*[1-9]|\bE1\s*=", every))
        for name, text in sorted(files.items(), key=lambda one: one[0].lower().endswith(".src")):
            self._at, self._lines = 0, _lines(name, text)
            if name.lower().endswith(".dat"):
                self.data += [one for one in self._lines if not re.match(r"(?i)(DEFDAT|ENDDAT|EXT)\b", one.text)]
                continue
            while self._at < len(self._lines):
                self._routine(name == main)

    def _routine(self, begins: bool) -> None:
        head = self._lines[self._at]
        self._at += 1
        found = re.match(r"(?i)(?:GLOBAL\s+)?(DEF|DEFFCT\s+\w+(?:\[\])?)\s+(\w+)\s*\(([^)]*)\)", head.text)
        if not found:
            return
        nodes, _ = self._body("END", "ENDFCT")
        name = found[2].upper()
        parameters = tuple(one.split(":")[0].strip().upper() for one in found[3].split(",") if one.strip())
        returned = tuple(one.strip().upper().endswith(":OUT") for one in found[3].split(",") if one.strip())
        self.routines[name] = _Routine(parameters, steps_of(nodes), returned)
        if begins and not self.main:
            self.main = name

    def _statement(self, line: Line) -> list[Any]:
        place, word = line.place, first_word(line.text)
        match word:
            case "IF":
                condition = re.sub(r"(?i)\bTHEN$", "", line.text[2:])
                bodies, _ = self._bodies(("ELSE",), "ENDIF")
                return [Branch(place, bodies, len(bodies) > 1, _valued(condition, line))]
            case "SWITCH":
                bodies, words = self._bodies(("CASE", "DEFAULT"), "ENDSWITCH")
                return [Branch(place, bodies[1:], "DEFAULT" in words, _valued(line.text[6:], line))]
            case "FOR":
                return [Loop(place, self._body("ENDFOR")[0])]
            case "WHILE":
                return [Loop(place, self._body("ENDWHILE")[0], False, _valued(line.text[5:], line))]
            case "LOOP":
                return [Loop(place, self._body("ENDLOOP")[0], at_least_once=True)]
            case "REPEAT":
                return [Loop(place, self._body("UNTIL")[0], at_least_once=True)]
            case "EXIT":
                return [Leave(place)]
            case "GOTO":
                return [Goto(place, (line.text[4:].strip().upper(),), perhaps=False)]
            case "RETURN":
                return [Do(place, _valued(line.text[6:], line) or (lambda _: None), ends=True)]
            case "SPLINE" | "ENDSPLINE" | "PTP_SPLINE":
                return []
        if re.fullmatch(r"\w+\s*:", line.text):
            return [Label(word)]
        if found := re.match(r"([A-Za-z]\w*)(\.\w+)?\s*=", line.text):
            self.written.setdefault(found[1].upper(), set()).add(place)
        return [Do(place, lambda m: m.instruction(line.text, line))]


@lru_cache(maxsize=4096)
def _tree(text: str) -> Tree:
    return KRL.tree(KRL.tokens(text))


@lru_cache(maxsize=4096)
def _assignment(text: str) -> tuple[Tree, Tree | None] | None:
    """Return target and value of an assignment, with None for a value that is not an expression; None for other
    instructions.
    """
    try:
        tokens = KRL.tokens(text)
        target = KRL.term(tokens)
    except NotUnderstood:
        return None
    if tokens.peek() != "=" or target[0] not in ("name", "field", "index"):
        return None
    tokens.take()
    try:
        return target, KRL.tree(tokens)
    except NotUnderstood:
        return target, None


@lru_cache(maxsize=4096)
def _move_of(word: str, text: str) -> tuple[list[Tree], dict[str, Tree], bool]:
    """Points of a move, its own settings, and whether it is relative to the tool."""
    text, _, settings = re.sub(r"\s+", " ", text).partition(" WITH ")
    found = {name: re.search(re.escape(name) + r"\s*=\s*([^,]+(?:\([^)]*\))?)", settings, re.I) for name in _STATE}
    tokens = KRL.tokens(text)
    points = [KRL.tree(tokens)]
    if word in ("CIRC", "SCIRC"):
        tokens.take(",")
        points.append(KRL.tree(tokens))
    in_tool = "#TOOL" in [text for _, text in tokens.items]
    return points, {name: _tree(match[1]) for name, match in found.items() if match}, in_tool


def _valued(text: str, line: Line) -> Any:
    text = text.strip()
    if not text:
        return None
    try:
        tree = _tree(text)
    except NotUnderstood:
        return lambda m: (m.world.number(text), NOWHERE)
    return lambda m: m.evaluate(tree, line)


class Machine(ValueMachine):
    """A controller that executes a module along one execution path."""

    dialect = "kuka"

    def __init__(self, program: Program, world: World, ways: Ways) -> None:
        super().__init__(program, world, ways)
        if program.has_rail:
            self.robot.begin_on_rail()
        self.handlers: dict[str, str] = {}
        if world.seed in program.made:
            self.scopes[0] |= program.made[world.seed]
            return
        self.scopes[0]["$TOOL"] = (as_frame(world.shift("$TOOL")), NOWHERE)
        self.scopes[0]["$BASE"] = (as_frame(world.shift("$BASE")), NOWHERE)
        self.scopes[0]["$IPO_MODE"] = ("#BASE", NOWHERE)
        for line in program.data:
            self.declare(line.text, line)
        if not ways.taken:
            program.made[world.seed] = dict(self.scopes[0])

    def run(self) -> None:
        """Execute the first routine of the module."""
        self.call(self.program.main, [])

    def call(self, name: str, values: list[Value]) -> Value:
        """Call a routine. Arguments become its own variables."""
        parameters = self.program.routines[name].parameters
        return self.run_routine(name, dict(zip(parameters, copied(values), strict=False)))

    def declare(self, text: str, line: Line) -> None:
        """Declare a variable, with its initial value if given."""
        text = re.sub(r"(?i)^((DECL|GLOBAL|CONST)\s+)*", "", text)
        found = re.match(r"(?i)(?:\w+\s+)?(\$?[A-Za-z_]\w*(?:\[\s*\d+\s*\])?)\s*=\s*(.*)$", text)
        if found:
            try:
                value = self.evaluate(_tree(found[2]), line)
            except NotUnderstood:
                return
            self.scopes[-1][found[1].upper().replace(" ", "")] = copied(value)

    def instruction(self, text: str, line: Line) -> None:
        word = first_word(text)
        if word in ("PTP", "LIN", "CIRC", "SPTP", "SLIN", "SCIRC", "SPL", "PTP_REL", "LIN_REL", "SPTP_REL", "SLIN_REL"):
            if (handler := self.interruption()) is not None:
                self.instruction(handler, line)
            self._move(word, text[len(word) :], line)
            return
        if found := re.match(r"(?i)ASYPTP\s*\{E1\s+([\d.]+)\}", text):
            self.robot.rail_mm = float(found[1])
            return
        if re.match(r"(?i)(GLOBAL\s+)?INTERRUPT\b|TRIGGER\b", text):
            self._interrupt(text)
            return
        if word in ("DECL", "GLOBAL", "CONST") or re.match(
            r"(?i)(E6POS|FRAME|POS|AXIS|E6AXIS|INT|REAL|BOOL)\s+\w", text
        ):
            self.declare(text, line)
            return
        if self._assigned(text, line):
            return
        try:
            tree = _tree(text)
        except NotUnderstood:
            tree = ("name", word)
        if tree[0] == "call":
            self.evaluate(tree, line)
        elif word not in _STILL:
            self.unknown(word)

    def _interrupt(self, text: str) -> None:
        if found := re.match(r"(?i)(?:GLOBAL\s+)?INTERRUPT\s+(?:GLOBAL\s+)?DECL\s+(\d+)\s+WHEN.*\bDO\s+(.*)", text):
            self.handlers[found[1]] = found[2]
        elif found := re.match(r"(?i)INTERRUPT\s+ON\s*(\d*)", text):
            chosen = [self.handlers[found[1]]] if found[1] in self.handlers else list(self.handlers.values())
            self.armed += [one for one in chosen if one not in self.armed]
        elif re.match(r"(?i)INTERRUPT\s+OFF", text):
            self.armed = []
        elif found := re.match(r"(?i)TRIGGER\s.*\bDO\s+(\w+\s*\(.*?\))", text):
            self.armed.append(found[1])

    def _assigned(self, text: str, line: Line) -> bool:
        parts = _assignment(text)
        if parts is None:
            return False
        target, tree = parts
        try:
            value = (self.world.number(text), NOWHERE) if tree is None else self.evaluate(tree, line)
        except NotUnderstood:
            value = (self.world.number(text), NOWHERE)
        self.assign(target, value, line)
        return True

    def assign(self, target: Tree, value: Value, line: Line) -> None:
        """Assign to a variable, an element or a component."""
        path = []
        while target[0] == "field":
            path.append(target[2])
            target = target[1]
        key = self._key(target, line)
        scope = next((one for one in (self.scopes[-1], self.scopes[0]) if key in one), self.scopes[0])
        if not path:
            old, before = scope.get(key, (None, NOWHERE))
            new = copied(value[0])
            if isinstance(old, dict) and isinstance(new, dict) and not key.startswith("$"):
                new = {**old, **new} if set(new) < set(old) else new  # missing components keep their values
            scope[key] = (new, value[1] | before)
            return
        old, src = self.read(key)
        new = copied(old) if isinstance(old, dict) else {}
        new[path[0]] = value[0]
        scope[key] = (new, src | value[1] | {line.place})

    def _key(self, tree: Tree, line: Line) -> str:
        if tree[0] == "index":
            return f"{self._key(tree[1], line)}[{int(self.evaluate(tree[2], line)[0])}]"
        return str(tree[1])

    def read(self, key: str) -> Value:
        if stored := self.stored(key, [self.scopes[-1], self.scopes[0]]):
            return stored
        if key in _FRAMES:
            return as_frame(np.eye(4)), NOWHERE
        if key == "$POS_ACT":
            return self._pose_now(), NOWHERE
        if key in ("$AXIS_ACT", "XHOME", "$H_POS"):
            q = self.robot.q if key == "$AXIS_ACT" else self.robot.here.centre
            return {f"A{k + 1}": float(np.degrees(q[k])) for k in range(6)}, NOWHERE
        if found := re.fullmatch(r"(TOOL|BASE)_DATA\[(-?\d+)\]", key):
            stated = self.world.stated.get(("tool" if found[1] == "TOOL" else "frame", found[2]))
            return as_frame(self.world.shift(key) if stated is None else stated), NOWHERE
        if re.search(r"FRAME|_BASE|_OFF|CORR", key):
            return as_frame(self.world.shift(key)), NOWHERE
        if re.match(r"XP\d|X_", key):
            return self._pose_now(), NOWHERE
        return (
            key == "TRUE" if key in ("TRUE", "FALSE") else key if key[0] == "#" else self.world.number(key)
        ), NOWHERE

    def _pose_now(self) -> dict[str, Any]:
        base, tool = (as_matrix(self.read(name)[0]) for name in ("$BASE", "$TOOL"))
        return as_frame(inverted(base) @ self.robot.pose_now(tool))

    def binary(self, operator: str, a: Any, b: Any) -> Any:
        if operator == ":":
            return as_frame(as_matrix(a) @ as_matrix(b))
        if isinstance(a, bool) or not isinstance(a, float | int) or not isinstance(b, float | int):
            return a == b if operator == "==" else False
        return arithmetic(operator, a, b)

    def evaluate_own(self, tree: Tree, line: Line) -> Value:
        match tree:
            case ("aggregate", _, pairs):
                values = [(name, self.evaluate(one, line)) for name, one in pairs]
                src = frozenset({line.place}).union(*(src for _, (_, src) in values))
                return {name: value for name, (value, _) in values}, src
            case ("index", _, _):
                return self.read(self._key(tree, line))
            case ("field", one, name):
                value, src = self.evaluate(one, line)
                if isinstance(value, dict) and name in value:
                    return value[name], src
                return self.world.number(str(tree)), src
            case ("call", name, arguments):
                value = self._function(name, [self.evaluate(one, line) for _, one in arguments])
                self._give_back(name, [one for _, one in arguments], line)
                return value
        raise NotUnderstood(str(tree))

    def _function(self, name: str, values: list[Value]) -> Value:
        if name in self.program.routines:
            return self.call(name, values)
        src = NOWHERE.union(*(more for _, more in values))
        first = values[0][0] if values else None
        match name:
            case "BAS":
                self._bas(str(first), values[1][0] if len(values) > 1 else 0)
            case "INV_POS":
                return as_frame(inverted(as_matrix(first))), src
            case "STOOL2":
                return self.read(f"TOOL_DATA[{int(first['TOOL_NO'])}]")
            case "SBASE":
                return self.read(f"BASE_DATA[{int(first)}]")
            case "SIPO_MODE":
                return first, src
            case "IR_STOPM":  # KUKA's routine for stop messages, which does not move
                return True, src
            case _ if name not in _STILL and not name.startswith(("MSG", "EKI_", "VAR", "STR", "CAST_")):
                self.unknown(name)
        return self.world.number(name), src

    def _give_back(self, name: str, arguments: list[Tree], line: Line) -> None:
        """Write the output parameters of a routine or a system function to its arguments."""
        if routine := self.program.routines.get(name):
            for parameter, argument, back in zip(routine.parameters, arguments, routine.returned, strict=False):
                if back and argument[0] in ("name", "field", "index"):
                    self.assign(argument, self.left[parameter], line)
        elif name in _GIVES_BACK and arguments and arguments[-1][0] in ("name", "field", "index"):
            number, moved = self.world.number(name), as_frame(self.world.shift(name))
            self.assign(arguments[-1], (moved if name.endswith("FRAME") else number, NOWHERE), line)

    def _bas(self, command: str, number: Any) -> None:
        variables = self.scopes[0]
        if command == "#TOOL":
            variables["$TOOL"] = copied(self.read(f"TOOL_DATA[{int(number)}]"))
        elif command == "#BASE":
            variables["$BASE"] = copied(self.read(f"BASE_DATA[{int(number)}]"))
        elif command in ("#PTP_PARAMS", "#CP_PARAMS", "#FRAMES", "#PTP_DAT", "#CP_DAT"):
            active = self.read("FDAT_ACT")[0]
            if isinstance(active, dict) and "TOOL_NO" in active:
                self._bas("#TOOL", active["TOOL_NO"])
                self._bas("#BASE", active["BASE_NO"])
                variables["$IPO_MODE"] = (active.get("IPO_FRAME", "#BASE"), NOWHERE)

    def _move(self, word: str, text: str, line: Line) -> None:
        if re.match(r"(?i)\s*\$AXIS_ACT\b", text):
            return  # to the current position
        points, settings, in_tool = _move_of(word, text)
        state = {name: self.read(name)[0] for name in _STATE}
        state |= {name: self.evaluate(tree, line)[0] for name, tree in settings.items()}
        for point in points:
            value, src = self.evaluate(point, line)
            self._to(word, value, state, line, src | {line.place}, in_tool=in_tool)

    def _to(
        self, word: str, value: Any, state: dict[str, Any], line: Line, src: frozenset[Place], *, in_tool: bool
    ) -> None:
        tool, base = as_matrix(state["$TOOL"]), as_matrix(state["$BASE"])
        if not isinstance(value, dict):
            raise Ended
        if "E1" in value and not word.endswith("REL"):  # a missing axis does not move
            self.robot.rail_mm = float(value["E1"])
        if any(name in value for name in ("A1", "A2", "A3", "A4", "A5", "A6")):
            now = np.degrees(self.robot.q)
            given = np.array([value.get(f"A{k + 1}", 0.0 if word.endswith("REL") else now[k]) for k in range(6)])
            q = now + given if word.endswith("REL") else given
            self.robot.joints(np.radians(q), tool, line.place, src)
            return
        X = inverted(base) @ self.robot.pose_now(tool)
        if word.endswith("REL"):
            step = as_matrix(value)
            X = X @ step if in_tool else moved(X, step)
        else:
            now = as_frame(X)
            X = as_matrix({**now, **{name: value[name] for name in now if name in value}})
        if state["$IPO_MODE"] == "#TCP":
            F = base @ inverted(tool @ X)
            point = (inverted(F) @ base)[:3, 3]
        else:
            F, point = base @ X @ inverted(tool), tool[:3, 3]
        F = shifted(F, -self.robot.rail_mm)
        chosen = Status(_bits(value["S"]), _bits(value.get("T"))) if "PTP" in word and "S" in value else None
        self.robot.pose(F, point, line.place, src, chosen, straight="PTP" not in word)

    def changed_by(self, name: str) -> None:
        if self.program.has_rail:
            self.robot.rail_mm = self.world.number(name + "rail", 20, 90)
        for setting in ("$TOOL", "$BASE"):
            value, src = self.read(setting)
            self.scopes[0][setting] = (as_frame(as_matrix(value) @ self.world.shift(name + setting)), src)


def _bits(value: Any) -> int | None:
    if isinstance(value, str):
        return int(value.strip("'").lstrip("Bb") or "0", 2)
    return None if value is None else int(value)


@dataclass(frozen=True)
class Status:
    """Test of joint angles (6,) rad against Status and Turn."""

    s: int | None
    t: int | None

    def __call__(self, q: Array) -> bool:
        s, t = status_turn(q)
        return (self.s is None or s == self.s & 7) and (self.t is None or t == self.t)


def status_turn(q: Array) -> tuple[int, int]:
    """Return S (overhead, axis 3 above its stretched angle near zero, axis 5 negative) and T (signs) of a KR 10."""
    here = cell("kuka")
    T = chain(here, q)[0]
    wrist = T[:3, 3] - here.nominal.d[5] * T[:3, 2]
    front = np.cos(np.arctan2(wrist[1], wrist[0]) + q[0]) > 0
    status = int(not front) + 2 * int(q[2] > np.radians(3)) + 4 * int(q[4] <= 0)
    return status, sum(1 << axis for axis in range(6) if q[axis] < 0)


def as_matrix(value: Any) -> Array:
    """Frame (4, 4) of an aggregate."""
    if not isinstance(value, dict):
        raise Ended
    x, y, z, a, b, c = (float(value.get(name, 0.0)) for name in "XYZABC")
    return of_angles(x, y, z, c, b, a)


def as_frame(T: Array) -> dict[str, Any]:
    """Aggregate of a frame (4, 4)."""
    x, y, z, c, b, a = angles_of(T)
    return {"X": x, "Y": y, "Z": z, "A": a, "B": b, "C": c}
