import time

import numpy as np
import pytest

from analysis.apps.emulate.robot import EmulatedRobot, Trace
from daq import clock
from daq.emulators.simulated_clock import SimulatedClock
from rigs.load import load
from rigs.schema.condition import ProgramState
from tests.support.refusals import refused

_STANDING = Trace(np.array([0.0, 30.0]), np.empty(0), np.zeros((2, 6)), np.zeros((2, 2)))


@pytest.fixture
def robot():
    return EmulatedRobot(load("ur10e-cell")[0], {"acw": _STANDING, "cw": _STANDING}, 1)


def test_its_program_runs_while_it_drives(robot):
    now_ns = time.monotonic_ns()
    assert robot.condition(now_ns)["program_state"] == ProgramState.STOPPED
    robot.start("cw")
    assert robot.condition(now_ns)["program_state"] == ProgramState.RUNNING
    assert robot.condition(now_ns + 40 * 10**9)["program_state"] == ProgramState.STOPPED


def test_status_follows_commands(robot):
    robot.show("speed_percent", "40")
    robot.show("safety_state", "2")
    robot.show("program_state", "2")
    shown = {"speed_percent": 40.0, "safety_state": 2.0, "program_state": ProgramState.PAUSED}
    assert robot.condition(0).items() >= shown.items()


@pytest.mark.parametrize(
    ("column", "value"), [("speed", "40"), ("safety_state", "9"), ("program_state", "paused"), ("payload_kg", "")]
)
def test_impossible_condition_is_refused(robot, column, value):
    with refused("usage", "is not a"):
        robot.show(column, value)


_RAMP_DEG = np.radians(np.array([0.0, 30.0]))[:, None] * np.ones(6)
_DRIVEN = Trace(
    np.array([0.0, 30.0]),
    np.empty(0),
    _RAMP_DEG,
    np.zeros((2, 2)),
    signals=((3.0, 2.0), (27.0, 0.0)),
    holds_s=(1.0,),
)
"""A degree a second, the signal from 3 to 27 s; it waits for a person after 1 s."""


def at_deg(robot: EmulatedRobot) -> float:
    return robot.joints_deg(clock.now_ns())[0]


def state(robot: EmulatedRobot) -> tuple[str, float, float]:
    now_ns = clock.now_ns()
    return robot.state(now_ns), robot.condition(now_ns)["program_state"], robot.signal(now_ns)


def test_a_person_continues_pauses_and_stops_a_program(robot):
    with SimulatedClock(1).running():
        assert not robot.stop() and not robot.pause() and not robot.go_on()
        assert robot.play(_DRIVEN) == 31
        clock.sleep(10)
        assert state(robot) == ("waits", ProgramState.PAUSED, 0) and at_deg(robot) == pytest.approx(1)
        assert not robot.pause() and robot.go_on() and not robot.go_on()
        clock.sleep(4)
        assert state(robot) == ("drives", ProgramState.RUNNING, 2) and at_deg(robot) == pytest.approx(5, abs=0.01)
        assert robot.pause() and not robot.pause()
        clock.sleep(10)
        # It comes to rest within 0.3 s, in which it goes on by half of that.
        assert state(robot) == ("paused", ProgramState.PAUSED, 2) and at_deg(robot) == pytest.approx(5.15, abs=0.01)
        assert robot.go_on()
        clock.sleep(2)
        assert state(robot)[0] == "drives" and at_deg(robot) == pytest.approx(7, abs=0.01)
        assert robot.stop() and not robot.finished.is_set()
        clock.sleep(20)
        assert state(robot) == ("stopped", ProgramState.STOPPED, 2)  # its outputs stay as they are
        assert at_deg(robot) == pytest.approx(7.15, abs=0.01) and robot.finished.is_set() and not robot.stop()


def test_outputs_after_a_stop_stay_until_the_next_program(robot):
    with SimulatedClock(1).running():
        robot.play(_DRIVEN)
        clock.sleep(3)
        robot.go_on()
        clock.sleep(10)
        assert robot.stop()
        clock.sleep(1)
        robot.play(_DRIVEN)
        assert state(robot) == ("drives", ProgramState.RUNNING, 2) and at_deg(robot) == 0  # at the start at once
        clock.sleep(5)
        robot.go_on()
        clock.sleep(40)
        assert state(robot) == ("done", ProgramState.STOPPED, 0) and robot.finished.is_set()


def test_entered_zero_changes_the_reading_at_rest(robot):
    before = robot.joints_deg(0)
    robot.reads_more(np.radians([0, 0.05, 0, 0, 0, 0]))
    np.testing.assert_allclose(np.subtract(robot.joints_deg(0), before), [0, 0.05, 0, 0, 0, 0], atol=1e-12)
