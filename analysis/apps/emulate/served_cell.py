"""An emulated or replayed cell in its directory: made there, locked, and served until a signal or its own end.

The directory holds the rig file by which a daemon reads the cell, and either what a perfect measurement would find or
the marks of a replay; by these it is known as no other's.

What a person types at `rig emulate` goes to the cell: a line starts a program, stops it, or changes the robot; each
answer is an event. stop, pause, go on and show act at once. What begins something (a program, entering parameters, the
end) waits until the program before it is over, so that lines can be typed, or piped, ahead.
"""

from __future__ import annotations

import json
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from queue import SimpleQueue
from typing import Literal

from analysis.apps.emulate.pendant import Pendant
from analysis.apps.emulate.robot import PROGRAMS, RIG, TRUTH, EmulatedRobot, State, write_cell_files
from daq import clock
from daq.apps.emulate.emulated_cell import Cell
from daq.apps.emulate.instruments import emulated
from daq.service.trust import InstanceLock
from rigs.errors import FileError, RigError, UseError
from rigs.load import load, load_hidden, named_by
from rigs.schema.vocabulary import MakerName
from rigs.signals import end_from

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


MARKS = "out-of-step.txt"
"""A file beside the rig file of a replayed cell."""
ENDED, INTERRUPTED = 0, 130
"""Exit codes of a cell that SIGTERM or its keyboard ends, and of one that Ctrl-C ends."""


def locked_cell(directory: Path) -> InstanceLock:
    """Make the directory of a cell, and lock it. Raises FileError where it cannot be made, and CellError where another
    cell is served in it."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(str(directory), error.strerror or str(error), "give another --output") from None
    return InstanceLock.take_cell(directory)


def rig_file_of_cell(directory: Path) -> Path:
    """Return where to write the rig file of a cell, in place of that of an earlier one. Raises FileError for any other
    rig file."""
    path = directory / RIG
    if path.exists() and not any((directory / file).exists() for file in (TRUTH, MARKS)):
        raise FileError(str(path), "exists already, and is not of an emulated cell", "give another --output")
    return path


def serve(cell: Cell, lock: InstanceLock, attend: Callable[[SimpleQueue[int]], int]) -> tuple[int, dict[str, int]]:
    """Serve a cell as long as `attend` takes, which is called with where the exit codes of signals come; return its
    exit code, and how much each instrument sent. The lock is released."""
    ends: SimpleQueue[int] = SimpleQueue()
    signal.signal(signal.SIGTERM, lambda *_: ends.put(ENDED))
    signal.signal(signal.SIGINT, lambda *_: ends.put(INTERRUPTED))
    cell.start()
    try:
        exit_code = attend(ends)
    finally:
        sent = cell.stop()
        lock.release()
    return exit_code, sent


@dataclass(frozen=True)
class EmulatedCell:
    """A cell to emulate: its rig file, the effects that its arm hides (a file, or a shipped rig; None for those of the
    rig file), the directory of the programs that its controller drives, of which maker, and the seed of its noise."""

    rig_file: str
    effects: str | None
    programs: Path | None
    maker: MakerName | None
    seed: int

    def serve(self, directory: Path, report: Callable[[CellEvent], None], *, has_person: bool) -> int:
        """Write the files of the cell into a directory, serve it until a signal or the keyboard ends it, and return the
        exit code. report: called with each event. Raises RigError where that cannot be."""
        if self.maker and self.programs is None:
            raise UseError("--for", "is for the controller that drives --programs", "give --programs as well")
        if self.programs is not None and not self.programs.is_dir():
            raise FileError(str(self.programs), "is no directory", "give the directory that holds the programs")
        rig, text = load(self.rig_file)
        path = rig_file_of_cell(directory)
        rig = load_hidden(self.effects).within(rig) if self.effects else rig
        with named_by(self.rig_file, rig):
            robot = EmulatedRobot.of_rig(rig, self.seed)
        cell = emulated(rig, robot, robot.signal, condition=robot.condition)
        lock = locked_cell(directory)
        write_cell_files(directory, rig, robot, cell.rig_text(text, emulated=True))

        def attend(ends: SimpleQueue[int]) -> int:
            for name, port in cell.ports.items():
                report(CellEvent("port", name, f"{name}: {port}"))
            programs = ", ".join(["run NAME"] if self.programs else PROGRAMS)
            report(CellEvent("ready", str(path), f"ready; next: rigd {path}; then type here: {programs} or quit"))
            pendant = Pendant(rig, self.programs, self.maker) if self.programs else None
            keyboard = Keyboard(robot, pendant, ends.put, report)
            keyboard.start()
            keyboard.read(has_person=has_person)
            return end_from(ends)

        exit_code, sent = serve(cell, lock, attend)
        for name, count in sent.items():
            report(CellEvent("sent", name, f"{name}: {count} sent"))
        return exit_code
