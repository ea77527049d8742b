"""An emulated or replayed cell in its directory: made there, locked, and served until a signal or its own end.

The directory holds the rig file by which a daemon reads the cell, and either what a perfect measurement would find or
the marks of a replay; by these it is known as no other's.
"""

from __future__ import annotations

import signal
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

from analysis.emulation.keyboard import CellEvent, Keyboard
from analysis.emulation.pendant import Pendant
from analysis.simulation.emulated_robot import PROGRAMS, RIG, TRUTH, EmulatedRobot, write_cell_files
from daq.emulators import Cell, emulated
from daq.service.trust import InstanceLock
from rigs.errors import FileError, UseError
from rigs.load import load, load_hidden, named_by
from rigs.schema.vocabulary import MakerName
from rigs.signals import end_from

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
