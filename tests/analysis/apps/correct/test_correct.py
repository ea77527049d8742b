"""Corrections: the real arm reaches the nominal target, and errors that no target can correct are left unchanged."""

from collections.abc import Sequence
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.apps.correct.correct_rig import correct_rig
from analysis.apps.correct.corrected_constants import joint_zeros, link_constants
from analysis.apps.correct.correction_report import correction_answer, write
from analysis.apps.report.texts import keys_of
from analysis.correction.corrected_targets import CorrectedTargets, corrected
from analysis.correction.support import supports
from analysis.correction.table_postures import stated_posture
from analysis.correction.work import tool_poses
from analysis.intake.table_problems import TableFileError
from analysis.robot.kinematics.arm import Array, arm_of, forward
from analysis.robot.kinematics.inverse import inverse
from analysis.robot.predict import model_of
from rigs.calibration import JointPortions, Portion
from rigs.edit import extended
from rigs.effects import (
    VOCABULARY,
    Backlash,
    ClockRate,
    Compliance,
    Effect,
    JointOffset,
    JointScale,
    LinkGeometry,
    ReversalSpike,
    ServoLag,
    ThermalGrowth,
    size_field,
)
from rigs.errors import FileError
from rigs.load import load
from rigs.rig import Rig
from tests.support.command_line import errors_of, json_of, ran, succeeded
from tests.support.refusals import refused
from tests.support.written_files import JOINTS, PLACES, TURNS, contents, numbers_in, rows_in
from tests.worlds.arms.faulty_arm import EFFECTS, flange_at, hidden
from tests.worlds.arms.faulty_arm import found as provenance

RIG = load("paper-fanuc")[0].model_copy(update={"effects": ()})
HEAD = ",".join(["name", *JOINTS])
TARGETS = np.array([[0, 20, 10, 0, 60, 0], [10, 25, 0, 20, -70, 30], [-30, 5, -20, 100, 40, 100]], dtype=float)


ZERO_3, _, A2, _ = EFFECTS
ALPHA3 = LinkGeometry(axis=4, field="alpha", delta=0.03, found=provenance(delta=0.002))
PLAY_1 = Backlash(axis=1, width_deg=0.05, found=provenance(width_deg=0.001))


def _rig(*effects: Effect) -> Rig:
    return RIG.model_copy(update={"effects": effects})


def _targets(path: Path, *effects: Effect) -> CorrectedTargets:
    return correct_rig(_rig(*effects), path).path[2]


def _path(tmp_path: Path, rows: Sequence[str] | Array = TARGETS, head: str = HEAD) -> Path:
    named = [row if isinstance(row, str) else f"P{k}," + ",".join(map(str, row)) for k, row in enumerate(rows)]
    path = tmp_path / "path.csv"
    path.write_text("\n".join([head, *named]) + "\n")
    return path


def _flanges(q: Array, *, is_nominal: bool = False) -> Array:
    """Flanges (n, 4, 4) at reported angles q (n, 6) rad, by an arm that is independent of the product."""
    wrong = hidden()
    wrong.alpha[3] = np.radians(0.03)
    return np.array([flange_at(RIG, one, None if is_nominal else wrong) for one in q])


def test_corrected_angles_bring_the_real_arm_to_its_targets(tmp_path):
    found = correct_rig(_rig(*EFFECTS, ALPHA3, PLAY_1), _path(tmp_path))
    *_, path = write(found, tmp_path / "out")
    corrected = np.radians(numbers_in(path, *JOINTS))
    wanted = _flanges(np.radians(TARGETS), is_nominal=True)
    np.testing.assert_allclose(_flanges(corrected), wanted, atol=1e-5)
    tool_mm = np.array([*RIG.robot.tool.xyz_mm, 1.0])
    missed = np.linalg.norm((_flanges(np.radians(TARGETS)) - wanted) @ tool_mm, axis=1)
    assert missed.min() > 0.3
    np.testing.assert_allclose(numbers_in(path, "missed_mm"), missed, atol=1e-5)


