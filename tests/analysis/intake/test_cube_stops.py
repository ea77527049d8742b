import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.intake.mapped import poses_of_stops
from analysis.robot.geometry.iso_cube import Cube
from tests.support.command_line import ran
from tests.worlds.arms.independent_arm import Array
from tests.worlds.arms.iso_plain import cube_places

CENTRE, SIDE = np.array([600.0, 50.0, 450.0]), 500.0
RISING = np.array([1.0, 0.0, 1.0]) / np.sqrt(2)
CUBE = Cube(CENTRE, SIDE, np.array([0.0, 1.0, 0.0]), RISING, np.eye(3), np.zeros((5, 6)))
ORDER = np.tile([5, 4, 3, 2, 1], 30)


def stops(seed: int = 0) -> Array:
    """In the frame of a tracker somewhere, with errors of an arm and scatter."""
    rng = np.random.default_rng(seed)
    places = cube_places(CENTRE, SIDE) + rng.normal(0, 0.5, (5, 3))
    turn = Rotation.random(random_state=rng)
    seen: Array = turn.apply(places[ORDER - 1] + rng.normal(0, 0.05, (150, 3))) + rng.uniform(-3000, 3000, 3)
    return seen


@pytest.mark.parametrize("seed", range(8))
def test_each_row_is_identified_despite_missing_stops(seed):
    places = stops(seed)
    kept = np.random.default_rng(seed).uniform(size=150) > 0.08
    pose = poses_of_stops(places[kept], CUBE)
    assert (pose == ORDER[kept]).all()


def test_another_order_another_cube_and_noise_are_no_stops_of_it():
    places = stops()
    across = places.reshape(30, 5, 3)[:, [0, 2, 1, 3, 4]].reshape(-1, 3)
    assert poses_of_stops(across, CUBE) is None
    assert poses_of_stops(places[np.random.default_rng(0).permutation(150)], CUBE) is None
    assert poses_of_stops(1.3 * places, CUBE) is None
    assert poses_of_stops(np.random.default_rng(0).uniform(0, 1000, (150, 3)), CUBE) is None


def test_a_row_elsewhere_is_named():
    places = np.insert(stops(), 20, [1.0, 2.0, 3.0], axis=0)
    pose = poses_of_stops(places, CUBE)
    assert np.flatnonzero(pose == 0).tolist() == [20]


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    directory = tmp_path_factory.mktemp("iso")
    text = ran("arms", "ur5e").stdout
    tests = "tests: {iso9283: {cycles: 4, path_cycles: 3}}\n"
    (directory / "cell.yaml").write_text(f"name: cell\n{text}{tests}")
    (directory / "hidden.yaml").write_text("effects: [{effect: joint_offset, axis: 2, offset_deg: 0.05}]\n")
    done = ran("simulate", directory / "cell.yaml", "--test", "iso9283", "--effects", directory / "hidden.yaml",
               "-o", directory / "sim")  # fmt: skip
    assert done.returncode == 0, done.stderr
    return directory


def test_five_postures_do_not_identify_the_arm(cell):
    found = ran(f"diagnose {cell}/sim/pose-000 --json")
    assert found.returncode == 0, found.stderr
    assert json.loads(found.stdout)["condition"] == "not_testable_here"


def test_path_is_no_evidence(cell):
    alone = ran(f"diagnose {cell}/sim/path-000 -o {cell}/found")
    assert alone.returncode != 0 and "joint angles" in alone.stderr
