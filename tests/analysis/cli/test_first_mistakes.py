import numpy as np
import pyarrow.csv as pa_csv
import pytest

from analysis.api import load_run, read_table
from analysis.procedures.checks.columns import joint_findings
from analysis.robot.kinematics.arm import arm_of, forward
from analysis.runs.tables import PoseTable, columns_of
from rigs.arms import load_arm
from rigs.load import load
from tests.support.command_line import errors_of, ran
from tests.support.refusals import refused
from tests.support.written_files import JOINTS, PLACES, write_columns
from tests.worlds.arms.seven_axes import draw_truth, touch_table

_SOCKETS_MM = np.array([[420.0, -160.0, 30.0], [420.0, 140.0, 130.0]])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cell")
    text = f"name: cell\n{load_arm('ur10e').text}tests: {{touch: {{sockets: [A, B]}}}}\n"
    (folder / "cell.yaml").write_text(text)
    robot, rng = load(folder / "cell.yaml")[0].robot, np.random.default_rng(3)
    table = touch_table(robot, draw_truth(robot, rng, ()), rng, np.array([10.0, -5.0, 120.0]), _SOCKETS_MM, 24)
    pa_csv.write_csv(columns_of(table).select(["socket", *JOINTS]), folder / "t.csv")
    return folder


@pytest.mark.parametrize("command", ["diagnose", "calibrate", "moved"])
@pytest.mark.parametrize("head", ["x_mm,y_mm,z_mm", "socket"])
def test_a_table_of_another_arm_gets_no_verdict(tmp_path, command, head):
    """Random poses received a complete diagnosis and exit code 0."""
    rng = np.random.default_rng(7)
    q, xyz = rng.uniform(-170, 170, (40, 6)), rng.uniform(-800, 800, (40, 3))
    table = tmp_path / "t.csv"
    write_columns(table, [*JOINTS, head], q, np.full(40, "A") if head == "socket" else xyz)
    options = {"diagnose": [], "calibrate": ["-o", tmp_path / "c.yaml"], "moved": ["--new", table]}[command]
    done = ran(command, table, *options, "--arm", "ur5")
    assert done.returncode == 3 and not (tmp_path / "c.yaml").exists() and not done.stdout
    assert done.stderr.splitlines()[-1].startswith("error: ")


@pytest.mark.parametrize("test", ["touch", "pose"])
def test_a_table_of_a_sibling_names_the_arm_that_it_fits(folder, test):
    """Offsets of 4 and 10 mm were two faults of a UR10e that was called a UR10, to enter at the controller."""
    own = load(folder / "cell.yaml")[0]
    given = own.model_copy(update={"robot": load_arm("ur10").robot})
    table = read_table(folder / "t.csv", folder / "cell.yaml", "touch").table
    if test == "pose":
        rng = np.random.default_rng(3)
        q = rng.uniform(-2.0, 2.0, (30, 6))
        table = PoseTable(q, forward(arm_of(own.robot), q)[:, :3, 3] + rng.normal(0, 0.1, (30, 3)), None)
    (finding,) = joint_findings(table, given)
    assert finding.strength == "decisive" and "--arm ur10e" in finding.remedy
    assert not list(joint_findings(table, own))


def test_a_column_that_occurs_twice_is_no_other_joint(folder):
    """`q1_deg` twice was read as joints 1 and 2, because the second was called `q1_deg (2)`."""
    table = folder / "twice.csv"
    table.write_text((folder / "t.csv").read_text().replace("q2_deg", "q1_deg"))
    told = errors_of(f"import {table} --rig {folder}/cell.yaml --test touch -o {folder}/twice")
    assert told.startswith(f"error: {table}: has two") and not (folder / "twice").exists()


@pytest.mark.parametrize(
    ("table", "test", "expected"), [("cell.yaml", "touch", "is a YAML file"), ("t.csv", "pose", "--test touch")]
)
def test_wrong_file_or_test_is_named(folder, table, test, expected):
    first = errors_of(f"import {folder}/{table} --rig {folder}/cell.yaml --test {test} -o {folder}/made").splitlines()[
        0
    ]
    assert first.startswith(f"error: {folder / table}: ") and expected in first
    assert not (folder / "made").exists()


def test_non_path_is_refused_in_python():
    with refused("argument.invalid", "path, but has the type NoneType"):
        load_run(None)


def test_rows_that_occur_twice_show_no_repeatability(tmp_path):
    """An export that contained each row twice had a scatter of 0.2 µm."""
    rng = np.random.default_rng(5)
    q = rng.uniform(-2.0, 2.0, (20, 6))
    tracked = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])  # in the frame of a tracker
    xyz = (forward(arm_of(load_arm("ur5").robot), q) @ [10.0, 20.0, 80.0, 1.0])[:, :3] @ tracked + [900.0, -700.0, 50.0]
    xyz += rng.normal(0, 0.1, xyz.shape)
    rows = np.tile(np.hstack([np.degrees(q), xyz]).round(4), (2, 1))
    write_columns(tmp_path / "t.csv", [*JOINTS, *PLACES], rows)
    done = ran(f"diagnose {tmp_path}/t.csv --arm ur5")
    assert done.returncode != 0 and "contains 20 of its 40 rows twice" in done.stderr
