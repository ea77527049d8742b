"""Interpreter of INFORM jobs (.JBI), written from Yaskawa's manuals.

Positions C, P, BC, EC use the preceding headings for tool, user frame, kind and RCONF. A shift (SFTON) moves each
target after it. Station axes (EC) move the workpiece, and with it the targets of coordinated moves (SMOVL). Rx, Ry, Rz
are rotations about fixed axes.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tests.worlds.languages.arms import Array
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
    steps_of,
)
from tests.worlds.languages.frames import angles_of, inverted, moved, of_angles, shifted
from tests.worlds.languages.machines import JobMachine, elbow_up_and_front

SCALE = (1365.3, -1137.8, 1000.0, 1024.0, -1024.0, 568.9)
"""Pulses per degree of the axes."""
_STILL = re.compile(
    r"NOP|TIMER|DOUT|DIN|WAIT|PULSE|AOUT|PAUSE|SPEED|REFP|CLEAR|INC|DEC|SET [BIDRS]|SET LB|ADD [BID]|SUB [BID]|MUL|DIV"
    r"|MSG|CNVRT|ARCON|ARCOF|ARCSET|GETS? [BID]|HAND|TOOLON|TOOLOF|SVSPOT|CSTART|'|COMM|SETREG|GETREG|ABORT|DIALOG"
    r"|SHCKSET|SHCKRST|ADVINIT|ADVSTOP"
)


@dataclass(frozen=True)
class Position:
    """A position: tool, kind and user frame of its headings, numbers, RCONF, and its line."""

    tool: int
    kind: str
    user: int
    numbers: tuple[float, ...]
    rconf: tuple[int, ...]
    src: frozenset[Place]


@dataclass
class _Job:
    positions: dict[str, Position]
    steps: list[Step]
    robot: str = "RB1"


class Program(LineBlocks):
    """The jobs of a controller by their names."""

    def __init__(self, files: Mapping[str, str], main: str) -> None:
        self.routines: dict[str, _Job] = {}
        self.main = ""
        for name, text in files.items():
            rows = [Line((name, k), row.rstrip()) for k, row in enumerate(re.split(r"\r\n|\r|\n", text), start=1)]
            begins = [k for k, row in enumerate(rows) if row.text == "/JOB"]
            for begin, end in zip(begins, [*begins[1:], len(rows)], strict=True):
                self._job(rows[begin:end])
                if name == main and not self.main:
                    self.main = next(reversed(self.routines))

    def _job(self, rows: list[Line]) -> None:
        name = next(row.text[7:].strip() for row in rows if row.text.startswith("//NAME"))
        begin = next(k for k, row in enumerate(rows) if row.text == "//INST")
        self._lines = [row for row in rows[begin + 1 :] if row.text and not row.text.startswith(("/", "'"))]
        self._at = 0
        robot = next((found[1] for row in rows if (found := re.match(r"///GROUP1 (\w+)", row.text))), "RB1")
        self.routines[name] = _Job(_positions(rows[:begin]), steps_of(self._block()), robot)

    def _statement(self, row: Line) -> list[Any]:
        place, text = row.place, row.text.strip()
        if found := re.match(r"\*(\S+)$", text):
            return [Label(found[1])]
        if found := re.match(r"JUMP \*(\S+)( IF .*)?$", text):
            return [Goto(place, (found[1],), perhaps=bool(found[2]))]
        if text.startswith(("IFTHEN", "SWITCH")):
            bodies, closings = self._bodies(("ELSE", "CASE", "DEFAULT"), "ENDIF", "ENDSWITCH")
            bodies = bodies[text.startswith("SWITCH") :]  # nothing stands before the first case
            return [Branch(place, bodies, bool({"ELSE", "DEFAULT"} & set(closings)))]
        if text.startswith("WHILE"):
            return [Loop(place, self._body("ENDWHILE")[0])]
        if text.startswith("FOR "):
            return [Loop(place, self._body("NEXT")[0])]
        if text.startswith("BREAK"):
            return [Leave(place)]
        if re.match(r"(END|RET)\b", text):
            return [Do(place, lambda _: None, ends=True)]
        if found := re.match(r"(.*?) IF .*", text):
            return [Branch(place, [[Do(place, lambda m: m.instruction(found[1], place))]], False)]
        return [Do(place, lambda m: m.instruction(text, place))]


def _positions(rows: list[Line]) -> dict[str, Position]:
    positions: dict[str, Position] = {}
    tool, kind, user, rconf = 0, "PULSE", 0, ()  # type: ignore[var-annotated]
    for row in rows:
        if found := re.match(r"///(TOOL|USER) (\d+)", row.text):
            tool, user = (int(found[2]), user) if found[1] == "TOOL" else (tool, int(found[2]))
        elif found := re.match(r"///POSTYPE (\w+)", row.text):
            kind = found[1]
        elif row.text.startswith("///RCONF"):
            rconf = tuple(int(one) for one in row.text[8:].split(","))
        elif found := re.match(r"((?:B|E)?[CP])0*(\d+)=(.*)", row.text):
            numbers = tuple(float(one) for one in found[3].split(","))
            positions[f"{found[1]}{int(found[2])}"] = Position(tool, kind, user, numbers, rconf, frozenset({row.place}))
    return positions


class Machine(JobMachine):
    """A controller that executes a job along one execution path."""

    dialect = "yaskawa"

    def __init__(self, program: Program, world: World, ways: Ways) -> None:
        super().__init__(program, world, ways)
        if any(key.startswith("BC") for job in program.routines.values() for key in job.positions):
            self.robot.begin_on_rail()
        self.variables: dict[str, Position] = {}
        self.shift: tuple[str, Array] | None = None
        self.tracking = False

    def call(self, name: str) -> None:
        """Call a job, with the position variables of its file."""
        if name in self.program.routines:
            positions = self.program.routines[name].positions
            self.variables = {key: one for key, one in positions.items() if key.startswith("P")} | self.variables
        super().call(name)

    def instruction(self, text: str, place: Place) -> None:
        if found := re.match(r"(?:\+|SY|S)?(MOVJ|MOVL|MOVC|MOVS) (.*)", text):
            if self.program.routines[self.running[-1]].robot == self.program.routines[self.program.main].robot:
                self._move(found[1], found[2], text, place)
        elif found := re.match(r"(?:E?IMOV) (P)0*(\d+)(.*)", text):
            self._relative(f"P{int(found[2])}", found[3], place)
        elif found := re.match(r"(?:CALL|PSTART) JOB:(\S+)", text):
            self.call(found[1])
        elif found := re.match(r"SFTON (?:P)0*(\d+)(?: (BF|RF|TF|UF#\((\d+)\)))?", text):
            self.shift = (found[2] or "BF", self._as_shift(f"P{int(found[1])}"))
        elif text.startswith("SFTOF"):
            self.shift = None
        elif found := re.match(r"(?:MFRAME|SETUF) UF#\((\d+)\)|SETTOOL TL#\((\d+)\)", text):
            kind, number = ("frame", int(found[1])) if found[1] else ("tool", int(found[2]))
            self.frames[kind, number] = self.frame(kind, number) @ self.world.shift(text)
        elif re.match(r"(SETE|SET|ADD|SUB|GETS|GETPOS|CNVRT|MSHIFT|MULMAT|INVMAT) P[X0-9]", text):
            self._set(text, place)
        elif text.startswith(("SYSTART", "SYEND", "CVON", "CVOF")):
            self.tracking = text.startswith(("SYSTART", "CVON"))
        elif not _STILL.match(text):
            self.unknown(text)

    def _set(self, text: str, place: Place) -> None:
        found = re.match(r"\w+ PX?0*(\d+)", text)
        key = f"P{int(found[1])}" if found else "P0"
        old = self.variables.get(key)
        if one := re.match(r"SETE P0*\d+ \((\d)\) (-?\d+)$", text):
            numbers = list(old.numbers) if old else [0.0] * 6
            numbers[int(one[1]) - 1] = float(one[2]) / (1000 if int(one[1]) <= 3 else 10000)
        elif one := re.match(r"SET P0*\d+ P0*(\d+)$", text):
            self.variables[key] = self._variable(f"P{int(one[1])}")
            return
        else:
            numbers = list(angles_of(self.world.shift(text)))
        base = old or Position(0, "BASE", 0, (), (), frozenset())
        self.variables[key] = replace(base, numbers=tuple(numbers), src=base.src | {place})

    def _variable(self, key: str) -> Position:
        if key in self.variables:
            return self.variables[key]
        return Position(0, "OUTSIDE", 0, angles_of(self.world.shift(key)), (), frozenset())

    def _as_shift(self, key: str) -> Array:
        return of_angles(*self._variable(key).numbers[:6])

    def _relative(self, key: str, rest: str, place: Place) -> None:
        step, tool = self._as_shift(key), self.frame("tool", 0)
        now = self.robot.pose_now(tool)
        X = now @ step if "TF" in rest else moved(now, step)
        self.robot.pose(X @ inverted(tool), tool[:3, 3], place, self._variable(key).src | {place})

    def _move(self, word: str, rest: str, text: str, place: Place) -> None:
        found = re.match(r"(C|P)0*(\d+)", rest)
        if re.match(r"E[CX]\d+", rest):
            return
        if not found:
            raise Ended
        key = f"{found[1]}{int(found[2])}"
        positions = self.program.routines[self.running[-1]].positions
        position = positions.get(key) if found[1] == "C" else self._variable(key)
        if position is None:
            raise Ended
        if position.kind == "OUTSIDE":
            self.robot.q = self.robot.here.centre.copy()
            return
        if outer := re.search(r"\bBC0*(\d+)", rest):
            base = positions.get(f"BC{int(outer[1])}")
            self.robot.rail_mm = base.numbers[0] / 100 if base else 0.0
        src = position.src | {place}
        tool = self.frame("tool", position.tool)
        if position.kind == "PULSE":
            q = np.radians(np.divide(position.numbers[:6], SCALE))
            if self.shift is None and not self.tracking and not text.startswith("S"):
                self.robot.joints(q, tool, place, src)
                return
            F = self.robot.flange(q)
        else:
            user = self.frame("frame", position.user) if position.kind == "USER" else np.eye(4)
            F = user @ of_angles(*position.numbers[:6]) @ inverted(tool)
        F = self._shifted(F, tool)
        if self.tracking or text.startswith("SY"):
            F = self.world.shift("conveyor") @ F
        elif text.startswith("S"):
            F = self.world.shift("station") @ F
        F = shifted(F, -self.robot.rail_mm)
        chosen = Rconf(position.rconf[:6]) if position.rconf and position.kind != "PULSE" else None
        self.robot.pose(F, tool[:3, 3], place, src, chosen, straight=word != "MOVJ")

    def _shifted(self, F: Array, tool: Array) -> Array:
        if self.shift is None:
            return F
        where, step = self.shift
        T = F @ tool
        if where == "TF":
            T = T @ step
        else:
            U = self.frame("frame", int(where[4:-1])) if where.startswith("UF") else np.eye(4)
            T = U @ moved(inverted(U) @ T, step)
        return T @ inverted(tool)

    def changed_by(self, name: str) -> None:
        self.shift = ("BF", self.world.shift(name))
        self.shift_frames(name, (0, 1, 2))


@dataclass(frozen=True)
class Rconf:
    """Test of joint angles (6,) rad against RCONF."""

    values: tuple[int, ...]

    def __call__(self, q: Array) -> bool:
        return rconf(q)[: len(self.values)] == self.values


def rconf(q: Array) -> tuple[int, ...]:
    """0 for a flipped wrist, the upper elbow and the front, and 1 for R, T, S of at least 180 degrees."""
    up, front = elbow_up_and_front("yaskawa", q)
    return (int(q[4] <= 0), int(not up), int(not front), *(int(abs(q[k]) >= np.pi) for k in (3, 5, 0)))
