from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.intake.controller_arm import read_controller
from analysis.intake.imports import propose_map
from analysis.runs.controller_poses import controller_places
from analysis.runs.loading import load_measured
from rigs.arms import load_arm
from tests.support.command_line import ran
from tests.support.drawn_tables import Array, constants, seen_by_tracker
from tests.support.foreign_tables import Poses, rows, text
from tests.support.refusals import refused
from tests.worlds.arms.independent_arm import flange, none

JOINTS = [f"J{axis}" for axis in range(1, 7)]


def measured(arm: str, seed: int, count: int = 40) -> Poses:
    return seen_by_tracker(arm, count, np.random.default_rng([11, seed]))


def by_controller(arm: str, q: Array) -> tuple[Array, Rotation]:
    """Pose of the flange that a controller with constants of its own computes, to a thousandth of a millimetre."""
    own = none()
    own.offset[1:4], own.a[2:4] = np.radians([0.05, -0.07, 0.04]), (0.6, -0.5)
    R, p = flange(constants(arm), own, q)
    return p.round(3), Rotation.from_matrix(R)


def written(folder: Path, arm: str, header: list[str], *columns: Array) -> list[str]:
    (folder / "arm.yaml").write_text(f"name: arm\n{load_arm(arm).text}")
    (folder / "t.csv").write_bytes(text(rows(*columns), header))
    return ["import", "t.csv", "--rig", "arm.yaml", "--test", "pose", "-o", "run"]


def axes_of(name: str) -> list[str]:
    return [name.format(axis) for axis in "XYZ"]


