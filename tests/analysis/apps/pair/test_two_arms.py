"""Two arms that measure each other, on an independent world: fit, plan, tables, and the command from init to files."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from analysis import calibrated_arm
from analysis.apps.pair.arm_terms import PairArm
from analysis.apps.pair.fit_pair import FittedPair, fit_pair, pair_of, start
from analysis.apps.pair.linear_gap import linearise
from analysis.apps.pair.pair_table import PairTable, read_pair_table
from analysis.apps.pair.plan_touches import plan_touches
from analysis.apps.pair.postures import is_clear
from analysis.apps.pair.result import PairResult, result_of
from analysis.runs.tables import joint_columns, second_joint_columns
from rigs.errors import FileError
from rigs.load import load
from rigs.rig import Rig
from rigs.schema.robot import Pose
from tests.support.changed_rigs import with_robot
from tests.support.command_line import errors_of, json_of, ran, succeeded
from tests.support.refusals import refused
from tests.support.two_arm_cases import (
    KNOWN,
    deviations,
    known_base,
    nominal_points,
    rigs,
    touches_of_pair,
    with_fixed,
)
from tests.support.written_files import contents, write_columns

FIRST_BALL, SECOND_BALL = (60.0, 20.0, 90.0), (-50.0, 30.0, 70.0)


@cache
def touches() -> PairTable:
    return touches_of_pair()


@cache
def fitted() -> FittedPair:
    return fit_pair(pair_of(*rigs(), touches(), "touches.csv"))


@cache
def result() -> PairResult:
    return result_of(fitted())


def error_over_u(found: PairResult, kind: str = "iiwa") -> float:
    """Largest deviation of a coordinate of the base in its standard uncertainty."""
    off = np.array(found.base.xyz_mm) - known_base(kind)[:3, 3]
    return float((np.abs(off) / np.array(found.base.u_xyz_mm)).max())


# ----------------------------------------------------------------------------------------------------------------------
# The fit.


def test_constants_and_base_are_within_their_uncertainty():
    z = deviations(fitted()).z
    assert 0.4 < np.sqrt(np.mean(z**2)) < 1.5
    assert np.mean(np.abs(z) < 2) > 0.88
    assert error_over_u(result()) < 3


def test_both_arms_become_several_times_more_accurate():
    error = deviations(fitted()).error
    for arm in ("first", "second"):
        assert error[f"{arm} fitted"] < 0.3 * error[f"{arm} nominal"]
    assert result().left_mm < 0.15 * result().before_mm


def test_the_columns_are_the_change_of_the_gap():
    pair = pair_of(*rigs(), touches().rows(np.arange(50) < 15), "t")
    state, _ = start(pair)
    gaps = linearise(pair, state)
    rng = np.random.default_rng(3)
    step = 0.02 * rng.normal(size=pair.unknowns)
    terms = int((gaps.group >= 0).sum())
    step[terms + 3 : terms + 6] *= 1e-3  # rad
    moved, before = pair.gaps(state.moved(step, gaps.centre_mm)), pair.gaps(state)
    change = (moved - before).ravel()
    assert np.abs(change - gaps.columns @ step).max() < 1e-3 * np.abs(change).max()


def test_a_ball_that_was_not_seated_is_left_out():
    table = touches_of_pair("four")
    q = table.q.copy()
    q[17, 1] += np.radians(0.5)  # some 8 mm
    fit = fit_pair(pair_of(*rigs("four"), replace(table, q=q), "t"))
    assert [row for row, _ in fit.odd] == [18]
    found = result_of(fit)
    assert any("row 18" in doubt for doubt in found.doubts)
    assert error_over_u(found, "four") < 4


def test_rows_of_other_touches_are_refused():
    table = touches()
    with refused("pair.invalid", "apart, whatever the place of the"):
        fit_pair(pair_of(*rigs(), replace(table, p=np.roll(table.p, 1, axis=0)), "t"))


def test_a_rail_is_refused():
    left, right = rigs()
    with pytest.raises(FileError, match="rail"):
        pair_of(with_robot(left, rail=object()), right, touches(), "t")


# ----------------------------------------------------------------------------------------------------------------------
# The scale.


def test_the_scale_of_both_arms_is_not_testable():
    found = result()
    assert not found.scale.known
    assert found.scale.u_ppm == pytest.approx(found.scale.nominal_u_ppm, rel=0.3)
    assert "scale" in found.not_testable[0].what


def test_a_known_distance_of_fixed_sockets_fixes_the_scale():
    found = result_of(fit_pair(pair_of(*rigs(more=KNOWN), with_fixed(touches()), "t")))
    assert found.scale.known
    assert found.base.u_distance_mm < 0.5 * result().base.u_distance_mm
    assert error_over_u(found) < 3.5
    assert "scale" not in found.not_testable[0].what


# ----------------------------------------------------------------------------------------------------------------------
# The plan.


def placed_rigs(apart_mm: float = 1500.0) -> tuple[Rig, Rig]:
    left, right = rigs()
    base = Pose(xyz_mm=(apart_mm, 0.0, 0.0), rpy_deg=(0.0, 0.0, 180.0))
    return left, with_robot(right, base=base)


def test_planned_touches_seat_the_ball_within_limits():
    left, right = placed_rigs()
    planned = plan_touches(left, right, 20, "t")
    table = planned.table
    tips = []
    for rig, joints, ball in ((left, table.q, FIRST_BALL), (right, table.p, SECOND_BALL)):
        tips.append(nominal_points(rig, joints, ball))
        assert (np.abs(joints) <= np.radians(180 if rig is left else 170)).all()
    there = np.array([1500.0, 0.0, 0.0]) + tips[1] * np.array([-1.0, -1.0, 1.0])
    assert np.abs(tips[0] - there).max() < 0.01
    arms = PairArm(left, ()).model.arm, PairArm(right, ()).model.arm
    assert is_clear(arms, table.q, table.p, tips[0]).all()


def test_arms_that_do_not_reach_each_other_are_refused():
    with refused("pair.invalid", "ball and socket meet in only"):
        plan_touches(*placed_rigs(4000.0), 20, "t")


# ----------------------------------------------------------------------------------------------------------------------
# The table.


def written(path: Path, table: PairTable) -> Path:
    names = ("socket", *joint_columns(table.q.shape[1]), *second_joint_columns(table.p.shape[1]))
    angles = np.degrees(np.hstack([table.q, table.p])).astype(object)
    return write_columns(path, names, table.socket, np.where(np.isnan(angles.astype(float)), "", angles))


def emptied(table: PairTable, axes: slice) -> PairTable:
    p = table.p.copy()
    p[4, axes] = np.nan
    return replace(table, p=p)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda t: replace(t, p=np.tile(t.p[:1], (len(t.p), 1))), "right stood"),
        (lambda t: replace(t, q=np.radians(t.q), p=np.radians(t.p)), "radians"),
        (lambda t: replace(t, p=np.radians(t.p)), "p1_deg … p7_deg within ±6.3"),
        (lambda t: t.rows(np.arange(len(t.q)) < 8), "has 8 touches"),
        (lambda t: replace(t, p=np.full_like(t.p, np.nan)), "has 0 touches"),
        (lambda t: replace(t, p=t.p[:, :5]), "p6_deg … p7_deg"),
        (lambda t: replace(t, q=np.column_stack([t.q, t.q[:, :1]])), "has q7_deg"),
        (lambda t: emptied(t, slice(2, 3)), "line 6: some of p1_deg … p7_deg "),
        (lambda t: emptied(t, slice(None)), "socket A "),
    ],
)
def test_a_wrong_table_is_refused_in_one_line(tmp_path, change, problem):
    path = written(tmp_path / "t.csv", change(touches()))
    with pytest.raises(FileError) as error:
        read_pair_table(path, *rigs())
    assert problem in str(error.value)
    assert "\n" not in str(error.value)


# ----------------------------------------------------------------------------------------------------------------------
# The command, from rig init to both files and the transform of the bases.


def test_from_init_to_both_calibrations_and_the_base(tmp_path):
    for name, arm, ball in (("left", "ur10e", "60,20,90"), ("right", "kuka-lbr-iiwa-14", "-50,30,70")):
        made = succeeded(f"init {name}.yaml --measured-by arm --arm {arm} --tool={ball}", cwd=tmp_path)
        assert "rig pair" in made.stdout
    written(tmp_path / "touches.csv", touches())
    found = json_of("pair left.yaml right.yaml touches.csv -o calibrated", cwd=tmp_path)
    off = np.array(found["base"]["xyz_mm"]) - known_base()[:3, 3]
    assert (np.abs(off) < 3 * np.array(found["base"]["u_xyz_mm"])).all()
    assert {one["what"] for one in found["not_testable"]} >= {"zero and d of axis 6", "zero and d of axis 7"}
    assert contents(tmp_path / "calibrated/pair.json") == found
    page = (tmp_path / "calibrated/pair.html").read_text()
    assert f"{found['base']['xyz_mm'][0]:.3f}" in page
    right, _ = load(tmp_path / "calibrated/right.yaml")
    assert right.robot.base.xyz_mm == pytest.approx(found["base"]["xyz_mm"], abs=1e-5)
    meets = []
    for name, joints in (("left", touches().q), ("right", touches().p)):
        rig, _ = load(tmp_path / f"calibrated/{name}.yaml")
        assert rig.calibrated is not None and rig.tests.touch is not None
        poses = calibrated_arm(rig).forward(np.degrees(joints))
        meets.append(poses.T[:, :3, 3] + poses.T[:, :3, :3] @ np.array(rig.tests.touch.ball_mm))
        assert np.isfinite(poses.u_mm).all()
    # Both files put ball and socket at one place in one world.
    assert np.sqrt(np.mean((meets[0] - meets[1]) ** 2)) < 0.1
    assert "exists already" in errors_of("pair left.yaml right.yaml touches.csv -o calibrated", cwd=tmp_path)
    assert "has a calibration already" in errors_of("pair left.yaml calibrated/right.yaml touches.csv", cwd=tmp_path)


def test_a_plan_and_drawn_touches_lead_to_a_calibration(tmp_path):
    arms, base = ("ur10e", "kuka-lbr-iiwa-14"), ("--base", "1500,0,0,0,0,180")
    made = succeeded("pair", *arms, "--plan", "20", *base, "--simulate", "2", "-o", "t.csv", cwd=tmp_path)
    drawn = [float(x) for x in made.stderr.split("true place")[1].split(": ")[1].split(" mm")[0].split(",")]
    found = json_of("pair", *arms, "t.csv", cwd=tmp_path)
    assert np.abs(np.array(found["base"]["xyz_mm"]) - drawn).max() < 3.5 * max(found["base"]["u_xyz_mm"])


def test_a_diagnosis_of_a_table_with_two_arms_is_that_of_the_pair(tmp_path):
    arms = ("ur10e", "kuka-lbr-iiwa-14")
    written(tmp_path / "t.csv", touches())
    assert "--second SECOND" in errors_of(f"diagnose t.csv --rig {arms[0]}", cwd=tmp_path, exit_code=2)
    done = succeeded(f"diagnose t.csv --rig {arms[0]} --second {arms[1]} --json", cwd=tmp_path)
    assert "two arms" in done.stderr
    assert json_of("pair", *arms, "t.csv", "-o", "pair.html", "--lang", "de", cwd=tmp_path) == json.loads(done.stdout)
    html = (tmp_path / "pair.html").read_text()
    assert '<html lang="de">' in html and "nicht prüfbar" in html and "Nennarmen" in html
    (tmp_path / "one.csv").write_text("socket,q1_deg\nA,1\n")
    assert "p1_deg" in errors_of(f"diagnose one.csv --rig {arms[0]} --second {arms[1]}", cwd=tmp_path, exit_code=2)


def test_a_table_of_two_arms_is_no_table_of_a_fixed_socket(tmp_path):
    written(tmp_path / "t.csv", touches())
    assert "rig pair FIRST SECOND t.csv" in errors_of("import t.csv --rig ur10e-cell --test touch -o run", cwd=tmp_path)


@pytest.mark.parametrize(
    ("words", "code", "problem"),
    [
        ("ur10e kuka-lbr-iiwa-14", 2, "or --plan"),
        ("ur10e kuka-lbr-iiwa-14 t.csv --base 1,2,3", 2, "--base: "),
        ("ur10e kuka-lbr-iiwa-14 --plan 20", 3, "same place"),
        ("ur10e kuka-lbr-iiwa-14 --plan 20 --base 1,2", 2, "'1,2' is not a pose"),
        ("ur10e ur10e t.csv", 3, "same name"),
        ("ur10e kuka-lbr-iiwa-14 none.csv", 3, "none.csv"),
    ],
)
def test_wrong_use_is_one_line(tmp_path, words, code, problem):
    done = ran(f"pair {words}", cwd=tmp_path)
    assert (done.returncode, len(done.stderr.splitlines())) == (code, 1)
    assert problem in done.stderr
