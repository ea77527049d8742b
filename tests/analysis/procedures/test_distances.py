import dataclasses

import numpy as np
import pytest

from analysis.procedures import radial, repeatability
from analysis.procedures.shared.test_kind import evaluate
from analysis.procedures.simulate import simulate
from rigs.load import load
from tests.support.refusals import refused
from tests.worlds.planted import closed_forms as planted
from tests.worlds.planted import targets
from tests.worlds.planted.targets import Stops

TABLE = planted.hemisphere()


def _radial(g: np.ndarray, u_mm: float = 0.0, **changes: object) -> radial.RadialResult:
    table = dataclasses.replace(planted.with_readings(TABLE, g), **changes)
    return radial.evaluate(table, 400.0, u_mm)


def test_a_moved_sphere_is_found_with_centre_and_radius():
    d = planted.directions(TABLE)
    centre, radius = np.array([0.5, -0.3, 0.2]), 400.192
    along = d @ centre
    g = along + np.sqrt(along**2 + radius**2 - centre @ centre) - 400.0  # where a ray from B meets the sphere
    result = _radial(g)
    found = [result.figures[f"centre_{axis}_mm"].value for axis in "xyz"]
    assert found == pytest.approx(centre, abs=1e-6)
    assert result.figures["radius_mm"].value == pytest.approx(radius, abs=1e-6)
    assert result.figures["band_mm"].value < 0.002
    assert result.figures["held_band_mm"].value == pytest.approx(np.ptp(g), abs=0.002)
    assert result.figures["held_radius_mm"].value == pytest.approx(400 + g.mean(), abs=1e-3)


def test_a_bad_target_is_named_and_left_out_and_no_other():
    g = planted.true_radial(TABLE)
    clean = _radial(g)
    assert clean.used.all()
    assert clean.notes == ()
    for off in (4.0, -30.0):
        result = _radial(g + off * (TABLE.target == 12))
        assert list(result.cells.target[~result.used]) == [12]
        assert "target 12 ignored" in result.notes[0]
        assert result.figures["radius_mm"].value == pytest.approx(clean.figures["radius_mm"].value, abs=0.05)
    two = _radial(g + 4.0 * np.isin(TABLE.target, (12, 13)))
    assert set(two.cells.target[~two.used]) == {12, 13}


@pytest.mark.parametrize("name", ["paper-fanuc", "paper-errors"])
def test_plays_leave_no_target_out_but_a_wrong_place_is(name):
    """Backlash produces two groups of errors, the smaller of only a few targets. These are errors of the robot, not
    outliers.
    """
    rig, _ = load(name)
    table = simulate(rig, "radial", None, 0)
    found = evaluate(table, rig, 0.0, name)
    assert found.used.all(), found.notes
    found = evaluate(dataclasses.replace(table, g_mm=table.g_mm + 5.0 * (table.target == 16)), rig, 0.0, name)
    assert list(found.cells.target[~found.used]) == [16]


def test_a_target_that_the_hemisphere_does_not_have_is_refused():
    rig, _ = load("paper-fanuc")
    for test in ("radial", "repeatability"):
        table = simulate(rig, test, None, 1)
        wrong = dataclasses.replace(table, target=np.where(np.arange(len(table.target)) == 4, 38, table.target))
        with refused("table.invalid", "is not one of the"):
            evaluate(wrong, rig, 0.0, "t")


def test_one_visit_has_an_assumed_scatter():
    result = _radial(planted.true_radial(TABLE), 0.0005)
    assert {figure.noise for figure in result.figures.values()} == {"assumed"}
    assert any("assumed" in note for note in result.notes)
    assert 0.001 < result.figures["held_radius_mm"].u < 0.02


def test_repeatability_keeps_the_drift_between_the_visits():
    """ISO 9283, 7.2.2, takes the poses as they were attained: by a steady drift of d from visit to visit, d, 0 and d
    from their mean."""
    once = planted.hemisphere()
    rows = np.tile(np.arange(len(once.g_mm)), 3)
    part = {name: getattr(once, name)[rows] for name in ("target", "polar", "azimuth", "orientation", "q")}
    t_s, step = 4.0 * np.arange(len(rows)), 0.02
    g = np.random.default_rng(5).normal(0, 0.0005, len(rows)) + 3 * step * t_s / t_s[-1]
    found = radial.evaluate(dataclasses.replace(once, **part, t_s=t_s, g_mm=g), 400.0, 0.0005).figures["rp_mean_mm"]
    drifted = np.array([step, 0.0, step])
    assert found.value == pytest.approx(drifted.mean() + 3 * drifted.std(ddof=1), rel=0.05)
    assert found.u < 0.1 * found.value  # the drift is no scatter


