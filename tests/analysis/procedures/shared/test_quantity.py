import numpy as np
import pytest
from scipy.stats import t

from analysis.procedures.pooled import figures_between_runs
from analysis.procedures.results import with_certificates
from analysis.procedures.shared.quantity import Quantity, figures_of, student_factor
from analysis.runs.noise.certificate import NO_CERTIFICATE, Systematic
from rigs.load import load


@pytest.mark.parametrize("u", [0.0, 0.012, float("inf")])
def test_a_small_negative_value_is_no_negative_zero(u):
    rounded = Quantity(0.0, u, "mm").rounded(-0.00001)
    assert float(rounded) == 0 and not rounded.startswith("-")
    assert Quantity(0.0, u, "mm").rounded(-0.06).startswith("-0.06")


@pytest.mark.parametrize(
    ("figure", "shown"),
    [
        (Quantity(0.330224, 0.00092, "deg"), "0.33022 ± 0.00092 °"),
        (Quantity(400.19231, 0.0111, "mm"), "400.192 ± 0.011 mm"),
        (Quantity(165.0401, 15.2, "deg"), "165 ± 15 °"),
        (Quantity(165.0401, 0.0015, "deg"), "165.04 ± 0.01 °"),  # no reader looks for a place so closely
        (Quantity(0.019999, 0.000016, "deg"), "0.02000 ± 0.00002 °"),
        (Quantity(0.677325, 0.000025, "mm"), "0.6773 ± 0.0001 mm"),  # upwards: a u is never stated too small
        (Quantity(94.6, 59.1, "ms"), "95 ± 59 ms"),
    ],
)
def test_figure_has_two_digits_of_its_u_at_most(figure, shown):
    assert str(figure) == shown


def test_spread_below_its_digits_is_not_zero():
    figure = Quantity(0.6773, 0.0007, "mm")
    sizes = (0.000004, 0.0012, 0.0)
    assert [figure.rounded_size(size) for size in sizes] == ["< 0.0001", "0.0012", "0.0000"]


@pytest.mark.parametrize("name", ["shift_deg", "distance_shift_deg", "max_at_deg"])
@pytest.mark.parametrize("value", [-179.99, -90.0, 0.0, 45.0, 179.99, 180.0])
def test_an_angle_around_the_circle_is_as_sure_wherever_it_is(name, value):
    drawn = value + np.random.default_rng(1).normal(0, 0.1, 4000)
    drawn = np.degrees(np.angle(np.exp(1j * np.radians(drawn))))  # as an arctangent has it
    figure = figures_of({name: value}, {name: drawn}, 1)[name]
    assert figure.value == value and figure.u == pytest.approx(0.1, rel=0.1)


def test_mean_angle_wraps_like_a_single_one():
    for name, expected in (("shift_deg", -179.9), ("max_at_deg", 180.1)):
        runs = [{name: Quantity(value, 0.1, "deg")} for value in (179.9, -179.7)]
        assert figures_between_runs(runs)[name].mean.value == pytest.approx(expected)


@pytest.mark.parametrize("freedom", [1, 2, 5, 30])
def test_two_u_of_few_runs_follow_students_law(freedom):
    assert 1 - 2 * t.sf(2 * student_factor(freedom), freedom) == pytest.approx(0.9545)


def test_without_certificates_nothing_changes_and_ball_and_link_enter_where_they_count():
    rig, _ = load("ur10e-cell")
    names = ("radius_mm", "ap_mm", "centre_x_mm", "spread_mm")
    figures = {name: Quantity(1.0, 0.003, "mm") for name in names}
    assert with_certificates(figures, NO_CERTIFICATE, rig, "radial") is figures
    found = with_certificates(figures, Systematic((0.0,), 0.001, 0.004), rig, "radial")
    assert found["radius_mm"].u == found["ap_mm"].u == pytest.approx(np.sqrt(9 + 16 + 1) / 1000)
    assert found["centre_x_mm"].u == pytest.approx(np.sqrt(9 + 2) / 1000)
    assert found["spread_mm"].u == 0.003  # at one target the link touches the ball at one place
