"""A session of an emulated cell in simulated time: 50 minutes in one or two.

Daemon, instruments, lines' pace, the robot with its programs and the inference are the same; only the processes, the
ports and the clock are not. So nothing is late here, whatever else the computer does, and a seed gives the same runs.
What a person would do between programs is planned for, and takes no time. An inference takes a time of its own beside
the robot, in which it must be done in fact.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

from analysis.apps.emulate.pendant import Pendant
from analysis.apps.emulate.robot import EmulatedRobot, write_cell_files
from analysis.apps.emulate.served_cell import CellEvent, Keyboard
from analysis.apps.session.answer import Inference
from analysis.apps.session.daemon_cell import Rigd
from analysis.apps.session.session_state import Answer
from daq import clock
from daq.apps.emulate.emulated_cell import as_emulated
from daq.apps.emulate.simulated_cell import SimulatedCell
from daq.apps.emulate.simulated_clock import SimulatedClock
from rigs.errors import CellError
from rigs.load import load, load_hidden

_INFERENCE_S = 20.0
"""Simulated seconds of an inference. Measured: 10 to 25 s for four to twelve runs, on a core of two that are busy."""
_HANGS_S = 1800.0
"""So long in real time the slowest inference takes."""
_LOOK_S = 0.02


class SimulatedChild:
    """What `rig emulate` is to a session, without a process: it takes the lines that are typed, and answers."""

    @classmethod
    def start(
        cls,
        time_of_cell: SimulatedClock,
        arguments: Sequence[str | Path],
        folder: Path,
        log: Path,
        hear: Callable[[CellEvent], None],
    ) -> SimulatedChild:
        """Start one. arguments: of `rig emulate`, as `EmulatedHands` gives them; folder: of the session. Raises
        RigError."""
        options: Mapping[str | Path, str | Path] = dict(zip(arguments[2::2], arguments[3::2], strict=True))
        rig, text = load(Path(arguments[1]))
        text = as_emulated(text)
        hidden = load_hidden(str(options["--effects"])).within(rig) if "--effects" in options else rig
        robot = EmulatedRobot.of_rig(hidden, int(str(options["--seed"])))
        write_cell_files(Path(options["-o"]), hidden, robot, text)
        time_of_cell.kill("cell")
        cell = SimulatedCell.switched_on(time_of_cell, folder, text, robot, robot.signal)
        pendant = Pendant(hidden, Path(options["--programs"]), str(options["--for"]))
        child = cls(cell, robot, pendant, log, hear)
        with time_of_cell.process("cell"):
            child._keyboard.start()
        hear(CellEvent("ready", str(options["-o"]), "ready"))
        return child

    def __init__(
        self,
        cell: SimulatedCell,
        robot: EmulatedRobot,
        pendant: Pendant,
        log: Path,
        hear: Callable[[CellEvent], None],
    ) -> None:
        self.name, self.log, self.runs, self.cell = "rig emulate", log, True, cell
        self._keyboard = Keyboard(robot, pendant, self._end, hear)

    def _end(self, _: int) -> None:
        self.runs = False

    def type_line(self, line: str) -> None:
        """Write a line to it."""
        self._keyboard.take(line)

    def ended(self) -> CellError:
        """Return the error for its end."""
        return CellError(self.name, "ended by itself", "the same command goes on")

    def stop(self) -> None:
        """End it."""
        self._end(0)


class SimulatedRigd(Rigd):
    """The daemon of a session, in this process."""

    def __init__(self, rig_name: str, cell: SimulatedCell) -> None:
        self._name, self._cell = rig_name, cell
        self._after = {}
        self._daemon: Any = cell.daemon()
        self._hold_reading()

    def ask(self, command: str, **fields: Any) -> dict[str, Any]:
        """Ask it. Raises RigError."""
        if self._daemon is None:
            raise CellError("rigd", "ended by itself", "see the log, then repeat the command")
        answer: dict[str, Any] = self._daemon.answer({"command": command, **fields})
        return answer

    def stop(self) -> None:
        """Stop it; a run that it records is closed."""
        if self._daemon is not None:
            self._daemon.close("complete", "the session is over")
            self._daemon = None

    def kill(self) -> None:
        """End it as SIGKILL does."""
        if self._daemon is not None:
            self._cell.kill(self._daemon)
            self._daemon = None


class SimulatedCells:
    """What a session starts: emulated cells, one after the other, and the daemon of each."""

    def __init__(self, simulated: SimulatedClock, folder: Path) -> None:
        """folder: of the session; runs are in `runs` of it."""
        self._clock, self._folder = simulated, folder
        self._child: SimulatedChild | None = None
        self.rigd: SimulatedRigd | None = None

    def start_cell(
        self, arguments: Sequence[str | Path], log: Path, hear: Callable[[CellEvent], None]
    ) -> SimulatedChild:
        """`StartCell` of `EmulatedHands`."""
        self._child = SimulatedChild.start(self._clock, arguments, self._folder, log, hear)
        return self._child

    def start_rigd(self, rig_name: str, _rig_file: Path, _runs: Path, _log: Path) -> Rigd:
        """`StartRigd` of `LiveDriver`."""
        assert self._child is not None  # noqa: S101 - hands set a stage up before it is read
        self.rigd = SimulatedRigd(rig_name, self._child.cell)
        return self.rigd


@dataclass
class SimulatedInference:
    """An inference in a process of its own beside the simulated cell, which is done after a fixed simulated time."""

    inference: Inference
    done_ns: int

    @classmethod
    def start(cls, used: Sequence[Path], judges: Sequence[Path], rig_file: Path, directory: Path) -> SimulatedInference:
        """Start one. Raises FileError and CellError where its request cannot be written."""
        done_ns = clock.now_ns() + int(1e9 * _INFERENCE_S)
        return cls(Inference.start(used, judges, rig_file, directory), done_ns)

    @property
    def is_done(self) -> bool:
        """Whether its time is over; by then it is waited for in fact."""
        if clock.now_ns() < self.done_ns:
            return False
        while not self.inference.is_done:
            time.sleep(_LOOK_S)
        return True

    def result(self) -> Answer:
        """Return its answer. Raises CellError where it has none."""
        return self.inference.result()


@contextmanager
def simulated_time(seed: int) -> Iterator[SimulatedClock]:
    """Let simulated time begin now, and pass as fast as it is computed; Ctrl-C ends it as it ends real time."""
    simulated = SimulatedClock(seed, hangs_s=_HANGS_S, began_wall_ns=time.time_ns())
    with simulated.running():
        if threading.current_thread() is not threading.main_thread():
            yield simulated
            return

        def interrupt(_signal: int, _frame: FrameType | None) -> None:
            simulated.interrupt()

        before = signal.signal(signal.SIGINT, interrupt)
        try:
            yield simulated
        finally:
            signal.signal(signal.SIGINT, before)