def test_nearly_planar_targets_leave_out_undetermined_figures():
    rows = np.degrees(TABLE.polar).round() == 60
    part = {name: getattr(TABLE, name)[rows] for name in ("target", "polar", "azimuth", "orientation", "t_s", "q")}
    result = _radial(planted.true_radial(TABLE)[rows], **part)
    assert not {"centre_z_mm", "radius_mm"} & result.figures.keys()
    assert {"centre_x_mm", "band_mm", "held_radius_mm"} <= result.figures.keys()
    assert any(note.startswith("centre_z_mm, radius_mm ignored") for note in result.notes)


def test_too_few_targets_are_refused():
    rows = TABLE.target <= 5
    part = {name: getattr(TABLE, name)[rows] for name in ("target", "polar", "azimuth", "orientation", "t_s", "q")}
    with refused("readings.too_few", "targets, too few for a sphere"):
        _radial(planted.true_radial(TABLE)[rows], **part)


def test_invalid_radial_run_is_refused():
    g = planted.true_radial(TABLE)
    for code, changes in (
        ("readings.unsuitable", {"g_mm": np.zeros_like(g)}),
        ("table.invalid", {"g_mm": np.where(np.arange(len(g)) == 3, np.nan, g)}),
        ("table.invalid", {"g_mm": np.full(len(g), np.nan)}),
        ("table.unclear", {"g_mm": g + 400}),
        ("table.unclear", {"polar": np.degrees(TABLE.polar)}),
        ("table.invalid", {"polar": TABLE.polar + 0.1 * (np.arange(len(g)) == 1)}),
    ):
        with refused(code):
            _radial(**{"g": g} | changes) if "g_mm" not in changes else _radial(changes["g_mm"])
    with refused("rig_file.invalid", "mm is impossible"):
        radial.evaluate(planted.with_readings(TABLE, g), 0.0, 0.0005)


def test_repeatability_by_hand():
    """One target: out 1, 2, 3, in 11, 12, 14: ranges 2, 3 and 13; s 1 and 1.5275; B 10.3333."""
    g = np.array([[[1.0, 11.0], [2.0, 12.0], [3.0, 14.0]]])
    result = repeatability.evaluate(planted.repeatability_table(g), 0.0005)
    value = {name: figure.value for name, figure in result.figures.items()}
    assert (value["uni_mm"], value["uni_mean_mm"], value["bi_mm"]) == (3.0, 2.5, 13.0)
    assert value["reversal_mean_mm"] == pytest.approx(37 / 3 - 2)
    s = np.std([11, 12, 14], ddof=1)
    assert value["r_out_mm"] == pytest.approx(4.0)
    assert value["r_in_mm"] == pytest.approx(4 * s)
    assert value["r_mm"] == pytest.approx(2 + 2 * s + 31 / 3)
    away = np.abs(np.array([11, 12, 14]) - 37 / 3)
    assert value["rp_mm"] == pytest.approx(away.mean() + 3 * away.std(ddof=1))
    assert result.notes == ("3 readings a side; ISO 230-2 requires 5, ISO 9283 requires 30",)
    assert result.figures["uni_mm"].samples == 6


def test_repeatability_ignores_one_sided_targets_and_needs_one_two_sided():
    g = np.random.default_rng(1).normal(0, 0.1, (3, 3, 2))
    table = planted.repeatability_table(g)
    keep = ~((table.target == 2) & (table.approach == "in"))
    part = {name: getattr(table, name)[keep] for name in ("target", "approach", "round", "t_s", "q", "g_mm")}
    result = repeatability.evaluate(dataclasses.replace(table, **part), 0.0005)
    assert list(result.targets) == [1, 3]
    assert "target 2 ignored" in result.notes[0]
    for code, changes in (
        ("table.invalid", {"approach": np.full(18, "out")}),
        ("table.invalid", {"approach": np.full(18, "left")}),
        ("readings.unsuitable", {"g_mm": np.ones(18)}),
    ):
        with refused(code):
            repeatability.evaluate(dataclasses.replace(table, **changes), 0.0005)


COARSE = Stops(scatter_mm=(0.002, 0.002), white_mm=0.0003, step_mm=0.010)


def test_uncertainties_include_the_step_of_a_coarse_gauge():
    within: dict[str, list[bool]] = {}
    for seed in range(30):
        rng = np.random.default_rng(seed)
        expected = targets.draw_errors(rng)
        twice = np.tile(expected, 2)
        g_mm = targets.read(rng, COARSE, targets.scattered(rng, COARSE, twice, np.full(len(twice), 0.002)))
        found = radial.evaluate(targets.visited(2, g_mm), 400.0, 0.0005, orientations=3)
        assert any(note.startswith("readings step by 10 µm") for note in found.notes)
        for name, value in targets.true_radial(expected).items():
            within.setdefault(name, []).append(abs(found.figures[name].value - value) <= 2 * found.figures[name].u)
    assert {name: float(np.mean(held)) >= 0.85 for name, held in within.items()} == dict.fromkeys(within, True)
