"""Programs with corrected targets: driven by the faulty arm, they leave the error stated by `rig correct`.

The programs run in the interpreters. The faulty arm is computed independently of the correction. The fault exceeds the
size in the rig file by exactly its standard uncertainty.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.apps.correct.correct_rig import correct_rig
from analysis.apps.correct.correction_report import write
from analysis.apps.makers.emulated import Event, LinearMove, PointToPointMove, Round, ToolPose, Waited
from analysis.apps.makers.motion_plan import Demand, MotionPlan, demand_of
from analysis.apps.programs.compensated import compensated, table_of
from analysis.apps.programs.planned import plans_of
from analysis.apps.programs.target_path import read_corrected_path
from analysis.robot.geometry.circle import frame_of
from analysis.robot.geometry.driven_programs import circle_of, drive, lap, radial_stops
from analysis.robot.kinematics.arm import arm_of
from analysis.robot.kinematics.newton import newton
from rigs.effects import JointOffset
from rigs.errors import FileError
from rigs.makers import MAKERS
from rigs.schema.vocabulary import DrivenTest, MakerName
from tests.support.command_line import errors_of, succeeded
from tests.support.refusals import refused
from tests.support.stated_controller import load
from tests.support.written_files import numbers_in
from tests.worlds.arms.faulty_arm import found
from tests.worlds.arms.independent_arm import Array, Wrong, constants_of, flange, none
from tests.worlds.interpreters.driven import files_of, paths, run

Tables = Callable[[DrivenTest], Path]

ZERO_DEG, U_DEG, AXIS = 0.06, 0.006, 3
DWELL_S = 4.0
POINTS = 11
"""On each arc, ends included."""
RIG = load("ur10e-cell")[0]
ARM = arm_of(RIG.robot)
FAULTY = RIG.model_copy(
    update={"effects": (JointOffset(axis=AXIS, offset_deg=ZERO_DEG, found=found(offset_deg=U_DEG)),)}
)


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    """The corrected path of a test, computed once."""

    @lru_cache
    def corrected(test: DrivenTest) -> Path:
        directory = tmp_path_factory.mktemp(test)
        path = directory / "path.csv"
        path.write_text(table_of(_nominal(test)))
        *_, written = write(correct_rig(FAULTY, path), directory / "corrections")
        return written

    return corrected


@lru_cache
def _nominal(test: DrivenTest) -> tuple[MotionPlan, ...]:
    return tuple(plans_of(RIG, test, DWELL_S))


@lru_cache
def _planned(test: DrivenTest, path: Path) -> tuple[MotionPlan, Demand]:
    joints, poses = read_corrected_path(path)
    plan = compensated(_nominal(test), np.radians(joints.values), poses.poses(), joints.lines, str(path))[0]
    return plan, demand_of(plan)


def _driven(dialect: MakerName, test: DrivenTest, path: Path) -> list[Event]:
    return run(dialect, files_of(dialect, *_planned(test, path)), RIG)


def _error_mm(places: Array, turns: Rotation, q: Array) -> Array:
    """How far (n,) mm the faulty arm's tool is from where the nominal arm is at joint angles q (n, 6) rad, when its
    controller, which knows the nominal arm, goes to these poses in the base frame."""
    T = np.tile(np.eye(4), (len(places), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = turns.as_matrix(), places
    commanded, good = newton(ARM, ARM.T_world_base @ T, q)
    assert good.all()
    wrong = none()
    wanted = _tool_mm(wrong, q)
    wrong.offset[AXIS - 1] = np.radians(ZERO_DEG + U_DEG)
    return np.linalg.norm(_tool_mm(wrong, commanded) - wanted, axis=1)


def _tool_mm(wrong: Wrong, q: Array) -> Array:
    R, p = flange(constants_of("ur10e"), wrong, q)
    return p + R @ np.array(RIG.robot.tool.xyz_mm)


@pytest.mark.parametrize("dialect", [maker for maker in MAKERS if maker != "linuxcnc"])  # its arcs are lines
def test_compensated_circle_keeps_only_the_uncertainty(dialect, tables):
    path, circle = tables("yaw"), circle_of(RIG)
    pieces = paths(_driven(dialect, "yaw", path))
    one_lap = pieces[: 1 + next(k for k, piece in enumerate(pieces) if piece.stops)]
    phi, share = lap(circle, "acw")[1], np.linspace(0, 1, POINTS)
    ends = phi[0] + np.linspace(0, 1, len(one_lap) + 1) * (phi[-1] - phi[0])
    on_it = np.concatenate([begin + share * (end - begin) for begin, end in pairwise(ends)])
    q = drive(ARM, frame_of(circle), on_it, np.radians(circle.posture_deg), "circle")
    places, turns = zip(*(piece.at(share) for piece in one_lap), strict=True)
    left = _error_mm(np.concatenate(places), Rotation.concatenate(turns), q)
    stated, missed = 1e-3 * numbers_in(path, "u_um"), numbers_in(path, "missed_mm")
    assert missed.min() > 0.5
    assert left.max() < stated.max() + 0.05 * missed.max()  # an arc between targets cannot follow the error in full
    assert left[::POINTS] == pytest.approx(stated[: 2 * len(one_lap) : 2], rel=0.05)


def test_compensated_hemisphere_keeps_only_the_uncertainty(tables):
    path, q = tables("radial"), radial_stops(RIG)
    poses = _dwelt(_driven("ur", "radial", path))
    left = _error_mm(np.array([one.place for one in poses]), Rotation.concatenate([one.turn for one in poses]), q)
    stated, missed = 1e-3 * numbers_in(path, "u_um"), numbers_in(path, "missed_mm")
    assert missed.min() > 0.25
    assert stated.min() * 0.95 < left.min() and left.max() < stated.max() * 1.05


def _dwelt(events: list[Event]) -> list[ToolPose]:
    """Tool position at each stop."""
    found, at = [], None
    for event in events:
        match event:
            case PointToPointMove(pose):
                at = pose
            case LinearMove() | Round():
                at = event.end
            case Waited(seconds) if seconds == DWELL_S:
                found.append(at)
    return found


def test_the_commands_lead_from_a_test_to_its_corrected_program(tmp_path, tables):
    cell = tmp_path / "ur10e.yaml"
    cell.write_text(load("ur10e-cell")[1])
    words = ("program", cell, "--for", "kuka", "--test", "yaw", "-o")
    succeeded(*words, tmp_path / "nominal", "--targets")
    head, first, *_ = (tmp_path / "nominal" / "yaw-path.csv").read_text(encoding="ascii").splitlines()
    assert head == "program,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg" and first.count(",") == 6
    succeeded(*words, tmp_path / "corrected", "--path", tables("yaw"))
    assert " 0.72 mm" in (tmp_path / "corrected" / "yaw_acw_ur10e.src").read_text(encoding="ascii")
    assert "column x_mm" in errors_of(*words, tmp_path / "other", "--path", tmp_path / "nominal" / "yaw-path.csv")
    assert not (tmp_path / "other").exists()


@pytest.mark.parametrize(("robot", "test"), [("ur10e-cell", "radial"), ("paper-fanuc", "yaw")])
def test_a_table_of_another_test_or_arm_is_refused(robot, test, tables):
    path = tables("yaw")
    joints, poses = read_corrected_path(path)
    plans = plans_of(load(robot)[0], test, DWELL_S)
    with refused("table.invalid", "this test"):
        compensated(plans, np.radians(joints.values), poses.poses(), joints.lines, str(path))


@pytest.mark.parametrize(
    ("add_deg", "room_deg", "code"), [(5.0, 4.0, "path.impossible"), (60.0, 90.0, "table.invalid")]
)
def test_a_joint_beyond_its_limit_or_in_another_posture_is_refused(add_deg, room_deg, code, tables):
    joints, poses = read_corrected_path(tables("yaw"))
    q, limits = np.radians(joints.values), ARM.limits.copy()
    limits[3, 1] = q[:, 3].max() + np.radians(room_deg)
    row = int(q[:, 3].argmax())
    q[row, 3] += np.radians(add_deg)
    plans = [replace(plan, arm=replace(ARM, limits=limits)) for plan in _nominal("yaw")]
    with pytest.raises(FileError, match=f"line {row + 2}: ") as refused:
        compensated(plans, q, poses.poses(), joints.lines, "path.csv")
    assert refused.value.code == code
