"""Session of an emulated cell in simulated time: 50 minutes pass in one or two.

The daemon, the instruments, the timing of the lines, the robot with its programs and the inference are the same as in
real time. Only the processes, ports and clock are replaced. Nothing is ever late, regardless of the load of the
computer, and a seed always produces the same runs. Manual work between programs is planned for but takes no time. An
inference runs in parallel with the robot and takes a fixed simulated time.
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
from typing import TYPE_CHECKING, Any

from analysis.apps.emulate.pendant import Pendant
from analysis.apps.emulate.robot import EmulatedRobot, write_cell_files
from analysis.apps.emulate.served_cell import CellEvent, Keyboard
from analysis.apps.session.answer import Inference
from analysis.apps.session.daemon_cell import Rigd
from analysis.apps.session.session_state import Answer
from daq import clock
from daq.apps.emulate.emulated_cell import as_emulated
from daq.apps.emulate.instruments import instruments_of
from daq.apps.emulate.simulated_cell import SimulatedCell
from daq.apps.emulate.simulated_clock import SimulatedClock
from rigs.errors import CellError
from rigs.load import load, load_hidden, parse

if TYPE_CHECKING:
    from analysis.diagnosis.judge.result import Diagnosis

_INFERENCE_S = 20.0
"""Simulated duration of an inference. Measured: 10 to 25 s for four to twelve runs on one of two busy cores."""
_HANGS_S = 1800.0
"""Upper limit for the slowest inference in real time."""
_POLL_S = 0.02


class SimulatedChild:
    """In-process replacement of `rig emulate` for a session. It receives typed lines and reports events."""

    @classmethod
    def start(
        cls,
        time_of_cell: SimulatedClock,
        arguments: Sequence[str | Path],
        folder: Path,
        log: Path,
        hear: Callable[[CellEvent], None],
    ) -> SimulatedChild:
        """Start an emulated cell.

        arguments: arguments of `rig emulate` from `EmulatedHands`. folder: directory of the session. Raises RigError.
        """
        options: Mapping[str | Path, str | Path] = dict(zip(arguments[2::2], arguments[3::2], strict=True))
        rig, text = load(Path(arguments[1]))
        text = as_emulated(text)
        hidden = load_hidden(str(options["--effects"])).apply_to(rig) if "--effects" in options else rig
        robot = EmulatedRobot.of_rig(hidden, int(str(options["--seed"])))
        write_cell_files(Path(options["-o"]), hidden, robot, text)
        time_of_cell.kill("cell")
        devices = instruments_of(parse(text, "cell"), robot, robot.signal, condition=robot.pose)
        cell = SimulatedCell.switched_on(time_of_cell, folder, text, robot, robot.signal, devices)
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
        """Process a typed line."""
        self._keyboard.take(line)

    def ended(self) -> CellError:
        """Return an error that reports the end of the cell."""
        return CellError(self.name, "exited unexpectedly", "repeat the command to continue")

    def stop(self) -> None:
        """Stop the cell."""
        self._end(0)


class SimulatedRigd(Rigd):
    """Daemon of a session in the same process."""

    def __init__(self, rig_name: str, cell: SimulatedCell) -> None:
        self._name, self._cell = rig_name, cell
        self._after = {}
        self._daemon: Any = cell.daemon()
        self._wait_for_readings()

    def ask(self, command: str, **fields: Any) -> dict[str, Any]:
        """Send a command to the daemon. Raises RigError."""
        if self._daemon is None:
            raise CellError("rigd", "exited unexpectedly", "see the log, then repeat the command")
        answer: dict[str, Any] = self._daemon.answer({"command": command, **fields})
        return answer

    def stop(self) -> None:
        """Stop the daemon. It closes a run in progress."""
        if self._daemon is not None:
            self._daemon.close("complete", "the session is over")
            self._daemon = None

    def kill(self) -> None:
        """Kill the daemon as SIGKILL would."""
        if self._daemon is not None:
            self._cell.kill(self._daemon)
            self._daemon = None


class SimulatedCells:
    """Emulated cells of a session and the daemon of each."""

    def __init__(self, simulated: SimulatedClock, folder: Path) -> None:
        """folder: directory of the session. The runs are in the subdirectory `runs`."""
        self._clock, self._folder = simulated, folder
        self._child: SimulatedChild | None = None
        self.rigd: SimulatedRigd | None = None

    def start_cell(
        self, arguments: Sequence[str | Path], log: Path, hear: Callable[[CellEvent], None]
    ) -> SimulatedChild:
        """Start a cell; implements `StartCell` of `EmulatedHands`."""
        self._child = SimulatedChild.start(self._clock, arguments, self._folder, log, hear)
        return self._child

    def start_rigd(self, rig_name: str, _rig_file: Path, _runs: Path, _log: Path) -> Rigd:
        """Start the daemon of the current cell; implements `StartRigd` of `LiveDriver`."""
        assert self._child is not None  # noqa: S101 - hands set a stage up before it is read
        self.rigd = SimulatedRigd(rig_name, self._child.cell)
        return self.rigd


@dataclass
class SimulatedInference:
    """An inference in a separate process that finishes after a fixed simulated time."""

    inference: Inference
    done_ns: int

    @classmethod
    def start(cls, used: Sequence[Path], judges: Sequence[Path], rig_file: Path, directory: Path) -> SimulatedInference:
        """Start an inference. Raises FileError or CellError if the request cannot be written."""
        done_ns = clock.now_ns() + int(1e9 * _INFERENCE_S)
        return cls(Inference.start(used, judges, rig_file, directory), done_ns)

    @property
    def is_done(self) -> bool:
        """True if the simulated time has passed. The property then blocks until the real process has finished."""
        if clock.now_ns() < self.done_ns:
            return False
        while not self.inference.is_done:
            time.sleep(_POLL_S)
        return True

    def result(self) -> Answer:
        """Return the answer. Raises CellError if the process failed."""
        return self.inference.result()

    def diagnosis(self) -> Diagnosis | None:
        """Return the diagnosis that the process has written."""
        return self.inference.diagnosis()


@contextmanager
def simulated_time(seed: int) -> Iterator[SimulatedClock]:
    """Start simulated time, which passes as fast as it can be computed. Ctrl-C interrupts it like real time."""
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
