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


@pytest.fixture(scope="module")
def poses(tmp_path_factory):
    """Joint angles of a UR10e in degrees, and the places of its tool in the frame of a tracker in mm."""
    rng, robot = np.random.default_rng(11), load_arm("ur10e").robot
    q = rng.uniform(-2.0, 2.0, (30, 6))
    T = forward(arm_of(robot), q)
    xyz = T[:, :3, 3] + T[:, :3, :3] @ [35.0, -20.0, 120.0] + rng.normal(0, 0.1, (30, 3))
    return np.degrees(q), xyz @ [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]] + [3000.0, -500.0, 900.0]


def test_quoted_decimal_commas_are_read(tmp_path, poses):
    rows = [",".join(f'"{value:.4f}"'.replace(".", ",") for value in (*q, *xyz)) for q, xyz in zip(*poses, strict=True)]
    (tmp_path / "t.csv").write_text("\n".join([",".join([*JOINTS, *PLACES]), *rows]) + "\n")
    table = read_table(tmp_path / "t.csv", "ur10e", "pose").table
    np.testing.assert_allclose(np.degrees(table.q), poses[0], atol=1e-4)
    np.testing.assert_allclose(table.xyz_mm, poses[1], atol=1e-4)


def test_quoted_thousands_are_no_decimals(tmp_path, poses):
    rows = [",".join([*(f"{value:.4f}" for value in q), *['"1,234"'] * 3]) for q in poses[0]]
    (tmp_path / "t.csv").write_text("\n".join([",".join([*JOINTS, *PLACES]), *rows]) + "\n")
    with refused("table.invalid", "decimal comma"):
        read_table(tmp_path / "t.csv", "ur10e", "pose")


def test_poses_of_an_arm_in_classic_constants_name_the_notation(poses):
    q_deg, xyz = poses
    rig, _ = load("ur10e")
    following = [(axis.a_mm, axis.alpha_deg) for axis in rig.robot.axes[1:]]
    rows = zip(rig.robot.axes, [*following, (0.0, 0.0)], strict=True)
    axes = tuple(axis.model_copy(update={"a_mm": a, "alpha_deg": alpha}) for axis, (a, alpha) in rows)
    classic = rig.model_copy(update={"robot": rig.robot.model_copy(update={"axes": axes, "arm": ""})})
    (finding,) = joint_findings(PoseTable(np.radians(q_deg), xyz, None), classic)
    assert finding.strength == "decisive" and "classic" in finding.what
    assert not list(joint_findings(PoseTable(np.radians(q_deg), xyz, None), rig))


def test_reversed_joints_do_not_also_look_like_two_placements(tmp_path, poses):
    write_columns(tmp_path / "t.csv", [*JOINTS, *PLACES], poses[0] * [1, -1, -1, 1, 1, 1], poses[1])
    doubts = errors_of(
        "import", tmp_path / "t.csv", "--arm", "ur10e", "--test", "pose", "-o", tmp_path / "run", exit_code=0
    )
    assert "opposite direction" in doubts and "different place" not in doubts


def test_export_takes_its_format_from_the_ending_or_names_the_conflict(tmp_path, folder):
    ran("import", folder / "t.csv", "--rig", folder / "cell.yaml", "--test", "touch", "-o", tmp_path / "run")
    done = ran("export", tmp_path / "run", "--to", "csv", "-o", tmp_path / "t.xlsx")
    assert done.returncode == 2 and "--to xlsx" in done.stderr and not (tmp_path / "t.xlsx").exists()
    assert ran("export", tmp_path / "run", "-o", tmp_path / "t.csv").returncode == 0
    assert "q1_deg" in (tmp_path / "t.csv").read_text().partition("\n")[0]
    assert ran("export", tmp_path / "run", "-o", tmp_path / "t").returncode == 2


def test_single_arm_is_not_compared(folder):
    done = ran("compare", folder / "cell.yaml")
    assert done.returncode == 2 and "is a single arm" in done.stderr


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("cell.yaml", b"name: cell\n", "--rig"),
        ("poses.csv.gz", b"\x1f\x8b\x08", "gunzip -k"),
        ("poses.zip", b"PK\x03\x04 poses.csv", "unpack"),
        ("scan.pdf", b"%PDF-1.7", "PDF"),
        ("run.sh", b"rig diagnose\n", "unknown type .sh"),
        ("manifest.json", b"{}", "give the directory"),
    ],
)
def test_file_in_the_place_of_a_run_is_named_by_its_kind(tmp_path, name, content, words):
    """Each was "a file, not the directory of a run"."""
    (tmp_path / name).write_bytes(content)
    done = ran("analyse", name, cwd=tmp_path)
    assert done.returncode in (2, 3) and words in done.stderr and len(done.stderr.splitlines()) == 1


def test_workbook_with_one_sheet_is_a_table_and_with_two_names_them(folder, tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    robot, rng = load(folder / "cell.yaml")[0].robot, np.random.default_rng(5)
    q = np.radians([0, -80, 95, -100, -90, 0]) + rng.uniform(-0.9, 0.9, (30, 6))
    xyz = [1500, -800, 300] + forward(arm_of(robot), q)[:, :3, :] @ [40, 25, 130, 1]  # in the frame of a tracker
    xyz += rng.normal(0, 0.1, xyz.shape)
    book = openpyxl.Workbook()
    for row in [[*JOINTS, *PLACES], *np.column_stack([np.degrees(q), xyz]).tolist()]:
        book.active.append(row)
    book.save(tmp_path / "one.xlsx")
    assert ran("analyse", tmp_path / "one.xlsx", "--rig", folder / "cell.yaml").returncode == 0
    book.create_sheet("notes").append(["measured by night"])
    book.save(tmp_path / "two.xlsx")
    refusal = ran("analyse", tmp_path / "two.xlsx", "--rig", folder / "cell.yaml")
    assert refusal.returncode == 3 and "'notes'" in refusal.stderr


def test_missing_axis_of_an_arm_is_named_before_its_coupling(tmp_path):
    text = load("paper-fanuc")[1].splitlines(keepends=True)
    last = max(k for k, line in enumerate(text) if "limits_deg" in line)
    (tmp_path / "cell.yaml").write_text("".join(text[:last] + text[last + 1 :]))
    done = ran("check", tmp_path / "cell.yaml")
    assert done.returncode == 3 and "5 axes, but coupling has 6 rows" in done.stderr


def test_report_with_the_rig_file_of_another_robot_names_both_robots(tmp_path):
    runs = tmp_path / "runs"
    ran("simulate", "ur10e-cell", "--test", "repeatability", "-o", runs)
    done = ran("report", runs, "--rig", "paper-fanuc", "-o", tmp_path / "page.html", "--no-diagnosis")
    assert done.returncode == 3 and "--rig describes FANUC-like elbow arm" in done.stderr


def test_output_that_is_a_file_is_no_directory_for_a_diagnosis(folder, tmp_path):
    output = tmp_path / "found.yaml"
    output.touch()
    done = ran("diagnose", folder / "t.csv", "--rig", folder / "cell.yaml", "-o", output)
    assert done.returncode == 3 and "is a file" in done.stderr and "--output DIR" in done.stderr
