"""Controller entries that represent the complete model, checked with independent forward kinematics against the stated
remaining error.
"""

from __future__ import annotations

import csv
import datetime as dt
import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from analysis.apps.correct.controller_entries import (
    Constant,
    ControllerEntries,
    Projection,
    _certain,  # private: rules of certainty without a whole diagnosis
    controller_entries,
)
from analysis.apps.correct.correct_rig import correct_rig
from analysis.apps.correct.program_report import reached
from analysis.cli import app
from analysis.correction.corrected_targets import corrected
from analysis.correction.support import supports
from analysis.correction.work import tool_poses, work_angles
from analysis.robot.kinematics.arm import forward
from analysis.robot.model.predict import model_of
from rigs.edit import extended
from rigs.effects import Compliance, Effect, EffectProvenance, JointOffset, LinkGeometry, TransmissionError, size_field
from rigs.rig import Rig
from rigs.schema.vocabulary import MakerName
from tests.support.stated_controller import load
from tests.worlds.arms.independent_arm import Wrong, constants_of, flange

Array = NDArray[np.float64]
JOINTS = tuple(f"q{k}_deg" for k in range(1, 7))
RANGES = ((-60.0, 60.0), (-110.0, -50.0), (60.0, 120.0), (-60.0, 20.0), (40.0, 110.0), (-60.0, 60.0))
"""Joint angles about the work of ur10e."""


def _known(effect: Effect, sd: float, joints_deg: tuple[tuple[float, float], ...] | None = None) -> Effect:
    found = EffectProvenance(
        date=dt.date(2026, 11, 20), runs=("yaw",), sd={size_field(effect): sd}, joints_deg=joints_deg
    )
    known: Effect = effect.model_copy(update={"found": found})
    return known


def _rig(name: str, effects: list[Effect]) -> Rig:
    return load(name)[0].model_copy(update={"effects": tuple(effects)})


WRONG = Wrong(*(np.zeros(6) for _ in range(4)), np.zeros((6, 2)), np.zeros((6, 2)))


def _faulty(name: str) -> tuple[Rig, Wrong]:
    """Zeros, lengths, a twist and a gear wave that is sure, in a rig file and in an arm of its own."""
    effects: list[Effect] = [
        JointOffset(axis=2, offset_deg=0.04),
        JointOffset(axis=5, offset_deg=-0.03),
        LinkGeometry(axis=3, field="a", delta=0.3),
        LinkGeometry(axis=4, field="alpha", delta=0.03),
        LinkGeometry(axis=4, field="d", delta=-0.25),
        TransmissionError(axis=1, order=2, amplitude_deg=0.02, phase_deg=0),
    ]
    sine = np.zeros((6, 2))
    sine[0, 1] = np.radians(0.02)
    wrong = replace(
        WRONG,
        offset=np.radians([0, 0.04, 0, 0, -0.03, 0]),
        a=np.array([0, 0, 0.3, 0, 0, 0]),
        alpha=np.radians([0, 0, 0, 0.03, 0, 0]),
        d=np.array([0, 0, 0, -0.25, 0, 0]),
        sine=sine,
    )
    return _rig(name, [_known(one, 1e-7) for one in effects]), wrong


UR = {"delta_theta": ("offset", 1.0), "delta_a": ("a", 1e3), "delta_alpha": ("alpha", 1.0), "delta_d": ("d", 1e3)}
KUKA = {"$LENGTH_A": ("a", 1), "$LENGTH_B": ("a", 2), "height in $TX3P3": ("a", 3), "length in $TX3P3": ("d", 3)}
KUKA |= {"length in $TFLWP": ("d", 5)}
FANUC = {f"$PARAM_GROUP[1].$DH_A[{k}]": ("a", k) for k in range(1, 6)}
FANUC |= {f"$PARAM_GROUP[1].$DH_D[{k}]": ("d", k - 1) for k in range(1, 7)}
LENGTHS = KUKA | FANUC


def _entered(name: str, maker: MakerName, at: ControllerEntries) -> Wrong:
    change = {field: np.zeros(6) for field in ("offset", "a", "alpha", "d")}
    for one in at.entries:
        if maker == "ur":
            parameter, _, index = one.parameter.rstrip("]").partition("[")
            field, unit = UR[parameter]
            # Craig has a and alpha of a link at the axis after it.
            change[field][int(index) - 1 + (field in ("a", "alpha"))] += one.add * unit
        elif one.parameter in LENGTHS:
            field, place = LENGTHS[one.parameter]
            nominal = getattr(constants_of(name), field)[place]
            assert one.now == pytest.approx(abs(nominal))
            change[field][place] += one.add * np.sign(nominal)
        else:
            change["offset"][one.axis - 1] += np.radians(one.add)
    return replace(WRONG, **change)


