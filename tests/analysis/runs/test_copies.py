import shutil

import numpy as np
import pytest
from pyarrow.csv import write_csv

import analysis
from analysis.apps.commission.what_moved import what_moved_in
from analysis.apps.plant.fitting_arm import fitting_arm
from analysis.robot.kinematics.arm import arm_of, forward, rotation
from analysis.runs.copies import NEW, REFERENCE, refuse_repeated
from rigs.load import load
from tests.support.command_line import failure_of
from tests.support.pose_runs import pose_run
from tests.support.refusals import refused

OTHERWISE = ("../{}/lap", "linked", "copied")
"""Other ways to the same readings."""


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    """A directory with a run, a copy, a link to it, a table of its readings, and a copy of the table."""
    folder = tmp_path_factory.mktemp("twice")
    analysis.save_run(analysis.simulate("ur10e-cell", "roll", "acw"), folder / "lap")
    analysis.save_run(analysis.simulate("ur10e-cell", "roll", "acw", seed=1), folder / "other")
    shutil.copytree(folder / "lap", folder / "copied")
    (folder / "linked").symlink_to(folder / "lap")
    rng = np.random.default_rng(2)
    q = rng.uniform(-1, 1, (12, 6))
    # Of this arm, because the table of another one is compared with every reading of its joints.
    places_mm = forward(arm_of(load("ur10e")[0].robot), q)[:, :3, 3] + rng.normal(0, 0.1, (12, 3))
    poses = pose_run("ur10e", q, places_mm @ rotation(np.array([0.2, -0.4, 1.1])).T + [1500.0, -300.0, 400.0])
    write_csv(poses.to_table(), folder / "one.csv")
    shutil.copy(folder / "one.csv", folder / "two.csv")
    return folder


@pytest.mark.parametrize(
    ("words", "second"),
    [
        *[("moved {0} --new {1}", way) for way in ("lap", *OTHERWISE)],
        *[("diagnose {0} {1}", way) for way in ("lap", *OTHERWISE)],
        ("moved {0} {1}", "lap"),
        ("moved {2} {0} --new {1}", "copied"),
        ("diagnose {2} --hold-out {0} --unseen {1}", "lap"),
        ("diagnose {2} {0} --hold-out {1}", "copied"),
        ("calibrate {0} --fit joint_offset --unseen {1}", "copied"),
        ("compare {0} --against {1}", "lap"),
        ("compare {0} {1}", "linked"),
        ("compare {0} --unseen {1}", "lap"),
        ("analyse {0} {1}", "linked"),
        ("circle fit {0} {1}", "linked"),
    ],
)
def test_a_run_given_twice_is_refused(cell, words, second):
    again = cell / second.format(cell.name)
    assert failure_of(words.format(cell / "lap", again, cell / "other")) == (3, "run.copied")


@pytest.mark.parametrize(
    "words", ["moved {} --new {} --rig ur10e", "diagnose {} {} --rig ur10e", "compare ur10e ur5e {} {}"]
)
def test_tables_with_equal_readings_are_refused(cell, words):
    for second in ("one.csv", "two.csv"):
        assert failure_of(words.format(cell / "one.csv", cell / second)) == (3, "run.copied")


def test_the_same_arm_given_twice_is_refused():
    assert failure_of("compare ur10e ur10e") == (3, "run.copied")


def test_functions_refuse_the_same_run(cell):
    run, rig = analysis.load_run(cell / "lap"), load("ur10e-cell")[0]
    for call in (
        lambda: analysis.compare(run, unseen=run),
        lambda: analysis.diagnose([run, run]),
        lambda: what_moved_in(rig, [run], [run]),
        lambda: fitting_arm([run, run], [("a", rig), ("b", rig)]),
    ):
        with refused("run.copied", "is given twice"):
            call()


def test_part_of_a_table_in_another_order_is_the_same_data():
    rng = np.random.default_rng(1)
    q, xyz_mm = rng.uniform(-1, 1, (40, 6)), rng.uniform(-500, 500, (40, 3))
    part = rng.permutation(40)[:10]
    run, subset = pose_run("ur10e", q, xyz_mm, "one"), pose_run("ur10e", q[part] + 2 * np.pi, xyz_mm[part], "two")
    for groups in ({REFERENCE: [run], NEW: [subset]}, {REFERENCE: [subset], NEW: [run]}):
        with refused("run.copied", "contains the same readings as"):
            refuse_repeated(groups)
    refuse_repeated({REFERENCE: [run], NEW: [pose_run("ur10e", q, xyz_mm + rng.normal(0, 0.01, (40, 3)), "three")]})
