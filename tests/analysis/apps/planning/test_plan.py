from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from analysis.apps.planning.capability import plan
from analysis.apps.planning.plan_report import plan_answer
from analysis.diagnosis.fit.background import background_of
from analysis.diagnosis.fit.candidates import HEALTHY, columns_for
from analysis.diagnosis.fit.refine import refine
from analysis.diagnosis.plan.expected import SEPARABLE, ExpectedPosterior, expected_posterior, planned_blocks
from analysis.diagnosis.plan.further_tests import PossibleTest, further_tests, possible_tests, sigma_between
from rigs.arms import load_arm
from rigs.effects import Backlash, JointOffset, LinkGeometry, TransmissionError, healthy_size, size_field
from rigs.errors import FileError
from rigs.schema.declared_tests import KnownSocketDistance, Touch
from rigs.schema.effect import name_of, scaled, size_of
from rigs.schema.vocabulary import TestName
from tests.support.answers import printed
from tests.support.changed_rigs import with_circle, with_robot, with_tests
from tests.support.command_line import failure_of, json_of, ran
from tests.support.diagnosis_cells import RIG, plan_of_circles, plan_without_further_tests
from tests.support.nightly import cases

NO_CIRCLE = with_tests(RIG, circle=None)
CIRCLE = ("yaw", "roll")
FAULTS = [JointOffset(axis=5, offset_deg=0.1), LinkGeometry(axis=6, field="a", delta=1.0)]


@pytest.fixture(scope="module")
def circle_alone():
    return plan_of_circles()


@cache
def _expected(tests: tuple[TestName, ...], runs: int = 3) -> ExpectedPosterior:
    return expected_posterior(*planned_blocks(RIG, tests, runs))


@cache
def _beside_a_hemisphere() -> list[PossibleTest]:
    """Further tests possible for an arm whose rig file has a hemisphere but no circle."""
    return possible_tests(NO_CIRCLE, ("radial",), *planned_blocks(NO_CIRCLE, ("radial",), 3))[0]


def test_80_columns_hold_every_size_of_the_table_of_joints_whole():
    circle_alone = plan_without_further_tests()
    joints = printed(plan_answer(circle_alone)).partition("links")[2].partition("Other errors")[0]
    assert "…" not in joints
    for one in circle_alone.detectabilities:
        if one.name.startswith(("joint_offset", "backlash")) and not one.hidden:
            assert f"{one.limit:.2g}" in joints, one.name


def test_another_radius_separates_the_zero_of_axis_5_from_a5(
    circle_alone,
):
    (pair,) = (pair for pair in circle_alone.pairs if set(pair.names) == {"joint_offset 5", "link_geometry 6.a"})
    assert pair.sigma < SEPARABLE
    assert any({"joint_offset 5", "link_geometry 6.a"} <= set(group) for group in circle_alone.groups)
    helps = {one.test: one.sigma for one in pair.further}
    larger = pair.further[0].test
    assert "radius 140 mm, 100 mm" in larger
    assert pair.further[0].sigma > 2 * SEPARABLE
    # Neither speed nor place nor repeats do.
    for test in ("circle at 100 mm/s", "circle 100 mm nearer to axis 1", "repeatability"):
        assert helps[test] < min(SEPARABLE, helps[larger]), test


def test_absorbed_and_effectless_errors_have_a_reason(
    circle_alone,
):
    hidden = {one.name: one for one in circle_alone.hidden}
    assert "set-up" in hidden["joint_offset 1"].hidden
    assert "gravity" in hidden["compliance 1"].hidden
    assert "healthy arm" in hidden["time_lag"].hidden
    assert "axis 6" in hidden["compliance 6"].hidden
    # The gauges' zeros hold the tool's length on a circle; a hemisphere has it in its radius and its ball.
    assert hidden["link_geometry 6.d"].further[0].test == "hemisphere (radial)"
    assert "joint_offset 3" not in hidden


def test_neighbours_that_are_one_thing_are_parted_by_no_test(circle_alone):
    (pair,) = (pair for pair in circle_alone.pairs if pair.names == ("link_geometry 2.d", "link_geometry 3.d"))
    assert pair.further and max(one.sigma for one in pair.further) < 0.3


@pytest.mark.parametrize(
    "fault",
    cases(
        [
            JointOffset(axis=3, offset_deg=0.2),
            LinkGeometry(axis=4, field="a", delta=2.0),
            Backlash(axis=3, width_deg=0.1, transit=0.2),
        ],
        lambda fault: isinstance(fault, Backlash),
    ),
    ids=lambda fault: fault.effect,
)
def test_planned_u_agrees_with_a_fit_of_faulty_readings(fault):
    expected = _expected(CIRCLE)
    columns = columns_for(expected.linear, expected.candidates)
    variance = columns.variance(HEALTHY)
    for form in columns.forms:
        if form.name == name_of(fault):
            variance[list(form.columns)] = 0.0
    background = background_of(columns, np.ones(len(expected.linear.y)), variance)
    found = refine(expected.linear.simulated_with((fault,)), background, [scaled(fault, 0.9)])
    one = next(one for one in expected.candidates if one.name == name_of(fault))
    times = size_of(fault)
    told = expected.sd(one, times) * healthy_size(fault)
    assert found.fitted_sd(0)[size_field(fault)] == pytest.approx(told, rel=0.25)


