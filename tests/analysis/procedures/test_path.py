from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.procedures import path
from analysis.procedures.checks.places import places_of
from analysis.robot.geometry.iso_cube import Cube
from analysis.runs.tables import PathTable
from rigs.schema.declared_tests import TrackerPose
from tests.support.refusals import refused
from tests.worlds.arms.independent_arm import Array
from tests.worlds.arms.iso_plain import Recorder, cube_places, repeatability

SIDE, CENTRE = 500.0, np.array([600.0, 50.0, 450.0])
LEVEL, RISING = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 1.0]) / np.sqrt(2)
ACROSS = np.cross(LEVEL, RISING)
INSTRUMENT = TrackerPose(xyz_mm=(-1500.0, 900.0, 300.0), rpy_deg=(4.0, -3.0, 75.0))
CUBE = Cube(CENTRE, SIDE, LEVEL, RISING, np.eye(3), np.zeros((5, 6)))
CYCLES = 10


@dataclass(frozen=True)
class Errors:
    """What is planted: the middle of the line bows by bow_mm out of the plane; the circle's radius is grown_mm larger,
    and it is oval by oval_mm; corners are cut by a straight line that begins cut_mm before them, or overrun by over_mm;
    each pass is moved as a whole by scatter_mm."""

    bow_mm: float = 0.0
    grown_mm: float = 0.0
    oval_mm: float = 0.0
    cut_mm: float = 0.0
    over_mm: float = 0.0
    scatter_mm: float = 0.0


def line(errors: Errors) -> Array:
    _, p2, _, p4, _ = cube_places(CENTRE, SIDE)
    share = np.linspace(0, 1, 801)[:, None]
    return p2 + share * (p4 - p2) + errors.bow_mm * np.sin(np.pi * share) * ACROSS


def ring(errors: Errors, radius: float, sense: float = 1.0) -> Array:
    angle = np.linspace(0, 2 * np.pi, 2001)[:, None]
    away = np.cos(angle) * LEVEL + sense * np.sin(angle) * RISING
    return CENTRE + (radius + errors.grown_mm + errors.oval_mm * np.cos(2 * angle)) * away


def rectangle(errors: Errors) -> Array:
    _, p2, p3, p4, p5 = cube_places(CENTRE, SIDE)
    way = [p2]
    for before, corner, after in ((p2, p3, p4), (p3, p4, p5), (p4, p5, p2)):
        old, new = (
            (corner - before) / np.linalg.norm(corner - before),
            (after - corner) / np.linalg.norm(after - corner),
        )
        if errors.cut_mm:
            way += [corner - errors.cut_mm * old, corner + errors.cut_mm * new]
        else:
            way += [corner + errors.over_mm * old, corner + errors.over_mm * old + 20 * new, corner + 30 * new]
    return np.array([*way, p2])


@cache
def recorded(errors: Errors, seed: int = 0, noise_mm: float = 0.0, rate_hz: float = 500.0) -> PathTable:
    rng, tape = np.random.default_rng(seed), Recorder(rate_hz, 250.0)
    _, p2, p3, p4, _ = cube_places(CENTRE, SIDE)
    tape.stand(p2, 2.0)
    last = p2

    def passed(way: Array) -> None:
        nonlocal last
        if np.linalg.norm(way[0] - last) > 5:
            tape.drive(np.array([last, way[0]]))
            tape.stand(way[0], 2.0)
        moved = way + errors.scatter_mm * rng.standard_normal(3)
        tape.drive(moved)
        tape.stand(moved[-1], 2.0)
        last = way[-1]

    for _ in range(CYCLES):
        passed(line(errors))
        passed(np.array([p4, p3, p2]))
    for _ in range(CYCLES):
        passed(rectangle(errors))
    for _ in range(CYCLES):
        passed(ring(errors, 0.4 * SIDE))
        passed(ring(errors, 0.4 * SIDE, -1.0))
    for _ in range(CYCLES):
        passed(ring(errors, 0.04 * SIDE))
    t_s, places = tape.written()
    places = places + noise_mm * rng.standard_normal(places.shape)
    turn = Rotation.from_euler("xyz", INSTRUMENT.rpy_deg, degrees=True)
    return PathTable(t_s, turn.inv().apply(places - np.array(INSTRUMENT.xyz_mm)))


