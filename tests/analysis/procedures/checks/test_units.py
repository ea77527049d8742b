from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.intake.read import parse_csv
from analysis.procedures.checks.columns import impossible_travel, unit_findings
from analysis.procedures.checks.gauges import EXCHANGED, ORDER
from analysis.procedures.checks.places import DUPLICATES, PLACE, STAMPS, WILDNESS
from analysis.procedures.shared.test_kind import Finding, findings_against
from analysis.procedures.simulate import simulate
from analysis.robot.kinematics.arm import arm_of, forward
from analysis.runs.tables import CircleTable, Table, table_from
from rigs.load import load
from rigs.rig import Rig
from rigs.schema.declared_tests import Hemisphere
from rigs.schema.vocabulary import TestName
from tests.support.table_cases import JOINTS, TESTS, Rows, csv_text, plain, rig, scaled, texts

RAD = np.pi / 180
RADIANS = tuple(JOINTS)


def found(rows: Rows, test: TestName, cell: Rig | None = None) -> list[Finding]:
    cell = cell or rig()
    table = read(rows, test, cell)
    every = list(unit_findings(table, cell))
    every += [one for kind in (DUPLICATES, WILDNESS, PLACE, STAMPS) for one in findings_against(kind, table, cell)]
    return [one for one in every if one.strength == "impossible"] or every


def units(rows: Rows, test: TestName, cell: Rig | None = None) -> list[tuple[tuple[str, ...], str]]:
    return [(one.columns, one.meant) for one in found(rows, test, cell) if one.strength == "impossible"]


def read(rows: Rows, test: TestName, cell: Rig) -> Table:
    columns = parse_csv(csv_text(rows).encode(), "t.csv", test, cell)
    words = columns["direction"][0].as_py() if test in ("yaw", "roll") else None
    return table_from(columns, test, words, "t.csv")


def changed(test: TestName, factors: dict[str, float]) -> Rows:
    rows = plain(test)
    return rows | {name: scaled(rows[name], factor) for name, factor in factors.items()}


def unknown_ball() -> Rig:
    """As for a real cell: the rig file does not tell the eccentricity."""
    tests = rig().tests
    assert tests.circle is not None
    circle = tests.circle.model_copy(update={"eccentricity_mm": (0.0, 0.0, 0.0)})
    return rig().model_copy(update={"tests": tests.model_copy(update={"circle": circle})})


@pytest.mark.parametrize("direction", ["acw", "cw"])
@pytest.mark.parametrize("test", TESTS)
def test_good_tables_have_no_finding(test, direction):
    assert found(plain(test, direction), test) == found(plain(test, direction), test, unknown_ball()) == []


@pytest.mark.parametrize("test", ["yaw", "roll", "pose"])
def test_joints_in_radians_are_impossible(test):
    assert (RADIANS, "radians") in units(changed(test, dict.fromkeys(JOINTS, RAD)), test)


def test_joints_in_radians_at_targets_are_impossible():
    rows = {name: [cells[0]] * 5 for name, cells in plain("radial").items()}
    q = np.radians([[float(rows[name][0]) for name in JOINTS]])
    x, y, z = forward(arm_of(rig().robot), q)[0, :3, 3]
    polar, azimuth = np.degrees(np.arctan2(np.hypot(x, y), z)), np.degrees(np.arctan2(y, x))
    rows |= {"polar_deg": [f"{polar:.6f}"] * 5, "azimuth_deg": [f"{azimuth:.6f}"] * 5}
    radius_mm = float(np.linalg.norm([x, y, z]))
    hemisphere = Hemisphere(centre_mm=(0.0, 0.0, 0.0), radius_mm=radius_mm, posture_deg=(0, 0, 0, 0, 0, 0))
    cell = rig().model_copy(update={"tests": rig().tests.model_copy(update={"hemisphere": hemisphere})})
    assert units(rows, "radial", cell) == []
    assert (RADIANS, "radians") in units(rows | {name: scaled(rows[name], RAD) for name in JOINTS}, "radial", cell)