def test_eccentric_ball_makes_axis_6_detectable(circle_alone):
    (spike,) = (one for one in circle_alone.hidden if one.name == "reversal_spike 6")
    assert "40 mm off axis 6" in spike.further[0].test


def test_undrivable_test_is_reported_and_not_advised(monkeypatch):
    monkeypatch.setattr("analysis.diagnosis.plan.further_tests.ExpectedPosterior", lambda *_: None)
    slow = [axis.model_copy(update={"speed_deg_s": 80.0}) for axis in RIG.robot.axes]
    rig = with_robot(RIG, axes=tuple(slow))
    found, impossible = possible_tests(rig, ("roll",), *planned_blocks(rig, ("roll",), 3))
    ((test, reason),) = impossible
    assert test == "circle at 100 mm/s" and "80°/s" in reason
    assert len(found) > 5 and test not in [one.test for one in found]


def test_a_rival_may_take_any_size_sign_and_phase():
    gear = TransmissionError(axis=4, order=2, amplitude_deg=0.01)
    for one, other in (
        (gear, gear.model_copy(update={"phase_deg": 100.0, "amplitude_deg": 0.02})),
        (LinkGeometry(axis=2, field="d", delta=0.2), LinkGeometry(axis=3, field="d", delta=-0.5)),
    ):
        assert sigma_between(one, other)(_beside_a_hemisphere()[0]) < 0.05
    large = gear.model_copy(update={"amplitude_deg": 0.1})
    assert sigma_between(large, large.model_copy(update={"order": 3.0}))(_beside_a_hemisphere()[0]) > SEPARABLE


def test_effects_of_a_pose_test_are_separated_by_programmed_tests():
    possible = possible_tests(NO_CIRCLE, ["pose"], [], {})[0]
    sigmas = {test.test: sigma_between(*FAULTS[:2])(test) for test in possible}
    assert "radial" in " ".join(sigmas) and max(sigmas.values()) > 0


def test_a_circle_that_cannot_be_driven_is_refused():
    with pytest.raises(FileError, match="limits"):
        plan(with_circle(RIG, radius_mm=140.0), CIRCLE)


def test_the_command_prints_words_or_one_object(monkeypatch, circle_alone):
    monkeypatch.setattr(
        "analysis.apps.planning.capability.plan",
        lambda *_: replace(circle_alone, impossible=(("a flight", "no wings"),)),
    )
    monkeypatch.setenv("COLUMNS", "140")
    told = ran("plan paper-fanuc --tests yaw,roll")
    assert "further test: hemisphere (radial)" in told.stdout
    assert "length a of axis 6 (a5)" in told.stdout
    assert " a flight: no wings" in told.stdout
    assert "Assumed noise" in told.stdout and "24.5 µm" in " ".join(told.stdout.split())
    assert "of 92 possible errors" in told.stdout  # a gear is one name, regardless of its orders
    found = json_of("plan paper-fanuc --tests yaw,roll")
    assert {"tests", "runs", "effects", "groups", "pairs", "further", "not_possible"} <= found.keys()
    by_name = {effect["name"]: effect for effect in found["effects"]}
    assert by_name["joint_offset 1"]["limit"] is None
    assert by_name["joint_offset 3"]["unit"] == "deg"


def test_unmeasured_socket_distance_is_a_further_test():
    apart = KnownSocketDistance(between=("A", "B"), distance_mm=100.0)
    for distances in ((), (apart,)):
        rig = with_tests(RIG, touch=Touch(sockets=("A", "B"), distances=distances))
        words = "\n".join(further.choices[0][0] for further in further_tests(rig, ("touch",)))
        assert ("between A and B (tests.touch.distances)" in words) == (not distances)


def test_plan_of_touches_names_neither_circles_nor_gauges(tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "140")
    (tmp_path / "cell.yaml").write_text(
        f"name: cell\n{load_arm('franka-fr3').text}tests: {{touch: {{sockets: [A, B]}}}}\n"
    )
    said = ran(f"plan {tmp_path}/cell.yaml --tests touch").stdout
    assert "touch: 3 runs" in said
    assert not [word for word in ("circle", "gauge") if word in said]


def test_an_unknown_test_is_refused_in_one_line():
    assert failure_of("plan paper-fanuc --tests yaw,jaw") == (2, "usage")