@cache
def slightly_scattered() -> tuple[PathTable, path.PathResult]:
    """A recording without outliers, and its result with a fitted frame."""
    table = recorded(Errors(scatter_mm=0.02), seed=2, noise_mm=0.01)
    return table, path.evaluate(table, CUBE, None, "path")


def test_a_perfect_arm_has_no_error_and_every_cycle_is_found():
    found = path.evaluate(recorded(Errors()), CUBE, INSTRUMENT, "path")
    assert {name: len(one.places) for name, one in found.driven.paths.items()} == dict.fromkeys(
        ("line", "rectangle", "circle", "circle_cw", "small_circle"), CYCLES
    )
    assert all(abs(found.figures[name].value) < 2e-3 for name in found.figures if name[-5:] in ("at_mm", "rt_mm"))
    assert abs(found.figures["d_mm"].value) < 1e-3
    assert found.figures["speed_mm_s"].value == pytest.approx(250.0, rel=1e-3)


def test_accuracy_and_repeatability_are_the_standards():
    """Each pass is moved as a whole, so the distances at a station are those of the shifts across the path."""
    errors = Errors(bow_mm=0.4, grown_mm=0.15, scatter_mm=0.05)
    found = path.evaluate(recorded(errors, seed=4), CUBE, INSTRUMENT, "path").figures
    rng = np.random.default_rng(4)
    lines, around = [], []
    for _ in range(CYCLES):
        lines.append(0.05 * rng.standard_normal(3))
        rng.standard_normal(3)
    for _ in range(CYCLES):
        rng.standard_normal(3)
    for _ in range(CYCLES):
        around.append(0.05 * rng.standard_normal(3))
        rng.standard_normal(3)
    _, p2, _, p4, _ = cube_places(CENTRE, SIDE)
    along = (p4 - p2) / np.linalg.norm(p4 - p2)
    across = np.array([one - (one @ along) * along for one in lines])
    assert found["line_rt_mm"].value == pytest.approx(repeatability(across), abs=2e-3)
    middle = max(np.linalg.norm(across.mean(axis=0) + 0.4 * np.sin(np.pi * s) * ACROSS) for s in np.linspace(0, 1, 401))
    assert found["line_at_mm"].value == pytest.approx(middle, abs=2e-3)
    rt, at = [], []
    for angle in np.linspace(0.02, 0.98, 200) * 2 * np.pi:
        out = np.cos(angle) * LEVEL + np.sin(angle) * RISING
        ahead = -np.sin(angle) * LEVEL + np.cos(angle) * RISING
        own = np.array([one - (one @ ahead) * ahead for one in around])
        rt.append(repeatability(own))
        at.append(np.linalg.norm(own.mean(axis=0) + 0.15 * out))
    assert found["circle_rt_mm"].value == pytest.approx(max(rt), abs=2e-3)
    assert found["circle_at_mm"].value == pytest.approx(max(at), abs=2e-3)


def test_fitted_frame_is_found_and_reported():
    errors = Errors(bow_mm=0.4, grown_mm=0.15, oval_mm=0.05, scatter_mm=0.03)
    table = recorded(errors, seed=2, noise_mm=0.01)
    by_frame, by_fit = (path.evaluate(table, CUBE, one, "path") for one in (INSTRUMENT, None))
    assert any("best fit" in note for note in by_fit.notes) and not any("best fit" in note for note in by_frame.notes)
    assert np.abs(by_fit.driven.T_world_instrument - by_frame.driven.T_world_instrument).max() < 0.5
    assert by_fit.figures["line_at_mm"].value < by_frame.figures["line_at_mm"].value
    for name in ("line_rt_mm", "circle_rt_mm", "f_max_mm", "d_mm"):
        assert by_fit.figures[name].value == pytest.approx(by_frame.figures[name].value, abs=5e-3), name


def test_corners_are_cut_and_overrun_as_the_standard_measures_it():
    cut = path.evaluate(recorded(Errors(cut_mm=4.0), rate_hz=1000.0), CUBE, INSTRUMENT, "path").figures
    # A line from 4 mm before the corner to 4 mm behind it passes it at 4 / sqrt(2).
    assert cut["corner_round_mm"].value == pytest.approx(4.0 / np.sqrt(2), abs=0.01)
    assert cut["corner_overshoot_mm"].value < 0.01
    over = path.evaluate(recorded(Errors(over_mm=0.6), rate_hz=1000.0), CUBE, INSTRUMENT, "path").figures
    assert over["corner_overshoot_mm"].value == pytest.approx(0.6, abs=0.02)


