import pytest

from analysis import evaluate, simulate
from rigs.load import SHIPPED, load, parse
from rigs.problems import RigFileError
from rigs.schema.limits import (
    CircleLimits,
    Limit,
    Limits,
    RadialLimits,
    RepeatabilityLimits,
    limits_of_tolerance,
    offered_tolerance_mm,
)

TEXT = (SHIPPED / "paper-fanuc.yaml").read_text().partition("# 0.25 mm is allowed")[0]
"""A rig file without limits."""


def test_one_number_is_a_fail_and_two_are_watch_and_fail():
    limits = parse(
        f"{TEXT}\nlimits:\n  yaw: {{band_deg: {{watch: 0.1, fail: 0.2}}}}\n  radial: {{band_mm: 1}}\n", "x"
    ).limits
    assert limits.of("yaw", "band_deg") == Limit(watch=0.1, fail=0.2)
    assert limits.of("radial", "band_mm") == Limit(fail=1.0)
    assert limits.of("roll", "band_deg") is None
    assert limits.of("yaw", "amplitude_deg") is None


@pytest.mark.parametrize(
    ("name", "tolerance_mm", "rp_mm"),
    [("paper-fanuc", 0.25, None), ("paper-errors", 0.25, None), ("ur10e-cell", 0.25, 0.05), ("ur10-cell", 0.5, 0.1)],
)
def test_the_shipped_rigs_have_the_limits_that_rig_offers(name, tolerance_mm, rp_mm):
    rig = load(name)[0]
    assert rig.tests.circle is not None and offered_tolerance_mm(rp_mm) == tolerance_mm
    assert rig.limits == limits_of_tolerance(tolerance_mm, rig.tests.circle.radius_mm, rp_mm)


def test_data_sheet_supplies_missing_limits():
    limits = load("ur10e-cell")[0].limits
    assert limits.of("repeatability", "rp_mm") == Limit(fail=0.05)
    assert limits.from_data_sheet("repeatability", "rp_mm")
    own = Limits(data_sheet_rp_mm=0.05, repeatability=RepeatabilityLimits(rp_mm=Limit(fail=0.02)))
    assert own.of("repeatability", "rp_mm") == Limit(fail=0.02)
    assert not own.from_data_sheet("repeatability", "rp_mm")


@pytest.mark.parametrize(
    ("limits", "told"),
    [
        ("{yaw: {band_dge: 0.1}}", "band_deg?"),
        ("{jaw: {}}", "yaw?"),
        ("{yaw: {band_deg: {watch: 0.2, fail: 0.1}}}", "below fail 0.1"),
        ("{yaw: {band_deg: {}}}", "watch, fail"),
        ("{yaw: {band_deg: 0}}", "greater than 0"),
        ("{yaw: {band_deg: narrow}}", "mapping"),
        ("{yaw: {band_deg: {fail: .nan}}}", "finite"),
    ],
)
def test_a_limit_that_cannot_be_is_one_line(limits, told):
    with pytest.raises(RigFileError) as caught:
        parse(f"{TEXT}\nlimits: {limits}\n", "cell.yaml")
    assert len(caught.value.problems) == 1
    assert told in str(caught.value)


@pytest.mark.parametrize(
    ("value", "u", "standing", "straddled"),
    [
        (0.4, 0.04, "pass", False),
        (0.45, 0.04, "watch", True),  # below watch, yet U reaches over it
        (0.7, 0.04, "watch", False),
        (1.05, 0.04, "watch", True),  # above fail, yet not proven
        (1.1, 0.04, "fail", False),
        (-1.1, 0.04, "fail", False),
        (0.4, float("nan"), "watch", True),
        (9.0, float("nan"), "watch", True),
    ],
)
def test_a_figure_is_decided_with_its_uncertainty(value, u, standing, *, straddled):
    limit = Limit(watch=0.5, fail=1.0)
    assert limit.standing(value, u) == standing
    assert limit.straddled(value, u) == straddled


def test_missing_fail_or_watch_has_its_default():
    assert Limit(watch=0.5).standing(9.0, 0.1) == "watch"
    assert Limit(fail=0.5).standing(0.4, 0.04) == "pass"
    assert Limit(fail=0.5).standing(0.6, 0.04) == "fail"


@pytest.mark.parametrize(
    ("test", "named"),
    [("yaw", CircleLimits), ("radial", RadialLimits), ("repeatability", RepeatabilityLimits)],
)
def test_every_limit_belongs_to_a_figure(test, named):
    figures = set(evaluate(simulate("ur10e-cell", test, "acw" if test == "yaw" else None)).figures)
    of_pairs = {"hysteresis_max_deg", "hysteresis_mean_deg", "hysteresis_max_mm", "hysteresis_mean_mm", "range_deg"}
    of_many_visits = {"rp_mm", "rp_mean_mm"}
    of_motors = {f"friction_j{axis}_a" for axis in range(1, 7)}
    assert set(named.model_fields) - of_pairs - of_many_visits - of_motors <= figures
