import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from analysis.robot.description.axis_lines import AxisLines, denavit_hartenberg
from analysis.robot.description.rig_section import Joint, flange_poses, largest_difference, parsed, robot_of, robot_text

Array = NDArray[np.float64]
JOINTS = [Joint(f"J{one}", (-170.0, 170.0), 100.0) for one in range(1, 7)]


def product_of_turns(axes: AxisLines, q: Array) -> Array:
    T = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    for point, direction, turn in zip(axes.points, axes.directions, q.T, strict=True):
        step = np.broadcast_to(np.eye(4), (len(q), 4, 4)).copy()
        step[:, :3, :3] = Rotation.from_rotvec(np.outer(turn, direction)).as_matrix()
        step[:, :3, 3] = point - step[:, :3, :3] @ point
        T = T @ step
    return T @ axes.T_base_flange


def some_axes(seed: int, tilt: float | None) -> AxisLines:
    """Six axes some hundred mm apart: in any direction, or each turned by tilt (rad) from the one before."""
    random = np.random.default_rng(seed)
    directions = [random.normal(size=3)]
    for _ in range(5):
        turn = random.normal(size=3)
        turn -= (turn @ directions[-1]) * directions[-1] / (directions[-1] @ directions[-1])
        if tilt is None:
            directions.append(random.normal(size=3))
        else:
            R = Rotation.from_rotvec(tilt * turn / np.linalg.norm(turn)).as_matrix()
            directions.append(R @ directions[-1] * random.choice([-1, 1]))
    units = np.array([one / np.linalg.norm(one) for one in directions])
    flange = np.eye(4)
    flange[:3, :3] = Rotation.random(rng=random).as_matrix()
    flange[:3, 3] = random.uniform(-500, 500, 3)
    return AxisLines(random.uniform(-500, 500, (6, 3)), units, flange)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("tilt", [None, 0.0, 1e-12, 1e-6, 1e-3, 0.05, 0.0999, 0.1001, 0.3, np.pi / 2])
def test_the_written_section_turns_about_the_axes(seed, tilt):
    axes = some_axes(seed, tilt)
    robot = parsed(robot_text(robot_of("arm", denavit_hartenberg(axes), JOINTS)))
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, (100, 6))
    mm, rad = largest_difference(flange_poses(robot, q), product_of_turns(axes, q))
    assert mm < 1e-9
    assert rad < 1e-11
    assert all(abs(axis.a_mm) < 20_000 and abs(axis.d_mm) < 20_000 for axis in robot.axes)


@pytest.mark.parametrize("off", [0.0, 1e-16, 1e-12, 1e-9, 3e-8, 1e-7, 1e-4])
@pytest.mark.parametrize("way", [1, -1])
def test_flange_with_x_along_axis_6_is_exact(off, way):
    """Its pitch is 90 degrees or nearly so, where roll and yaw turn about the same line."""
    axes = some_axes(4, None)
    z = way * axes.directions[5]
    side = np.cross(z, [1.0, 2.0, 3.0])
    side /= np.linalg.norm(side)
    x = Rotation.from_rotvec(off * side).apply(z)
    axes.T_base_flange[:3, :3] = np.column_stack([x, side, np.cross(x, side)])
    robot = parsed(robot_text(robot_of("arm", denavit_hartenberg(axes), JOINTS)))
    q = np.random.default_rng(5).uniform(-3, 3, (50, 6))
    mm, rad = largest_difference(flange_poses(robot, q), product_of_turns(axes, q))
    assert mm < 1e-9
    assert rad < 1e-12


def test_a_joint_that_counts_against_the_base_keeps_its_z_upwards():
    axes = some_axes(1, None)
    axes.directions[0] = [0, 0, -1]
    found = denavit_hartenberg(axes)
    assert found.senses[0] == -1
    assert abs(found.alpha[0]) < 1e-12


def test_centres_of_mass_stay_where_they_are():
    axes = some_axes(2, None)
    centre = np.array([10.0, -20.0, 30.0])
    joints = [*JOINTS[:5], Joint("J6", (-170.0, 170.0), 100.0, 2.5, centre)]
    found = denavit_hartenberg(axes)
    last = robot_of("arm", found, joints).axes[5]
    T = found.T_base_link[5]
    np.testing.assert_allclose(T[:3, :3] @ last.centre_mm + T[:3, 3], centre, atol=2e-3)
    assert last.mass_kg == 2.5
