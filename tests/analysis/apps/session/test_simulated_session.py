"""A session with daemon, instruments and robot in simulated time: what trials of sessions rest on."""

import math
from dataclasses import replace
from typing import Any

import pytest

from analysis.apps.session.answer import Inference
from analysis.apps.session.run_session import run_session
from analysis.apps.session.session_plan import SessionOptions, SessionProgram
from analysis.apps.session.session_state import Emulated, Session, SessionDirectory
from analysis.apps.session.simulated import CellInSimulatedTime
from analysis.runs.loading import load_measured
from daq import clock
from daq.emulators.simulated_clock import SimulatedClock
from daq.store import verify
from rigs.load import load
from tests.support.refusals import refused
from tests.support.session_cell import Oracle, Screen, cell_file


class Told(CellInSimulatedTime):
    """A cell whose runs are diagnosed immediately."""

    def infer(self, *request: Any) -> Inference:
        return replace(Oracle()(*request), kept=None)  # an InstantDiagnosis


class Stopping(Told):
    """Press stop in the middle of the first program."""

    stop_s = 0.0

    def go_on(self, program: SessionProgram) -> None:
        super().go_on(program)
        self.stop_s = self.stop_s or clock.now_s() + 6.0

    def check(self) -> None:
        super().check()
        if 0 < self.stop_s < clock.now_s():
            self.stop_s = math.inf
            self.machine.type_line("stop")


class Killing(Told):
    """Kill the daemon when the recording has started."""

    def go_on(self, program: SessionProgram) -> None:
        super().go_on(program)
        self.kill_rigd()


@pytest.mark.cpu_limit(120)
def test_session_in_simulated_time_continues_after_a_kill_of_rigd(tmp_path):
    cell, directory = cell_file(tmp_path), tmp_path / "own"
    rig, text = load(cell)
    emulated = Emulated(effects="paper-fanuc", seed=3)
    asked = SessionOptions(str(cell), "check", 1.4, "kuka", emulated, operator="ada", wait_min=1.0)

    with SimulatedClock(1, hangs_s=300).running() as simulated:

        def go_on(kind: type[CellInSimulatedTime]) -> None:
            def make_cell(session: Session) -> CellInSimulatedTime:
                return kind(session, directory, Screen(), asked, simulated=simulated)

            run_session(rig, text, SessionDirectory(directory), asked, Screen(), make_cell)

        with refused("process.ended"):
            go_on(Killing)
        go_on(Stopping)
        assert 10 < simulated.elapsed_s < 600
    session = SessionDirectory(directory).read()
    assert session.report
    whys = [[one.why for one in step.tries] for step in session.steps]
    assert whys[0][0] and [step[-1] for step in whys] == ["", ""]
    for step in session.steps:
        assert step.run and not verify(directory / "runs" / step.run)
        assert load_measured(directory / "runs" / step.run).is_simulated  # no page says that a robot was measured