@pytest.mark.parametrize(("travel_mm", "strength"), [(100, "likely"), (500, "impossible")])
def test_travel_of_a_gauge_at_targets_shows_another_unit(travel_mm, strength):
    rows = plain("radial")
    factor = travel_mm / float(np.ptp([float(cell) for cell in rows["g1_mm"]]))
    (finding,) = found(rows | {"g1_mm": scaled(rows["g1_mm"], factor)}, "radial")
    assert (finding.strength, finding.columns) == (strength, ("g1_mm",))


def test_small_angles_off_the_circle_are_not_called_radians():
    """Degrees that all lie within ±6: only the circle says which they are, and this robot is not on it either way."""
    rows = plain("yaw")
    t = np.linspace(0, 6, len(rows["t_s"]))
    assert units(rows | {name: texts(np.sin(t + k)) for k, name in enumerate(JOINTS)}, "yaw") == []


@pytest.mark.parametrize("test", ["yaw", "roll"])
@pytest.mark.parametrize("factor", [1 / 25.4, 1000.0])
def test_one_gauge_in_another_unit_is_impossible(test, factor):
    assert [columns for columns, _ in units(changed(test, {"g2_mm": factor}), test, unknown_ball())][:1] == [("g2_mm",)]


def test_robot_errors_that_cancel_one_wave_are_no_unit():
    """A gear error of 1 mm left one gauge of a UR10e a wave of 0.04 of the other's, and thirty waves besides."""
    rows = plain("yaw")
    g2_mm = np.array(rows["g2_mm"], dtype=float)
    lap = np.linspace(0, 2 * np.pi, len(g2_mm))
    changed_mm = (g2_mm - g2_mm.mean()) / 25.4 + 0.3 * np.ptp(g2_mm) * np.sin(30 * lap)
    assert units(rows | {"g2_mm": [f"{reading:.6f}" for reading in changed_mm]}, "yaw", unknown_ball()) == []


@pytest.mark.parametrize("test", ["yaw", "roll"])
def test_inches_need_a_known_ball_and_micrometres_do_not(test):
    inches = changed(test, {"g1_mm": 1 / 25.4, "g2_mm": 1 / 25.4})
    assert [columns for columns, _ in units(inches, test)] == [("g1_mm", "g2_mm")]
    assert units(inches, test, unknown_ball()) == []
    assert units(changed(test, {"g1_mm": 1000.0, "g2_mm": 1000.0}), test, unknown_ball())


def _exchanged(rows: Rows) -> Rows:
    return rows | {"g1_mm": rows["g2_mm"], "g2_mm": rows["g1_mm"]}


def _orders(rows: Rows, test: TestName) -> list[str]:
    return [finding.meant for finding in findings_against(ORDER, read(rows, test, rig()), rig())]


@pytest.mark.parametrize("test", ["yaw", "roll"])
@pytest.mark.parametrize("direction", ["acw", "cw"])
def test_exchanged_gauges_are_a_doubt_in_yaw_and_never_refused(test, direction):
    rows = plain(test, direction)
    assert _orders(rows, test) == found(_exchanged(rows), test) == []
    assert _orders(_exchanged(rows), test) == [EXCHANGED] * (test == "yaw")


@pytest.mark.parametrize(("mm", "expected"), [(0.2, [EXCHANGED]), (0.8, [])])
def test_gear_error_that_opposes_the_two_first_orders_is_no_exchange(mm, expected):
    rows = _exchanged(plain("yaw"))
    wave = mm * np.sin(3 * np.radians(np.arange(-10.0, 371.0, 2.0)))
    moved = {
        name: texts(np.array(rows[name], dtype=float) + sign * wave) for name, sign in (("g1_mm", 1), ("g2_mm", -1))
    }
    assert _orders(rows | moved, "yaw") == expected


def test_part_of_a_lap_shows_no_order_of_the_gauges():
    assert _orders({name: cells[:100] for name, cells in _exchanged(plain("yaw")).items()}, "yaw") == []


PLACES = ("x_mm", "y_mm", "z_mm")
TURNS = ("rx_deg", "ry_deg", "rz_deg")


def repeated(rows: Rows, passes: int, at_once: int) -> Rows:
    """All poses driven several times, and each measured several times at once."""
    return {name: [cell for cell in cells for _ in range(at_once)] * passes for name, cells in rows.items()}


