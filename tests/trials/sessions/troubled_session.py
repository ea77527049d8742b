"""A session in simulated time, with hands at the cell that make mistakes: for `scripts/dev sessions` alone.

What a person or a computer does wrong comes at its time: `at_robot` by the number of the start of a program,
`at_computer` by the second of the session.
"""

from __future__ import annotations

import json
import shutil
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Console

from analysis.apps.report.blocks import Block, on_screen
from analysis.apps.session.run_session import run_session
from analysis.apps.session.session_plan import SessionOptions, SessionProgram
from analysis.apps.session.session_state import Emulated, Session, SessionDirectory
from analysis.apps.session.simulated import CellInSimulatedTime
from daq import clock
from daq.emulators.simulated_clock import SimulatedClock
from rigs.errors import RigError
from rigs.load import load

MOST_STARTS = 8
"""So often the same command is given again."""
_SLOWEST_INFERENCE_S = 1800.0


class SessionKilled(BaseException):
    """The session's process is gone."""


@dataclass
class TroubledCell(CellInSimulatedTime):
    """Does at a given start of a program what a person may do, and calls `meanwhile` at each look."""

    at_robot: dict[int, str] = field(kw_only=True)
    meanwhile: Callable[[TroubledCell], None] = field(kw_only=True)
    _later: list[tuple[float, str]] = field(default_factory=list)

    def start_program(self, program: SessionProgram) -> None:
        file = self.directory / "starts.txt"
        number = int(file.read_text()) if file.exists() else 0
        file.write_text(str(number + 1))
        trouble, now_s = self.at_robot.get(number, ""), clock.now_s()
        self._later = []
        match trouble:
            case "late":
                self._later = [(now_s + 20, f"run {program.name}")]
                return
            case "other":
                others = [path.stem for path in sorted((self.directory / "programs" / program.stage).glob("*.*"))]
                mine = program.name.replace("-", "_")
                wrong = next((name for name in others if name.lower() != mine.lower()), mine)
                self._later = [(now_s + 1, "stop"), (now_s + 3, f"run {wrong}")]
            case "stop":
                self._later = [(now_s + 10, "stop")]
            case "pause":
                self._later = [(now_s + 9, "pause"), (now_s + 11, "go on")]
            case "twice":
                self._later = [(now_s + 2, f"run {program.name}")]
        super().start_program(program)
        if trouble == "other":
            self._waits = False

    def check(self) -> None:
        self.meanwhile(self)
        now_s = clock.now_s()
        for line in [line for at_s, line in self._later if at_s <= now_s]:
            self.machine.type_line(line)
        self._later = [(at_s, line) for at_s, line in self._later if at_s > now_s]
        super().check()


class Computer:
    """What happens to the session's computer at its time."""

    def __init__(self, directory: Path, troubles: list[tuple[float, str]]) -> None:
        self._runs, self._pending = directory / "runs", troubles
        self._began_s = clock.now_s()

    def meanwhile(self, cell: TroubledCell) -> None:
        while self._pending and self._pending[0][0] <= clock.now_s() - self._began_s and self._runs.is_dir():
            self._do(self._pending.pop(0)[1], cell)

    def _do(self, trouble: str, cell: TroubledCell) -> None:
        match trouble:
            case "kill":
                raise SessionKilled
            case "interrupt":
                raise KeyboardInterrupt
            case "kill_rigd":
                cell.kill_rigd()
            case "by_hand":
                whole = next((p for p in sorted(self._runs.glob("*_p0*")) if (p / "manifest.json").exists()), None)
                if whole:
                    shutil.copytree(whole, self._runs / "20200101T000000Z_somebody", dirs_exist_ok=True)
            case "stranger":
                (self._runs / "20200101T000001Z_elsewhere").mkdir(exist_ok=True)
                (self._runs / "20200101T000001Z_elsewhere" / "manifest.json").write_text("{}")


class Lines:
    """The session's screen: lines with the minute of the session."""

    def say(self, line: str) -> None:
        print(f"{clock.now_s() / 60 % 1000:6.2f} {line}", flush=True)

    def answer(self, blocks: Sequence[Block]) -> None:
        Console(width=100).print(on_screen(blocks))

    def show(self, line: str) -> None:
        """Nothing is rewritten in a log."""


def main() -> None:
    """Read a request, run the session to its end, and write the result next to the request."""
    request = json.loads(Path(sys.argv[1]).read_text())
    began_s = time.monotonic()
    with SimulatedClock(request["seed"], hangs_s=_SLOWEST_INFERENCE_S).running() as simulated:
        exits = _starts(simulated, request)
        came: dict[str, Any] = {"exits": exits, "minutes": simulated.elapsed_s / 60}
    came["computing_s"] = time.monotonic() - began_s
    Path(sys.argv[1]).with_name("came.json").write_text(json.dumps(came))


def _starts(simulated: SimulatedClock, request: dict[str, Any]) -> list[int]:
    """Give the same command until the session is at its end; its exit codes."""
    directory = Path(request["directory"])
    computer = Computer(directory, [(at_s, kind) for at_s, kind in request["at_computer"]])
    at_robot = {int(number): trouble for number, trouble in request["at_robot"].items()}
    rig, text = load(request["rig"])
    asked = SessionOptions(
        rig_file=request["rig"],
        aim=request["aim"],
        minutes=request["minutes"],
        maker=request["maker"],
        emulated=Emulated(effects=request["effects"], seed=request["seed"]),
        operator="trial",
        wait_min=1.5,
    )

    def make_cell(session: Session) -> TroubledCell:
        shared: Any = {"simulated": simulated, "at_robot": at_robot, "meanwhile": computer.meanwhile}
        return TroubledCell(session, directory, Lines(), asked, **shared)

    exits: list[int] = []
    while len(exits) < MOST_STARTS and 0 not in exits:
        try:
            run_session(rig, text, SessionDirectory(directory), asked, Lines(), make_cell)
            exits.append(0)
        except RigError as error:
            print(f"error: {error}", flush=True)
            exits.append(error.exit_code)
        except KeyboardInterrupt:
            exits.append(130)
        except SessionKilled:
            exits.append(-9)
    return exits


if __name__ == "__main__":
    main()
