from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.procedures import pose
from analysis.robot.kinematics.arm import forward
from analysis.runs.tables import PoseTable
from tests.support.refusals import refused
from tests.worlds.planted import closed_forms as planted

UR10 = Path(__file__).parents[4] / "shared" / "data" / "ipa-ur10"


def measured(series: str) -> tuple[PoseTable, np.ndarray]:
    """The table of a series and its standard deviations (n, 3) mm. Intrinsic XYZ becomes fixed-axis roll-pitch-yaw."""
    path = UR10 / f"{series}.csv"
    if not path.exists():
        pytest.skip(f"{path} is not here: the measured data is not copied into the project")
    head, *rows = path.read_text().split("\n")
    names = head.strip().split(";")
    values = np.array([[float(cell.replace(",", ".")) for cell in row.split(";")] for row in rows if row.strip()])
    place = [names.index(f"measurement_{axis}") for axis in ("x", "y", "z", "rx", "ry", "rz")]
    spread = values[:, [names.index(f"measurement_std_{axis}") for axis in "xyz"]]
    first = names.index("shoulder_pan_joint")
    rpy = Rotation.from_euler("XYZ", values[:, place[3:]], degrees=True).as_euler("xyz")
    return PoseTable(values[:, first : first + 6], values[:, place[:3]], rpy), spread


def test_a_planted_set_up_is_found_and_leaves_nothing():
    rng = np.random.default_rng(2)
    q = rng.uniform(-2, 2, (40, 6))
    base, tool = np.eye(4), np.eye(4)
    base[:3, :3], base[:3, 3] = Rotation.from_rotvec([0.1, -2.0, 1.0]).as_matrix(), (3000.0, -200.0, 90.0)
    tool[:3, :3], tool[:3, 3] = Rotation.from_rotvec([1.5, 0.1, 0.2]).as_matrix(), (10.0, -20.0, 130.0)
    T = base @ forward(planted.ur10(), q) @ tool
    rpy = Rotation.from_matrix(T[:, :3, :3]).as_euler("xyz")
    result = pose.evaluate(PoseTable(q, T[:, :3, 3], rpy), planted.ur10(), 0.01)
    np.testing.assert_allclose(result.setup.T_world_base, base, atol=1e-6)
    np.testing.assert_allclose(result.setup.T_flange_tool, tool, atol=1e-6)
    assert result.figures["rms_mm"].value < 1e-6
    assert result.figures["rms_deg"].value < 1e-6
    measured_once, no_u_of_rotation = result.notes
    assert "repeatability" in measured_once and "orientation" in no_u_of_rotation
    assert str(result.figures["rms_deg"]) == "0.0000 °"
    assert {figure.noise for figure in result.figures.values()} == {"assumed"}


def test_an_error_is_measured_less_fitted_in_the_arms_base():
    """Each row has an error of its own: one among rows without any would be a wild reading, and left out."""
    base, row, rng = np.eye(4), 17, np.random.default_rng(4)
    base[:3, :3], base[:3, 3] = Rotation.from_rotvec([0.1, -2.0, 1.0]).as_matrix(), (3000.0, -200.0, 90.0)
    q = np.random.default_rng(2).uniform(-2, 2, (200, 6))
    T = forward(planted.ur10(), q)
    off_mm, turned = rng.normal(0, 0.2, (200, 3)), rng.normal(0, 0.002, (200, 3))
    off_mm[row], turned[row] = (0.1, -0.2, 0.3), (0.001, -0.002, 0.003)
    T[:, :3, 3] += off_mm
    T[:, :3, :3] = Rotation.from_rotvec(turned).as_matrix() @ T[:, :3, :3]
    seen = base @ T
    table = PoseTable(q, seen[:, :3, 3], Rotation.from_matrix(seen[:, :3, :3]).as_euler("xyz"))
    result = pose.evaluate(table, planted.ur10(), 0.01)
    np.testing.assert_allclose(result.position_mm[row], (0.1, -0.2, 0.3), atol=0.08)
    np.testing.assert_allclose(result.rotation[row], (0.001, -0.002, 0.003), atol=8e-4)


@pytest.mark.parametrize(("series", "rows", "rms"), [("series_d", 632, 0.7720), ("series_b", 1495, 1.0846)])
def test_the_measured_ur10_nominal(series, rows, rms):
    """All rows, base and tool fitted on the same rows, rms of the length of the position error.

    rms here were got apart from this code (alternating Procrustes and mean, standard DH).
    """
    table, _ = measured(series)
    result = pose.evaluate(table, planted.ur10(), 0.012)
    assert result.samples == rows
    assert result.figures["rms_mm"].value == pytest.approx(rms, abs=0.001)
    assert result.figures["rms_deg"].value == pytest.approx({"series_d": 0.110, "series_b": 0.085}[series], abs=0.001)


def test_visits_are_grouped_and_judged_by_iso_9283():
    x = np.array([[[0.0, 0, 0], [0, 0, 0], [1, 2, 3]]])
    figures = pose.place_figures(x)
    assert figures["ap_mm"] == pytest.approx(2.0)
    assert figures["rp_mm"] == pytest.approx(2 / 3 + 3 * np.std([1, 0, 1], ddof=1))
    turned = pose.turn_figures(x)
    assert (turned["ap_c_deg"], turned["rp_c_deg"], turned["rp_a_deg"]) == (2.0, 3.0, 0.0)
    q = np.zeros((5, 6))
    q[3:, 2] = 0.1
    q[1, 0] = 1e-4
    assert list(pose.groups(q, 1e-3)) == [0, 0, 0, 1, 1]


def test_invalid_pose_table_is_refused():
    rng = np.random.default_rng(3)
    q, xyz = rng.uniform(-2, 2, (20, 6)), rng.normal(0, 500, (20, 3))
    for code, table in (
        ("readings.too_few", PoseTable(q[:5], xyz[:5], None)),
        ("readings.unsuitable", PoseTable(np.zeros((20, 6)), xyz, None)),
        ("readings.unsuitable", PoseTable(q, np.zeros((20, 3)), None)),
        ("table.unclear", PoseTable(np.degrees(q), xyz, None)),
        ("table.invalid", PoseTable(q, np.where(np.arange(60).reshape(20, 3) == 4, np.nan, xyz), None)),
    ):
        with refused(code):
            pose.evaluate(table, planted.ur10(), 0.01)