def _tool_mm(rig: Rig, wrong: Wrong, q: Array) -> Array:
    R, p = flange(constants_of(rig.name), wrong, q)
    return np.asarray(p + R @ np.array(rig.robot.tool.xyz_mm))


def _as_taught_mm(real: Array, wanted: Array, turns: Array) -> Array:
    """How far (n,) places (n, 3) are off with the frame and the tool, turned by (n, 3, 3), with which they fit best."""
    turn, _ = Rotation.align_vectors(wanted - wanted.mean(axis=0), real - real.mean(axis=0))
    off = turn.apply(real - real.mean(axis=0)) - wanted + wanted.mean(axis=0)
    about = wanted - wanted.mean(axis=0)
    moved = [np.tile(np.eye(3), (len(off), 1, 1)), np.stack([np.cross(one, about) for one in np.eye(3)], axis=2), turns]
    columns = np.concatenate(moved, axis=2).reshape(off.size, 9)
    left = off.ravel() - columns @ np.linalg.lstsq(columns, off.ravel(), rcond=1e-9)[0]
    return np.asarray(np.linalg.norm(left.reshape(off.shape), axis=1))


@pytest.mark.parametrize(
    ("name", "maker"),
    [("ur10e", "ur"), ("ur10e", "kuka"), ("paper-fanuc", "kuka"), ("ur10e", "fanuc"), ("paper-fanuc", "fanuc")],
)
def test_residual_of_entries_agrees_with_independent_kinematics(name, maker):
    rig, wrong = _faulty(name)
    at, q = controller_entries(rig, supports(rig), maker), work_angles(rig)
    real = _tool_mm(rig, wrong, q)
    turns = flange(constants_of(rig.name), WRONG, q)[0]
    before = _as_taught_mm(real, _tool_mm(rig, WRONG, q), turns)
    after = _as_taught_mm(real, _tool_mm(rig, _entered(name, maker, at), q), turns)
    assert 1e3 * np.sqrt(np.mean(before**2)) == pytest.approx(at.before_um, rel=1e-3)
    assert 1e3 * np.sqrt(np.mean(after**2)) == pytest.approx(at.after_um, rel=0.01, abs=0.2)
    assert at.after_um < at.before_um or (maker == "ur" and not at.entries)  # a and alpha cannot be entered
    assert at.by_targets_um < 1


@pytest.mark.parametrize(("name", "maker"), [("ur10e", "ur"), ("paper-fanuc", "kuka")])
def test_with_entries_targets_hold_the_rest_whatever_path_is_given(tmp_path, name, maker):
    """The controller computes with its new constants, so it is sent where these and the posture say; the arm then
    stands where it should, with the wave that only targets hold."""
    rig, wrong = _faulty(name)
    q = work_angles(rig)[::4]
    path = tmp_path / "path.csv"
    np.savetxt(path, np.degrees(q), "%.9f", ",", header=",".join(JOINTS), comments="")
    found = correct_rig(rig, path, maker, entered=True)
    assert found.path and found.at_controller
    targets, change = found.path[2], _entered(name, maker, found.at_controller)
    # What the joints read less what the zeros add is the posture, in the words of the nominal arm.
    shifted = np.degrees(change.offset) if maker != "ur" else np.zeros(6)
    posture = targets.q - np.radians(shifted)
    np.testing.assert_allclose(_tool_mm(rig, change, posture), targets.T[:, :3, 3], atol=1e-4)
    np.testing.assert_allclose(_tool_mm(rig, wrong, posture), _tool_mm(rig, WRONG, q), atol=1e-4)
    again = controller_entries(rig, supports(rig), maker)
    assert again.entries == found.at_controller.entries  # one rig file has one set of entries


def test_entries_do_no_harm_outside_the_work_area():
    wide = ((-60.0, 60.0), (-120.0, 60.0), (-40.0, 130.0), (-160.0, 40.0), (-130.0, 70.0), (-180.0, 180.0))
    faults: list[Effect] = [
        JointOffset(axis=2, offset_deg=-0.03),
        JointOffset(axis=4, offset_deg=0.05),
        LinkGeometry(axis=3, field="a", delta=0.3),
        Compliance(axis=2, deg_per_Nm=2e-4),
        TransmissionError(axis=1, order=2, amplitude_deg=0.02, phase_deg=30),
    ]
    rig = _rig("ur10e", [_known(one, 1e-6, wide) for one in faults])
    at = controller_entries(rig, supports(rig), "ur")
    assert at.elsewhere_um[1] < 0.95 * at.elsewhere_um[0]
    assert at.after_um < at.before_um


