"""Wrong units and labels are reported if the data prove them, without false reports."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.intake.read import parse_csv
from analysis.procedures.checks.gauge_sign import ORDER
from analysis.procedures.checks.lost_poses import DUPLICATES, WILDNESS
from analysis.procedures.checks.place import PLACE, STAMPS
from analysis.procedures.checks.units import impossible_travel, unit_findings
from analysis.procedures.shared.finding import Finding
from analysis.procedures.shared.test_kind import findings_against
from analysis.procedures.simulate import simulate
from analysis.runs.csv_tables import table_from
from analysis.runs.tables import CircleTable, Table
from rigs.errors import FileError
from rigs.load import load
from rigs.rig import Rig
from rigs.schema.declared_tests import Hemisphere
from rigs.schema.vocabulary import Direction, TestName
from tests.support.table_cases import JOINTS, TESTS, Rows, csv_text, plain, rig, scaled, texts

RAD = np.pi / 180


def _of(convention: str) -> Callable[[Table, Rig], Iterable[Finding]]:
    """What speaks against a convention, in a table of any kind."""
    return lambda table, cell: findings_against(convention, table, cell)


def check(rows: Rows, test: TestName, cell: Rig | None = None) -> list[str]:
    cell = cell or rig()
    table = read(rows, test, cell)
    found = [
        finding
        for one in (unit_findings, *map(_of, (DUPLICATES, WILDNESS, PLACE, STAMPS)))
        for finding in one(table, cell)
    ]
    for finding in found:
        if finding.strength == "impossible":
            raise FileError("t.csv", finding.what, finding.remedy)
    return [finding.words for finding in found]


def doubts_of_order(table: Table, cell: Rig) -> list[str]:
    return [finding.words for finding in _of(ORDER)(table, cell)]


def doubts_of(table: Table, cell: Rig) -> tuple[str, ...]:
    return tuple(finding.words for finding in (*_of(PLACE)(table, cell), *_of(STAMPS)(table, cell)))


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
def test_good_tables_are_let_through(test: TestName, direction: str) -> None:
    assert check(plain(test, "cw" if direction == "cw" else "acw"), test) == []
    assert check(plain(test, "cw" if direction == "cw" else "acw"), test, unknown_ball()) == []


@pytest.mark.parametrize("test", ["yaw", "roll", "pose"])
def test_joints_in_radians(test: TestName) -> None:
    with pytest.raises(FileError, match=r"q1_deg … q6_deg are in radians.*; convert them to degrees"):
        check(changed(test, dict.fromkeys(JOINTS, RAD)), test)


def test_joints_in_radians_at_targets() -> None:
    rows = plain("radial")
    one = {name: [cells[0]] * 5 for name, cells in rows.items()}
    one |= _direction_of(one)
    tool = np.array([0.0, 0.0, 0.0])
    hemisphere = Hemisphere(centre_mm=tuple(tool), radius_mm=_reach(one), posture_deg=(0, 0, 0, 0, 0, 0))
    cell = rig().model_copy(update={"tests": rig().tests.model_copy(update={"hemisphere": hemisphere})})
    check(one, "radial", cell)
    with pytest.raises(FileError, match="are in radians"):
        check(one | {name: scaled(one[name], RAD) for name in JOINTS}, "radial", cell)


def test_targets_of_a_gauge_in_micrometres() -> None:
    rows = plain("radial")
    travel = float(np.ptp([float(cell) for cell in rows["g1_mm"]]))
    (doubt,) = check(rows | {"g1_mm": scaled(rows["g1_mm"], 100 / travel)}, "radial")
    assert doubt.startswith("g1_mm travels 100 mm on a radius of 400 mm, more than any robot error; check the unit")
    with pytest.raises(
        FileError, match=r"g1_mm travels 500 mm on a radius of 400 mm, which is impossible for a link; check"
    ):
        check(rows | {"g1_mm": scaled(rows["g1_mm"], 500 / travel)}, "radial")


def _direction_of(rows: Rows) -> Rows:
    """The angles of the place from the base, about which the hemisphere of that test lies."""
    from analysis.robot.kinematics.arm import arm_of, forward  # noqa: PLC0415

    q = np.radians([[float(rows[name][0]) for name in JOINTS]])
    x, y, z = forward(arm_of(rig().robot), q)[0, :3, 3]
    polar, azimuth = np.degrees(np.arctan2(np.hypot(x, y), z)), np.degrees(np.arctan2(y, x))
    return {"polar_deg": [f"{polar:.6f}"] * 5, "azimuth_deg": [f"{azimuth:.6f}"] * 5}


def _reach(rows: Rows) -> float:
    from analysis.robot.kinematics.arm import arm_of, forward  # noqa: PLC0415

    q = np.radians([[float(rows[name][0]) for name in JOINTS]])
    return float(np.linalg.norm(forward(arm_of(rig().robot), q)[0, :3, 3]))


def test_small_angles_are_no_radians() -> None:
    """Degrees that all lie within ±6: only the circle says which they are, and this robot is not on it either way."""
    rows = plain("yaw")
    t = np.linspace(0, 6, len(rows["t_s"]))
    check(rows | {name: texts(np.sin(t + k)) for k, name in enumerate(JOINTS)}, "yaw")


@pytest.mark.parametrize("test", ["yaw", "roll"])
@pytest.mark.parametrize(("factor", "unit"), [(1 / 25.4, "inches"), (1000.0, "µm")])
def test_one_gauge_in_another_unit(test: TestName, factor: float, unit: str) -> None:
    with pytest.raises(FileError, match=f"g2_mm (is in {unit}|travels)"):
        check(changed(test, {"g2_mm": factor}), test, unknown_ball())


def test_a_robot_whose_errors_cancel_one_wave_is_let_through() -> None:
    """A gear error of 1 mm left one gauge of a UR10e a wave of 0.04 of the other's, and thirty waves besides."""
    rows = plain("yaw")
    g2_mm = np.array(rows["g2_mm"], dtype=float)
    lap = np.linspace(0, 2 * np.pi, len(g2_mm))
    changed_mm = (g2_mm - g2_mm.mean()) / 25.4 + 0.3 * np.ptp(g2_mm) * np.sin(30 * lap)
    check(rows | {"g2_mm": [f"{reading:.6f}" for reading in changed_mm]}, "yaw", unknown_ball())


