from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.procedures.shared.test_kind import evaluate
from analysis.robot.geometry.iso_cube import cube_of, cycle_stops
from analysis.runs.tables import PoseTable
from rigs.load import load
from rigs.rig import Rig
from rigs.schema.declared_tests import Iso9283, TrackerPose
from tests.analysis.procedures.test_pose import measured as series
from tests.support.refusals import refused
from tests.worlds.arms.faulty_arm import flange_at, hidden
from tests.worlds.arms.independent_arm import Array
from tests.worlds.arms.iso_plain import accuracy, cube_places, distance, repeatability

INSTRUMENT = TrackerPose(xyz_mm=(2100.0, -700.0, 900.0), rpy_deg=(3.0, -2.0, 140.0), u_mm=0.03)
CYCLE = (5, 4, 3, 2, 1)


def rig_with(test: Iso9283, name: str = "ur10e-cell") -> Rig:
    rig, _ = load(name)
    return rig.model_copy(update={"tests": rig.tests.model_copy(update={"iso9283": test})})


def tool_places(rig: Rig, q: Array, *, wrong: bool) -> Array:
    """Tool positions of the independent arm in the world, whose base is that of the rig."""
    tool = np.array([*rig.robot.tool.xyz_mm, 1.0])
    return np.array([(flange_at(rig, one, hidden() if wrong else None) @ tool)[:3] for one in q])


def seen(places: Array) -> Array:
    turn = Rotation.from_euler("xyz", INSTRUMENT.rpy_deg, degrees=True)
    return turn.inv().apply(places - np.array(INSTRUMENT.xyz_mm))


def measured(rig: Rig) -> tuple[PoseTable, Array, Array]:
    """A run of the wrong arm in the known frame, where its tool was (n, 3), and the nominal places of P1 … P5."""
    q = cycle_stops(rig)
    noise = 0.03 * np.random.default_rng(3).standard_normal((len(q), 3))
    attained = tool_places(rig, q, wrong=True) + noise
    return PoseTable(q, seen(attained), None), attained, tool_places(rig, cube_of(rig).q, wrong=False)


@pytest.mark.parametrize("name", ["ur10e-cell", "paper-fanuc"])
def test_cube_has_the_poses_of_the_standard(name):
    rig = rig_with(Iso9283(), name)
    cube = cube_of(rig)
    placed = tool_places(rig, cube.q, wrong=False)
    assert np.abs(placed - cube_places(cube.centre_mm, cube.side_mm)).max() < 1e-5
    low, high = np.array([axis.limits_deg for axis in rig.robot.axes]).T
    assert (np.degrees(cube.q) > low).all() and (np.degrees(cube.q) < high).all()


def test_figures_are_those_of_the_standard_with_a_known_frame():
    rig = rig_with(Iso9283(instrument=INSTRUMENT))
    table, attained, nominal = measured(rig)
    figures = evaluate(table, rig, 0.0, "cube").figures
    order = np.tile(CYCLE, 30)
    ap = {p: accuracy(attained[order == p], nominal[p - 1]) for p in CYCLE}
    rp = {p: repeatability(attained[order == p]) for p in CYCLE}
    command = float(np.linalg.norm(nominal[1] - nominal[3]))
    ad, rd = distance(attained[order == 4], attained[order == 2], command)
    for p in CYCLE:
        assert figures[f"ap_p{p}_mm"].value == pytest.approx(ap[p], abs=1e-6)
        assert figures[f"rp_p{p}_mm"].value == pytest.approx(rp[p], abs=1e-6)
    assert figures["ap_mm"].value == pytest.approx(max(ap.values()), abs=1e-6) and max(ap.values()) > 0.5
    assert figures["rp_mm"].value == pytest.approx(max(rp.values()), abs=1e-6)
    assert figures["ad_mm"].value == pytest.approx(ad, abs=1e-6) and abs(ad) > 0.02
    assert figures["rd_mm"].value == pytest.approx(rd, abs=1e-6)
    assert figures["ap_mm"].u > INSTRUMENT.u_mm > figures["rp_mm"].u