def test_soft_joints_have_corrected_targets_and_a_figure(tmp_path):
    cell = tmp_path / "cell.yaml"
    soft = _known(Compliance(axis=2, deg_per_Nm=2e-4), 1e-5)
    cell.write_text(extended(load("paper-fanuc")[1], [soft], "cell"), encoding="utf-8")
    done = CliRunner().invoke(app, ["correct", str(cell), "-o", str(tmp_path / "out")])
    told = " ".join(done.stdout.split())
    rig = load(str(cell))[0]
    q = work_angles(rig)
    real, wanted = (tool_poses(model_of(rig, some), q) for some in ((soft,), ()))
    before = np.sqrt(np.mean(_as_taught_mm(real[:, :3, 3], wanted[:, :3, 3], wanted[:, :3, :3]) ** 2))
    # A twentieth of the softness is its uncertainty.
    assert f"from {1e3 * before:.0f} to {50 * before:.0f} µm rms" in told


def test_path_and_entries_belong_to_one_controller_each(tmp_path):
    cell, path = tmp_path / "cell.yaml", tmp_path / "path.csv"
    zero = _known(JointOffset(axis=3, offset_deg=0.05), 0.002)
    cell.write_text(extended(load("ur10e")[1], [zero], "cell"), encoding="utf-8")
    path.write_text(",".join(JOINTS) + "\n0,-80,100,-20,80,0\n")
    for k, (option, told) in enumerate({"": "without these", "--entered": "already entered"}.items()):
        options = [str(cell), "--path", str(path), "-o", f"{tmp_path}/{k}", *([option] if option else [])]
        done = CliRunner().invoke(app, ["correct", *options])
        said = " ".join(done.stdout.split())
        assert told in said and ("be entered" in said) == (not option)


def test_error_after_correction_agrees_with_its_prediction():
    """Hidden constants, softness and waves, known as well as their rig file says: 100 arms, 200 targets."""
    rng = np.random.default_rng(4)
    within, worst = [], []
    for _ in range(100):
        true: list[Effect] = [
            JointOffset(axis=2, offset_deg=0.05),
            JointOffset(axis=4, offset_deg=-0.04),
            LinkGeometry(axis=3, field="a", delta=0.4),
            Compliance(axis=3, deg_per_Nm=2e-4),
            TransmissionError(axis=1, order=2, amplitude_deg=0.03, phase_deg=30),
        ]
        told = []
        for one in true:
            size = getattr(one, size_field(one))
            sd = 0.1 * abs(size)
            told.append(_known(one.model_copy(update={size_field(one): size + sd * rng.normal()}), sd, RANGES))
        rig = _rig("ur10e", told)
        q = np.radians(rng.uniform([low for low, _ in RANGES], [high for _, high in RANGES], (2, 6)))
        found = corrected(rig, supports(rig), q)
        wanted = forward(model_of(rig, ()).arm, q)
        apart = np.linalg.norm((tool_poses(model_of(rig, true), found.q) - wanted)[:, :3, 3], axis=1)
        within += (apart < 2 * found.u_mm).tolist()
        worst += (apart / found.u_mm).tolist()
        assert found.covered is not None and found.covered.all()
    assert np.mean(within) >= 0.93
    assert 0.6 < np.sqrt(np.mean(np.square(worst))) < 1.4  # neither too sure nor too careful