def test_a_controller_given_corrected_poses_brings_the_real_arm_to_the_poses(tmp_path):
    given = np.array([TARGETS[0], [10, 25, 0, 20, 70, 30]])
    wanted = forward(arm_of(RIG.robot), np.radians(given))
    turns = Rotation.from_matrix(wanted[:, :3, :3]).as_euler("xyz", degrees=True)
    values = np.concatenate([wanted[:, :3, 3], turns], axis=1)
    names = (*PLACES, *TURNS)
    rows = [",".join(map(repr, row)) for row in values.tolist()]
    rig = _rig(*EFFECTS, ALPHA3)
    start = stated_posture(rig, None, ",".join(map(str, given[0])))
    *_, path = write(correct_rig(rig, _path(tmp_path, rows, ",".join(names)), posture=start), tmp_path / "out")
    corrected = numbers_in(path, *names)
    T = np.tile(np.eye(4), (len(corrected), 1, 1))
    T[:, :3, :3] = Rotation.from_euler("xyz", corrected[:, 3:], degrees=True).as_matrix()
    T[:, :3, 3] = corrected[:, :3]
    # The controller solves with its nominal constants, in the posture in which the path was given.
    branches = inverse(arm_of(RIG.robot), T).q
    nearest = np.nanargmin(np.abs(branches - np.radians(given)[:, None]).max(axis=2), axis=1)
    real = _flanges(branches[np.arange(2), nearest])
    np.testing.assert_allclose(real, _flanges(np.radians(given), is_nominal=True), atol=1e-4)


def test_one_target_is_corrected_by_a_model_that_knows_the_clocks(tmp_path):
    """A target has neither a time nor servo lag, although the calibration contains clock and lag effects."""
    late = ServoLag(axis=2, lag_s=0.001, found=provenance(lag_s=0.0001))
    portions = JointPortions(portions=(Portion(of=late.model_copy(update={"found": None}), times=2.0),))
    rig = _rig(ZERO_3, ClockRate(ppm=200.0, found=provenance(ppm=20.0)), late, portions)
    one, three = (np.radians(TARGETS[:count]) for count in (1, 3))
    np.testing.assert_array_equal(tool_poses(model_of(rig), one), tool_poses(model_of(_rig(ZERO_3)), three)[:1])
    found = correct_rig(rig, _path(tmp_path, TARGETS[:1]))
    assert found.path[2].done.all() and np.isfinite(found.path[2].u_mm).all()
    alone = correct_rig(_rig(ZERO_3), None)
    assert found.work == alone.work, "a clock was an error of the tool: 229 µm of a sound arm"
    assert not found.path[2].left_out


def test_too_uncertain_effect_is_not_called_uncorrectable(tmp_path):
    vague = [JointOffset(axis=axis, offset_deg=0.05, found=provenance(offset_deg=0.049)) for axis in (2, 3, 5)]
    cell = tmp_path / "cell.yaml"
    cell.write_text(extended(load("paper-fanuc")[1], vague, "cell"))
    succeeded(f"correct {cell} -o {tmp_path}/out")
    written = contents(tmp_path / "out" / "corrections.yaml")
    assert {effect["corrected_as"] for effect in written["effects"]} == {"joint zero"}


def test_effects_known_only_by_their_sum_are_corrected_with_its_uncertainty(tmp_path):
    """d2 and d3 have the same effect in every posture: only their sum is well known."""

    def half(axis: int, other: int) -> LinkGeometry:
        twin = f"link_geometry {other}.d"
        of_sum = provenance(delta=0.4).model_copy(update={"correlation": {twin: -0.999}, "together": (twin,)})
        return LinkGeometry(axis=axis, field="d", delta=0.3, found=of_sum)

    found = correct_rig(_rig(half(2, 3), half(3, 2)), _path(tmp_path))
    assert [one.use for one in found.effects] == ["link constant", "link constant"]
    assert "only together with link_geometry 3.d" in found.effects[0].reason
    np.testing.assert_allclose(found.path[2].u_mm, 0.4 * np.sqrt(2 * 0.001), rtol=1e-2)


