"""Recognise the program that a robot drives, from its joint angles: as expected, another, a stopped one, or none."""

from dataclasses import dataclass

import numpy as np
import pytest

from analysis.apps.session.program_watch import ProgramPath, ProgramWatch
from analysis.apps.session.session_plan import BY_ITSELF, planned, programs_of_steps
from analysis.robot.kinematics.arm import Array
from rigs.load import load

_PERIOD_S = 0.1
_SPEED_DEG_S = 20.0


@dataclass(frozen=True)
class Cell:
    """The ways of a session of the paper's arm."""

    ways: dict[str, ProgramPath]

    def driven(self, program: str, share: float = 1.0, stands_s: float = 9.0) -> list[Array]:
        """Joint angles each tenth of a second: a stand at the start, a share of the way, a stand."""
        way = self.ways[program].q_deg
        count = int(share * (len(way) - 1))
        at = np.arange(0, count + 1, int(_SPEED_DEG_S * _PERIOD_S / 0.5))
        stand = int(stands_s / _PERIOD_S)
        return [*([way[0]] * 20), *way[at], *([way[count]] * stand)]


@pytest.fixture(scope="module")
def cell():
    rig, _ = load("paper-fanuc")
    stages, steps = planned(rig, "faults", 11, BY_ITSELF, lambda _: None)
    return Cell({name: ProgramPath.of(program.plan) for name, program in programs_of_steps(rig, stages, steps).items()})


def seen(watch: ProgramWatch, joints: list[Array]) -> list[str]:
    """Events of a watch up to the first end, each once and in order."""
    found = []
    for k, q in enumerate(joints):
        one = watch.feed(k * _PERIOD_S, q)
        if not found or found[-1] != one:
            found.append(one)
        if one in ("ended", "stopped", "astray"):
            break
    return found


def test_a_program_is_followed_from_its_start_to_its_end_with_the_way_back_between_laps(cell):
    watch = ProgramWatch(cell.ways, "p01-yaw-acw")
    assert seen(watch, cell.driven("p01-yaw-acw")) == ["nothing", "at_start", "driving", "ended"]
    assert watch.program == "p01-yaw-acw" and watch.share > 0.99


def test_a_way_of_two_laps_is_no_way_of_one(cell):
    half = ProgramWatch(cell.ways, "p01-yaw-acw")
    assert seen(half, cell.driven("p01-yaw-acw", 0.33, 12))[-1] == "stopped"
    assert 0.3 < half.share < 0.36


def test_no_program_begins_by_itself_after_another(cell):
    end = cell.ways["p01-yaw-acw"].q_deg[-1]
    assert np.abs(end - cell.ways["p02-yaw-cw"].q_deg[0]).max() < 0.1, "cw begins where acw ends"
    again = ProgramWatch(cell.ways, "p01-yaw-acw", ended="p01-yaw-acw")
    assert set(seen(again, [end] * 100)) == {"nothing"}
    meant = ProgramWatch(cell.ways, "p02-yaw-cw", ended="p01-yaw-acw")
    assert seen(meant, [end] * 100)[-1] == "at_start"


def test_a_robot_that_leaves_the_way_drives_something_else(cell):
    watch = ProgramWatch(cell.ways, "p01-yaw-acw")
    away = cell.driven("p01-yaw-acw", 0.2, 0)
    moved = away[-1] + np.outer(np.arange(30), [0, 0.5, 0, 0, 0, 0])
    assert seen(watch, [*away, *moved])[-1] == "astray"


def test_flicker_is_no_motion(cell):
    watch, chance = ProgramWatch(cell.ways, "p01-yaw-acw"), np.random.default_rng(1)
    start = cell.ways["p01-yaw-acw"].q_deg[0]
    assert seen(watch, list(start + chance.uniform(-0.01, 0.01, (200, 6))))[-1] == "at_start"
