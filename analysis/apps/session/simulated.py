"""Cell of a session in simulated time: 50 minutes pass in one or two.

Only processes, ports and clock are replaced, nothing is ever late, and a seed always gives the same runs. Manual work
takes no time; an inference takes a fixed simulated time.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

from analysis.apps.emulate.pendant import Pendant
from analysis.apps.emulate.robot import EmulatedRobot, write_cell_files
from analysis.apps.emulate.served_cell import CellEvent, Keyboard
from analysis.apps.session.answer import Inference
from analysis.apps.session.cell import Machine, ServedCell
from daq import clock
from daq.emulators.emulated_cell import as_emulated
from daq.emulators.instruments import instruments_of
from daq.emulators.simulated_cell import SimulatedCell
from daq.emulators.simulated_clock import SimulatedClock
from rigs.errors import CellError
from rigs.load import load, load_hidden, parse

_INFERENCE_S = 20.0
"""Simulated duration of an inference. Measured: 10 to 25 s for four to twelve runs on one of two busy cores."""
_HANGS_S = 1800.0
"""Upper limit for the slowest inference in real time."""


class SimulatedInference(Inference):
    def __init__(self, *request: Any) -> None:
        super().__init__(*request)
        self._done_ns = clock.now_ns() + int(1e9 * _INFERENCE_S)

    @property
    def is_done(self) -> bool:
        """Blocks, once the simulated time has passed, until the real process has finished."""
        return clock.now_ns() >= self._done_ns and self._outcome.poll(None)


@dataclass
class MachineInThisProcess:
    keyboard: Keyboard | None = None

    @property
    def runs(self) -> bool:
        return self.keyboard is not None

    def type_line(self, line: str) -> None:
        if self.keyboard:
            self.keyboard.take(line)

    def ended(self) -> CellError:
        problem, remedy = "exited unexpectedly", "repeat the command to continue"
        return CellError("rig emulate", problem, remedy, code="process.failed")

    def stop(self) -> None:
        self.keyboard = None


@dataclass
class CellInSimulatedTime(ServedCell):
    simulated: SimulatedClock = field(kw_only=True)
    _cell: SimulatedCell | None = None
    _daemon: Any = None

    def switch_on(self, rig_file: Path, programs: Path, seed: int, hear: Callable[[CellEvent], None]) -> Machine:
        rig, text = load(rig_file)
        text, effects = as_emulated(text), self.emulated.effects
        hidden = load_hidden(effects).apply_to(rig) if effects else rig
        robot = EmulatedRobot.of_rig(hidden, seed)
        write_cell_files(self.directory / "emulated", hidden, robot, text)
        self.simulated.kill("cell")
        devices = instruments_of(parse(text, "cell"), robot, robot.signal, condition=robot.pose)
        self._cell = SimulatedCell(self.simulated, self.directory, text, robot, robot.signal, devices)
        machine, pendant = MachineInThisProcess(), Pendant(hidden, programs, self.session.maker)
        machine.keyboard = Keyboard(robot, pendant, lambda _: machine.stop(), hear)
        with self.simulated.process("cell"):
            machine.keyboard.start()
        hear(CellEvent("ready", str(rig_file), "ready"))
        return machine

    def start_rigd(self, rig_file: Path) -> None:
        assert self._cell is not None  # noqa: S101 - the stage was mounted
        self._daemon = self._cell.daemon()

    def ask(self, command: str, **fields: Any) -> dict[str, Any]:
        if self._daemon is None:
            raise CellError(
                "rigd", "exited unexpectedly", "see the log, then repeat the command", code="process.failed"
            )
        answer: dict[str, Any] = self._daemon.answer({"command": command, **fields})
        return answer

    def stop_rigd(self) -> None:
        if self._daemon is not None:
            self._daemon.close("complete", "the session is over")
            self._daemon = None

    def kill_rigd(self) -> None:
        if self._cell is not None and self._daemon is not None:
            self._cell.kill(self._daemon)
            self._daemon = None

    def infer(self, *request: Any) -> Inference:
        return SimulatedInference(*request)


@contextmanager
def simulated_time(seed: int) -> Iterator[SimulatedClock]:
    """Simulated time, which Ctrl-C interrupts like real time."""
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
