"""A session with daemon, instruments and robot in simulated time: what trials of sessions rest on."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from analysis.apps.session.daemon_cell import EmulatedHands
from analysis.apps.session.run_session import SessionDependencies, SessionOptions, run_session
from analysis.apps.session.session_plan import SessionProgram
from analysis.apps.session.session_state import Emulated, SessionDirectory
from analysis.apps.session.simulated import SimulatedCells
from analysis.runs.loading import load_measured
from daq import clock
from daq.apps.emulate.simulated_clock import SimulatedClock
from daq.store import verify
from rigs.errors import CellError
from rigs.load import load
from tests.support.session_cell import Oracle, Screen, cell_file


class Stopping(EmulatedHands):
    """Press stop in the middle of the first program."""

    stop_s = 0.0

    def go_on(self, program: SessionProgram) -> None:
        super().go_on(program)
        self.stop_s = self.stop_s or clock.now_s() + 6.0

    def look(self) -> None:
        super().look()
        if 0 < self.stop_s < clock.now_s():
            self.stop_s = math.inf
            self._type("stop")


@pytest.mark.cpu_limit(120)
def test_a_session_in_simulated_time_records_what_is_driven_and_goes_on_after_a_kill_of_rigd(tmp_path: Path) -> None:
    cell, directory = cell_file(tmp_path), tmp_path / "own"
    rig, text = load(cell)
    emulated = Emulated(effects="paper-fanuc", seed=3)
    asked = SessionOptions(str(cell), "check", 1.4, "kuka", emulated, operator="ada", wait_min=1.0)

    def go_on(cells: SimulatedCells, hands: EmulatedHands) -> None:
        means = SessionDependencies(hands, cells.start_rigd, Oracle())
        run_session(rig, text, SessionDirectory(directory), asked, Screen(), means)

    with SimulatedClock(1, hangs_s=300).running() as simulated:
        cells = SimulatedCells(simulated, directory)

        class Killing(EmulatedHands):
            def go_on(self, program: SessionProgram) -> None:
                super().go_on(program)
                assert cells.rigd is not None
                cells.rigd.kill()

        with pytest.raises(CellError, match="ended by itself"):
            go_on(cells, Killing(directory, "kuka", emulated, [], cells.start_cell))
        go_on(cells, Stopping(directory, "kuka", emulated, [], cells.start_cell))
        assert 10 < simulated.elapsed_s < 600
    session = SessionDirectory(directory).read()
    assert session is not None and session.report
    whys = [[one.why for one in step.tries] for step in session.steps]
    assert "the robot stopped at" in whys[0][0] and [step[-1] for step in whys] == ["", ""]
    for step in session.steps:
        assert step.run and not verify(directory / "runs" / step.run)
        assert load_measured(directory / "runs" / step.run).is_simulated  # no page says that a robot was measured