@pytest.mark.parametrize(
    ("effect", "joint_rad"),
    [
        (Backlash(axis=1, width_deg=0.05), np.radians(0.025)),
        (ThermalGrowth(ppm=100), None),
        (VOCABULARY["gauge_scale"].model_validate({"gauge": "g1", "relative": 0.1}), 0.0),
    ],
    ids=["play", "growth", "gauge"],
)
def test_uncorrected_effects_increase_the_uncertainty(tmp_path, effect, joint_rad):
    targets = _targets(_path(tmp_path), ZERO_3, effect)
    sure = _targets(_path(tmp_path), ZERO_3)
    place = forward(arm_of(RIG.robot), targets.q)[:, :3, 3]
    # Warm in half of all cases: 100 ppm of the distance from the base, over the square root of two.
    turned = np.hypot(place[:, 0], place[:, 1])
    wanted = np.linalg.norm(place, axis=1) * 1e-4 / np.sqrt(2) if joint_rad is None else joint_rad * turned
    left_out_mm = targets.left_out_mm[:, 0]
    np.testing.assert_allclose(left_out_mm, wanted, rtol=0.15, atol=1e-6)
    np.testing.assert_allclose(targets.u_mm, np.hypot(sure.u_mm, left_out_mm), rtol=1e-6)


def _ball_mm(q_deg: Array) -> Array:
    """Position (3,) mm of the ball, by an arm that is independent of the product."""
    return (flange_at(RIG, np.radians(q_deg)) @ [*RIG.robot.tool.xyz_mm, 1.0])[:3]


def test_command_reports_the_error_of_an_uncorrected_play_at_each_target(tmp_path, monkeypatch):
    """Half the play in both directions at the commanded angles, by independent forward kinematics."""
    play = Backlash(axis=2, width_deg=0.1, found=provenance(width_deg=0.002))
    cell, path, out = tmp_path / "cell.yaml", _path(tmp_path), tmp_path / "out"
    cell.write_text(extended(load("paper-fanuc")[1], [ZERO_3, play], "cell"))
    monkeypatch.setenv("COLUMNS", "300")
    done = succeeded(f"correct {cell} --path {path} -o {out}")
    told = numbers_in(out / "corrected-path.csv", *JOINTS)
    half, off = np.eye(6)[1] * 0.05, np.eye(6)[2] * 0.05
    away = [[np.linalg.norm(_ball_mm(q + off + way * half) - _ball_mm(q + off)) for way in (1, -1)] for q in told]
    play_mm = np.sqrt(np.mean(np.square(away), axis=1))
    assert play_mm.max() > 0.5
    left_out_mm = numbers_in(out / "corrected-path.csv", "left_out_mm")
    np.testing.assert_allclose(left_out_mm, play_mm, rtol=0.01)
    u_mm = [np.linalg.norm(_ball_mm(q + off * 1.04) - _ball_mm(q + off)) for q in told]
    np.testing.assert_allclose(numbers_in(out / "corrected-path.csv", "u_um"), 1e3 * np.hypot(play_mm, u_mm), rtol=0.01)
    stands = [np.linalg.norm(_ball_mm(q + off) - _ball_mm(sent)) for q, sent in zip(told, TARGETS, strict=True)]
    assert max(stands) < 1e-4
    assert f"{left_out_mm.max():.3f} mm" in done.stdout
    found = json_of(f"correct {cell} --path {path} -o {out}2")
    assert found["path"]["left_out_mm"]["backlash 2"] == pytest.approx(play_mm.max(), rel=0.01)


def test_uncorrected_spike_counts_by_its_size_at_the_target(tmp_path):
    left = {}
    for decay_s in (0.02, 0.1):
        spike = ReversalSpike(axis=1, amplitude_deg=0.05, decay_s=decay_s)
        targets = _targets(_path(tmp_path), ZERO_3, spike)
        place = forward(arm_of(RIG.robot), targets.q)[:, :3, 3]
        left[decay_s] = targets.left_out_mm[:, 0] / (np.radians(0.05) * np.hypot(place[:, 0], place[:, 1]))
    assert (left[0.1] > 0.2).all() and (left[0.1] < 1).all() and (left[0.02] < 0.5 * left[0.1]).all()