@pytest.mark.parametrize(
    ("arm", "computed", "tracked"),
    [("ur5e", "{}", "FARO {}"), ("kuka-kr-6-r900-2", "{}1", "{}2"), ("staubli-tx2-60", "{}_ref", "{}_laser")],
)
def test_measured_place_is_used_and_the_pose_of_the_controller_kept(arm, computed, tracked, tmp_path):
    p = measured(arm, 1)
    xyz_mm, turn = by_controller(arm, p.q)
    angles = [computed.format(axis) for axis in ("RX", "RY", "RZ")]
    both = [([*axes_of(computed), *angles], xyz_mm, turn.as_euler("xyz", degrees=True)), (axes_of(tracked), p.xyz_mm)]
    both = both if arm < "k" else both[::-1]
    header = [*JOINTS, *(name for names, *_ in both for name in names)]
    words = written(tmp_path, arm, header, np.degrees(p.q), *(value for _, *values in both for value in values))
    done = ran(*words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    run = load_measured(tmp_path / "run")
    assert np.abs(run.table.readings - p.xyz_mm).max() < 1e-5
    kept = controller_places(run.run.table)
    assert np.abs(kept.xyz_mm - xyz_mm).max() < 1e-5 and np.abs(kept.q - p.q).max() < 1e-7
    assert ran("export run --to csv -o back.csv", cwd=tmp_path).returncode == 0
    robot = load_arm(arm).robot
    by_table, by_export = (read_controller(robot, tmp_path / name) for name in ("t.csv", "back.csv"))
    assert by_table.moved_mm == pytest.approx(by_export.moved_mm, abs=1e-3) and by_export.moved_mm > 0.1
    if kept.R is not None:
        assert (Rotation.from_matrix(kept.R) * turn.inv()).magnitude().max() < 1e-4


def test_two_measured_places_are_a_question_and_a_typed_target_is_not_of_the_controller(tmp_path):
    p = measured("ur10e", 2)
    second = p.xyz_mm + p.turn.apply([60.0, 10.0, -30.0])
    written(tmp_path, "ur10e", [*JOINTS, *axes_of("{} left"), *axes_of("{} right")], np.degrees(p.q), p.xyz_mm, second)
    proposal = propose_map([tmp_path / "t.csv"], tmp_path / "arm.yaml")
    assert [question.key for question in proposal.questions] == ["place"] and proposal.table_map.controller is None
    typed = p.xyz_mm + np.random.default_rng(3).normal(0, 0.7, p.xyz_mm.shape).round(1)
    written(tmp_path, "ur10e", [*JOINTS, *axes_of("{} nominal"), *axes_of("{} ist")], np.degrees(p.q), typed, p.xyz_mm)
    proposal = propose_map([tmp_path / "t.csv"], tmp_path / "arm.yaml")
    assert not proposal.questions and proposal.table_map.controller is None
    assert proposal.table_map.place and proposal.table_map.place.columns == tuple(axes_of("{} ist"))


@pytest.mark.parametrize(
    ("angles", "lengths", "style"),
    [
        ("rad deg deg deg deg deg", "mm mm m", "{} [{}]"),
        ("deg rad deg rad deg rad", "in in mm", "{}_{}"),
        ("rad rad rad rad rad deg", "m cm mm", "a line"),
        (" ".join(["Grad"] * 6), "mm mm mm", "{} [{}]"),
        (" ".join(["gon"] * 6), "mm mm mm", "{} [{}]"),
    ],
)
def test_each_column_is_read_in_its_own_unit(angles, lengths, style, tmp_path):
    p = measured("ur10e", 6, 20)
    units = [*angles.split(), *lengths.split()]
    of_angles = {"deg": 180 / np.pi, "Grad": 180 / np.pi, "gon": 200 / np.pi, "rad": 1.0}
    to_unit = {**of_angles, "mm": 1.0, "cm": 0.1, "m": 1e-3, "in": 1 / 25.4}
    values = np.column_stack([p.q, p.xyz_mm]) * [to_unit[unit] for unit in units]
    names = [*JOINTS, "X", "Y", "Z"]
    header = names if style == "a line" else [style.format(name, unit) for name, unit in zip(names, units, strict=True)]
    words = written(tmp_path, "ur10e", header, values)
    if style == "a line":
        lines = (tmp_path / "t.csv").read_text().splitlines()
        (tmp_path / "t.csv").write_text("\n".join([lines[0], ",".join(units), *lines[1:]]) + "\n")
    done = ran(*words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    table = load_measured(tmp_path / "run").table
    assert np.abs(table.readings - p.xyz_mm).max() < 1e-2 and np.abs(table.q - p.q).max() < 1e-5


@pytest.mark.parametrize(("count", "postures", "plain"), [(50, 1, False), (33, 3, False), (25, 1, True)])
def test_a_table_of_few_postures_asks_for_others(count, postures, plain, tmp_path):
    rng = np.random.default_rng(7)
    p, of = measured("ur5e", 7, postures), np.arange(count) % postures
    q_deg = np.degrees(p.q[of]) + rng.normal(0, 0.002, (count, 6))
    header = [*(f"q{axis}_deg" for axis in range(1, 7)), "x_mm", "y_mm", "z_mm"] if plain else [*JOINTS, *"xyz"]
    words = written(tmp_path, "ur5e", header, q_deg, p.xyz_mm[of] + rng.normal(0, 0.02, (count, 3)))
    done = ran(*words, cwd=tmp_path)
    assert done.returncode == (0 if plain else 3) and "postures" in done.stderr


def test_a_table_without_a_fitting_place_is_refused(tmp_path):
    p, other = measured("ur10e", 10), measured("ur5e", 10)
    written(tmp_path, "ur10e", [*JOINTS, *axes_of("{}1"), *axes_of("{}2")], np.degrees(p.q), other.xyz_mm, other.xyz_mm)
    with refused("table.unclear", "in any reading of the columns,"):
        propose_map([tmp_path / "t.csv"], tmp_path / "arm.yaml")


@pytest.mark.parametrize(
    ("joints_are", "extra"),
    [
        ("first", "uncertainties"), ("in another file", "numbered points"),
    ],
)  # fmt: skip
def test_points_of_a_report_without_a_header_are_found_among_other_numbers(joints_are, extra, tmp_path):
    p, rng = measured("ur10e", 12, 30), np.random.default_rng(13)
    u_mm = rng.uniform(0.01, 0.03, p.xyz_mm.shape) if extra == "uncertainties" else np.empty((30, 0))
    point = [str(k) if extra == "numbered points" else f"p{k}" for k in range(30)]
    joints = [np.degrees(p.q)] if joints_are == "first" else []
    numbers = np.column_stack([*joints, p.xyz_mm, u_mm])
    cells = [",".join(f"{value:.6f}" for value in row) for row in numbers]
    lines = [f"A,Main,{name},{values}" for name, values in zip(point, cells, strict=True)]
    words = written(tmp_path, "ur10e", JOINTS, np.degrees(p.q))
    (tmp_path / "report.txt").write_text("\n".join(["// FRAME: World", "// AXES: X Y Z", *lines]) + "\n")
    files = ["report.txt", "t.csv", "--join", "rows"] if joints_are == "in another file" else ["report.txt"]
    done = ran("import", *files, *words[2:], cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert np.abs(load_measured(tmp_path / "run").table.readings - p.xyz_mm).max() < 1e-5
