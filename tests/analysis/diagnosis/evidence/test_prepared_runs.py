from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.evidence.gather import gather, prepare_runs
from analysis.procedures.simulate import simulate
from analysis.runs.loading import Measured
from analysis.runs.tables import PoseTable
from rigs.errors import FileError
from rigs.rig import Rig
from tests.support.diagnosis_cells import RIG, circles, measured, poses


def _at(ball_mm: tuple[float, float, float]) -> Rig:
    circle = RIG.tests.circle.model_copy(update={"eccentricity_mm": ball_mm})
    return RIG.model_copy(update={"tests": RIG.tests.model_copy(update={"circle": circle})})


def _elsewhere(run: Measured) -> Measured:
    return replace(run, rig=_at((0.0, 0.0, 0.0)))


def test_set_up_has_one_name_for_all_uses_of_its_runs():
    first, second, third, fourth = circles(seed=31)
    (used, judges, unseen), told = prepare_runs(RIG, [first, _elsewhere(second)], [_elsewhere(third)], [fourth])
    assert [run.setup for run in (*used, *judges, *unseen)] == ["yaw", "yaw 2", "yaw 2", "yaw"]
    assert told == []


def test_a_circle_with_another_tool_on_the_same_arm_is_a_set_up_and_not_a_robot():
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


def test_the_rows_that_are_held_out_are_numbered_as_in_the_table_of_their_run():
    first, second = poses(2), measured(poses(3).table, "pose", "second")
    evidence = gather(RIG, [first, second], [], [], None, lambda _: None)
    assert set(evidence.withheld) == {"pose", "second"}
    for run, fitted in zip((first, second), evidence.runs, strict=True):
        withheld = evidence.withheld[run.run.manifest.name]
        assert sorted([*withheld, *(fitted.rows + 1).tolist()]) == list(range(1, len(run.table.q) + 1))
    assert not gather(RIG, [first], [second], [], None, lambda _: None).withheld


def test_a_placement_that_takes_up_all_its_readings_is_left_out():
    run = poses(3)
    table = run.table
    two = measured(PoseTable(table.q[:2], table.xyz_mm[:2] + np.array([0.0, 900.0, 0.0]), None), "pose", "two")
    placed = two.run.manifest.model_copy(update={"placement": "wall"})
    two = replace(two, run=replace(two.run, manifest=placed))
    (used,), told = prepare_runs(RIG, [run, two])
    assert [run.setup for run in used] == ["pose"]
    assert len(told) == 1 and told[0].startswith("pose at wall ") and "2 poses" in told[0]