def test_fitted_frame_removes_accuracy_but_not_repeatability():
    known, fitted = rig_with(Iso9283(instrument=INSTRUMENT)), rig_with(Iso9283())
    table, _, _ = measured(known)
    by_frame, by_fit = evaluate(table, known, 0.0, "cube"), evaluate(table, fitted, 0.0, "cube")
    assert by_fit.figures["ap_mm"].value < 0.5 * by_frame.figures["ap_mm"].value
    for name in ("rp_mm", "rp_p3_mm", "ad_mm", "rd_mm"):
        assert by_fit.figures[name].value == pytest.approx(by_frame.figures[name].value, abs=1e-6)
    assert any("best fit" in note for note in by_fit.notes) and not any("best fit" in note for note in by_frame.notes)


def test_orientation_is_judged_in_the_known_frame():
    rig = rig_with(Iso9283(instrument=INSTRUMENT))
    q = cycle_stops(rig)
    turn = Rotation.from_euler("xyz", INSTRUMENT.rpy_deg, degrees=True)
    tool = Rotation.from_euler("xyz", rig.robot.tool.rpy_deg, degrees=True)
    flanges = [flange_at(rig, one) for one in q]
    twist = Rotation.from_rotvec(np.radians([0.0, 0.2, 0.0]))
    turned = [turn.inv() * twist * Rotation.from_matrix(T[:3, :3]) * tool for T in flanges]
    rpy = np.array([one.as_euler("xyz") for one in turned])
    table = PoseTable(q, seen(tool_places(rig, q, wrong=False)), rpy)
    found = evaluate(table, rig, 0.0, "cube").figures
    assert found["ap_b_deg"].value == pytest.approx(0.2, abs=1e-6)
    assert found["ap_a_deg"].value == pytest.approx(0.0, abs=1e-6)
    fitted = evaluate(table, rig_with(Iso9283()), 0.0, "cube").figures
    assert fitted["ap_b_deg"].value == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("rises", ["x", "y"])
def test_the_diagonals_of_a_measured_ur10(rises):
    """Cubes of 500 mm of Fraunhofer IPA's series D: AD is that of the places alone, without any frame."""
    table, _ = series("series_d")
    posture = tuple(map(float, np.degrees(table.q[0])))
    rig = rig_with(Iso9283(posture_deg=posture, side_mm=500.0, rises=rises), "ur10-cell")
    found = evaluate(table, rig, 0.0, "series d").figures
    cube = cube_of(rig)
    there = {p: np.abs(table.q - cube.q[p - 1]).max(axis=1) < np.radians(0.5) for p in (2, 4)}
    ones, others = table.xyz_mm[there[2]], table.xyz_mm[there[4]]
    ad, rd = distance(ones, others, float(np.linalg.norm(cube.places_mm[1] - cube.places_mm[3])))
    assert found["ad_mm"].value == pytest.approx(ad, abs=1e-6) and 0.7 < abs(ad) < 1.0
    assert found["rd_mm"].value == pytest.approx(rd, abs=1e-6)
    assert found["rp_p1_mm"].value == pytest.approx(0.038, abs=0.002)


def test_other_poses_have_no_figures_of_the_cube():
    rig = rig_with(Iso9283())
    table, _, _ = measured(rig)
    moved = replace(table, q=table.q + np.radians(2.0))
    found = evaluate(moved, rig, 0.0, "poses")
    assert not any(name.startswith(("ap_p", "rp_p", "ad_", "rd_")) for name in found.figures)


@pytest.mark.parametrize(
    "test", [Iso9283(centre_mm=(3000.0, 0.0, 500.0)), Iso9283(centre_mm=(600.0, 0.0, 500.0), side_mm=2000.0)]
)
def test_a_cube_without_room_is_refused(test):
    with refused("path.impossible", "clear of floor, column and singularities,"):
        cube_of(rig_with(test))