@pytest.mark.parametrize(("passes", "at_once"), [(1, 1), (2, 1), (3, 1), (6, 1), (1, 5), (2, 5)])
def test_units_of_a_tracker_are_found_in_any_order_of_visits(passes, at_once):
    for factor, fact in ((1e-3, "in m:"), (0.1, "in cm:"), (1 / 25.4, "in inches:")):
        findings = found(repeated(changed("pose", dict.fromkeys(PLACES, factor)), passes, at_once), "pose")
        assert any(fact in finding.what and finding.columns == PLACES for finding in findings)
    assert units(repeated(changed("pose", dict.fromkeys(TURNS, RAD)), passes, at_once), "pose")[0][0] == TURNS
    assert (RADIANS, "radians") in units(repeated(changed("pose", dict.fromkeys(JOINTS, RAD)), passes, at_once), "pose")
    assert units(repeated(plain("pose"), passes, at_once), "pose") == []


@pytest.mark.parametrize("factor", [10, 25.4])
def test_places_of_a_tracker_read_in_a_wrong_unit_are_impossible(factor):
    assert [columns for columns, _ in units(changed("pose", dict.fromkeys(PLACES, factor)), "pose")] == [PLACES]


def test_joints_in_radians_are_found_next_to_places_in_metres():
    """Read as degrees they move the arm so little that the metres look like inches."""
    moved = changed("pose", dict.fromkeys(JOINTS, RAD) | dict.fromkeys(PLACES, 1e-3))
    rows = {name: cells for name, cells in moved.items() if name not in TURNS}
    assert [columns[0] for columns, _ in units(rows, "pose")] == ["q1_deg", "x_mm"]


def test_angles_of_a_tracker_about_moving_axes_are_impossible():
    rows = plain("pose")
    fixed = np.array([[float(cell) for cell in rows[name]] for name in TURNS]).T
    moving = Rotation.from_euler("xyz", fixed, degrees=True).as_euler("XYZ", degrees=True)
    rows |= {name: texts(column) for name, column in zip(TURNS, moving.T, strict=True)}
    assert units(rows, "pose")[0][0] == TURNS


def test_tracker_that_saw_one_place_shows_no_unit():
    rows = plain("pose")
    rows |= {name: [rows[name][0]] * len(rows[name]) for name in PLACES}
    rows |= {name: scaled(rows[name], RAD) for name in JOINTS}
    assert units({name: cells for name, cells in rows.items() if name not in TURNS}, "pose") == []


def _times(table: Table, cell: Rig, factor: float) -> list[str]:
    assert isinstance(table, CircleTable)
    scaled_table = dataclasses.replace(table, t_s=factor * table.t_s)
    return [finding.meant for finding in findings_against(STAMPS, scaled_table, cell)]


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "ms"), (1e6, "µs"), (1e9, "ns"), (1e-3, "another unit")])
def test_time_in_another_unit_is_doubted(factor, unit):
    assert _times(read(plain("yaw"), "yaw", rig()), rig(), factor) == [unit]


@pytest.mark.parametrize("laps", [1, 2, 5])
def test_speed_is_that_of_all_laps_and_ways_back(laps):
    shipped, _ = load("paper-fanuc")
    assert shipped.tests.circle is not None
    circle = shipped.tests.circle.model_copy(update={"laps": laps})
    driven = shipped.model_copy(update={"tests": shipped.tests.model_copy(update={"circle": circle})})
    table = simulate(driven, "yaw", "acw", 1)
    assert (_times(table, driven, 1.0), _times(table, driven, 1e9)) == ([], ["ns"])


@pytest.mark.parametrize("test", ["radial", "repeatability"])
def test_target_that_the_robot_was_not_at_is_doubted(test):
    rows = plain(test)
    rows["target"][9:12] = ["8"] * 3
    if test == "radial":
        rows["polar_deg"][9:12] = ["60"] * 3
    (finding,) = found(rows, test)
    assert finding.columns == ("target",) and "row 10" in finding.what and "3 of 24" in finding.what


def test_wrapped_counts_are_not_called_micrometres():
    """Readings of a signed 32-bit gauge read as unsigned were refused as µm."""
    true = np.round(0.02 * np.sin(np.linspace(0, 7, 400)), 4)
    wrapped = np.where(true < 0, true + 1e-4 * 2.0**32, true)
    ((_, remedy),) = impossible_travel("g1_mm", wrapped, 70.0)
    assert "`type: int32`" in remedy
