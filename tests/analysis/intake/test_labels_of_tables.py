from pathlib import Path

import numpy as np
import pytest

from analysis.apps.interchange.ros_bag import uneven_header
from analysis.procedures.checks.check_runs import command_errors, findings_of
from analysis.robot.kinematics.arm import arm_of, forward
from analysis.robot.predict import load_of, pull
from analysis.runs.loading import load_measured
from rigs.arms import load_arm
from rigs.errors import RigError
from rigs.load import parse
from tests.support.command_line import ran

TEXT = f"name: x\n{load_arm('ur10e').text}"
RIG = parse(TEXT, "x")
RNG = np.random.default_rng(12)
Q = np.radians([0, -80, 100, -20, 80, 0]) + np.radians(RNG.uniform(-1, 1, (40, 6)) * [60, 25, 25, 60, 40, 80])
T = forward(arm_of(RIG.robot), Q)
XYZ = T[:, :3, 3] + T[:, :3, :3] @ [60.0, -30.0, 90.0] + [2000.0, 300.0, 10.0] + RNG.normal(0, 0.3, (40, 3))


def written(folder: Path, header: str, *columns: np.ndarray, rig: str = TEXT) -> Path:
    (folder / "cell.yaml").write_text(rig)
    table = np.column_stack(columns)
    lines = [header, *(",".join(f"{value:.6f}" for value in row) for row in table)]
    (folder / "poses.csv").write_text("\n".join(lines) + "\n")
    return folder / "poses.csv"


def imported(folder: Path, *options: str) -> str:
    table, rig, run = (str(folder / name) for name in ("poses.csv", "cell.yaml", "run"))
    done = ran("import", table, "--rig", rig, "--test", "pose", "-o", run, *options)
    return str(done.stderr)


def joints(template: str) -> str:
    return ",".join(template.format(axis) for axis in range(1, 7))


def test_rigs_own_headers_are_questioned_from_the_same_limits(tmp_path):
    longer = TEXT.replace("a_mm: -571.55", "a_mm: -531.55")
    assert longer != TEXT
    written(tmp_path, joints("q{}_deg") + ",x_mm,y_mm,z_mm", np.degrees(Q), XYZ, rig=longer)
    assert "not fit" in imported(tmp_path)


def test_a_place_in_other_columns_is_read_by_a_map(tmp_path):
    written(tmp_path, joints("q{}_deg") + ",tvec_x,tvec_y,tvec_z", np.degrees(Q), XYZ / 1000)
    assert "place tvec_x … tvec_z in m" in imported(tmp_path)
    np.testing.assert_allclose(load_measured(tmp_path / "run").table.readings, XYZ, atol=1e-2)  # fmt: skip


@pytest.mark.parametrize("options", [(), ("--joints", "commanded")])
def test_the_difference_of_commanded_and_measured_angles_is_reported(tmp_path, options):
    load = pull(arm_of(RIG.robot), load_of(RIG.robot), Q).torque[:, 1]
    sags = np.zeros(Q.shape)
    sags[:, 1] = 0.04 * load / np.abs(load).max()
    header = f"{joints('q{}_deg')},{joints('q{}_commanded_deg')},x_mm,y_mm,z_mm"
    written(tmp_path, header, np.degrees(Q), np.degrees(Q) - sags, XYZ)
    assert "axis 2 mean" in imported(tmp_path, *options)
    run = load_measured(tmp_path / "run")
    assert not run.has_only_commanded_angles
    second = command_errors(run)[1]
    assert second.rms_deg == pytest.approx(np.sqrt((sags[:, 1] ** 2).mean()), rel=1e-2)
    assert second.with_load > 0.99
    assert [one.columns for one in findings_of([run]) if one.convention == "commands"] == [("q2_deg",)]


def test_an_uneven_header_is_named_and_two_publishers_are_not():
    came = np.arange(200) * 20_000_000 + np.rint(RNG.normal(0, 1e5, 200)).astype(np.int64)
    uneven = came + np.rint(RNG.uniform(-3e7, 3e7, 200)).astype(np.int64)
    assert "uneven" in uneven_header(came, uneven)
    assert uneven_header(came, came - 5_000_000) == ""
    both = np.where(np.arange(200) % 2 == 0, came, came - 4_000_000_000)  # the second is late, each is even
    assert uneven_header(came, both) == ""
    assert uneven_header(np.sort(uneven), came) == ""  # a network that delays


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is empty"),
        ("q1_deg,q2_deg,x_mm\n1,2,3\n4,5,6\n", "is a table of 3 columns"),
        ("J1;J2\n1,5;2\n", "is a table of 2 columns"),
        (TEXT.replace("-612.7", "-0.6127").replace("-571.55", "-0.57155").replace("180.7", "0.1807")
         .replace("174.15", "0.17415").replace("119.85", "0.11985").replace("116.55", "0.11655"), "metres"),
        (TEXT + "\ntests: {touch: {sockets: [A, B], distances: [{between: [A, B], distance_mm: 0.1}]}}", "metres"),
    ],
)  # fmt: skip
def test_wrong_rig_file_or_metres_are_reported(text, says):
    with pytest.raises(RigError, match=says):
        parse(text, "cell.yaml")