def test_f_and_d_of_the_circle_driven_both_ways():
    errors = Errors(grown_mm=-0.12, oval_mm=0.04)
    found = path.evaluate(recorded(errors), CUBE, None, "path").figures
    assert found["d_mm"].value == pytest.approx(-0.12, abs=2e-3)
    assert found["f_max_mm"].value == pytest.approx(-0.12 + 0.04, abs=2e-3)
    assert found["f_min_mm"].value == pytest.approx(-0.12 - 0.04, abs=2e-3)


def test_missing_and_sparse_paths_are_reported():
    table = recorded(Errors())
    line = table.t_s < 40.0
    found = path.evaluate(PathTable(table.t_s[line], table.xyz_mm[line]), CUBE, None, "path")
    assert set(found.driven.paths) == {"line"}
    assert any("small circle 0 times" in note for note in found.notes)
    found = path.evaluate(recorded(Errors(), rate_hz=10.0), CUBE, None, "path")
    assert any("too few" in note for note in found.notes)


def test_times_in_another_unit_are_doubted_by_the_speed():
    table = recorded(Errors())
    for share in (10.0, 1e3):
        found = path.evaluate(PathTable(table.t_s * share, table.xyz_mm), CUBE, None, "path", 250.0)
        assert any("check that t_s is in s" in note for note in found.notes) == (share == 1e3)


@pytest.mark.parametrize(
    ("scale", "cube", "code"),
    [
        (1e-3, CUBE, "rig_file.invalid"),
        (1.0, replace(CUBE, side_mm=300.0), "rig_file.invalid"),
        (1.0, replace(CUBE, rising=-RISING), "rig_file.invalid"),
    ],
)
def test_a_recording_of_something_else_is_refused(scale, cube, code):
    table = recorded(Errors())
    instrument = INSTRUMENT if cube.side_mm == SIDE and scale == 1.0 else None
    with refused(code):
        path.evaluate(PathTable(table.t_s, scale * table.xyz_mm), cube, instrument, "path")


def test_spike_is_ignored_and_reported():
    sound, truth = slightly_scattered()
    xyz = sound.xyz_mm.copy()
    row = int(np.searchsorted(sound.t_s, 3.3))
    assert np.linalg.norm(np.diff(xyz[row - 3 : row + 3], axis=0), axis=1).min() > 0.3  # it moves
    xyz[row] += 3.7 * ACROSS
    found = path.evaluate(replace(sound, xyz_mm=xyz), CUBE, None, "path")
    assert found.notes[0].startswith(f"1 of {len(xyz)} places ")
    assert str(row + 1) in found.notes[0] and "ignored" in found.notes[0]
    for name in ("line_rt_mm", "line_at_mm", "circle_rt_mm"):
        assert found.figures[name].value == pytest.approx(truth.figures[name].value, abs=2e-3)
    assert not any("outlier" in note or "repeat" in note for note in truth.notes)


def test_repeated_places_are_ignored_and_reported():
    sound, truth = slightly_scattered()
    xyz, row = sound.xyz_mm.copy(), int(np.searchsorted(sound.t_s, 3.3))
    count = 150
    xyz[row : row + count] = xyz[row - 1]
    found = path.evaluate(replace(sound, xyz_mm=xyz), CUBE, None, "path")
    (note,) = [one for one in found.notes if "repeat" in one]
    assert note.startswith(f"{count} of {len(xyz)} places") and f"from row {row + 1} on" in note
    assert found.figures["line_rt_mm"].value == pytest.approx(truth.figures["line_rt_mm"].value, rel=0.15)


@pytest.mark.parametrize("digits", [1, 4])
def test_sound_places_are_neither_wild_nor_repeated(digits):
    table = recorded(Errors(cut_mm=2.0, scatter_mm=0.05), seed=3, noise_mm=0.02)
    assert not places_of(replace(table, xyz_mm=np.round(table.xyz_mm, digits))).words
