from itertools import pairwise

import numpy as np
import pytest

from analysis import load_run
from analysis.apps.planning import pose_plan
from analysis.apps.planning.pose_plan import planned_poses, pool_of
from analysis.apps.planning.pose_pool import Sight, drawn_poses, in_order_of_ways, is_seen, is_way_clear
from analysis.robot.geometry.clearance import is_clear
from analysis.robot.kinematics.arm import arm_of
from analysis.runs.tables import PoseTable
from rigs.load import load
from tests.support.command_line import errors_of, succeeded
from tests.support.foreign_tables import rows, text
from tests.support.nightly import cases
from tests.support.refusals import refused
from tests.support.written_files import JOINTS, numbers_in
from tests.worlds.arms.independent_arm import constants_of, flange, healthy

RIG = load("ur10e-cell")[0]
ARM = arm_of(RIG.robot)
SIGHT = Sight(np.array([2500.0, 0.0, 800.0]), np.array([0.0, 0.0, 1.0]))


def places(q: np.ndarray) -> np.ndarray:
    """The tool (n, 3) mm of the nominal arm, multiplied out apart from the product."""
    none = healthy(np.random.default_rng(0))
    zero = type(none)(**{name: np.zeros_like(value) for name, value in vars(none).items()})
    R, p = flange(constants_of("ur10e"), zero, q)
    return p + R @ np.array(RIG.robot.tool.xyz_mm)


def test_poses_are_within_limits_clear_of_the_floor_and_seen():
    q = drawn_poses(ARM, 60, SIGHT, np.random.default_rng(1))
    assert len(q) == 60 and is_clear(ARM, q).all() and is_seen(ARM, q, SIGHT).all()
    tool = places(q) - np.array(RIG.robot.base.xyz_mm)
    assert tool[:, 2].min() > 100 and (np.abs(q) <= np.pi).all()
    outside = drawn_poses(ARM, 200, None, np.random.default_rng(1))
    assert 0.05 < is_seen(ARM, outside, SIGHT).mean() < 0.5


def test_an_arm_between_tracker_and_target_hides_it():
    q = drawn_poses(ARM, 600, None, np.random.default_rng(2))
    tool = places(q)
    behind = q[(tool[:, 0] < -400) & (np.abs(tool[:, 1]) < 60) & (np.abs(tool[:, 2] - 200) < 300)]
    low = Sight(np.array([3000.0, 0.0, 100.0]))
    assert len(behind) and not is_seen(ARM, behind, low).any()
    assert is_seen(ARM, q[tool[:, 0] > 700], low).mean() > 0.8


def test_each_next_pose_has_a_clear_way():
    q = drawn_poses(ARM, 30, None, np.random.default_rng(3))
    driven = in_order_of_ways(ARM, q)
    assert len(driven) > 20
    assert all(is_way_clear(ARM, one, other) for one, other in pairwise(driven))
    near = q[:1] + np.random.default_rng(5).uniform(-0.02, 0.02, (8, 6))
    assert sorted(in_order_of_ways(ARM, near).tolist()) == sorted(near.tolist())  # no pose is lost on clear ways


def test_planned_poses_leave_less_than_random_ones():
    rng = np.random.default_rng(4)
    pool = pool_of(RIG, drawn_poses(ARM, 60, None, rng))
    planned = pool.u_mm(pool.choose(15))
    assert all(planned < pool.u_mm(rng.permutation(60)[:15]) for _ in range(5))
    assert planned > pool.u_mm(pool.choose(30)) > 0


def test_a_tracker_that_sees_nothing_is_refused():
    with refused("readings.too_few", "takes clear of floor and column,"):
        planned_poses(RIG, 20, Sight(np.array([0.0, 0.0, 100.0])))  # inside the arm


@pytest.mark.parametrize("maker", cases(("ur", "fanuc", "kuka", "abb", "yaskawa"), ("fanuc",)))
def test_the_planned_table_and_a_tracker_s_become_a_run(maker, tmp_path, monkeypatch):
    monkeypatch.setattr(pose_plan, "_POOL", 50)
    done = succeeded(f"plan ur10e-cell --poses 14 --for {maker} --tracker 2500,0,800 -o {tmp_path}/p")
    assert "random poses" in done.stdout and len(list((tmp_path / "p").iterdir())) > 1
    q = np.radians(numbers_in(tmp_path / "p" / "poses.csv", *JOINTS))
    assert 12 <= len(q) <= 14
    nominal = numbers_in(tmp_path / "p" / "poses.csv", "nominal_x_mm", "nominal_y_mm", "nominal_z_mm")
    assert np.abs(nominal - places(q)).max() < 0.01
    rng = np.random.default_rng(6)
    R, p = flange(constants_of("ur10e"), healthy(rng), q)
    seen = p + R @ np.array([10.0, 0.0, 90.0]) + [400.0, 300.0, 0.0]
    (tmp_path / "tracker.csv").write_bytes(text(rows(seen), ["X [mm]", "Y [mm]", "Z [mm]"]))
    files = (tmp_path / "tracker.csv", tmp_path / "p" / "poses.csv")
    succeeded("import", *files, "--join", "rows", "--rig", "ur10e-cell", "--test", "pose", "-o", tmp_path / "run")
    read = load_run(tmp_path / "run").table
    assert (
        isinstance(read, PoseTable) and np.allclose(read.q, q, atol=1e-6) and np.allclose(read.xyz_mm, seen, atol=1e-5)
    )


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ("--poses 12 --for ur", "output"),
        ("--poses 12 --tracker here", "is not a position"),
        ("--poses 12 --faces z", "position of"),
        ("--poses 12 --propose", "combined"),
        ("--for ur", "--for, --tracker, --faces and --one-axis require --poses"),
    ],
)
def test_contradicting_options_are_refused(options, says):
    assert says in " ".join(errors_of(f"plan ur10e-cell {options}", exit_code=2).replace("│", " ").split())
