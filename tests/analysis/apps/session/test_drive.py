"""A step in a cell with problems: not started, silent, a full disk, a wrong program, a stopped program."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.apps.session import cell as session_cell
from analysis.apps.session.cell import ProgramRun, RealCell
from analysis.apps.session.program_watch import ProgramPath
from analysis.apps.session.session_plan import SessionProgram, programs_of_steps
from analysis.apps.session.session_state import Session, Stage
from analysis.robot.kinematics.arm import Array
from daq import clock
from rigs.errors import CellError
from rigs.load import find, load
from tests.support.refusals import refused
from tests.support.session_cell import Screen, asked_for, begun

_WAIT_S = 60.0


class Time:
    """A clock that moves only while the test sleeps."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s = 0.0
        monkeypatch.setattr(clock, "now_s", lambda: self.now_s)
        monkeypatch.setattr(clock, "sleep", self.sleep)

    def sleep(self, seconds: float) -> None:
        if threading.current_thread() is threading.main_thread():
            self.now_s += seconds
        else:  # a robot of another test that still drives
            time.sleep(seconds)


class Cell(RealCell):
    """A cell without rigd: robot position by time, and a log of the requests."""

    def __init__(self, bench: Bench, robot: Callable[[float], Array]) -> None:
        asked = replace(asked_for(bench.session), wait_min=_WAIT_S / 60)
        super().__init__(bench.session, Path("/"), bench.screen, asked)
        self.bench, self.robot = bench, robot
        self.requests = []
        self.refusals = []
        self.missing = []
        self.went_on = 0

    def start_rigd(self, rig_file: Path) -> None:
        pass

    def ask(self, command: str, **fields: Any) -> dict[str, Any]:
        self.requests.append((command, fields))
        if command == "record_start" and self.refusals:
            raise self.refusals.pop(0)
        return {"run": "/runs/20260101T000000Z_run", "counters": {"g1": {"samples": 9, "silent": 3}}}

    def silent(self) -> list[str]:
        return self.missing

    def joints(self) -> tuple[float, list[float]]:
        return self.bench.time.now_s, list(self.robot(self.bench.time.now_s))

    def go_on(self, program: SessionProgram) -> None:
        self.went_on += 1


class Bench:
    """The programs of a session of the paper's arm, and a drive of its first step."""

    def __init__(self, session: Session, time: Time, monkeypatch: pytest.MonkeyPatch) -> None:
        self.session, self.steps = session, session.steps
        rig = load("paper-fanuc")[0]
        self.programs = programs_of_steps(rig, session.stages, session.steps)
        self.ways = {name: ProgramPath.of(program.plan) for name, program in self.programs.items()}
        self.time, self.screen = time, Screen()
        monkeypatch.setattr(session_cell, "why_unusable", lambda run: "")

    def robot(self, program: str, share: float = 1.0, leaves_s: float = 10.0) -> Callable[[float], Array]:
        """A robot that comes to the start of a program, drives a share of it from a time on, and stands."""
        way = self.ways[program].q_deg
        last = int(share * (len(way) - 1))
        elsewhere = way[len(way) // 3] + [0, 9, 0, 0, 0, 0]

        def at(now_s: float) -> Array:
            if now_s < 2:
                return np.asarray(elsewhere)
            return np.asarray(way[int(np.clip(40 * (now_s - leaves_s), 0, last))])

        return at

    def drive(self, cell: Cell) -> ProgramRun:
        cell.set_up(Stage(name="yaw", words=""), self.programs)
        return cell.drive(self.steps[0], lambda: None)


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    return begun(find("paper-fanuc"), tmp_path_factory.mktemp("drive"), 11)


@pytest.fixture
def bench(session, monkeypatch):
    return Bench(session, Time(monkeypatch), monkeypatch)


def test_program_is_recorded_from_start_to_end(bench):
    cell = Cell(bench, bench.robot("p01-yaw-acw"))
    assert bench.drive(cell) == ProgramRun("20260101T000000Z_run", "p01-yaw-acw", "")
    (start, fields), (stop, _) = cell.requests
    assert (start, stop) == ("record_start", "record_stop") and cell.went_on == 1
    assert (fields["name"], fields["test"], fields["direction"]) == ("p01-yaw-acw", "yaw", "acw")
    assert (fields["operator"], fields["placement"], fields["corrected"]) == ("ada", "yaw", "")


def test_corrected_program_is_labelled(bench):
    cell = Cell(bench, bench.robot("p01-yaw-acw"))
    bench.programs = {name: replace(one, corrected="targets") for name, one in bench.programs.items()}
    bench.drive(cell)
    assert cell.requests[0][1]["corrected"] == "targets"


def test_other_program_is_recorded_with_its_own_label(bench):
    cell = Cell(bench, bench.robot("p02-yaw-cw"))
    assert bench.drive(cell).program == "p02-yaw-cw"
    assert cell.requests[0][1]["direction"] == "cw"
    (line,) = bench.screen.lines
    assert "p02-yaw-cw" in line and "p01-yaw-acw" in line


def test_stopped_program_is_unusable_and_states_the_place(bench):
    run = bench.drive(Cell(bench, bench.robot("p01-yaw-acw", 0.3)))
    assert "30 %" in run.why and "g1: 3 silent" in run.why


def test_robot_that_never_starts_ends_the_step_and_the_recording(bench):
    cell = Cell(bench, bench.robot("p01-yaw-acw", leaves_s=1e9))
    with pytest.raises(CellError) as error:
        bench.drive(cell)
    assert (error.value.code, error.value.where) == ("robot.refused", "p01-yaw-acw")
    assert _WAIT_S < bench.time.now_s < _WAIT_S + 5
    assert [command for command, _ in cell.requests] == ["record_start", "record_stop"]


def test_robot_elsewhere_is_asked_for_its_program(bench):
    away = bench.ways["p01-yaw-acw"].q_deg[500]
    cell = Cell(bench, lambda now_s: away + min(now_s, 5) * np.array([2.0, 0, 0, 0, 0, 0]))
    with refused("robot.refused", "was not started"):
        bench.drive(cell)
    assert len(bench.screen.lines) == 1 and "p01-yaw-acw" in bench.screen.lines[0] and not cell.requests


def test_silent_gauge_is_reported_once_and_named_at_the_end(bench):
    cell = Cell(bench, bench.robot("p01-yaw-acw", leaves_s=1e9))
    cell.set_up(Stage(name="yaw", words=""), bench.programs)
    cell.missing = ["g2"]
    with pytest.raises(CellError) as error:
        cell.drive(bench.steps[0], lambda: None)
    assert (error.value.code, error.value.where) == ("robot.silent", "g2")
    assert len(bench.screen.lines) == 1 and "g2" in bench.screen.lines[0]


def test_refused_recording_is_repeated_while_the_robot_waits(bench):
    cell = Cell(bench, bench.robot("p01-yaw-acw", leaves_s=20))
    cell.refusals = [CellError("disk", "nearly full", "free some space")] * 3
    assert bench.drive(cell).why == ""
    assert sum("nearly full" in line for line in bench.screen.lines) == 1
    assert [command for command, _ in cell.requests].count("record_start") == 4


def test_program_that_began_unrecorded_is_requested_again(bench):
    once, again = bench.robot("p01-yaw-acw", leaves_s=8), bench.robot("p01-yaw-acw", leaves_s=100)
    cell = Cell(bench, lambda now_s: once(now_s) if now_s < 75 else again(now_s))
    cell.refusals = [CellError("disk", "nearly full", "free some space")] * 8
    assert bench.drive(cell).why == ""
    assert len(bench.screen.lines) == 2