def test_targets_beyond_the_driven_joint_angles_are_marked(tmp_path):
    cell = tmp_path / "cell.yaml"
    zero = _known(JointOffset(axis=3, offset_deg=0.05), 0.002, RANGES)
    cell.write_text(extended(load("ur10e")[1], [zero], "cell"), encoding="utf-8")
    path = tmp_path / "path.csv"
    # 62° is within the margin of 3°, 70° is not.
    rows = ["0,-80,100,-20,80,0", "62,-80,100,-20,80,0", "70,-80,100,-20,80,0"]
    path.write_text("\n".join([",".join(JOINTS), *rows]) + "\n")
    done = CliRunner().invoke(app, ["correct", str(cell), "--path", str(path), "-o", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    assert "1 of 3 targets" in " ".join(done.stdout.split())
    with (tmp_path / "out" / "corrected-path.csv").open(encoding="utf-8") as file:
        table = list(csv.DictReader(file))
    assert [row["covered"] for row in table] == ["yes", "yes", "no"]
    found = json.loads(
        CliRunner().invoke(app, ["correct", str(cell), "--path", str(path), "-o", f"{tmp_path}/2", "--json"]).stdout
    )
    assert found["path"]["covered"] == [True, True, False]
    assert found["path"]["u_um"][:2] == pytest.approx([float(row["u_um"]) for row in table[:2]], abs=1e-3)
    assert min(found["path"]["u_um"][:2]) > 10
    assert found["path"]["u_um"][2] is None and table[2]["u_um"] == table[2]["u_frame_um"] == ""
    assert found["work"]["after_um"] < 0.1 * found["work"]["before_um"]


def test_unmeasured_work_area_has_unknown_error(tmp_path):
    cell = tmp_path / "cell.yaml"
    zero = _known(JointOffset(axis=3, offset_deg=0.05), 0.002, ((0.0, 1.0),) * 6)
    cell.write_text(extended(load("ur10e")[1], [zero], "cell"), encoding="utf-8")
    path = tmp_path / "path.csv"
    path.write_text(",".join(JOINTS) + "\n0,-80,100,-20,80,0\n")
    done = CliRunner().invoke(app, ["correct", str(cell), "--path", str(path), "-o", str(tmp_path / "0")])
    assert done.exit_code == 3 and "unknown" in done.stderr
    assert not (tmp_path / "0" / "corrected-path.csv").exists()  # a guess was written as a correction
    words = ["correct", str(cell), "--path", str(path), "--anyway", "-o"]
    said = " ".join(CliRunner().invoke(app, [*words, str(tmp_path / "1")]).stdout.split())
    assert "unknown" in said
    assert "nan" not in said
    found = json.loads(CliRunner().invoke(app, [*words, str(tmp_path / "2"), "--json"]).stdout)
    assert found["work"]["unknown_share"] == 1.0
    assert found["path"]["largest_mm"]["u"] is None and found["path"]["u_frame_um"] == [None]


@pytest.mark.parametrize(("q1", "status"), [(0, 3), (30, 0)])
def test_a_path_is_judged_by_its_own_targets(tmp_path, q1, status):
    """A wave of axis 1 is nothing where it crosses zero, however much it does over the work."""
    cell, path = tmp_path / "cell.yaml", tmp_path / "path.csv"
    wave = _known(TransmissionError(axis=1, order=2, amplitude_deg=0.05, phase_deg=0), 0.001)
    cell.write_text(extended(load("paper-fanuc")[1], [wave], "cell"), encoding="utf-8")
    path.write_text("\n".join([",".join(JOINTS), *(f"{q1},{20 + 9 * k},{10 - 9 * k},0,60,0" for k in range(5))]) + "\n")
    done = CliRunner().invoke(app, ["correct", str(cell), "--path", str(path), "-o", str(tmp_path / "out")])
    assert (done.exit_code, (tmp_path / "out" / "corrected-path.csv").exists()) == (status, not status)
    assert ("not reduce" in done.stderr) == bool(status)
    assert ("path.csv: " in " ".join(done.stdout.split())) == (not status)


def test_u_of_a_program_is_that_of_targets_that_runs_cover():
    u_mm = np.array([0.1, 0.2])
    assert "± 0.400 mm" in reached(u_mm, 2 * u_mm)
    assert "runs cover" in reached(np.append(u_mm, np.nan), np.append(u_mm, np.nan))


def test_without_the_joint_angles_of_the_runs_coverage_is_unknown(tmp_path):
    path = tmp_path / "path.csv"
    path.write_text(",".join(JOINTS) + "\n0,-80,100,-20,80,0\n")
    found = correct_rig(_rig("ur10e", [_known(JointOffset(axis=3, offset_deg=0.05), 0.002)]), path)
    assert found.path and found.path[2].covered is None and not found.path[2].doubts


class _SumIsSure(Projection):
    """Two changes of which the second is needed beside the first, and the first is not needed beside the second."""

    def gains(self, fewer: Projection, *_: object) -> bool:
        return self.constants[0] in fewer.constants


def test_insignificant_entry_is_left_out():
    constants = (Constant(2, "q_deg"), Constant(3, "q_deg"))
    every = _SumIsSure(constants, np.array([1.0, 0.2]), np.ones(2), np.eye(2, 6), np.ones((1, 6)), ())
    moves = np.zeros((2, 1, 6))
    moves[:, 0, :2] = [[0.9, 0.18], [0.0, 0.05]]  # one standard uncertainty each
    projection, u = _certain(load("ur10e")[0], (), every, np.zeros((1, 6)), moves)
    assert (np.abs(projection.values) >= u).all() and projection.constants == ()


def test_nothing_to_enter_has_no_steps():
    rig = _rig("ur10e", [_known(JointOffset(axis=2, offset_deg=1e-5), 1e-2)])
    at = controller_entries(rig, supports(rig), "ur")
    assert at.entries == () and at.steps == ()
