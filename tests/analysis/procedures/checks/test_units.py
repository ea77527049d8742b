import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.intake.read import parse_csv
from analysis.procedures.checks.places import DUPLICATES, PLACE, STAMPS, WILDNESS
from analysis.procedures.checks.units import impossible_travel, unit_findings
from analysis.procedures.shared.test_kind import Finding, findings_against
from analysis.runs.tables import Table, table_from
from rigs.rig import Rig
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
    circle = tests.circle.model_copy(update={"eccentricity_mm": (0.0, 0.0, 0.0)})
    return rig().model_copy(update={"tests": tests.model_copy(update={"circle": circle})})


@pytest.mark.parametrize("direction", ["acw", "cw"])
@pytest.mark.parametrize("test", TESTS)
def test_good_tables_have_no_finding(test, direction):
    assert found(plain(test, direction), test) == found(plain(test, direction), test, unknown_ball()) == []


@pytest.mark.parametrize("test", ["yaw", "roll", "pose"])
def test_joints_in_radians_are_impossible(test):
    assert (RADIANS, "radians") in units(changed(test, dict.fromkeys(JOINTS, RAD)), test)


@pytest.mark.parametrize("test", ["yaw", "roll"])
def test_inches_need_a_known_ball_and_micrometres_do_not(test):
    inches = changed(test, {"g1_mm": 1 / 25.4, "g2_mm": 1 / 25.4})
    assert [columns for columns, _ in units(inches, test)] == [("g1_mm", "g2_mm")]
    assert units(inches, test, unknown_ball()) == []
    assert units(changed(test, {"g1_mm": 1000.0, "g2_mm": 1000.0}), test, unknown_ball())


PLACES = ("x_mm", "y_mm", "z_mm")
TURNS = ("rx_deg", "ry_deg", "rz_deg")


def repeated(rows: Rows, passes: int, at_once: int) -> Rows:
    return {name: [cell for cell in cells for _ in range(at_once)] * passes for name, cells in rows.items()}


@pytest.mark.parametrize(("passes", "at_once"), [(1, 5), (2, 1)])
def test_units_of_a_tracker_are_found_in_any_order_of_visits(passes, at_once):
    for factor, fact in ((1e-3, "in m:"), (0.1, "in cm:"), (1 / 25.4, "in inches:")):
        findings = found(repeated(changed("pose", dict.fromkeys(PLACES, factor)), passes, at_once), "pose")
        assert any(fact in finding.what and finding.columns == PLACES for finding in findings)
    assert units(repeated(changed("pose", dict.fromkeys(TURNS, RAD)), passes, at_once), "pose")[0][0] == TURNS
    assert (RADIANS, "radians") in units(repeated(changed("pose", dict.fromkeys(JOINTS, RAD)), passes, at_once), "pose")
    assert units(repeated(plain("pose"), passes, at_once), "pose") == []


def test_angles_of_a_tracker_about_moving_axes_are_impossible():
    rows = plain("pose")
    fixed = np.array([[float(cell) for cell in rows[name]] for name in TURNS]).T
    moving = Rotation.from_euler("xyz", fixed, degrees=True).as_euler("XYZ", degrees=True)
    rows |= {name: texts(column) for name, column in zip(TURNS, moving.T, strict=True)}
    assert units(rows, "pose")[0][0] == TURNS


def _times(table: Table, cell: Rig, factor: float) -> list[str]:
    scaled_table = dataclasses.replace(table, t_s=factor * table.t_s)
    return [finding.meant for finding in findings_against(STAMPS, scaled_table, cell)]


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "ms"), (1e6, "µs"), (1e9, "ns"), (1e-3, "another unit")])
def test_time_in_another_unit_is_doubted(factor, unit):
    assert _times(read(plain("yaw"), "yaw", rig()), rig(), factor) == [unit]


@pytest.mark.parametrize("test", ["radial", "repeatability"])
def test_target_that_the_robot_was_not_at_is_doubted(test):
    rows = plain(test)
    rows["target"][9:12] = ["8"] * 3
    if test == "radial":
        rows["polar_deg"][9:12] = ["60"] * 3
    (finding,) = found(rows, test)
    assert finding.columns == ("target",) and "row 10" in finding.what and "3 of 24" in finding.what


def test_wrapped_counts_are_not_called_micrometres():
    true = np.round(0.02 * np.sin(np.linspace(0, 7, 400)), 4)
    wrapped = np.where(true < 0, true + 1e-4 * 2.0**32, true)
    ((_, remedy),) = impossible_travel("g1_mm", wrapped, 70.0)
    assert "`type: int32`" in remedy
