import datetime as dt
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.apps.certify.drift import Drift, drifts_of, until
from analysis.apps.certify.features import Feature, features_of
from analysis.apps.certify.target_errors import Cause, Work, causes_of
from analysis.apps.plant.collect import Collected
from analysis.apps.plant.history import history_of
from analysis.apps.plant.records import RunRecord
from analysis.procedures.shared.quantity import Quantity
from analysis.robot.kinematics.arm import arm_of, forward, roll_pitch_yaw
from rigs.calibration import ModelAssessment, packed_factor
from rigs.effects import Backlash, Effect, JointOffset, TransmissionError
from rigs.load import load
from rigs.schema.limits import Limits
from tests.support.command_line import failure_of, ran
from tests.support.handmade_calibration import calibrated_model, written

ROWS = (("A", 0, 5), ("B", 2, 5), ("C", 4, 5), ("D", 4, 8), ("far", 80, 5))
TARGETS = "name,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n" + "\n".join(
    f"{name},{q1},{q2},-8,2,-15,5" for name, q1, q2 in ROWS
)
SHIFT = ((JointOffset(axis=2, offset_deg=0.3), 1.0),)
"""Moves neighbouring targets alike."""
RIPPLE = ((TransmissionError(axis=1, order=90, amplitude_deg=0.02, phase_deg=90), 1.0),)
"""Moves targets that are two degrees of axis 1 apart in opposite directions."""


def certified(
    directory: Path, terms: Sequence[tuple[Effect, float]], *tolerances: str, options: str = ""
) -> dict[str, Any]:
    written(directory, calibrated_model(terms, factor=packed_factor(1e-3 * np.eye(len(terms) + 1))))
    (directory / "targets.csv").write_text(TARGETS)
    asked = " ".join([f"--tolerance {one}" for one in tolerances] + [options])
    done = ran(f"certify targets.csv --rig cell.yaml --repeatability 0.02 --json {asked}", cwd=directory)
    found = json.loads(done.stdout)
    return found | {"exit_code": done.returncode, "by_name": {one["name"]: one for one in found["features"]}}


def test_common_error_is_rejected_for_positions_and_accepted_for_distances(tmp_path):
    found = certified(tmp_path, SHIFT, "A=0.7mm", "distance:A,B=0.7mm", "distance:A,D=0.7mm")
    verdicts = {name: (one["verdict"], one["corrected"]["verdict"]) for name, one in found["by_name"].items()}
    assert verdicts == {
        "A": ("reject", "accept"),
        "distance:A,B": ("accept", "accept"),
        "distance:A,D": ("accept", "accept"),
    }
    assert found["exit_code"] == 1
    assert found["by_name"]["A"]["expected_mm"] > 0.3
    assert "usual" in found["by_name"]["A"]["cause"]


def test_opposite_errors_are_accepted_for_positions_and_rejected_for_distances(tmp_path):
    found = certified(tmp_path, RIPPLE, "A=0.9mm", "B=0.9mm", "distance:A,B=0.6mm")["by_name"]
    assert [found[name]["verdict"] for name in ("A", "B", "distance:A,B")] == ["accept", "accept", "reject"]


def test_target_outside_the_measured_region_is_undecided_with_the_reason(tmp_path):
    found = certified(tmp_path, SHIFT, "far=50mm", "distance:A,far=50mm")
    for feature in found["features"]:
        assert (feature["verdict"], feature["probability"], feature["u_mm"]) == ("undecided", None, None)
        assert "axis 1" in feature["why"]
        assert feature["next"]["q_deg"][0] == pytest.approx(80)


def test_straightness_of_two_targets_is_that_of_the_line_between_them(tmp_path):
    asked = "straightness:A,C=0.1mm", "straightness:A,far=0.1mm"
    line, beyond = certified(tmp_path, RIPPLE, *asked)["features"]
    assert 0.005 < line["expected_mm"] < 0.1  # two points alone are always straight
    assert (line["verdict"], beyond["verdict"]) == ("accept", "undecided")


def test_unmeasured_arm_decides_nothing(tmp_path):
    (tmp_path / "targets.csv").write_text(TARGETS)
    done = ran("certify targets.csv --arm ur10e --tolerance A=50mm --json", cwd=tmp_path)
    feature = json.loads(done.stdout)["features"][0]
    assert (done.returncode, feature["verdict"], feature["probability"]) == (1, "undecided", 1.0)


