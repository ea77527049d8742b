"""An arm on a rail that a stranger made: its poses with e1_mm are imported, named and corrected."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pytest
from pyarrow import csv

from analysis.diagnosis.diagnose import diagnose
from analysis.diagnosis.judge.result import Diagnosis
from analysis.procedures.checks.columns import joint_findings, unit_findings
from analysis.procedures.pose import evaluate as evaluate_poses
from analysis.procedures.shared.test_kind import path_of
from analysis.robot.geometry.pose_setup import best_rigid, fit_setup, position_error
from analysis.robot.kinematics.arm import Array, arm_of, forward, forward_and_jacobian
from analysis.robot.model.predict import model_of, moved
from analysis.runs.loading import measured_of
from analysis.runs.tables import PoseTable, TouchTable, columns_of, table_from
from rigs.arms import load_arm
from rigs.effects import Effect, RailLine
from rigs.errors import FileError
from rigs.load import parse
from rigs.problems import RigFileError
from rigs.rig import Rig
from rigs.schema.effect import name_of, size_field
from tests.support.command_line import ran
from tests.worlds.arms.railed_arm import RailTruth, draw_rail, railed_places, railed_poses, railed_touches
from tests.worlds.arms.seven_axes import Fault, Truth, draw_postures, draw_truth, run_of

BALL_MM = np.array([10.0, -5.0, 120.0])
ZERO = Fault("zero", 3, -0.25)
CELL = f"name: railed\n{load_arm('ur10e').text}  rail: {{direction: [2, 0, 0], limits_mm: [0, 3000]}}\n"


@dataclass(frozen=True)
class Case:
    arm: Truth
    rail: RailTruth
    table: PoseTable

    @cached_property
    def found(self) -> Diagnosis:
        """Return the diagnosis of these poses, computed on demand."""
        rig = parse(CELL, "cell.yaml")
        return diagnose(rig, [run_of(rig, self.table)], [], [], lambda _: None)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return parse(CELL, "cell.yaml")


@pytest.fixture(scope="module")
def case(rig: Rig) -> Case:
    rng = np.random.default_rng(17)
    arm, rail = draw_truth(rig.robot, rng, (ZERO,)), draw_rail(rng, 0.3, 0.4, -0.9)
    table = railed_poses(rig.robot, arm, rail, rng, BALL_MM, 150)
    return Case(arm, rail, table)


def effects(found: Diagnosis) -> list[Effect]:
    assert found.calibrated is not None
    return [*(one.effect for one in found.written), *found.calibrated.effects]


def elsewhere_mm(case: Case, rig: Rig, effects: list[Effect]) -> float:
    """How far a model is off, mm rms, at postures and places of the rail that were not used."""
    rng = np.random.default_rng(18)
    q, e1_mm = draw_postures(rig.robot, rng, 150), rng.uniform(0, 3000, 150)
    really = railed_places(case.arm, case.rail, q, np.vstack([q[:1], q[:-1]]), e1_mm, BALL_MM)
    table = PoseTable(np.column_stack([q, e1_mm / 1000]), really, None, rail=True)
    model = model_of(rig, effects)
    T = moved(model, path_of(model, table)).T
    return float(np.sqrt(np.mean(np.sum(position_error(T, really, fit_setup(T, really)) ** 2, axis=1))))


def test_scale_and_height_of_the_rail_are_named_beside_a_fault_of_a_joint(case: Case) -> None:
    named = {name_of(one.effect): one for one in case.found.standing}
    truth = {"rail_line along": 0.3, "rail_line up": -0.9, "joint_offset 3": case.arm.size_of(ZERO)}
    assert set(named) >= set(truth)
    for name, size in truth.items():
        one = named[name]
        field = size_field(one.effect)
        assert getattr(one.effect, field) == pytest.approx(size, abs=4 * one.sd[field] + 0.03 * abs(size))


def test_the_calibrated_model_holds_elsewhere_on_the_rail(case: Case, rig: Rig) -> None:
    assert not any("rail stood" in doubt for doubt in case.found.doubts)
    assert elsewhere_mm(case, rig, []) > 2.0
    assert elsewhere_mm(case, rig, effects(case.found)) < 0.15
    assert case.found.calibrated is not None
    assert len(case.found.calibrated.joints_deg) == 6
    low, high = case.found.calibrated.rail_mm or (0, 0)
    assert 0 <= low < 200 and 2800 < high <= 3000


def test_a_rail_carries_the_arm_and_its_jacobian(rig: Rig) -> None:
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
def test_each_error_of_the_line_grows_with_where_the_rail_stands(rig: Rig, way: str, moved: list[float]) -> None:
    effect = RailLine.model_validate({"way": way, "mm_per_m": 0.3})
    q = np.column_stack([draw_postures(rig.robot, np.random.default_rng(2), 2), [0.0, 2.0]])
    table = PoseTable(q, np.zeros((2, 3)), None, rail=True)
    bare, wrong = (_places(rig, own, table) for own in ([], [effect]))
    np.testing.assert_allclose(wrong - bare, [[0, 0, 0], moved], atol=1e-9)


def _places(rig: Rig, effects: list[Effect], table: PoseTable) -> Array:
    model = model_of(rig, effects)
    path = path_of(model, table)
    return np.asarray(path.at_readings(moved(model, path).T)[:, :3, 3])


def test_tables_keep_where_the_rail_stands() -> None:
    q = np.column_stack([np.zeros((3, 6)), [0.0, 1.5, 3.0]])
    touches = TouchTable(np.array(["A", "B", "A"]), q, q - 0.1, rail=True)
    columns = columns_of(touches)
    assert columns["e1_mm"].to_pylist() == [0.0, 1500.0, 3000.0]
    again = table_from(columns, "touch", None, "t")
    assert isinstance(again, TouchTable) and again.rail and again.came_from is not None
    np.testing.assert_allclose(again.q, q)
    np.testing.assert_allclose(again.came_from, q - 0.1)


def test_a_rail_that_one_of_rig_file_and_table_does_not_know_is_told(case: Case, rig: Rig) -> None:
    standing = parse(CELL.replace("  rail:", "  # rail:"), "standing.yaml")
    run = run_of(rig, case.table).run
    with pytest.raises(FileError, match="no rail"):
        measured_of(run, standing)
    bare = replace(run, table=columns_of(PoseTable(case.table.q[:, :6], case.table.xyz_mm, None)))
    with pytest.raises(FileError, match="lacks e1_mm"):
        measured_of(bare, rig)


def test_what_stands_is_refused_on_a_rail() -> None:
    circle = "tests: {circle: {centre_mm: [700, 0, 400], posture_deg: [0, -90, 90, 0, 90, 0]}}\n"
    with pytest.raises(RigFileError, match="rail"):
        parse(CELL + circle, "cell.yaml")


def test_commands_from_a_table_to_corrected_targets(case: Case, rig: Rig, tmp_path: Path) -> None:
    cell, table, targets = tmp_path / "cell.yaml", tmp_path / "poses.csv", tmp_path / "targets.csv"
    cell.write_text(CELL)
    csv.write_csv(columns_of(case.table), table)
    run = tmp_path / "run"
    assert ran("import", table, "--rig", cell, "--test", "pose", "-o", run).returncode == 0
    assert ran("diagnose", run, "-o", tmp_path / "found").returncode == 0
    q = draw_postures(rig.robot, np.random.default_rng(9), 8) * 0.9
    e1_mm = np.linspace(200, 2800, 8)
    rows = np.column_stack([np.degrees(q), e1_mm])
    header = ",".join([*(f"q{axis}_deg" for axis in range(1, 7)), "e1_mm"])
    np.savetxt(targets, rows, delimiter=",", header=header, comments="")
    done = ran("correct", tmp_path / "found" / "railed.yaml", "--path", targets, "-o", tmp_path / "corrections")
    assert done.returncode == 0 and "e1_mm of" in done.stderr and "--controller" not in done.stderr
    corrected = csv.read_csv(tmp_path / "corrections" / "corrected-targets.csv")
    np.testing.assert_allclose(corrected["e1_mm"].to_numpy(), e1_mm, atol=1e-6)
    sent = np.radians(np.stack([corrected[f"q{axis}_deg"].to_numpy() for axis in range(1, 7)], axis=1))
    wanted = forward(arm_of(rig.robot), np.column_stack([q, e1_mm / 1000]))
    wanted_mm = wanted[:, :3, 3] + wanted[:, :3, :3] @ BALL_MM

    def missed_mm(q: Array) -> float:
        places = railed_places(case.arm, case.rail, q, q, e1_mm, BALL_MM)
        T = best_rigid(places, wanted_mm)
        return float(np.sqrt(np.mean(np.sum((places @ T[:3, :3].T + T[:3, 3] - wanted_mm) ** 2, axis=1))))

    assert missed_mm(q) > 1.0  # with the frame taught over these targets
    assert missed_mm(sent) < 0.15


def test_tables_without_it_and_rails_without_the_rest_are_refused_in_a_line(case: Case, tmp_path: Path) -> None:
    cell, table = tmp_path / "cell.yaml", tmp_path / "poses.csv"
    cell.write_text(CELL)
    csv.write_csv(columns_of(PoseTable(case.table.q[:, :6], case.table.xyz_mm, None)), table)
    done = ran("import", table, "--rig", cell, "--test", "pose", "-o", tmp_path / "run")
    assert done.returncode and "e1_mm: " in done.stderr
    for words in (("plan", cell, "--poses", "12"), ("simulate", cell, "--test", "yaw", "-o", tmp_path / "none")):
        done = ran(*words)
        assert done.returncode and "rail" in done.stderr and "Traceback" not in done.stderr


@pytest.mark.nightly  # 7 s; poses along the rail show that it climbs, and touches a play, in each commit
def test_touches_from_along_the_rail_show_that_it_climbs(rig: Rig) -> None:
    """Of each socket a stretch of the rail is used, where the arm reaches it."""
    rng = np.random.default_rng(23)
    arm, rail = draw_truth(rig.robot, rng, (ZERO,)), draw_rail(rng, 0.3, 0.2, 2.0)
    sockets = np.array([[700.0, 600.0, 300.0], [2300.0, -600.0, 350.0]])
    touched = parse(f"{CELL}tests: {{touch: {{sockets: [A, B]}}}}\n", "cell.yaml")
    run = run_of(touched, railed_touches(rig.robot, arm, rail, rng, BALL_MM, sockets, 50))
    found = diagnose(touched, [run], [], [], lambda _: None)
    named = {name_of(one.effect): one.effect for one in found.standing}
    assert set(named) == {"joint_offset 3", "rail_line up"}
    assert getattr(named["rail_line up"], size_field(named["rail_line up"])) == pytest.approx(2.0, rel=0.2)
    assert found.train.calibrated_um < 0.1 * found.train.before_um


def of_poses(rig: Rig, table: PoseTable) -> dict[str, float]:
    figures = evaluate_poses(table, arm_of(rig.robot), 0.01).figures
    return {name: figure.value for name, figure in figures.items()}


def test_a_turned_base_carries_its_rail_with_it(case: Case, rig: Rig) -> None:
    """Base and tool are fitted: where the base of the rig file stands changes no figure, and no joint is to blame."""
    turned = parse(
        CELL.replace("  rail:", "  base: {xyz_mm: [100, 0, 50], rpy_deg: [180, 0, 90]}\n  rail:"), "turned.yaml"
    )
    assert of_poses(turned, case.table) == pytest.approx(of_poses(rig, case.table), rel=1e-6)
    assert not [*joint_findings(case.table, turned), *unit_findings(case.table, turned)]


@pytest.mark.parametrize(("unit", "factor"), [("m", 1000), ("inches", 25.4), ("cm", 10)])
def test_a_rail_in_another_unit_is_refused(case: Case, rig: Rig, unit: str, factor: float) -> None:
    found = next(unit_findings(replace(case.table, q=case.table.q / [*np.ones(6), factor]), rig))
    assert found.strength == "impossible"
    assert found.what.startswith(f"e1_mm is in {unit}")
    assert not list(unit_findings(case.table, rig))


def test_a_rail_beyond_its_ends_and_one_that_counts_the_other_way_are_doubted(case: Case, rig: Rig) -> None:
    far = parse(CELL.replace("3000", "2000"), "short.yaml")
    assert [one.strength for one in unit_findings(case.table, far)] == ["likely"]
    backwards = replace(case.table, q=case.table.q * [*np.ones(6), -1])
    (found,) = joint_findings(backwards, rig)
    assert "correct robot.rail.direction" in found.remedy


def test_a_rail_that_nobody_moved_is_said(case: Case, rig: Rig) -> None:
    still = railed_poses(rig.robot, case.arm, RailTruth(0, 0, 0, ()), np.random.default_rng(5), BALL_MM, 40)
    q = np.column_stack([still.q[:, :6], np.zeros(40)])
    arm = arm_of(rig.robot)
    table = replace(still, q=q, xyz_mm=forward(arm, q)[:, :3, 3] + np.random.default_rng(6).normal(0, 0.02, (40, 3)))
    found = diagnose(rig, [run_of(rig, table)], [], [], lambda _: None)
    assert any("at 0 mm" in doubt for doubt in found.doubts)
