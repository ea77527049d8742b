from __future__ import annotations

import json
from pathlib import Path

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
def test_each_row_is_known_whatever_was_missed(seed):
    places = stops(seed)
    kept = np.random.default_rng(seed).uniform(size=150) > 0.08
    pose = poses_of_stops(places[kept], CUBE)
    assert pose is not None and (pose == ORDER[kept]).all()


def test_a_recording_may_begin_anywhere_in_a_cycle():
    places = stops()
    for first in range(5):
        pose = poses_of_stops(places[first:], CUBE)
        assert pose is not None and (pose == ORDER[first:]).all()


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
    assert pose is not None and np.flatnonzero(pose == 0).tolist() == [20]


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cell with a small test, its two simulated runs and their tables as a tracker writes them."""
    directory = tmp_path_factory.mktemp("iso")
    text = ran("arms", "ur5e").stdout
    tests = "tests: {iso9283: {cycles: 4, path_cycles: 3}}\n"
    (directory / "cell.yaml").write_text(f"name: cell\n{text}{tests}")
    (directory / "hidden.yaml").write_text("effects: [{effect: joint_offset, axis: 2, offset_deg: 0.05}]\n")
    done = ran("simulate", directory / "cell.yaml", "--test", "iso9283", "--effects", directory / "hidden.yaml",
               "-o", directory / "sim")  # fmt: skip
    assert done.returncode == 0, done.stderr
    for run, name in (("pose-000", "stops"), ("path-000", "path")):
        assert ran("export", directory / "sim" / run, "--to", "csv", "-o", directory / f"{name}.csv").returncode == 0
    head, *rows = (directory / "stops.csv").read_text().splitlines()
    columns = [head.split(",").index(name) for name in ("x_mm", "y_mm", "z_mm")]
    places = [[row.split(",")[column] for column in columns] for row in rows]
    lines = ["X;Y;Z", *(";".join(place).replace(".", ",") for k, place in enumerate(places) if k != 7)]
    (directory / "tracker.csv").write_text("\n".join(lines) + "\n")
    return directory


def test_tracker_files_become_runs_with_all_figures(cell):
    rig = str(cell / "cell.yaml")
    cube = ran("import", cell / "tracker.csv", "--rig", rig, "--test", "pose", "-o", cell / "runs" / "cube")
    assert cube.returncode == 0 and "stops: " in cube.stderr, cube.stderr
    path = ran("import", cell / "path.csv", "--rig", rig, "--test", "path", "-o", cell / "runs" / "path")
    assert path.returncode == 0 and "doubt" not in path.stderr, path.stderr
    shown = ran("analyse", cell / "runs" / "cube", cell / "runs" / "path", "--plot", cell / "pictures")
    for words in ("RP of P4", "distance accuracy AD", "path accuracy AT", "corner overshoot CO", "radial deviation D"):
        assert words in shown.stdout, words
    assert len(list((cell / "pictures").glob("*.png"))) == 3
    page = ran("report", cell / "runs" / "cube", cell / "runs" / "path", "--no-diagnosis", "-o", cell / "page.html")
    assert page.returncode == 0 and "each path" in (cell / "page.html").read_text()
    assert ran("verify", cell / "runs" / "path").returncode == 0


def test_five_postures_do_not_identify_the_arm(cell):
    found = ran("diagnose", cell / "sim" / "pose-000", "--json")
    assert found.returncode == 0, found.stderr
    assert json.loads(found.stdout)["condition"] == "not_testable_here"


def test_path_is_no_evidence(cell):
    alone = ran("diagnose", cell / "sim" / "path-000", "-o", cell / "found")
    assert alone.returncode != 0 and "joint angles" in alone.stderr


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("program", "ur10e", "--for", "ur", "--test", "iso9283", "-o", "P"), "no tests.iso9283"),
        (("simulate", "ur10e", "--test", "iso9283", "-o", "P"), "no tests.iso9283"),
        (("program", "SEVEN", "--for", "ur", "--test", "iso9283", "-o", "P"), "7 axes"),
        (("program", "CELL", "--for", "ur", "--test", "iso9283", "--targets", "-o", "P"), "remove it"),
    ],
)
def test_impossible_use_is_one_line(words, says, cell):
    seven = cell / "seven.yaml"
    seven.write_text(f"name: seven\n{ran('arms', 'franka-fr3').stdout}tests: {{iso9283: {{}}}}\n")
    named = {"SEVEN": seven, "CELL": cell / "cell.yaml", "P": cell / "programs"}
    done = ran(*(named.get(word, word) for word in words))
    assert done.returncode != 0 and says in done.stderr and "Traceback" not in done.stderr
    assert not (cell / "programs").exists()


def test_a_path_in_another_unit_is_doubted_at_import(cell):
    head, *rows = (cell / "path.csv").read_text().splitlines()
    metres = [
        ",".join([row.split(",")[0], *(f"{float(one) / 1000:.7f}" for one in row.split(",")[1:])]) for row in rows
    ]
    (cell / "metres.csv").write_text("\n".join([head, *metres]) + "\n")
    done = ran("import", cell / "metres.csv", "--rig", cell / "cell.yaml", "--test", "path", "-o", cell / "metres")
    assert "doubt:" in done.stderr and "a line has" in done.stderr
