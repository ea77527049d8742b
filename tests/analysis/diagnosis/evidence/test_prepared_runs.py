"""Runs of several cells and placements laid about one model: one name for one set-up, whatever a run is used for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.evidence.gather import Uses, gather
from analysis.diagnosis.evidence.prepared_runs import prepare_runs
from analysis.procedures.simulate import simulate
from analysis.runs.loading import Measured
from analysis.runs.tables import PoseTable
from rigs.effects import Backlash, Effect, JointOffset
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.effect import name_of
from rigs.schema.vocabulary import Direction
from tests.support.diagnosis_cells import RIG, circles, found_in, measured, poses

PLAY = Backlash(axis=3, width_deg=0.1)


def _at(ball_mm: tuple[float, float, float]) -> Rig:
    assert RIG.tests.circle
    circle = RIG.tests.circle.model_copy(update={"eccentricity_mm": ball_mm})
    return RIG.model_copy(update={"tests": RIG.tests.model_copy(update={"circle": circle})})


def _elsewhere(run: Measured) -> Measured:
    return replace(run, rig=_at((0.0, 0.0, 0.0)))


def _driven(way: Direction, seed: int, ball_mm: tuple[float, float, float], effects: tuple[Effect, ...]) -> Measured:
    """Simulate a circle whose ball position differs from the rig file."""
    return measured(simulate(_at(ball_mm), "yaw", way, seed, effects), "yaw", f"yaw-{way}-{seed}")


def test_a_set_up_has_one_name_whatever_its_runs_are_used_for() -> None:
    first, second, third, fourth = circles(seed=31)
    (used, judges, unseen), told = prepare_runs(RIG, [first, _elsewhere(second)], [_elsewhere(third)], [fourth])
    assert [run.setup for run in (*used, *judges, *unseen)] == ["yaw", "yaw 2", "yaw 2", "yaw"]
    assert told == []


def test_a_circle_with_another_tool_on_the_same_arm_is_a_set_up_and_not_a_robot() -> None:
    """As `rig plan --propose` has it: the ball beside axis 6."""
    run, like = circles(seed=34)[:2]
    tool = RIG.robot.tool.model_copy(update={"xyz_mm": (40.0, 0.0, 327.3)})
    beside = RIG.model_copy(update={"robot": RIG.robot.model_copy(update={"tool": tool})})
    other = replace(measured(simulate(beside, "yaw", "acw", 35), "yaw", "yaw-acw-9"), rig=beside)
    (used,), told = prepare_runs(RIG, [run, other])
    assert [one.setup for one in used] == ["yaw", "yaw 2"] and told == []
    assert [one.model.arm.T_flange_tool[0, 3] for one in used] == [0.0, 40.0]
    with pytest.raises(FileError, match="a different robot"):
        prepare_runs(beside, [run, like])


@pytest.mark.nightly  # two diagnoses of eight runs
def test_runs_left_out_in_a_second_cell_judge_names() -> None:
    runs = circles((PLAY,), seed=32)
    more = [_elsewhere(run) for run in circles((PLAY,), seed=33)]
    found = found_in([*runs, *more[:3]], held_out=more[3:])
    (one,) = [one for one in found.effects if one.is_confirmed]
    assert name_of(one.effect) == "backlash 3" and one.held_out_gain and one.held_out_gain > 0.9
    assert set(found.setups) == {"yaw", "yaw 2"}


@pytest.mark.parametrize("axis", [3, pytest.param(4, marks=pytest.mark.nightly)])
def test_a_ball_moved_between_runs_is_reported_and_a_play_is_not_taken_for_it(axis: int) -> None:
    effects = (Backlash(axis=axis, width_deg=0.1),)
    runs = [_driven(way, seed, (0.3, 0.2, 0.0), effects) for way in ("acw", "cw") for seed in (1, 2)]
    more = [_driven(way, seed, (1.4, -0.5, 0.0), effects) for way in ("acw", "cw") for seed in (3, 4)]
    assert prepare_runs(RIG, runs)[1] == []
    found = found_in([*runs, *more])
    assert [name_of(one.effect) for one in found.effects if one.is_confirmed] == [f"backlash {axis}"]
    assert set(found.setups) == {"yaw", "yaw, frame 2"}
    assert any("yaw-acw-3, yaw-acw-4, yaw-cw-3, yaw-cw-4" in doubt for doubt in found.doubts)


def test_poses_left_out_in_neighbourhoods_judge_each_name() -> None:
    found = found_in([poses(2, JointOffset(axis=3, offset_deg=0.2))])
    (one,) = [one for one in found.effects if one.is_confirmed]
    assert one.held_out_gain and one.held_out_gain > 0.8
    withheld = found.to_dict()["gap"]["held_out"]["rows"]
    assert list(withheld) == ["pose"] and 20 < len(withheld["pose"]) < 40
    assert "rows" not in found.to_dict()["gap"]["train"]


def test_the_rows_that_are_held_out_are_numbered_as_in_the_table_of_their_run() -> None:
    """Of two runs of one set-up; with the fitted rows they make up each table."""
    first, second = poses(2), measured(poses(3).table, "pose", "second")
    evidence = gather(RIG, Uses([first, second]), None, lambda _: None)
    assert set(evidence.withheld) == {"pose", "second"}
    for run, fitted in zip((first, second), evidence.runs, strict=True):
        withheld = evidence.withheld[run.run.manifest.name]
        assert sorted([*withheld, *(fitted.rows + 1).tolist()]) == list(range(1, 151))
    assert not gather(RIG, Uses([first], [second]), None, lambda _: None).withheld


def test_a_placement_that_takes_up_all_its_readings_is_left_out() -> None:
    run = poses(3)
    table = run.table
    assert isinstance(table, PoseTable)
    two = measured(PoseTable(table.q[:2], table.xyz_mm[:2] + np.array([0.0, 900.0, 0.0]), None), "pose", "two")
    placed = two.run.manifest.model_copy(update={"placement": "wall"})
    two = replace(two, run=replace(two.run, manifest=placed))
    (used,), told = prepare_runs(RIG, [run, two])
    assert [run.setup for run in used] == ["pose"]
    assert len(told) == 1 and told[0].startswith("pose at wall ") and "6 readings" in told[0]
