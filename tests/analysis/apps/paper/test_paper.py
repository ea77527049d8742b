"""`rig paper`: the table is computed, and its figures are those of docs/paper.md."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest

from analysis.apps.paper import pictures
from analysis.apps.paper.rows import PaperRow, circle, curve_of, repeats, rows_of, sphere, step, typical_seed
from analysis.procedures.simulate import simulate
from rigs.load import load, load_hidden
from tests.support.command_line import json_of

RIG, TEXT = load("paper-errors")


@pytest.fixture(scope="module")
def rows():
    return {(row.where, row.figure): row for row in rows_of(RIG)}


def test_the_ten_reversals_lie_within_one_and_a_half_degrees_and_gamma_has_none(rows):
    turns = [row for (where, _), row in rows.items() if where == "Table 1" and row.place]
    assert len(turns) == 10
    for row in turns:
        assert abs(row.difference) <= 1.5, row
    assert rows["Table 1", "gamma turns back"].ours == "none"


def test_the_rule_by_arithmetic_and_through_the_evaluation(rows):
    rule = [row.ours for (where, _), row in rows.items() if where == "§2.1"]
    e_over_R = 14.142 / 70
    expected = [206 * 14142 / 70 / 3600, np.degrees(e_over_R), np.degrees(np.arcsin(e_over_R))]
    np.testing.assert_allclose(np.array(rule, dtype=float), expected, atol=0.005)


@pytest.mark.parametrize(
    ("where", "figure", "told", "within"),
    [
        # What docs/paper.md tells of the shipped effects.
        ("Fig. 6", "yaw error band, cw", 0.567, 0.005),
        ("Fig. 6", "yaw error band, acw", 0.862, 0.005),
        ("Fig. 10", "roll error band, cw", 1.861, 0.01),
        ("Fig. 10", "roll error band, acw", 1.577, 0.01),
        ("Fig. 11", "roll error band, simulated", 1.686, 0.01),
        ("Fig. 11", "roll largest at", 199, 3),
        ("Fig. 11", "roll smallest at", 18, 3),
        ("Fig. 13", "sphere, measured: radius", 400.191, 0.003),
        ("Fig. 13", "sphere, measured: band", 1.058, 0.01),
        ("Fig. 14", "sphere, simulated: band", 0.928, 0.01),
        ("Fig. 15", "repeatability, uni-directional", 0.266, 0.01),
        ("Fig. 15", "repeatability, bi-directional", 1.554, 0.02),
    ],
)
def test_figures_are_those_of_the_page(rows, where, figure, told, within):
    assert rows[where, figure].ours == pytest.approx(told, abs=within)


def test_rows_of_the_page_are_printed(rows):
    page = (Path(__file__).parents[4] / "docs" / "paper.md").read_text()
    shown = re.findall(r"^\| (?:§|Table|Fig)[^|]*\| ([^|]+) \|", page, re.M)
    assert len(shown) > 10
    assert set(shown) <= {row.figure for row in rows.values()}


def test_theta_jumps_at_237_in_both_directions(rows):
    cw, acw = (rows["Fig. 8", f"yaw jumps at Theta 237°, {direction}"] for direction in ("cw", "acw"))
    assert (cw.ours, acw.ours) == ("-0.45°", "-0.35°")
    assert "1 of 10" in cw.note
    assert "2 of 10" in acw.note


def test_arm_and_circle_are_those_behind_table_1():
    plain = load_hidden("paper-fanuc").apply_to(load("paper-fanuc")[0])
    assert RIG.robot == plain.robot.model_copy(update={"controller": RIG.robot.controller})
    assert RIG.tests.circle == plain.tests.circle


def test_without_effects_nothing_is_left():
    for test in ("yaw", "roll"):
        curve = circle(RIG, test, "acw", ())
        # The eccentricity's second harmonic is all: e²/2R² of a radian.
        assert curve.figures["band_deg"] < 0.01
    ball = sphere(RIG, ())
    assert ball.radius_mm == pytest.approx(400.0, abs=1e-6)
    assert ball.band_mm < 1e-6


def test_a_step_is_measured_in_the_direction_of_travel():
    curve = curve_of(simulate(RIG, "yaw", "acw", None, ()), RIG)
    stepped = dataclasses.replace(curve, residual=np.where(curve.phi > np.radians(240), np.radians(0.3), 0.0))
    assert step(stepped, 237, 6) == pytest.approx(0.3)
    assert step(stepped, 243, -6) == pytest.approx(-0.3)
    assert step(stepped, 357, 6) == pytest.approx(-0.3)


def test_difference_of_places_goes_the_short_way():
    assert PaperRow("", "", 0.0, 359.5, place=True).difference == pytest.approx(-0.5)
    assert PaperRow("", "", "none", "none").difference is None


def test_json_is_the_same_table(rows):
    told = json_of("paper")
    assert told["rig"] == "paper-errors"
    assert [row["ours"] for row in told["rows"]] == [row.ours for row in rows.values()]


def test_data_figures_are_drawn_with_the_figures_of_the_table(rows, tmp_path, monkeypatch):
    charts = pictures.charts_of(RIG, TEXT)
    (bands,) = charts[6]
    for line in bands.lines:
        assert np.ptp(line.y) == pytest.approx(rows["Fig. 6", f"yaw error band, {line.name}"].ours, abs=0.02)
    for number, row in ((13, "sphere, measured: band"), (14, "sphere, simulated: band")):
        sphere_chart, _ = charts[number]
        assert np.ptp(sphere_chart.deviation_mm) == pytest.approx(rows[f"Fig. {number}", row].ours, abs=0.02)
    assert [*charts] == [*pictures.FIGURES]
    monkeypatch.setattr(pictures, "charts_of", lambda rig, text: {number: charts[number] for number in (6, 13)})
    written = pictures.save(RIG, TEXT, list(rows.values()), tmp_path / "pictures")
    assert [int(path.name.split("-")[1]) for path in written] == [6, 13]
    assert all(path.stat().st_size > 10_000 for path in written)


def test_drawn_repeatability_is_typical_of_the_table():
    found = repeats(RIG, RIG.effects)
    seed = typical_seed(found)
    for values in found.values():
        assert abs(values[seed] - values.mean()) < 0.3 * values.std()