def test_targets_in_unmeasured_regions_are_doubted(tmp_path):
    near = provenance(offset_deg=0.002).model_copy(
        update={"joints_deg": ((-40.0, 20.0), *[(-180.0, 180.0)] * 4, (0, 5.0))}
    )
    targets = _targets(_path(tmp_path), ZERO_3.model_copy(update={"found": near}))
    assert len(targets.doubts) == 2
    assert "2 of 3 targets" in targets.doubts[0]
    assert "axis 6 is at 0.0° to 100.0°, 2 of 3 outside 0.0° to 5.0°" in targets.doubts[1]
    assert targets.covered.tolist() == [True, False, False]
    assert np.isnan(targets.u_mm).tolist() == np.isnan(targets.u_frame_mm).tolist() == [False, True, True]


def test_joint_a_full_turn_from_the_runs_is_covered(tmp_path):
    ranges = ((-180.0, 180.0),) * 5 + ((-130.0, -90.0),)
    near = provenance(offset_deg=0.002).model_copy(update={"joints_deg": ranges})
    rows = [[*TARGETS[0][:5], sixth] for sixth in (248.6, -111.4, 111.4)]
    targets = _targets(_path(tmp_path, rows), ZERO_3.model_copy(update={"found": near}))
    assert targets.covered.tolist() == [True, True, False]
    assert targets.u_mm[0] == pytest.approx(targets.u_mm[1])
    assert targets.unknown[2] == "axis 6 (alpha) at 111.4°, in the runs -130.0° to -90.0°"
    assert "axis 6 is at -111.4° to 111.4°, 1 of 3 outside -130.0° to -90.0°" in targets.doubts[1]


def test_refusal_of_targets_outside_the_runs_names_axis_value_and_range(tmp_path):
    cell, path, out = tmp_path / "cell.yaml", _path(tmp_path), tmp_path / "out"
    near = ZERO_3.found.model_copy(update={"joints_deg": ((-180.0, 180.0),) * 5 + ((170.0, 180.0),)})
    cell.write_text(extended(load("paper-fanuc")[1], [ZERO_3.model_copy(update={"found": near})], "cell"))
    told = errors_of(f"correct {cell} --path {path} -o {out}")
    assert "at 0.0°, in the runs 170.0° to 180.0°, so no corrected targets were written" in told


def test_joint_angle_beyond_a_limit_is_named_with_the_same_posture_within_it(tmp_path):
    rows = [*TARGETS, [0, 20, 10, 0, 60, 300]]
    (left,) = _targets(_path(tmp_path, rows), ZERO_3).left
    assert left.what.endswith("beyond the limits -270° and 270°; -60.000° is the same posture")


def test_effects_on_one_constant_add_up_and_their_uncertainties_in_quadrature():
    more = JointOffset(axis=3, offset_deg=-0.02, found=provenance(offset_deg=0.0015))
    rig = _rig(ZERO_3, more, A2)
    (zero,) = joint_zeros(rig, supports(rig))
    assert (zero.axis, zero.delta, zero.u) == (3, pytest.approx(0.03), pytest.approx(0.0025))
    (constant,) = link_constants(rig, supports(rig))
    assert (constant.key, constant.corrected, constant.u) == ("a_mm", pytest.approx(695.4), 0.03)


def _of_size(name: str, value: float, **sd: float) -> Effect:
    needed = {"axis": 1, "field": "a", "gauge": "g1", "from_axis": 4, "to_axis": 5, "order": 2, "lobes": 2}
    needed |= {"period_mm": 1.0, "frequency_hz": 5.0}
    model = VOCABULARY[name]
    if "way" in model.model_fields:
        needed["way"] = get_args(model.model_fields["way"].annotation)[0]
    fields = {key: field for key, field in needed.items() if key in model.model_fields}
    bare = model.model_validate(fields)
    return bare.model_copy(update={size_field(bare): value, "found": provenance(**sd)})