@pytest.mark.parametrize("test", ["yaw", "roll"])
def test_both_gauges_in_another_unit(test: TestName) -> None:
    with pytest.raises(FileError, match="g1_mm and g2_mm are in inches"):
        check(changed(test, {"g1_mm": 1 / 25.4, "g2_mm": 1 / 25.4}), test)
    with pytest.raises(
        FileError,
        match=r"g1_mm travels .* which is impossible for a link; convert it to mm: the values are probably µm",
    ):
        check(changed(test, {"g1_mm": 1000.0, "g2_mm": 1000.0}), test, unknown_ball())


def test_inches_without_a_known_ball_cannot_be_told() -> None:
    check(changed("yaw", {"g1_mm": 1 / 25.4, "g2_mm": 1 / 25.4}), "yaw", unknown_ball())


def _exchanged(rows: Rows) -> Rows:
    return rows | {"g1_mm": rows["g2_mm"], "g2_mm": rows["g1_mm"]}


@pytest.mark.parametrize("test", ["yaw", "roll"])
@pytest.mark.parametrize("direction", ["acw", "cw"])
def test_exchanged_gauges_are_a_doubt_in_yaw_and_never_refused(test: TestName, direction: Direction) -> None:
    rows = plain(test, direction)
    assert doubts_of_order(read(rows, test, rig()), rig()) == []
    assert check(_exchanged(rows), test) == check(_exchanged(rows), test, unknown_ball()) == []
    said = doubts_of_order(read(_exchanged(rows), test, rig()), rig())
    assert [doubt[:26] for doubt in said] == ["g1 and g2 may be exchanged"] * (test == "yaw")


def test_an_arm_that_errs_as_much_as_it_turns_the_ball_round_is_not_taken_for_exchanged_gauges() -> None:
    """A gear error that opposes the two first orders has other orders too."""
    rows = _exchanged(plain("yaw"))
    phi = np.radians(np.arange(-10.0, 371.0, 2.0))
    for mm, count in ((0.2, 1), (0.8, 0)):
        wave = mm * np.sin(3 * phi)
        moved = rows | {
            name: texts(np.array(rows[name], dtype=float) + sign * wave)
            for name, sign in (("g1_mm", 1.0), ("g2_mm", -1.0))
        }
        assert len(doubts_of_order(read(moved, "yaw", rig()), rig())) == count


def test_a_part_of_a_lap_tells_nothing_of_the_order_of_the_gauges() -> None:
    half = {name: cells[:100] for name, cells in _exchanged(plain("yaw")).items()}
    assert doubts_of_order(read(half, "yaw", rig()), rig()) == []


def repeated(rows: Rows, passes: int, at_once: int) -> Rows:
    """All poses driven several times, and each measured several times at once."""
    return {name: [cell for cell in cells for _ in range(at_once)] * passes for name, cells in rows.items()}


REPEATS = [(1, 1), (2, 1), (3, 1), (4, 1), (5, 1), (6, 1), (1, 5), (2, 5)]


@pytest.mark.parametrize(("passes", "at_once"), REPEATS)
@pytest.mark.parametrize(("factor", "unit"), [(1e-3, "m"), (0.1, "cm"), (1 / 25.4, "inches")])
def test_tracker_places_in_another_unit(factor: float, unit: str, passes: int, at_once: int) -> None:
    rows = changed("pose", dict.fromkeys(("x_mm", "y_mm", "z_mm"), factor))
    with pytest.raises(FileError, match=f"x_mm, y_mm, z_mm are in {unit}"):
        check(repeated(rows, passes, at_once), "pose")


