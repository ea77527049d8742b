"""Interpreter of FANUC TP programs in ASCII, written from the HandlingTool manual.

Positions contain their user frame and tool, and the controller refuses positions of frames that are not selected. The
arm is group 1. The other groups move by themselves, unless a move is coordinated (COORD): its target then moves with
the leading group.
Offset rotates and shifts in the user frame, Tool_Offset in the tool. CONFIG selects the posture. W, P, R are rotations
about the fixed x, y, z axes.
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
    Line,
    LineBlocks,
    Loop,
    Place,
    Step,
    Ways,
    World,
    steps_of,
    stop,
)
from tests.worlds.languages.frames import angles_of, inverted, moved, of_angles, shifted
from tests.worlds.languages.machines import JobMachine, elbow_up_and_front

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)"
_AXES = ("X", "Y", "Z", "W", "P", "R")
_STILL = re.compile(
    r"(?i)(DO|RO|GO|AO|SO|UO|F|M|WO|R|SR|PL|TIMER|\$WAITTMOUT|\$[A-LN-Z]\w*|\$MOR\w*)\[?.*=|WAIT|PAUSE|OVERRIDE|PAYLOAD|MESSAGE|UALM|RSR|JOINT_MAX|LINEAR_MAX"
    r"|SKIP CONDITION|COL|MONITOR|LOCK|UNLOCK|DETECT|PULSE|DO\[|GO\[|RO\[|TC_ONLINE|LOOK|STOP_TRACKING"
    r"|ARC (START|END)|WELD (START|END)|WEAVE|SPOT\["
)


@dataclass(frozen=True)
class Position:
    """A taught position: user frame and tool (None for the selected ones), numbers, CONFIG, and its lines."""

    uf: int | None
    ut: int | None
    q: Array | None
    X: Array | None
    config: str
    rail: float | None
    """Position of extended axes of group 1; None if not given, so they do not move."""
    others: float
    """Sum of the positions of the other groups."""
    src: frozenset[Place]

    @property
    def frame(self) -> Array:
        return np.eye(4) if self.X is None else self.X


@dataclass
class _Routine:
    steps: list[Step]
    positions: dict[int, Position]
    tracks: bool


class Program(LineBlocks):
    """The programs of a controller by their names."""

    def __init__(self, files: Mapping[str, str], main: str) -> None:
        self.routines: dict[str, _Routine] = {}
        self.main = ""
        for name, text in files.items():
            rows = re.split(r"\r\n|\r|\n", text)
            head = next(row.split()[1].upper() for row in rows if row.startswith("/PROG"))
            at = {mark: k for k, row in enumerate(rows) for mark in ("/MN", "/POS", "/END") if row.strip() == mark}
            self._lines = _lines(name, rows[at["/MN"] + 1 : at["/POS"]], at["/MN"] + 1)
            self._at = 0
            positions = _positions(name, rows[at["/POS"] + 1 : at["/END"]], at["/POS"] + 1)
            tracks = any("LINE_TRACK_SCHEDULE" in row and not re.search(r":\s*0\s*;", row) for row in rows[: at["/MN"]])
            self.routines[head] = _Routine(steps_of(self._block()), positions, tracks)
            if name == main:
                self.main = head

    def _statement(self, line: Line) -> list[Any]:
        place, text = line.place, line.text
        upper = text.upper()
        if found := re.match(r"LBL\[(\w+)", upper):
            return [Label(found[1])]
        if found := re.match(r"JMP LBL\[(\w+)", upper):
            return [Goto(place, (found[1],), perhaps=False)]
        if re.match(r"IF\s*\(.*\)\s*THEN$", upper):
            bodies, _ = self._bodies(("ELSE",), "ENDIF")
            return [Branch(place, bodies, len(bodies) > 1)]
        if upper.startswith("FOR "):
            return [Loop(place, self._body("ENDFOR")[0])]
        if upper.startswith(("IF", "SELECT")) or re.match(r"(=|ELSE,)", upper):
            action = re.split(r",(?![^(]*\))", text)[-1].strip()  # Commas in brackets separate arguments.
            return [Branch(place, [self._statement(Line(place, action))], False)]
        if re.match(r"(END|ABORT)$", upper):
            return [Do(place, (lambda _: None) if upper == "END" else stop, ends=True)]
        return [Do(place, lambda m: m.instruction(text, place))]


def _lines(name: str, rows: list[str], begin: int) -> list[Line]:
    lines: list[Line] = []
    ended = False
    for number, row in enumerate(rows, start=begin + 1):
        found = re.match(r"\s*(\d*)\s*:(.*)$", row)
        if not found:
            continue
        text = found[2].rstrip().removesuffix(";").strip()
        if not found[1] and lines and not ended:
            lines[-1] = Line(lines[-1].place, lines[-1].text + " " + text)
        elif text and not text.startswith(("!", "//", "--")):
            lines.append(Line((name, number), text))
        elif found[1]:
            lines.append(Line((name, number), "!"))
        ended = row.rstrip().endswith(";")
    return [line for line in lines if not line.text.startswith("!")]


def _positions(name: str, rows: list[str], begin: int) -> dict[int, Position]:
    positions: dict[int, Position] = {}
    k = 0
    while k < len(rows):
        head = re.match(r"\s*P\[(\d+)", rows[k])
        if not head:
            k += 1
            continue
        end = next(j for j in range(k, len(rows)) if "}" in rows[j])
        text = "\n".join(rows[k : end + 1])
        src = frozenset((name, begin + j + 1) for j in range(k, end + 1))
        first, *others = re.split(r"GP\d\s*:", text)[1:]
        numbers = {
            key: float(value) for key, value in re.findall(rf"\b([XYZWPR]|J[1-9]|E[1-3])\s*=\s*({_NUMBER})", first)
        }
        uf, ut = (re.search(rf"{which}\s*:\s*(\w+)", first) for which in ("UF", "UT"))
        config = re.search(r"CONFIG\s*:\s*'([^']*)'", first)
        joints = [numbers[f"J{axis}"] for axis in range(1, 7) if f"J{axis}" in numbers]
        X = of_angles(*(numbers[axis] for axis in _AXES)) if numbers.keys() >= set(_AXES) else None
        moved = sum(float(value) for other in others for value in re.findall(rf"=\s*({_NUMBER})", other))
        positions[int(head[1])] = Position(
            int(uf[1]) if uf and uf[1].isdigit() else None,
            int(ut[1]) if ut and ut[1].isdigit() else None,
            np.radians(joints) if len(joints) == 6 else None,
            X,
            config[1] if config else "",
            numbers.get("E1"),
            moved,
            src,
        )
        k = end + 1
    return positions


class Machine(JobMachine):
    """A controller that executes a program along one execution path."""

    dialect = "fanuc"

    def __init__(self, program: Program, world: World, ways: Ways) -> None:
        super().__init__(program, world, ways)
        if any(position.rail for routine in program.routines.values() for position in routine.positions.values()):
            self.robot.begin_on_rail()
        self.unchecked = bool(world.seed % 2)
        """True if the check of frame numbers is off ($FRM_CHKTYP), so the controller uses the selected frames."""
        self.uf: int | None = None
        self.ut: int | None = None
        self.registers: dict[int, Array] = {}
        self.taught = {
            (name, number): position
            for name, routine in program.routines.items()
            for number, position in routine.positions.items()
        }
        self.conditions = {"OFFSET": np.eye(4), "TOOL_OFFSET": np.eye(4)}

    def frame(self, kind: str, number: int) -> Array:
        return super().frame(kind, number) if number else np.eye(4)

    def _register(self, number: int) -> Array:
        return self.registers.get(number, self.world.shift(f"PR[{number}]"))

    def instruction(self, text: str, place: Place) -> None:
        upper = text.upper()
        if re.match(r"[JLCAS] +P(R?)\[", upper):
            self._move(text, place)
        elif found := re.match(r"(CALL|RUN) +([A-Z0-9_]+)", upper):
            self.call(found[2])
        elif found := re.match(r"U(FRAME|TOOL)_NUM *= *(\w+)", upper):
            number = int(found[2]) if found[2].isdigit() else int(self.world.number(text, 1, 3))
            if found[1] == "FRAME":
                self.uf = number
            else:
                self.ut = number
        elif found := re.match(r"U(FRAME|TOOL)\[(\d+)[^\]]*\] *= *(.*)", upper):
            self.frames[("frame" if found[1] == "FRAME" else "tool"), int(found[2])] = self._value(found[3].strip())
        elif found := re.match(r"(OFFSET|TOOL_OFFSET) CONDITION +PR\[(\d+)", upper):
            self.conditions[found[1]] = self._register(int(found[2]))
        elif re.match(r"PR\[GP[2-9]:", upper):
            pass  # The register of a group that is not the arm.
        elif found := re.match(r"PR\[(?:GP1:)?(\d+)(?::[^\],]*)?(?:, *(\d))?[^\]]*\] *= *(.*)", upper):
            number = int(found[1])
            self.registers[number] = self._assigned(self._register(number), found[2], found[3])
        elif found := re.match(r"P\[(\d+)[^\]]*?(?:, *(\d))?\] *= *(.*)", upper):
            self._teach(int(found[1]), found[2], found[3], place)
        elif not _STILL.match(upper):
            self.unknown(upper)

    def _assigned(self, T: Array, component: str | None, text: str) -> Array:
        """Value (4, 4) of a text, or a frame T (4, 4) of which the text is one component."""
        if component is None:
            return self._value(text.strip())
        found = re.fullmatch(rf"\(?({_NUMBER})\)?", text.strip())
        numbers = list(angles_of(T))
        numbers[int(component) - 1] = float(found[1]) if found else self.world.number(text)
        return of_angles(*numbers)

    def _value(self, text: str) -> Array:
        if found := re.fullmatch(r"(PR?)\[(\d+)[^\]]*\]", text):
            number = int(found[2])
            return self._register(number) if found[1] == "PR" else self._taught(number).frame
        if re.fullmatch(r"LPOS *- *LPOS", text):
            return np.eye(4)
        if text == "LPOS":
            tool, user = self.frame("tool", self.ut or 0), self.frame("frame", self.uf or 0)
            return inverted(user) @ self.robot.pose_now(tool)
        return self.world.shift(text)

    def _taught(self, number: int) -> Position:
        position = self.taught.get((self.running[-1], number))
        if position is None:
            raise Ended
        return position

    def _teach(self, number: int, component: str | None, text: str, place: Place) -> None:
        old = self._taught(number)
        X = self._assigned(old.frame, component, text)
        self.taught[self.running[-1], number] = replace(old, q=None, X=X, rail=None, src=old.src | {place})

    def _move(self, text: str, place: Place) -> None:
        for kind, number in re.findall(
            r"\b(P|PR)\[(\w+)[^\]]*\](?![^,]*,PR)", re.split(r"(?i)offset|\bTA\b|\bTB\b|\bDB\b", text)[0]
        ):
            if kind == "PR" or not number.isdigit():
                self.robot.q = self.robot.here.centre.copy()
                continue
            self._to(self._taught(int(number)), text, place)

    def _to(self, position: Position, text: str, place: Place) -> None:
        src = position.src | {place}
        for name, wanted in (("uf", position.uf), ("ut", position.ut)):
            if getattr(self, name) is None and wanted is not None:
                setattr(self, name, int(self.world.number(name, 1, 3)) if self.unchecked else wanted)
            if wanted is not None and wanted != getattr(self, name) and not self.unchecked:
                raise Ended
        tool, user = self.frame("tool", self.ut or 0), self.frame("frame", self.uf or 0)
        relative, offset, tool_offset = self._options(text)
        if position.rail is not None:
            self.robot.rail_mm = position.rail
        if position.q is not None and not (relative or "COORD" in text) and offset is None and tool_offset is None:
            self.robot.joints(position.q, tool, place, src)
            return
        X = position.X
        if X is None and position.q is not None:
            X = inverted(user) @ self.robot.flange(position.q) @ tool
        if X is None:
            raise Ended
        if relative:
            now = inverted(user) @ self.robot.pose_now(tool)
            X = moved(now, X)
        if offset is not None:
            X = offset @ X
        if tool_offset is not None:
            X = X @ tool_offset
        if self.program.routines[self.running[-1]].tracks:
            X = self.world.shift("track") @ X
        if re.search(r"\bCOORD\b", text):
            X = self.world.shift(f"leader at {position.others}") @ X
        F = shifted(user @ X @ inverted(tool), -self.robot.rail_mm)
        config = position.config or ("" if position.q is None else config_letters(position.q))
        chosen = Config(config) if config and not relative else None
        self.robot.pose(F, tool[:3, 3], place, src, chosen, straight=text[0] != "J")

    def _options(self, text: str) -> tuple[bool, Array | None, Array | None]:
        relative = bool(re.search(r"\bINC\b", text, re.I))
        offsets: list[Array | None] = []
        for word, condition in ((r"(?<!_)(?<![A-Z])Offset", "OFFSET"), ("Tool_Offset", "TOOL_OFFSET")):
            found = re.search(rf"(?i:{word})(?:, *PR\[(\d+))?", text)
            if found:
                offsets.append(self._register(int(found[1])) if found[1] else self.conditions[condition])
            elif condition == "OFFSET" and re.search(r"(?i)VOFFSET", text):
                offsets.append(self.world.shift("vision"))
            else:
                offsets.append(None)
        return relative, offsets[0], offsets[1]

    def changed_by(self, name: str) -> None:
        self.shift_frames(name, (1, 2, 3))
        self.conditions["OFFSET"] = self.world.shift(name)


@dataclass(frozen=True)
class Config:
    """Test of joint angles (6,) rad against CONFIG; its turn numbers belong to J4, J5, J6."""

    text: str

    def __call__(self, q: Array) -> bool:
        letters, *turns = [one.strip() for one in self.text.split(",")]
        counts = [int(one) for one in turns if one.lstrip("-").isdigit()]
        return letters.split() == config_letters(q).split() and all(
            count == int(np.floor((np.degrees(angle) + 180) / 360)) for count, angle in zip(counts, q[3:], strict=False)
        )


def config_letters(q: Array) -> str:
    """Return N or F for the wrist, U or D for the elbow, and T or B for the side the arm faces."""
    up, front = elbow_up_and_front("fanuc", q)
    return f"{'F' if q[4] > 0 else 'N'} {'U' if up else 'D'} {'T' if front else 'B'}"