@pytest.mark.parametrize(
    ("tolerance", "code"),
    [
        ("A=0.3", "usage"),
        ("A=0mm", "usage"),
        ("A", "usage"),
        ("Z=0.3mm", "usage"),
        ("roundness:A,B=0.3mm", "usage"),
        ("distance:A=0.3mm", "usage"),
        ("distance:A,A=0.3mm", "usage"),
        ("distance:A,D..B=0.3mm", "usage"),
        ("flatness:A..B..D=0.3mm", "usage"),
        ("flatness:A..far=0.3mm", "usage"),
    ],
)
def test_wrong_feature_is_one_error_and_the_others_are_judged(tmp_path, tolerance, code):
    found = certified(tmp_path, SHIFT, tolerance, "B=5mm")
    assert [error["code"] for error in found["errors"]] == [code]
    assert (found["exit_code"], list(found["by_name"])) == (2, ["B"])


def test_flatness_of_a_program_without_targets_is_an_error():
    features, errors = features_of(["flatness:all=1mm"], None, (), (), np.empty((0, 3)))
    assert not features and [error.code for error in errors] == ["usage"]


def test_table_of_features_and_page(tmp_path):
    rows = "name,kind,targets,tolerance_mm\nedge,distance,A;B,0.3\n,position,all,90\nbad,distance,A;B,wide\n"
    (tmp_path / "features.csv").write_text(rows)
    found = certified(tmp_path, SHIFT, options="--features features.csv -o page.html")
    assert list(found["by_name"]) == ["edge", "A", "B", "C", "D", "far"]
    assert [error["code"] for error in found["errors"]] == ["usage"]
    page = (tmp_path / "page.html").read_text()
    assert page.count("<tr>") == 7
    assert "data:image/png" in page
    (tmp_path / "features.csv").write_text(rows.replace("tolerance_mm", "tolerance"))
    assert failure_of("certify targets.csv --rig cell.yaml --features features.csv", cwd=tmp_path)[1] == "table.invalid"


PROGRAM = """def job():
  set_tcp(p[0, 0, 0, 0, 0, 0])
  movej([0, -1.57, 1.57, -1.57, -1.57, 0], a=1, v=0.5)
  hole = p[-0.4, -0.17, 0.6, 0, 3.14, 0]
  movel(p[-0.5, -0.17, 0.6, 0, 3.14, 0], a=1, v=0.1)
  movel(hole, a=1, v=0.1)
  popup_of_ours()
  movej([0.1, -1.57, 1.57, -1.57, -1.57, 0], a=1, v=0.5)
end
"""


def test_program_judges_understood_targets_and_lists_the_others(tmp_path):
    (tmp_path / "job.script").write_text(PROGRAM)
    asked = "--tolerance position:all=90mm --tolerance straightness:3,5=90mm --tolerance straightness:3,8=1mm"
    found = json.loads(
        ran(f"certify job.script --arm ur10e --calibration data_sheet --json {asked}", cwd=tmp_path).stdout
    )
    names = [feature["name"] for feature in found["features"]]
    assert len(names) == 5
    assert sum(feature["probability"] is None for feature in found["features"]) == len(found["not_understood"]) == 1
    assert [error["code"] for error in found["errors"]] == ["usage"]
    assert found["errors"][0]["where"] == "--tolerance straightness:3,8=1mm"


def test_program_takes_what_rig_correct_takes(tmp_path):
    straight = PROGRAM.replace("  movej([0, -1.57, 1.57, -1.57, -1.57, 0], a=1, v=0.5)\n", "").partition("  popup")[0]
    (tmp_path / "job.script").write_text(straight + "end\n")
    call = "certify job.script --arm ur10e --calibration data_sheet --tolerance position:all=90mm"
    done = ran(call, cwd=tmp_path)
    assert "add --near" in done.stderr and "uncertain posture" in done.stderr
    near = "--near 0,-90,90,-90,-90,0"
    done = ran(f"{call} {near}", cwd=tmp_path)
    assert "uncertain posture" not in done.stderr and "only --near states the posture" in done.stderr
    assert json.loads(ran(f"{call} {near} --json", cwd=tmp_path).stdout)["posture_by_near"] == [4]
    assert failure_of(f"{call} --neutral ?", cwd=tmp_path) == (2, "usage")


LEVEL = np.array([[0.0, 0, 0], [100, 0, 0], [0, 100, 0], [100, 100, 0]])