@pytest.mark.parametrize("name", sorted(VOCABULARY))
def test_effects_are_corrected_if_a_target_can_and_the_uncertainty_allows(name):
    field = size_field(_of_size(name, 0.0))
    postural = {"joint_offset", "link_geometry", "compliance", "link_bending", "transmission_error", "wrist_coupling"}
    postural |= {"joint_scale", "strain_wave", "rail_line", "base_yields", "base_sags"}
    (sure,) = supports(_rig(_of_size(name, 0.004, **{field: 0.001})))
    assert (sure.use != "none") == (name in postural)
    for doubtful in (_of_size(name, 0.004, **{field: 0.004}), _of_size(name, 0.004)):
        (support,) = supports(_rig(doubtful))
        assert support.use == "none" and support.reason


def test_the_command_writes_files_and_says_why_not(tmp_path, monkeypatch):
    text = load("paper-fanuc")[1]
    cell = tmp_path / "cell.yaml"
    soft = Compliance(axis=2, deg_per_Nm=2e-4, found=provenance(deg_per_Nm=1e-5))
    cell.write_text(extended(text, [ZERO_3, A2, soft, PLAY_1], "cell"))
    path, out = _path(tmp_path), tmp_path / "out"
    monkeypatch.setenv("COLUMNS", "200")
    done = succeeded(f"correct {cell} --path {path} -o {out}")
    assert "+0.0500° (± 0.0020°)" in done.stdout
    assert {file.name for file in out.iterdir()} == {"corrections.yaml", "dh.csv", "corrected-path.csv"}
    held = contents(out / "corrections.yaml")
    assert held["joint_zeros"] == [{"axis": 3, "add_deg": 0.05, "u_deg": 0.002}]
    assert [one["corrected_as"] for one in held["effects"]] == ["joint zero", "link constant", "targets only", None]
    assert numbers_in(out / "dh.csv", "a_mm").tolist() == [0, 254.5, 695.4, 142.4, 0, 0]
    assert [row["name"] for row in rows_in(out / "corrected-path.csv")] == ["P0", "P1", "P2"]

    assert "exists already" in errors_of(f"correct {cell} -o {out}")
    found = json_of(f"correct {cell} -o {tmp_path}/other")
    assert found["path"] is None and found["link_constants"][0]["corrected"] == 695.4


@pytest.mark.parametrize(
    ("head", "row", "code", "told"),
    [
        (HEAD, "A,0,20,ten,0,60,0", "table.invalid", "line 2, q3_deg"),
        (HEAD, "A,0,20,10,0,60", "table.invalid", "line 2"),
        (HEAD, "A,0,20,10,0,200,0", "program.unclear", "line 2"),
        ("x_mm,y_mm,z_mm", "900,0,0", "table.invalid", "rx_deg"),
        ("x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg", "9000,0,0,0,180,0", "program.unclear", "line 2"),
        ("x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg", "0.9,0,0.4,0,180,0", "table.unclear", "by 1000"),
        (HEAD, "A,0,0.35,0.17,0,1.05,0", "table.unclear", "by 57.29578"),
        (f"{HEAD},u_um", "A,0,20,10,0,60,0,1", "correction.repeated", "u_um"),
        (HEAD, "", "table.invalid", ""),
    ],
)
def test_a_bad_path_is_refused_with_its_line(tmp_path, head, row, code, told):
    with refused(code) as error:
        correct_rig(_rig(ZERO_3), _path(tmp_path, [row], head))
    assert told in str(error.value)


def test_every_bad_cell_is_reported(tmp_path):
    with pytest.raises(TableFileError) as refused:
        correct_rig(_rig(ZERO_3), _path(tmp_path, ["A,0,,10,0,60,0", "B,nan,20,10,0,60,0"]))
    assert [problem.line for problem in refused.value.problems] == [2, 3]


