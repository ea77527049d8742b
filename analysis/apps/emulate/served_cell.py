"""An emulated or replayed cell in a directory, served until a signal or the end.

Typed commands and their responses are lines. stop, pause, go on and show act immediately; all others wait for the
running program, so lines can be piped.
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
from analysis.cli.dialogue import has_keyboard
from daq import clock
from daq.emulators.emulated_cell import EmulatedInstruments
from daq.emulators.instruments import emulated
from daq.store import durable
from rigs.errors import CellError, FileError, RigError, UseError
from rigs.load import load, load_hidden, named_by
from rigs.schema.vocabulary import MakerName
from rigs.signals import end_from

_POLL_S = 0.02
_STATE_TEXTS: dict[State, str] = {
    "waits": "waits for the operator; type go on",
    "paused": "paused",
    "drives": "goes on",
    "stopped": "stopped",
    "done": "done",
}


@dataclass(frozen=True)
class CellEvent:
    event: Literal["port", "ready", "driving", "entered", "shows", "refused", "sent", State]
    name: str
    text: str

    @property
    def as_line(self) -> str:
        return json.dumps(asdict(self))

    @classmethod
    def of_line(cls, line: str) -> CellEvent | None:
        """Parse a line of JSON; None for other lines, such as the end of a traceback."""
        try:
            return cls(**json.loads(line))
        except (ValueError, TypeError):
            return None


class Keyboard:
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
        """Start reading standard input. has_person: end with the input; otherwise serve until a signal."""
        threading.Thread(target=self._read, args=(has_person,), daemon=True).start()

    def start(self) -> None:
        clock.Thread(target=self._begin_in_turn, name="keyboard", daemon=True).start()

    def take(self, line: str) -> None:
        word, _, _ = line.partition(" ")
        if word in ("stop", "pause", "show") or line == "go on":
            self._try(self._at_once, line)
        else:
            self._waiting.append(line)
            self._some_wait.set()

    def _read(self, has_person: bool) -> None:
        for line in filter(None, map(str.strip, sys.stdin or ())):  # empty if standard input is closed
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
            raise UseError(repr(line), "is not a command", "type stop, pause or go on", code="robot.refused")
        if not done():
            problem = "no program is waiting or paused" if line == "go on" else "no program drives"
            raise UseError(line, problem, "start a program with run NAME", code="robot.refused")

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
            problem = "is not possible with the entered parameters"
            raise UseError(line, problem, "start a program with run NAME", code="robot.refused")
        else:
            name, seconds = line, self._robot.start(line)
        self._report(CellEvent("driving", name, f"{name}: driving, {seconds:.1f} s"))
        # Report each state of the program until it is finished.
        before: State = "drives"
        while before not in ("done", "stopped"):
            if (state := self._robot.state(clock.now_ns())) != before:
                before = state
                self._report(CellEvent(state, name, f"{name}: {_STATE_TEXTS[state]}"))
            clock.sleep(_POLL_S)

    def _with_programs(self) -> Pendant:
        if self._pendant is None:
            remedy = "start rig emulate with --programs DIRECTORY"
            raise UseError("rig emulate", "has no programs", remedy, code="usage")
        return self._pendant

    def _try(self, act: Callable[[str], None], line: str) -> None:
        try:
            act(line)
        except RigError as error:
            self._report(CellEvent("refused", line, f"error: {error}"))


MARKS = "out-of-step.txt"
"""File of timing deviations next to the rig file of a replayed cell."""
ENDED, INTERRUPTED = 0, 130
"""Exit codes after SIGTERM or a keyboard command, and after Ctrl-C."""


def locked_cell(directory: Path) -> int:
    """Create the directory of a cell, and lock it like the writer of a run; the lock is a descriptor."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
        lock = durable.try_lock(directory)
    except OSError as error:
        raise FileError.of_os(directory, error, "choose a different --output", code="output.not_writable") from None
    if lock is None:
        problem = "a different rig emulate or rig replay serves a cell in this directory"
        remedy = "stop that one, or choose a different --output"
        raise CellError(str(directory), problem, remedy, code="output.exists")
    return lock


def rig_file_of_cell(directory: Path) -> Path:
    """Path for the rig file of a cell. Raises FileError for an existing file that does not belong to a cell."""
    path = directory / RIG
    if path.exists() and not any((directory / file).exists() for file in (TRUTH, MARKS)):
        problem = "already exists, and does not belong to an emulated cell"
        raise FileError(str(path), problem, "choose a different --output", code="output.exists")
    return path


def serve(
    cell: EmulatedInstruments, lock: int, attend: Callable[[SimpleQueue[int]], int]
) -> tuple[int, dict[str, int]]:
    """Serve a cell while `attend` runs, which gets the queue of exit codes of signals, and release the lock.

    Gives the exit code, and the number of readings sent by each instrument.
    """
    ends: SimpleQueue[int] = SimpleQueue()
    signal.signal(signal.SIGTERM, lambda *_: ends.put(ENDED))
    signal.signal(signal.SIGINT, lambda *_: ends.put(INTERRUPTED))
    cell.start()
    try:
        exit_code = attend(ends)
    finally:
        sent = cell.stop()
        durable.close(lock)
    return exit_code, sent


def serve_emulated(
    rig_file: str,
    directory: Path,
    report: Callable[[CellEvent], None],
    *,
    effects: str | None,
    programs: Path | None,
    maker: MakerName | None,
    seed: int,
) -> int:
    """Write the files of an emulated cell to a directory and serve it until the end. Gives the exit code.

    effects: file or shipped rig with the hidden effects; None for those of the rig file.
    """
    if maker and programs is None:
        raise UseError("--for", "applies only to --programs", "add --programs")
    if programs is not None and not programs.is_dir():
        remedy = "give the directory of the programs"
        raise FileError(str(programs), "is not a directory", remedy, code="file.missing")
    rig, text = load(rig_file)
    path = rig_file_of_cell(directory)
    rig = load_hidden(effects).apply_to(rig) if effects else rig
    with named_by(rig_file, rig):
        robot = EmulatedRobot.of_rig(rig, seed)
    cell = emulated(rig, robot, robot.signal, condition=robot.condition)
    lock = locked_cell(directory)
    write_cell_files(directory, rig, robot, cell.rig_text(text, emulated=True))

    def attend(ends: SimpleQueue[int]) -> int:
        for name, port in cell.ports.items():
            report(CellEvent("port", name, f"{name}: {port}"))
        startable = ", ".join(["run NAME"] if programs else PROGRAMS)
        report(CellEvent("ready", str(path), f"ready; next: rigd {path}; then type here: {startable} or quit"))
        keyboard = Keyboard(robot, Pendant(rig, programs, maker) if programs else None, ends.put, report)
        keyboard.start()
        keyboard.read(has_person=has_keyboard())
        return end_from(ends)

    exit_code, sent = serve(cell, lock, attend)
    for name, count in sent.items():
        report(CellEvent("sent", name, f"{name}: {count} sent"))
    return exit_code
