"""What the emulated robot shows of its condition: whether it drives, and what a person made it show."""

from __future__ import annotations

import time

import numpy as np
import pytest

from analysis.simulation.emulated_robot import EmulatedRobot, Trace
from rigs.errors import FileError
from rigs.load import load
from rigs.schema.condition import ProgramState

_STANDING = Trace(np.array([0.0, 30.0]), np.empty(0), np.zeros((2, 6)), np.zeros((2, 2)))


@pytest.fixture
def robot() -> EmulatedRobot:
    return EmulatedRobot(load("ur10e")[0], {"acw": _STANDING, "cw": _STANDING}, 1)


def test_its_program_runs_while_it_drives(robot: EmulatedRobot) -> None:
    now_ns = time.monotonic_ns()
    assert robot.condition(now_ns) == {"program_state": ProgramState.STOPPED}
    robot.start("cw")
    assert robot.condition(now_ns) == {"program_state": ProgramState.RUNNING}
    assert robot.condition(now_ns + 40 * 10**9) == {"program_state": ProgramState.STOPPED}


def test_it_shows_what_it_is_told(robot: EmulatedRobot) -> None:
    robot.show("speed_percent", "40")
    robot.show("safety_state", "2")
    robot.show("program_state", "2")
    assert robot.condition(0) == {"speed_percent": 40.0, "safety_state": 2.0, "program_state": ProgramState.PAUSED}


@pytest.mark.parametrize(
    ("column", "value", "says"),
    [
        ("speed", "40", "'speed': is not of the robot's condition"),
        ("safety_state", "9", "2 protective stop"),
        ("program_state", "paused", "0 stopped, 1 running, 2 paused"),
        ("payload_kg", "", "give a number"),
    ],
)
def test_what_it_cannot_show_is_an_error_of_one_line(robot: EmulatedRobot, column: str, value: str, says: str) -> None:
    with pytest.raises(FileError) as error:
        robot.show(column, value)
    assert says in str(error.value) and "\n" not in str(error.value)
