import csv
import datetime as dt
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner, Result

from analysis.apps.correct.controller_entries import ControllerEntries, controller_entries
from analysis.apps.correct.correct_rig import correct_rig
from analysis.apps.correct.work_area import WorkArea
from analysis.apps.programs.target_path import compensated_plans
from analysis.cli import app
from analysis.correction.corrected_targets import corrected
from analysis.correction.support import supports
from analysis.correction.work import tool_poses, work_angles
from analysis.robot.kinematics.arm import forward
from analysis.robot.predict import model_of
from rigs.edit import extended
from rigs.effects import Compliance, Effect, EffectProvenance, JointOffset, LinkGeometry, TransmissionError, size_field
from rigs.rig import Rig
from rigs.schema.vocabulary import MakerName
from tests.support.refusals import refused
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
    """Zeros, lengths, a twist and a certain gear wave, in a rig file and in an independent arm."""
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
    """Errors (n,) of places (n, 3) after the best fit of frame and tool with rotations (n, 3, 3)."""
    turn, _ = Rotation.align_vectors(wanted - wanted.mean(axis=0), real - real.mean(axis=0))
    off = turn.apply(real - real.mean(axis=0)) - wanted + wanted.mean(axis=0)
    about = wanted - wanted.mean(axis=0)
    moved = [np.tile(np.eye(3), (len(off), 1, 1)), np.stack([np.cross(one, about) for one in np.eye(3)], axis=2), turns]
    columns = np.concatenate(moved, axis=2).reshape(off.size, 9)
    left = off.ravel() - columns @ np.linalg.lstsq(columns, off.ravel(), rcond=1e-9)[0]
    return np.asarray(np.linalg.norm(left.reshape(off.shape), axis=1))


@pytest.mark.parametrize(
    ("name", "maker"),
    [
        ("ur10e-cell", "ur"),
        ("ur10e-cell", "kuka"),
        ("paper-fanuc", "kuka"),
        ("ur10e-cell", "fanuc"),
        ("paper-fanuc", "fanuc"),
    ],
)
def test_residual_of_entries_agrees_with_independent_kinematics(name, maker):
    rig, wrong = _faulty(name)
    at, q = controller_entries(WorkArea(rig, supports(rig)), maker), work_angles(rig)
    real = _tool_mm(rig, wrong, q)
    turns = flange(constants_of(rig.name), WRONG, q)[0]
    before = _as_taught_mm(real, _tool_mm(rig, WRONG, q), turns)
    after = _as_taught_mm(real, _tool_mm(rig, _entered(name, maker, at), q), turns)
    assert 1e3 * np.sqrt(np.mean(before**2)) == pytest.approx(at.before_um, rel=1e-3)
    assert 1e3 * np.sqrt(np.mean(after**2)) == pytest.approx(at.after_um, rel=0.01, abs=0.2)
    assert at.after_um < at.before_um or (maker == "ur" and not at.entries)  # a and alpha cannot be entered
    assert at.by_targets_um < 1


@pytest.mark.parametrize(("name", "maker"), [("ur10e-cell", "ur"), ("paper-fanuc", "kuka")])
def test_targets_contain_the_error_that_entries_leave_for_any_path(tmp_path, name, maker):
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
    again = controller_entries(WorkArea(rig, supports(rig)), maker)
    assert again.entries == found.at_controller.entries  # one rig file has one set of entries


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
        rig = _rig("ur10e-cell", told)
        q = np.radians(rng.uniform([low for low, _ in RANGES], [high for _, high in RANGES], (2, 6)))
        found = corrected(rig, supports(rig), q)
        wanted = forward(model_of(rig, ()).arm, q)
        apart = np.linalg.norm((tool_poses(model_of(rig, true), found.q) - wanted)[:, :3, 3], axis=1)
        within += (apart < 2 * found.u_mm).tolist()
        worst += (apart / found.u_mm).tolist()
        assert found.covered.all()
    assert np.mean(within) >= 0.93
    assert 0.6 < np.sqrt(np.mean(np.square(worst))) < 1.4  # neither too sure nor too careful


def _command(folder: Path, rig: str, effect: Effect, rows: list[str], *options: str) -> Result:
    folder.mkdir(exist_ok=True)
    cell, path = folder / "cell.yaml", folder / "path.csv"
    cell.write_text(extended(load(rig)[1], [effect], "cell"))
    path.write_text("\n".join([",".join(JOINTS), *rows]) + "\n")
    return CliRunner().invoke(app, ["correct", str(cell), "--path", str(path), "-o", str(folder / "out"), *options])


def test_targets_beyond_the_driven_joint_angles_are_marked(tmp_path):
    zero = _known(JointOffset(axis=3, offset_deg=0.05), 0.002, RANGES)
    rows = [f"{q1},-80,100,-20,80,0" for q1 in (0, 62, 70)]  # 62° is within the margin of 3°, 70° is not
    found = json.loads(_command(tmp_path, "ur10e-cell", zero, rows, "--json").stdout)
    with (tmp_path / "out" / "corrected-path.csv").open() as file:
        table = list(csv.DictReader(file))
    assert [row["covered"] for row in table] == ["yes", "yes", "no"]
    assert found["path"]["covered"] == [True, True, False]
    assert found["path"]["u_um"][:2] == pytest.approx([float(row["u_um"]) for row in table[:2]], abs=1e-3)
    assert found["path"]["u_um"][2] is None and table[2]["u_um"] == table[2]["u_frame_um"] == ""
    assert found["work"]["after_um"] < 0.1 * found["work"]["before_um"]


def test_correction_of_an_unmeasured_work_area_needs_anyway(tmp_path):
    zero = _known(JointOffset(axis=3, offset_deg=0.05), 0.002, ((0.0, 1.0),) * 6)
    done = _command(tmp_path / "refused", "ur10e-cell", zero, ["0,-80,100,-20,80,0"])
    assert done.exit_code == 3 and not (tmp_path / "refused" / "out" / "corrected-path.csv").exists()
    done = _command(tmp_path / "anyway", "ur10e-cell", zero, ["0,-80,100,-20,80,0"], "--anyway", "--json")
    found = json.loads(done.stdout)
    assert found["work"]["unknown_share"] == 1.0
    assert found["path"]["largest_mm"]["u"] is None and found["path"]["u_frame_um"] == [None]
    with refused("correction.impossible", "although rig advises against a correction"):
        table = tmp_path / "anyway" / "out" / "corrected-path.csv"
        compensated_plans([], table, _rig("ur10e-cell", []), "rig", anyway=False)


@pytest.mark.parametrize(("q1", "status"), [(0, 3), (30, 0)])
def test_a_path_is_judged_by_its_own_targets(tmp_path, q1, status):
    """A wave of axis 1 is nothing where it crosses zero, however much it does over the work."""
    wave = _known(TransmissionError(axis=1, order=2, amplitude_deg=0.05, phase_deg=0), 0.001)
    done = _command(tmp_path, "paper-fanuc", wave, [f"{q1},{20 + 9 * k},{10 - 9 * k},0,60,0" for k in range(5)])
    assert (done.exit_code, (tmp_path / "out" / "corrected-path.csv").exists()) == (status, not status)