@pytest.mark.parametrize(("factor", "unit"), [(10, "cm"), (25.4, "inches")])
def test_tracker_places_that_were_taken_for_another_unit(factor: float, unit: str) -> None:
    rows = changed("pose", dict.fromkeys(("x_mm", "y_mm", "z_mm"), factor))
    with pytest.raises(FileError, match=f"x_mm, y_mm, z_mm were not in {unit}"):
        check(rows, "pose")


@pytest.mark.parametrize(("passes", "at_once"), REPEATS)
def test_tracker_angles_and_joints_in_radians(passes: int, at_once: int) -> None:
    rows = changed("pose", dict.fromkeys(("rx_deg", "ry_deg", "rz_deg"), RAD))
    with pytest.raises(FileError, match="rx_deg, ry_deg, rz_deg are in radians"):
        check(repeated(rows, passes, at_once), "pose")
    with pytest.raises(FileError, match="q1_deg … q6_deg are in radians"):
        check(repeated(changed("pose", dict.fromkeys(JOINTS, RAD)), passes, at_once), "pose")
    check(repeated(plain("pose"), passes, at_once), "pose")


def test_joints_in_radians_are_told_beside_places_in_metres() -> None:
    """Read as degrees they move the arm so little that the metres look like inches."""
    moved = changed("pose", dict.fromkeys(JOINTS, RAD) | dict.fromkeys(("x_mm", "y_mm", "z_mm"), 1e-3))
    rows = {name: cells for name, cells in moved.items() if not name.startswith("r")}
    cell = rig()
    found = [(finding.columns[0], finding.what) for finding in unit_findings(read(rows, "pose", cell), cell)]
    assert [column for column, _ in found] == ["q1_deg", "x_mm"] and "are in radians" in found[0][1]
    assert "are in m:" in found[1][1]


def test_tracker_angles_about_moving_axes() -> None:
    rows = plain("pose")
    names = ("rx_deg", "ry_deg", "rz_deg")
    fixed = np.array([[float(cell) for cell in rows[name]] for name in names]).T
    moving = Rotation.from_euler("xyz", fixed, degrees=True).as_euler("XYZ", degrees=True)
    with pytest.raises(FileError, match="are rotations about moving axes"):
        check(rows | {name: texts(column) for name, column in zip(names, moving.T, strict=True)}, "pose")


def test_a_tracker_that_saw_one_place_only_tells_no_unit() -> None:
    rows = plain("pose")
    still = {name: [rows[name][0]] * len(rows[name]) for name in ("x_mm", "y_mm", "z_mm")}
    small = {name: scaled(rows[name], RAD) for name in JOINTS}
    check({name: cells for name, cells in (rows | still | small).items() if not name.startswith("r")}, "pose")


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (1e3, "t_s may be in ms"),
        (1e6, "t_s may be in µs"),
        (1e9, "t_s may be in ns"),
        (1e-3, "check the units of t_s and speed_mm_s"),
    ],
)
def test_time_in_another_unit_is_doubted(factor: float, said: str) -> None:
    table = read(plain("yaw"), "yaw", rig())
    assert isinstance(table, CircleTable)
    (doubt,) = doubts_of(dataclasses.replace(table, t_s=factor * table.t_s), rig())
    assert said in doubt


@pytest.mark.parametrize("laps", [1, 2, 5])
def test_the_speed_is_that_of_all_laps_and_ways_back(laps: int) -> None:
    shipped, _ = load("paper-fanuc")
    assert shipped.tests.circle is not None
    circle = shipped.tests.circle.model_copy(update={"laps": laps})
    driven = shipped.model_copy(update={"tests": shipped.tests.model_copy(update={"circle": circle})})
    table = simulate(driven, "yaw", "acw", 1)
    assert isinstance(table, CircleTable) and doubts_of(table, driven) == ()
    (doubt,) = doubts_of(dataclasses.replace(table, t_s=1e9 * table.t_s), driven)
    assert "t_s may be in ns" in doubt


@pytest.mark.parametrize("test", ["radial", "repeatability"])
def test_a_target_that_the_robot_was_not_at_is_doubted_by_name(test: TestName) -> None:
    rows = plain(test)
    rows["target"][9:12] = ["8"] * 3
    if test == "radial":
        rows["polar_deg"][9:12] = ["60"] * 3
    (doubt,) = check(rows, test)
    assert "from target 8 in row 10, and further away than 20 mm in 3 of 24 rows" in doubt


def test_wrapped_counts_that_travel_farther_than_a_link_are_not_called_micrometres() -> None:
    """Readings of a signed 32-bit gauge read as unsigned were refused as µm."""
    true = np.round(0.02 * np.sin(np.linspace(0, 7, 400)), 4)
    wrapped = np.where(true < 0, true + 1e-4 * 2.0**32, true)
    ((fact, remedy),) = impossible_travel("g1_mm", wrapped, 70.0)
    assert "a signed value was read as unsigned" in fact and remedy == "set `type: int32`"
