"""A step at a cell that behaves badly: never started, silent, a full disk, another program, one that is stopped."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.apps.session import daemon_cell as session_cell
from analysis.apps.session.daemon_cell import ProgramRun
from analysis.apps.session.program_watch import ProgramPath, ProgramWatch
from analysis.apps.session.session_plan import BY_ITSELF, SessionProgram, planned, programs_of_steps
from analysis.apps.session.session_state import ProgramStep
from analysis.robot.kinematics.arm import Array
from daq import clock
from rigs.errors import CellError
from rigs.load import load
from tests.support.session_cell import Screen

_WAIT_S = 60.0


class Time:
    """A clock that only sleeping moves."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s = 0.0
        monkeypatch.setattr(clock, "now_s", lambda: self.now_s)
        monkeypatch.setattr(clock, "sleep", self.sleep)

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


class Cell:
    """A replacement of rigd and operator: robot position by time, and a log of the requests."""

    def __init__(self, time: Time, robot: Callable[[float], Array]) -> None:
        self._time, self._robot = time, robot
        self.asked: list[tuple[str, dict[str, Any]]] = []
        self.refusals: list[CellError] = []
        self.missing: list[str] = []
        self.went_on = 0

    def ask(self, command: str, **fields: Any) -> dict[str, Any]:
        self.asked.append((command, fields))
        if command == "record_start" and self.refusals:
            raise self.refusals.pop(0)
        return {"run": "/runs/20260101T000000Z_run", "counters": {"g1": {"samples": 9, "silent": 3}}}

    def silent(self) -> list[str]:
        return self.missing

    def joints(self) -> tuple[float, list[float]]:
        return self._time.now_s, list(self._robot(self._time.now_s))

    def start(self, program: SessionProgram) -> None:
        pass

    def go_on(self, program: SessionProgram) -> None:
        self.went_on += 1

    def look(self) -> None:
        pass


class Bench:
    """The programs of a session of the paper's arm, and a drive of its first step."""

    def __init__(self, time: Time, monkeypatch: pytest.MonkeyPatch) -> None:
        rig, _ = load("paper-fanuc")
        stages, self.steps = planned(rig, "faults", 11, BY_ITSELF, lambda _: None)
        self.programs = programs_of_steps(rig, stages, self.steps)
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

    def drive(self, cell: Cell, step: ProgramStep | None = None) -> ProgramRun:
        step = step or self.steps[0]
        watch = ProgramWatch(self.ways, step.program)
        own = session_cell._Drive  # private _Drive: a step without a daemon
        made = own(cell, cell, self.screen, self.programs, watch, step, lambda: None)  # type: ignore[arg-type]
        return made.run("ada", _WAIT_S, Path("/runs"))


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    return Bench(Time(monkeypatch), monkeypatch)


def test_a_program_is_recorded_from_its_start_to_its_end(bench: Bench) -> None:
    cell = Cell(bench.time, bench.robot("p01-yaw-acw"))
    assert bench.drive(cell) == ProgramRun("20260101T000000Z_run", "p01-yaw-acw", "")
    (start, fields), (stop, _) = cell.asked
    assert (start, stop) == ("record_start", "record_stop") and cell.went_on == 1
    assert (fields["name"], fields["test"], fields["direction"]) == ("p01-yaw-acw", "yaw", "acw")
    assert (fields["operator"], fields["placement"], fields["corrected"]) == ("ada", "yaw", "")


def test_a_corrected_program_is_recorded_as_one(bench: Bench) -> None:
    cell = Cell(bench.time, bench.robot("p01-yaw-acw"))
    bench.programs = {name: replace(one, corrected="targets") for name, one in bench.programs.items()}
    bench.drive(cell)
    assert cell.asked[0][1]["corrected"] == "targets"


def test_another_program_is_recorded_as_what_it_is(bench: Bench) -> None:
    cell = Cell(bench.time, bench.robot("p02-yaw-cw"))
    assert bench.drive(cell).program == "p02-yaw-cw"
    assert cell.asked[0][1]["direction"] == "cw"
    assert (
        "this is p02-yaw-cw, not p01-yaw-acw: the run is recorded with the label of that program" in bench.screen.lines
    )


def test_a_program_that_is_stopped_is_not_usable_and_says_where(bench: Bench) -> None:
    run = bench.drive(Cell(bench.time, bench.robot("p01-yaw-acw", 0.3)))
    assert run.why.startswith("the robot stopped at 30 % of the path") and "g1: 3 silent" in run.why


def test_a_robot_that_never_starts_ends_with_a_sentence_and_the_recording(bench: Bench) -> None:
    cell = Cell(bench.time, bench.robot("p01-yaw-acw", leaves_s=1e9))
    with pytest.raises(CellError, match=r"p01-yaw-acw: waits at the start and was not started; start it"):
        bench.drive(cell)
    assert _WAIT_S < bench.time.now_s < _WAIT_S + 5
    assert [command for command, _ in cell.asked] == ["record_start", "record_stop"]


def test_a_robot_that_is_elsewhere_is_asked_for_its_program(bench: Bench) -> None:
    away = bench.ways["p01-yaw-acw"].q_deg[500]
    cell = Cell(bench.time, lambda now_s: away + min(now_s, 5) * np.array([2.0, 0, 0, 0, 0, 0]))
    with pytest.raises(CellError, match=r"p01-yaw-acw: was not started"):
        bench.drive(cell)
    assert bench.screen.lines == ["the robot drove a path of none of the programs of this stage: start p01-yaw-acw"]
    assert not cell.asked


def test_a_gauge_that_is_silent_is_reported_once_and_named_at_the_end(bench: Bench) -> None:
    cell = Cell(bench.time, bench.robot("p01-yaw-acw", leaves_s=1e9))
    cell.missing = ["g2"]
    with pytest.raises(CellError, match=r"g2: does not send readings"):
        bench.drive(cell)
    assert bench.screen.lines == ["g2 does not send readings: check the cable; see rig doctor"]


def test_a_refused_recording_is_tried_again_while_the_robot_waits(bench: Bench) -> None:
    cell = Cell(bench.time, bench.robot("p01-yaw-acw", leaves_s=20))
    cell.refusals = [CellError("disk", "nearly full", "free some space")] * 3
    assert bench.drive(cell).why == ""
    assert sum("nearly full" in line for line in bench.screen.lines) == 1
    assert [command for command, _ in cell.asked].count("record_start") == 4


def test_a_program_that_began_unrecorded_is_asked_for_again(bench: Bench) -> None:
    once, again = bench.robot("p01-yaw-acw", leaves_s=8), bench.robot("p01-yaw-acw", leaves_s=100)
    cell = Cell(bench.time, lambda now_s: once(now_s) if now_s < 75 else again(now_s))
    cell.refusals = [CellError("disk", "nearly full", "free some space")] * 8
    assert bench.drive(cell).why == ""
    assert any("started before the recording" in line for line in bench.screen.lines)
