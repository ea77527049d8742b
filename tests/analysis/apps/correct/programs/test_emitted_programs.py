"""Programs of `rig program`, corrected as a person's own, run by the interpreters: a wrong arm drives them.

An interpreter gives the poses that the controller computes; the wrong arm, multiplied out apart from the product, then
stands where the nominal arm was sent.
"""

from pathlib import Path

import numpy as np
import pytest

from analysis.apps.correct.corrected_program import CorrectedProgram, correct_program
from analysis.apps.correct.stated_frames import frames_of
from analysis.apps.correct.stated_points import computed_points
from analysis.apps.makers import maker_of_file
from analysis.apps.makers.emulated import Event, LinearMove, PointToPointMove, Round, ToolPose
from analysis.apps.makers.motion_plan import demand_of
from analysis.apps.makers.writing import programs_of, write_programs
from analysis.apps.programs.compensated import targets_of
from analysis.apps.programs.planned import plans_of
from rigs.rig import Rig
from rigs.schema.vocabulary import MakerName
from tests.support.changed_rigs import with_circle
from tests.support.every import for_every_maker
from tests.worlds.arms.faulty_arm import flange_at, frame, hidden, joints_of, known
from tests.worlds.arms.independent_arm import Array
from tests.worlds.interpreters.arms import pose_of, rig_of
from tests.worlds.interpreters.driven import run

CASES = [
    ("ur", "ur10e"),
    ("fanuc", "paper-fanuc"),
    ("fanuc", "fanuc-m-10ia"),
    ("kuka", "kuka-kr-10-r1100-2"),
    ("kuka", "kuka-hanging"),
    ("abb", "abb-irb-120"),
    ("yaskawa", "yaskawa-gp7"),
]


def _written(dialect: MakerName, rig: Rig, directory: Path) -> tuple[Path, list[Array]]:
    """The program of a lap, and the joint angles of its targets."""
    plan = plans_of(rig, "yaw", 4.0)[0]
    write_programs(dialect, programs_of(dialect, [(plan, demand_of(plan))]), directory)
    (path,) = filter(maker_of_file, directory.iterdir())
    return path, [target.q for target in targets_of(plan)]


def _corrected(rig: Rig, path: Path) -> CorrectedProgram:
    return correct_program(computed_points(rig), path, frames_of(rig.robot, ["9=rig"], []), None)


def _poses(events: list[Event]) -> list[ToolPose]:
    return [
        event.pose if isinstance(event, PointToPointMove) else event.end for event in events if isinstance(event, MOVES)
    ]


MOVES = PointToPointMove | LinearMove | Round


@pytest.mark.parametrize(("dialect", "name"), CASES)
def test_the_wrong_arm_drives_the_corrected_program_as_the_right_one_the_given(dialect, name, tmp_path):
    rig = rig_of(name)
    path, angles = _written(dialect, rig, tmp_path)
    found = _corrected(known(rig), path)
    assert not found.left
    given = {file: (tmp_path / file).read_bytes() for file in found.files}
    sent, wanted = (
        _poses(run(dialect, {file: data.decode() for file, data in files.items()}, rig))
        for files in (found.files, given)
    )
    assert len(sent) == len(wanted) > 5
    tool = pose_of(rig.robot.tool)
    T_tool = frame(tool.place, tool.turn)
    missed, left = [], []
    for there, here in zip(sent, wanted, strict=True):
        flange, told = (frame(one.place, one.turn) @ np.linalg.inv(T_tool) for one in (here, there))
        q = min(angles, key=lambda one: float(np.abs(flange_at(rig, one) - flange).max()))
        missed.append(np.linalg.norm((flange_at(rig, q, hidden()) @ T_tool)[:3, 3] - here.place))
        real = flange_at(rig, joints_of(rig, told, q), hidden()) @ T_tool
        left.append(np.linalg.norm(real[:3, 3] - here.place))
    assert min(missed) > 0.1
    # The decimals of a job (0.001 mm, 0.0001°) are what is left of Yaskawa's.
    assert max(left) < (4e-3 if dialect == "yaskawa" else 1e-5)


@for_every_maker
def test_without_anything_to_correct_the_program_stays_byte_for_byte(dialect, tmp_path):
    rig = rig_of("paper-fanuc")
    rig = with_circle(rig, laps=1, radius_mm=40).model_copy(update={"effects": ()})
    path, _ = _written(dialect, rig, tmp_path)
    found = _corrected(rig, path)
    assert found.names and not found.moved_mm.any() and not found.left
    assert found.files == {file: (tmp_path / file).read_bytes() for file in found.files}