@pytest.mark.parametrize(
    ("kind", "count", "moved", "expected"),
    [
        ("position", 1, [[3, 4, 0]], 5.0),
        ("distance", 2, [[-2, 0, 0], [1, 0, 0]], 3.0),
        ("distance", 3, [[3, 3, 9], [0, 0, 0], [-9, 9, 0]], -3.636),
        ("distance", 4, [[0, 0, 7], [0, 0, 0], [0, 0, 0], [0, 0, 0]], 7.0),
        ("flatness", 4, [[0, 0, 1], [0, 0, -1], [0, 0, -1], [0, 0, 1]], 2.0),
    ],
)
def test_error_of_a_feature_is_that_of_its_points(kind, count, moved, expected):
    nominal = LEVEL[:count]
    values = Feature("", kind, 1.0, np.arange(count)).values(nominal, (nominal + np.array(moved))[None])
    assert values == pytest.approx([expected], abs=1e-2)


def test_draws_have_the_covariance_of_common_and_own_parts():
    common, own = np.array([[[2.0, 0, 0], [2, 0, 0]]]), np.broadcast_to(np.eye(3), (2, 3, 3))
    drawn = Cause("", "model", np.ones((2, 3)), common, own).draw(np.arange(2), 20_000, np.random.default_rng(0))
    assert drawn.mean(axis=(0, 1)) == pytest.approx([1, 1, 1], abs=0.06)
    assert np.var(drawn[:, 0, 0] - drawn[:, 1, 0]) == pytest.approx(2.0, rel=0.05)  # the common part cancels
    assert np.var(drawn[:, 0, 0]) == pytest.approx(5.0, rel=0.05)


def test_growing_error_dates_the_end_of_the_tolerance():
    runs = tuple(
        RunRecord(
            f"run-{day}", str(day), "r", (dt.datetime(2026, 1, 1, tzinfo=dt.UTC) + dt.timedelta(days=day)).isoformat(),
            "pose", "", "", figures={"rms_mm": Quantity(0.1 + 0.002 * day + 0.001 * (day % 3), 0.001, "mm")},
        )
        for day in range(0, 100, 5)
    )  # fmt: skip
    (drift,) = drifts_of(history_of(Collected("r", runs, (), (), Limits())))
    assert drift.rate == pytest.approx(0.002 / 0.29, rel=0.05)
    moved, work = np.array([[[0.1, 0, 0]]]), Work(*(np.zeros((1, 6)) for _ in range(4)))
    found = until(load("paper-fanuc")[0], drift, work, moved, lambda at: float(np.linalg.norm(at) < 0.2))
    assert found.date == dt.date(2026, 4, 6) + dt.timedelta(days=round(1 / drift.rate))
    assert found.earliest < found.date < (found.latest or dt.date.max)
    steady = Drift("play_j1_deg", 0, 1e-9, 0.0, dt.date(2026, 1, 1))
    assert until(load("paper-fanuc")[0], steady, work, moved, lambda at: float(np.linalg.norm(at) < 0.2)) is None


def test_backlash_moves_a_target_by_half_its_width_times_the_lever():
    effect = Backlash(axis=1, width_deg=0.1)
    rig = load("ur10")[0].model_copy(update={"effects": ()})
    rig = rig.with_calibration(None, calibrated_model([(effect, 1.0)], factor=packed_factor(1e-3 * np.eye(2))))
    q = np.radians([20.0, -70, 100, -60, -80, 30]) + np.radians(np.linspace(-30, 30, 5))[:, None] * np.ones(6)
    poses = forward(arm_of(rig.robot), q)
    x, y = poses[:, :2, 3].T
    half = np.radians(0.05) * np.stack([-y, x, 0 * x], axis=1)
    for came_from, mean, own in ((q - 0.1, -half, 0.0), (q + 0.1, half, 0.0), (np.full_like(q, np.nan), 0.0, half)):
        work = Work(q, poses, came_from, np.full(5, np.nan))
        (approach,) = (one for one in causes_of(rig, work, (q, poses), None) if one.nature == "approach")
        assert approach.mean == pytest.approx(mean + 0 * half, abs=1e-4)
        assert np.abs(approach.own[:, 0]) == pytest.approx(np.abs(own + 0 * half), abs=1e-4)


