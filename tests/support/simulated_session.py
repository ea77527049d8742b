"""A whole session in simulated time: the daemon, the instruments, the robot that drives programs of its maker, and the
inference are the same; only the processes, the ports and the clock are not.

An inference takes as much simulated time as it took of the computer's: it comes while the robot drives, as in a cell.
"""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from analysis.cli.emulated_keyboard import Keyboard
from analysis.emulation.pendant import Pendant
from analysis.session.answer import Inference
from analysis.session.cell import Rigd
from analysis.session.state import Answer
from analysis.simulation.emulated_robot import EmulatedRobot
from daq import clock
from daq.service.daemon import Daemon
from rigs.errors import CellError
from rigs.load import load, load_hidden
from tests.support.simulated_cell import SimulatedCell
from tests.support.simulated_clock import SimulatedClock


class CellOfSession:
    """What `rig emulate` is to a session, without a process: it takes the lines that are typed, and answers."""

    def __init__(self, clock_of_cell: SimulatedClock, arguments: Sequence[str | Path], folder: Path, log: Path) -> None:
        """arguments: of `rig emulate`, as `EmulatedHands` gives them."""
        self.name, self.log, self.runs = "rig emulate", log, True
        self.lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        rig_file = Path(arguments[1])
        options = dict(zip(arguments[2::2], arguments[3::2], strict=True))
        rig, text = load(rig_file)
        hidden = load_hidden(Path(options["--effects"])).within(rig) if "--effects" in options else rig
        robot = EmulatedRobot.of_rig(hidden, int(str(options["--seed"])))
        directory = Path(options["-o"])
        directory.mkdir(parents=True, exist_ok=True)
        (directory / "rig.yaml").write_text(text)
        clock_of_cell.kill("cell")
        self.cell = SimulatedCell(clock_of_cell, folder, text, robot, robot.signal)
        pendant = Pendant(hidden, Path(options["--programs"]), options["--for"])  # type: ignore[arg-type]
        self._keyboard = Keyboard(robot, pendant, self._end, self.lines.put)
        with clock_of_cell.process("cell"):
            self._keyboard.start()
        self.lines.put("ready")

    def _end(self, _: int) -> None:
        self.runs = False

    def type_line(self, line: str) -> None:
        self._keyboard.take(line)

    def ended(self) -> CellError:
        return CellError(self.name, "ended by itself", "the same command goes on")

    def stop(self) -> None:
        self._end(0)


class RigdOfSession(Rigd):
    """The daemon of a session, in this process."""

    def __init__(self, rig_name: str, cell: SimulatedCell) -> None:
        self._name, self._cell = rig_name, cell
        self._daemon: Daemon | None = cell.daemon()
        self._hold_reading()

    def ask(self, command: str, **fields: Any) -> dict[str, Any]:
        if self._daemon is None:
            raise CellError("rigd", "ended by itself", "see its log; then the same command goes on")
        return self._daemon.answer({"command": command, **fields})

    def stop(self) -> None:
        if self._daemon is not None:
            self._daemon.close("complete", "the session is over")
            self._daemon = None

    def kill(self) -> None:
        """SIGKILL."""
        if self._daemon is not None:
            self._cell.kill(self._daemon)
            self._daemon = None


@dataclass
class TimedInference:
    """An inference in a process of its own, waited for; it is done when as much simulated time has passed."""

    answer: Callable[[], Answer]
    done_ns: int

    @classmethod
    def start(cls, used: Sequence[Path], judges: Sequence[Path], rig_file: Path, directory: Path) -> TimedInference:
        began_s = time.monotonic()
        started = Inference.start(used, judges, rig_file, directory)
        while not started.is_done:
            time.sleep(0.05)
        return cls(started.result, clock.now_ns() + int(1e9 * (time.monotonic() - began_s)))

    @property
    def is_done(self) -> bool:
        return clock.now_ns() >= self.done_ns

    def result(self) -> Answer:
        return self.answer()


class SimulatedCells:
    """What a session starts: emulated cells, one after the other, and the daemon of each."""

    def __init__(self, simulated: SimulatedClock, folder: Path) -> None:
        """folder: of the session; runs are in `runs` of it."""
        self._clock, self._folder = simulated, folder
        self._child: CellOfSession | None = None
        self.rigd: RigdOfSession | None = None

    def start_cell(self, arguments: Sequence[str | Path], log: Path) -> CellOfSession:
        """`StartCell` of `EmulatedHands`."""
        self._child = CellOfSession(self._clock, arguments, self._folder, log)
        return self._child

    def start_rigd(self, rig_name: str, _rig_file: Path, _runs: Path, _log: Path) -> Rigd:
        """`StartRigd` of `LiveDriver`."""
        assert self._child is not None
        self.rigd = RigdOfSession(rig_name, self._child.cell)
        return self.rigd
