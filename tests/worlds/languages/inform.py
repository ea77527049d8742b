"""Interpreter of INFORM jobs (.JBI), written from Yaskawa's manuals.

Positions C, P, BC, EC use the preceding headings for tool, user frame, kind and RCONF. A shift (SFTON) moves each
target after it. Station axes (EC) move the workpiece, and with it the targets of coordinated moves (SMOVL). Rx, Ry, Rz
are rotations about fixed axes.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.worlds.languages.arms import Array, cell, links, placed
from tests.worlds.languages.execution import (
    Branch,
    Do,
    Ended,
    Goto,
    Label,
    Leave,
    LineBlocks,
    Loop,
    Place,
    Robot,
    Step,
    Ways,
    World,
    run_steps,
    steps_of,
)
from tests.worlds.languages.frames import angles_of, inverted, of_angles, shifted

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


@dataclass(frozen=True)
class _Line:
    place: Place
    text: str


class Program(LineBlocks):
    """The jobs of a controller by their names."""

    def __init__(self, files: Mapping[str, str], main: str) -> None:
        self.jobs: dict[str, _Job] = {}
        self.main = ""
        for name, text in files.items():
            rows = [_Line((name, k), row.rstrip()) for k, row in enumerate(re.split(r"\r\n|\r|\n", text), start=1)]
            begins = [k for k, row in enumerate(rows) if row.text == "/JOB"]
            for begin, end in zip(begins, [*begins[1:], len(rows)], strict=True):
                self._job(rows[begin:end])
                if name == main and not self.main:
                    self.main = next(reversed(self.jobs))

    def _job(self, rows: list[_Line]) -> None:
        name = next(row.text[7:].strip() for row in rows if row.text.startswith("//NAME"))
        begin = next(k for k, row in enumerate(rows) if row.text == "//INST")
        self._lines = [row for row in rows[begin + 1 :] if row.text and not row.text.startswith(("/", "'"))]
        self._at = 0
        robot = next((found[1] for row in rows if (found := re.match(r"///GROUP1 (\w+)", row.text))), "RB1")
        self.jobs[name] = _Job(_positions(rows[:begin]), steps_of(self._block(())), robot)

    def _body(self, *ends: str) -> tuple[list[Any], str]:
        nodes = self._block(ends)
        self._at += 1
        return nodes, self._lines[self._at - 1].text.strip()

    def _statement(self, row: _Line) -> list[Any]:
        place, text = row.place, row.text.strip()
        if found := re.match(r"\*(\S+)$", text):
            return [Label(found[1])]
        if found := re.match(r"JUMP \*(\S+)( IF .*)?$", text):
            return [Goto(place, (found[1],), perhaps=bool(found[2]))]
        if text.startswith(("IFTHEN", "SWITCH")):
            ends = ("ELSE", "ENDIF", "CASE", "DEFAULT", "ENDSWITCH")
            bodies, otherwise = [], False
            if text.startswith("SWITCH"):
                _, closing = self._body(*ends)
            else:
                body, closing = self._body(*ends)
                bodies.append(body)
            while not closing.startswith(("ENDIF", "ENDSWITCH")):
                otherwise |= closing in ("ELSE", "DEFAULT")
                body, closing = self._body(*ends)
                bodies.append(body)
            return [Branch(place, bodies, otherwise)]
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


def _positions(rows: list[_Line]) -> dict[str, Position]:
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


class Machine:
    """A controller that executes a job along one execution path."""

    def __init__(self, program: Program, world: World, ways: Ways) -> None:
        self.program, self.world = program, world
        self.robot = Robot("yaskawa", cell("yaskawa"), world, ways)
        if any(key.startswith("BC") for job in program.jobs.values() for key in job.positions):
            self.robot.begin_on_rail(world.number("rail", 50, 150))
        self.frames: dict[tuple[str, int], Array] = {}
        self.variables: dict[str, Position] = {}
        self.shift: tuple[str, Array] | None = None
        self.running = [program.main]
        self.tracking = False

    def run(self) -> None:
        """Execute the job."""
        self._enter(self.program.main)
        run_steps(self, self.program.jobs[self.program.main].steps)

    def _enter(self, name: str) -> None:
        """Load the position variables of the job's file."""
        for key, position in self.program.jobs[name].positions.items():
            if key.startswith("P"):
                self.variables.setdefault(key, position)

    def _call(self, name: str) -> None:
        if name not in self.program.jobs:
            self._unknown(name)
            return
        self._enter(name)
        self.running.append(name)
        try:
            run_steps(self, self.program.jobs[name].steps, len(self.running))
        finally:
            self.running.pop()

    def _frame(self, kind: str, number: int) -> Array:
        if (kind, number) in self.frames:
            return self.frames[kind, number]
        stated = self.world.stated.get((kind, str(number)))
        return self.world.shift(f"{kind}{number}") if stated is None else stated

    def instruction(self, text: str, place: Place) -> None:
        if found := re.match(r"(?:\+|SY|S)?(MOVJ|MOVL|MOVC|MOVS) (.*)", text):
            if self.program.jobs[self.running[-1]].robot == self.program.jobs[self.program.main].robot:
                self._move(found[1], found[2], text, place)
        elif found := re.match(r"(?:E?IMOV) (P)0*(\d+)(.*)", text):
            self._relative(f"P{int(found[2])}", found[3], place)
        elif found := re.match(r"(?:CALL|PSTART) JOB:(\S+)", text):
            self._call(found[1])
        elif found := re.match(r"SFTON (?:P)0*(\d+)(?: (BF|RF|TF|UF#\((\d+)\)))?", text):
            where = found[2] or "BF"
            self.shift = (where, self._as_shift(f"P{int(found[1])}"))
        elif text.startswith("SFTOF"):
            self.shift = None
        elif found := re.match(r"(?:MFRAME|SETUF) UF#\((\d+)\)|SETTOOL TL#\((\d+)\)", text):
            kind, number = ("frame", int(found[1])) if found[1] else ("tool", int(found[2]))
            self.frames[kind, number] = self._frame(kind, number) @ self.world.shift(text)
        elif re.match(r"(SETE|SET|ADD|SUB|GETS|GETPOS|CNVRT|MSHIFT|MULMAT|INVMAT) P[X0-9]", text):
            self._set(text, place)
        elif text.startswith(("SYSTART", "SYEND", "CVON", "CVOF")):
            self.tracking = text.startswith(("SYSTART", "CVON"))
        elif not _STILL.match(text):
            self._unknown(text)

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
            T = self.world.shift(text)
            numbers = list(angles_of(T))
        base = old or Position(0, "BASE", 0, (), (), frozenset())
        self.variables[key] = Position(base.tool, base.kind, base.user, tuple(numbers), base.rconf, base.src | {place})

    def _variable(self, key: str) -> Position:
        if key in self.variables:
            return self.variables[key]
        T = self.world.shift(key)
        return Position(0, "OUTSIDE", 0, angles_of(T), (), frozenset())

    def _as_shift(self, key: str) -> Array:
        numbers = self._variable(key).numbers
        return of_angles(*numbers[:6])

    def _relative(self, key: str, rest: str, place: Place) -> None:
        step, tool = self._as_shift(key), self._frame("tool", 0)
        now = self.robot.pose_now(tool)
        X = now @ step if "TF" in rest else placed(now[:3, 3] + step[:3, 3], step[:3, :3] @ now[:3, :3])
        self.robot.pose(X @ inverted(tool), tool[:3, 3], place, self._variable(key).src | {place})

    def _move(self, word: str, rest: str, text: str, place: Place) -> None:
        found = re.match(r"(C|P)0*(\d+)", rest)
        if re.match(r"E[CX]\d+", rest):
            return
        if not found:
            raise Ended
        key = f"{found[1]}{int(found[2])}"
        positions = self.program.jobs[self.running[-1]].positions
        position = positions.get(key) if found[1] == "C" else self._variable(key)
        if position is None or position.kind == "OUTSIDE":
            if position is None:
                raise Ended
            self.robot.q = self.robot.here.centre.copy()
            return
        if outer := re.search(r"\bBC0*(\d+)", rest):
            base = positions.get(f"BC{int(outer[1])}")
            self.robot.rail_mm = base.numbers[0] / 100 if base else 0.0
        src = position.src | {place}
        tool = self._frame("tool", position.tool)
        if position.kind == "PULSE":
            q = np.radians(np.divide(position.numbers[:6], SCALE))
            if self.shift is None and not self.tracking and not text.startswith("S"):
                self.robot.joints(q, tool, place, src)
                return
            F = self.robot.flange(q)
        else:
            user = self._frame("frame", position.user) if position.kind == "USER" else np.eye(4)
            X = of_angles(*position.numbers[:6])
            F = user @ X @ inverted(tool)
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
            U = self._frame("frame", int(where[4:-1])) if where.startswith("UF") else np.eye(4)
            X = inverted(U) @ T
            T = U @ placed(X[:3, 3] + step[:3, 3], step[:3, :3] @ X[:3, :3])
        return T @ inverted(tool)

    def _unknown(self, name: str) -> None:
        """Execute a job without text: it does nothing, or changes position, shift and frames."""
        if self.robot.ways.choose(2):
            self.robot.go_astray(name)
            self.shift = ("BF", self.world.shift(name))
            for kind in ("tool", "frame"):
                for number in (0, 1, 2):
                    self.frames[kind, number] = self._frame(kind, number) @ self.world.shift(f"{name}{kind}{number}")


@dataclass(frozen=True)
class Rconf:
    """Test of joint angles (6,) rad against RCONF."""

    values: tuple[int, ...]

    def __call__(self, q: Array) -> bool:
        return rconf(q)[: len(self.values)] == self.values


def rconf(q: Array) -> tuple[int, ...]:
    """0 for a flipped wrist, the upper elbow and the front, and 1 for R, T, S of at least 180 degrees."""
    first, shoulder, elbow, _, wrist, *_ = links(cell("yaskawa"), q)
    reach, bend = wrist[:3, 3] - shoulder[:3, 3], elbow[:3, 3] - shoulder[:3, 3]
    above = bend - (bend @ reach) / (reach @ reach) * reach
    up, front = above @ first[:3, 2] > 0, (wrist[:3, 3] - first[:3, 3]) @ first[:3, 0] > 0
    return (int(q[4] <= 0), int(not up), int(not front), *(int(abs(q[k]) >= np.pi) for k in (3, 5, 0)))