def certified_poses(directory: Path, terms: Sequence[tuple[Effect, float]], tolerance: str, options: str = "") -> Any:
    """Certify A, B and C of `TARGETS` as poses, which a FANUC reaches in up to eight postures."""
    wide = tuple((low, high) for low, high in [(-360.0, 360.0)] * 6)
    model = calibrated_model(terms, factor=packed_factor(1e-4 * np.eye(len(terms) + 1)), joints_deg=wide)
    written(directory, model)
    rig, _ = load(str(directory / "cell.yaml"))
    T = forward(arm_of(rig.robot), np.radians([[q1, q2, -8, 2, -15, 5] for _, q1, q2 in ROWS[:3]]))
    rows = np.hstack([T[:, :3, 3], np.degrees(roll_pitch_yaw(T))]).tolist()
    lines = ["name,x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg"]
    lines += [",".join([name, *map(repr, row)]) for (name, *_), row in zip(ROWS, rows, strict=False)]
    (directory / "poses.csv").write_text("\n".join(lines))
    asked = f"--calibration data_sheet --repeatability 0.02 --json --tolerance {tolerance} {options}"
    return ran(f"certify poses.csv --rig cell.yaml {asked}", cwd=directory)


NEAR = "--near 0,5,-8,2,-15,5"
WRIST = ((JointOffset(axis=2, offset_deg=0.1), 1.0), (JointOffset(axis=5, offset_deg=0.3), 1.0))
"""Axis 5 turns the tool to the opposite side in the other posture of the wrist."""


def test_feature_with_one_verdict_in_all_postures_is_decided_and_otherwise_undecided_with_the_range(tmp_path):
    def judged(tolerance: str, options: str = "") -> tuple[dict[str, Any], dict[str, Any]]:
        found = json.loads(certified_poses(tmp_path / f"{tolerance}{len(options)}", WRIST, tolerance, options).stdout)
        return found["features"][0], found["posture"]

    errors = []
    for tolerance, verdict in (("A=0.001mm", "reject"), ("A=50mm", "accept"), ("distance:A,B=50mm", "accept")):
        feature, _ = judged(tolerance)
        assert (feature["verdict"], feature["corrected"]["verdict"]) == (verdict, verdict), tolerance
        errors.append(feature["expected_mm"])  # of the posture that decides
    low, high, _ = errors
    between = f"A={(low + high) / 2:.3f}mm"
    feature, posture = judged(between)
    assert (feature["verdict"], feature["probability"], feature["cause"]) == ("undecided", None, None)
    np.testing.assert_allclose(feature["range_mm"], [low, high], atol=1e-9)
    assert "postures are possible" in feature["why"]
    assert posture == {"source": None, "joints_deg": None, "not_stated": 3}
    line, _ = judged("straightness:A,C=9mm")
    assert line["verdict"] == "undecided" and "postures" in line["why"]
    feature, posture = judged(between, NEAR)
    assert feature["probability"] is not None and feature["range_mm"] is None
    assert posture == {"source": "--near", "joints_deg": [0, 5, -8, 2, -15, 5], "not_stated": 0}


def test_statement_of_a_posture_for_joint_targets_or_of_no_posture_is_refused(tmp_path):
    written(tmp_path, calibrated_model(SHIFT))
    (tmp_path / "targets.csv").write_text(TARGETS)
    call = "certify targets.csv --rig cell.yaml --tolerance A=1mm"
    assert failure_of(f"{call} {NEAR}", cwd=tmp_path) == (2, "usage")
    assert failure_of(f"{call} --start-joints 0,0,0,0,0,0", cwd=tmp_path) == (2, "usage")
    done = certified_poses(tmp_path / "poses", SHIFT, "A=1mm", "--near 0,5,-8")
    assert (done.returncode, "must be 6 numbers, one for each joint, but has 3" in done.stderr) == (2, True)


def test_model_for_which_calibrate_asks_for_more_readings_decides_nothing_and_says_why(tmp_path):
    def judged(**changed: Any) -> dict[str, Any]:
        assessment = ModelAssessment(
            condition="nothing_unusual", place="used", before_um=500, names_um=9, whole_um=9, handed_um=9, noise_um=9,
            unexplained_um=0, **changed,
        )  # fmt: skip
        there = tmp_path / str(len(changed))
        written(there, calibrated_model(SHIFT, factor=packed_factor(1e-3 * np.eye(2)), judged=assessment))
        (there / "targets.csv").write_text(TARGETS)
        done = ran("certify targets.csv --rig cell.yaml --repeatability 0.02 --json --tolerance A=9mm", cwd=there)
        feature: dict[str, Any] = json.loads(done.stdout)["features"][0]
        return feature | {"stderr": done.stderr}

    assert judged()["verdict"] == "accept"
    first = judged(measure_first=True)
    assert (first["verdict"], first["probability"]) == ("undecided", 1.0)
    assert "asks for more readings" in first["why"] and "no reading was left out" in first["why"]
    assert "rig plan cell.yaml --next" in first["stderr"]
    assert "93 µm rms" in judged(measure_first=True, left_out_um=93.0)["why"]
