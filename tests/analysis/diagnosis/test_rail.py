from dataclasses import replace

import numpy as np
import pytest
from pyarrow import csv

from analysis.procedures.checks.columns import joint_findings
from analysis.procedures.checks.units import unit_findings
from analysis.procedures.pose import evaluate as evaluate_poses
from analysis.procedures.shared.test_kind import path_of
from analysis.robot.kinematics.arm import Array, arm_of, forward, forward_and_jacobian
from analysis.robot.predict import model_of, moved
from analysis.runs.loading import measured_of
from analysis.runs.tables import PoseTable, TouchTable, columns_of, table_from
from rigs.arms import load_arm
from rigs.effects import Effect, RailLine
from rigs.errors import FileError
from rigs.load import parse
from rigs.problems import RigFileError
from rigs.rig import Rig
from tests.support.command_line import ran
from tests.worlds.arms.railed_arm import draw_rail, railed_poses
from tests.worlds.arms.seven_axes import Fault, draw_postures, draw_truth, run_of

BALL_MM = np.array([10.0, -5.0, 120.0])
CELL = f"name: railed\n{load_arm('ur10e').text}  rail: {{direction: [2, 0, 0], limits_mm: [0, 3000]}}\n"


@pytest.fixture(scope="module")
def rig():
    return parse(CELL, "cell.yaml")


@pytest.fixture(scope="module")
def table(rig):
    rng = np.random.default_rng(17)
    arm = draw_truth(rig.robot, rng, (Fault("zero", 3, -0.25),))
    return railed_poses(rig.robot, arm, draw_rail(rng, 0.3, 0.4, -0.9), rng, BALL_MM, 150)


def test_a_rail_carries_the_arm_and_its_jacobian(rig):
    arm, q = arm_of(rig.robot), draw_postures(rig.robot, np.random.default_rng(1), 20)
    railed = np.column_stack([q, np.full(20, 1.25)])
    np.testing.assert_allclose(forward(arm, railed) - forward(arm, q), _moved_by([1250.0, 0, 0]), atol=1e-9)
    (T, J), (_, standing) = forward_and_jacobian(arm, railed), forward_and_jacobian(arm, q)
    np.testing.assert_allclose(J, standing, atol=1e-9)
    np.testing.assert_allclose(T, forward(arm, railed), atol=1e-9)


def _moved_by(way_mm: list[float]) -> Array:
    change = np.zeros((20, 4, 4))
    change[:, :3, 3] = way_mm
    return change


@pytest.mark.parametrize(("way", "moved"), [("along", [0.6, 0, 0]), ("across", [0, 0.6, 0]), ("up", [0, 0, 0.6])])
def test_errors_of_the_line_grow_with_the_rail_position(rig, way, moved):
    effect = RailLine.model_validate({"way": way, "mm_per_m": 0.3})
    q = np.column_stack([draw_postures(rig.robot, np.random.default_rng(2), 2), [0.0, 2.0]])
    table = PoseTable(q, np.zeros((2, 3)), None, rail=True)
    bare, wrong = (_places(rig, own, table) for own in ([], [effect]))
    np.testing.assert_allclose(wrong - bare, [[0, 0, 0], moved], atol=1e-9)


def _places(rig: Rig, effects: list[Effect], table: PoseTable) -> Array:
    model = model_of(rig, effects)
    path = path_of(model, table)
    return np.asarray(path.at_readings(moved(model, path).T)[:, :3, 3])


def test_tables_keep_the_rail_position():
    q = np.column_stack([np.zeros((3, 6)), [0.0, 1.5, 3.0]])
    touches = TouchTable(np.array(["A", "B", "A"]), q, q - 0.1, rail=True)
    columns = columns_of(touches)
    assert columns["e1_mm"].to_pylist() == [0.0, 1500.0, 3000.0]
    again = table_from(columns, "touch", None, "t")
    assert again.rail and again.came_from is not None
    np.testing.assert_allclose(again.q, q)
    np.testing.assert_allclose(again.came_from, q - 0.1)


def test_rail_missing_in_rig_file_or_table_is_reported(table, rig):
    standing = parse(CELL.replace("  rail:", "  # rail:"), "standing.yaml")
    run = run_of(rig, table).run
    with pytest.raises(FileError, match="no rail"):
        measured_of(run, standing)
    bare = replace(run, table=columns_of(PoseTable(table.q[:, :6], table.xyz_mm, None)))
    with pytest.raises(FileError, match="lacks e1_mm"):
        measured_of(bare, rig)


def test_standing_tests_are_refused_on_a_rail():
    circle = "tests: {circle: {centre_mm: [700, 0, 400], posture_deg: [0, -90, 90, 0, 90, 0]}}\n"
    with pytest.raises(RigFileError, match="rail"):
        parse(CELL + circle, "cell.yaml")


def test_tables_without_it_and_rails_without_the_rest_are_refused_in_a_line(table, tmp_path):
    cell, file = tmp_path / "cell.yaml", tmp_path / "poses.csv"
    cell.write_text(CELL)
    csv.write_csv(columns_of(PoseTable(table.q[:, :6], table.xyz_mm, None)), file)
    done = ran(f"import {file} --rig {cell} --test pose -o {tmp_path}/run")
    assert done.returncode and "e1_mm: " in done.stderr
    for words in (("plan", cell, "--poses", "12"), ("simulate", cell, "--test", "yaw", "-o", tmp_path / "none")):
        done = ran(*words)
        assert done.returncode and "rail" in done.stderr and "Traceback" not in done.stderr


def of_poses(rig: Rig, table: PoseTable) -> dict[str, float]:
    figures = evaluate_poses(table, arm_of(rig.robot), 0.01).figures
    return {name: figure.value for name, figure in figures.items()}


def test_a_turned_base_carries_its_rail_with_it(table, rig):
    """Base and tool are fitted: where the base of the rig file stands changes no figure, and no joint is to blame."""
    turned = parse(
        CELL.replace("  rail:", "  base: {xyz_mm: [100, 0, 50], rpy_deg: [180, 0, 90]}\n  rail:"), "turned.yaml"
    )
    assert of_poses(turned, table) == pytest.approx(of_poses(rig, table), rel=1e-6)
    assert not [*joint_findings(table, turned), *unit_findings(table, turned)]


@pytest.mark.parametrize(("unit", "factor"), [("m", 1000), ("inches", 25.4), ("cm", 10)])
def test_a_rail_in_another_unit_is_refused(table, rig, unit, factor):
    found = next(unit_findings(replace(table, q=table.q / [*np.ones(6), factor]), rig))
    assert found.strength == "impossible"
    assert found.what.startswith(f"e1_mm is in {unit}")
    assert not list(unit_findings(table, rig))


def test_a_rail_beyond_its_ends_and_one_that_counts_the_other_way_are_doubted(table, rig):
    far = parse(CELL.replace("3000", "2000"), "short.yaml")
    assert [one.strength for one in unit_findings(table, far)] == ["likely"]
    backwards = replace(table, q=table.q * [*np.ones(6), -1])
    (found,) = joint_findings(backwards, rig)
    assert "correct robot.rail.direction" in found.remedy