def test_a_rig_without_effects_has_nothing_to_correct():
    with refused("calibration.missing", "has no effects to correct"):
        correct_rig(_rig(), None)


def test_a_target_that_cannot_be_corrected_stays_as_it_was_and_the_others_are_corrected(tmp_path):
    """The real arm is shorter than in its rig file: a stretched arm cannot reach the target."""
    cell, path, out = tmp_path / "cell.yaml", tmp_path / "path.csv", tmp_path / "out"
    cell.write_text(extended(load("ur10e-cell")[1], [A2], "cell"))
    good = "A,0,-80,100,-20,80,0", "D,10,-85,90,-20,70,30"
    path.write_text(f"{HEAD}\n{good[0]}\nB,0,-80,0,-20,80,0\nC,0,-80,100,-20,400,0\n{good[1]}\n")
    done = ran(f"correct {cell} --path {path} -o {out}")
    assert done.returncode == FileError.exit_code
    assert "line 3: " in done.stderr and "line 4: axis 5 " in done.stderr and "400.000°" in done.stderr
    rows = rows_in(out / "corrected-path.csv")
    assert [row["corrected"] for row in rows] == ["yes", "no", "no", "yes"]
    assert [row["covered"] for row in rows] == ["unknown", "no", "no", "unknown"]
    for name in ("u_um", "u_frame_um"):
        assert [bool(row[name]) for row in rows] == [True, False, False, True]
    assert [float(rows[1][name]) for name in JOINTS] == [0, -80, 0, -20, 80, 0]
    held = contents(out / "corrections.yaml")["not_corrected"]
    assert [(one["line"], one["reason"]) for one in held] == [(3, "singular"), (4, "beyond_limits")]
    path.write_text("\n".join([HEAD, *good]) + "\n")
    alone = correct_rig(load(str(cell))[0], path).path[2]
    told = numbers_in(out / "corrected-path.csv", *JOINTS)[[0, 3]]
    np.testing.assert_allclose(told, np.degrees(alone.q), atol=1e-6)


def test_motion_of_the_whole_arm_is_not_in_the_uncertainty_of_a_taught_frame(tmp_path):
    path = _path(tmp_path, np.concatenate([TARGETS, np.add(TARGETS, [20, -5, 5, 0, 5, 0])]))
    turn = JointOffset(axis=1, offset_deg=0.05, found=provenance(offset_deg=0.01))
    base = correct_rig(_rig(turn), path)
    assert base.path[2].u_mm.min() > 0.05 and base.path[2].u_frame_mm.max() < 1e-3
    assert base.work.base_u_um == pytest.approx(base.work.base.u_um, rel=1e-3) and base.work.u_um < 1
    both, elbow = _targets(path, turn, ZERO_3), _targets(path, ZERO_3)
    np.testing.assert_allclose(both.u_frame_mm, elbow.u_frame_mm, rtol=1e-2)
    assert (elbow.u_frame_mm < elbow.u_mm).all() and elbow.u_frame_mm.min() > 0


def test_a_frame_taught_at_the_targets_removes_error_and_never_adds_it():
    """Fifteen targets in nearly one orientation hardly determine the shift of the tool."""
    rig = _rig(ZERO_3)
    q = np.radians(TARGETS[0] + np.random.default_rng(1).normal(0, 0.2, (15, 6)))
    error, few = corrected(rig, supports(rig), q).error, corrected(rig, supports(rig), q[:4]).error
    assert not error.taught_elsewhere and error.before_um < error.base.before_um
    assert few.taught_elsewhere


def test_a_value_to_check_in_the_controller_is_named_before_the_correction():
    """A wrong gear ratio was corrected in the targets, and only the diagnosis said to check the controller first."""
    for effect, is_checked in (
        (JointScale(axis=3, relative=-0.03, found=provenance(relative=0.0001)), True),
        (ZERO_3, False),
    ):
        corrections = correct_rig(_rig(effect), None)
        first, *_ = correction_answer(corrections)
        assert (keys_of(first.text) == ("correct_check_first",)) == is_checked == ("axis 3" in first.text)
