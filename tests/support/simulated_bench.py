"""An emulated cell in simulated time: like `Bench`, but with the daemon in this process.

Only ports, command line and processes are omitted. Readers, recorder, store and emulated instruments are the real ones.
A lap takes only its computing time, and other load on the computer has no effect.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

from analysis.apps.emulate.robot import EmulatedRobot
from daq import clock
from daq.emulators.instruments import MotionSource
from daq.emulators.simulated_cell import SimulatedCell
from daq.emulators.simulated_clock import SimulatedClock
from daq.protocol.conversation import Device
from daq.service.daemon import Daemon
from tests.support.bench import ByHand, Watched, rig_text
from tests.support.command_line import ran

_AFTERWARDS_S = 0.2
"""Additional recording time after the robot has stopped."""


class SimulatedBench(Watched):
    """Cell and daemon in one directory, in simulated time within the context.

    devices: see `SimulatedCell`. options: of the `Daemon`.
    """

    def __init__(
        self,
        folder: Path,
        text: str | None = None,
        motion: MotionSource | None = None,
        *,
        devices: Mapping[str, Callable[[], Device]] | None = None,
        **options: Any,
    ) -> None:
        self.folder, self.text = folder, text or rig_text()
        self.motion = ByHand()
        driven = motion or self.motion
        signal = getattr(driven, "signal", self.motion.signal)
        self._make = partial(
            SimulatedCell, folder=folder, text=self.text, motion=driven, signal=signal, devices=devices
        )
        self._options = options
        self._ends = ExitStack()
        self.cell: SimulatedCell
        self.daemon: Daemon

    def __enter__(self) -> SimulatedBench:
        self.time = self._ends.enter_context(SimulatedClock(1).running())
        self.cell = self._make(self.time)
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        with self._ends:
            if kind is None:
                self.end()

    def start(self) -> SimulatedBench:
        self.daemon = self.cell.daemon(**self._options)
        return self

    def end(self) -> None:
        """Stop a running daemon as a service manager does. Fails if a thread has died of an error."""
        if hasattr(self, "daemon"):
            self.daemon.close("complete", "the test is over")
            del self.daemon
        assert not self.time.errors, self.time.errors

    def status(self) -> dict[str, Any]:
        return self.daemon.answer({"command": "status"})

    def run(self, *command: str | Path) -> CompletedProcess[str]:
        """Run a `rig` command to completion. It may query the daemon; simulated time does not advance."""
        return ran(*command, cwd=self.folder, XDG_RUNTIME_DIR=str(self.folder))

    def record(self, name: str = "run", direction: str | None = "acw", test: str = "yaw") -> Path:
        asked = {"command": "record_start", "name": name, "test": test, "direction": direction}
        return Path(self.daemon.answer(asked)["run"])

    def stop(self) -> dict[str, dict[str, int]]:
        """End the recording and return the counts by stream."""
        counters: dict[str, dict[str, int]] = self.daemon.answer({"command": "record_stop"})["counters"]
        return counters

    def drive(self, robot: EmulatedRobot, program: str) -> None:
        """Let the robot execute a program to its end."""
        clock.sleep(robot.start(program) + _AFTERWARDS_S)
