"""What a person types at `rig emulate`: a line starts a program, stops it, or changes the robot; each answer an event.

stop, pause, go on and show act at once. What begins something (a program, entering parameters, the end) waits until the
program before it is over, so that lines can be typed, or piped, ahead.
"""

from __future__ import annotations

import json
import sys
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

from analysis.emulation.pendant import Pendant
from analysis.simulation.emulated_robot import EmulatedRobot, State
from daq import clock
from rigs.errors import RigError, UseError

_LOOK_S = 0.02
"""How often it is looked at what a program does."""
_SAID: dict[State, str] = {
    "waits": "waits for a person; type go on",
    "paused": "paused",
    "drives": "goes on",
    "stopped": "stopped",
    "done": "done",
}


@dataclass(frozen=True)
class CellEvent:
    """What an emulated cell reports. event: what happened; name: of the port, program, file or column of which it
    happened, or the line that was refused; text: the same in words."""

    event: Literal["port", "ready", "driving", "entered", "shows", "refused", "sent", State]
    name: str
    text: str

    @property
    def as_line(self) -> str:
        """A line of JSON, for programs."""
        return json.dumps(asdict(self))

    @classmethod
    def of_line(cls, line: str) -> CellEvent | None:
        """Return the event of a line of JSON; None for any other line, such as the end of a traceback."""
        try:
            return cls(**json.loads(line))
        except (ValueError, TypeError):
            return None


class Keyboard:
    """A person at the keyboard of an emulated cell; end: called with the exit code when the cell is to end.

    report: called with each event that the cell answers with.
    """

    def __init__(
        self,
        robot: EmulatedRobot,
        pendant: Pendant | None,
        end: Callable[[int], None],
        report: Callable[[CellEvent], None],
    ) -> None:
        self._robot, self._pendant, self._end, self._report = robot, pendant, end, report
        self._waiting: deque[str] = deque()
        self._some_wait = clock.Event()

    def read(self, *, has_person: bool) -> None:
        """Begin to take the lines of standard input. has_person: whether the cell ends where they end; else it serves
        until a signal comes."""
        threading.Thread(target=self._read, args=(has_person,), daemon=True).start()

    def start(self) -> None:
        """Begin to do what waits for its turn."""
        clock.Thread(target=self._begin_in_turn, name="keyboard", daemon=True).start()

    def take(self, line: str) -> None:
        """Take a line: what acts at once is done."""
        word, _, _ = line.partition(" ")
        if word in ("stop", "pause", "show") or line == "go on":
            self._try(self._at_once, line)
        else:
            self._waiting.append(line)
            self._some_wait.set()

    def _read(self, has_person: bool) -> None:
        for line in filter(None, map(str.strip, sys.stdin or ())):  # none where standard input is closed
            self.take(line)
        if has_person:
            self.take("quit")

    def _begin_in_turn(self) -> None:
        while (line := self._next()) != "quit":
            self._try(self._begin, line)
        self._end(0)

    def _next(self) -> str:
        while not self._waiting:
            self._some_wait.wait()
            self._some_wait.clear()
        return self._waiting.popleft()

    def _at_once(self, line: str) -> None:
        word, _, argument = line.partition(" ")
        if word == "show":
            column, _, value = argument.strip().partition(" ")
            self._robot.show(column, value.strip())
            self._report(CellEvent("shows", column, f"{column}: {value.strip()}"))
            return
        done = {"stop": self._robot.stop, "pause": self._robot.pause, "go on": self._robot.go_on}.get(line)
        if done is None:
            raise UseError(repr(line), "is no command", "type stop, pause or go on")
        if not done():
            problem = "no program waits or is paused" if line == "go on" else "no program drives"
            raise UseError(line, problem, "start one with run NAME")

    def _begin(self, line: str) -> None:
        word, _, name = line.partition(" ")
        if word == "enter":
            count, more_rad = self._with_programs().enter(Path(name.strip()))
            self._robot.reads_more(more_rad)
            self._report(CellEvent("entered", name.strip(), f"{name.strip()}: entered, {count} parameters"))
            return
        if word == "run":
            name = name.strip()
            seconds = self._robot.play(self._with_programs().trace(name))
        elif self._pendant and self._pendant.controller:
            raise UseError(line, "does not know the parameters that were entered", "start a program with run NAME")
        else:
            name, seconds = line, self._robot.start(line)
        self._report(CellEvent("driving", name, f"{name}: driving, {seconds:.1f} s"))
        # Say each change of what the program does, until it is over.
        before: State = "drives"
        while before not in ("done", "stopped"):
            if (state := self._robot.state(clock.now_ns())) != before:
                before = state
                self._report(CellEvent(state, name, f"{name}: {_SAID[state]}"))
            clock.sleep(_LOOK_S)

    def _with_programs(self) -> Pendant:
        if self._pendant is None:
            raise UseError("rig emulate", "has no programs", "start it with --programs DIRECTORY")
        return self._pendant

    def _try(self, act: Callable[[str], None], line: str) -> None:
        try:
            act(line)
        except RigError as error:
            self._report(CellEvent("refused", line, f"error: {error}"))
