"""Plan of a session: programs with realistic times, short arcs, a place for validation, and further tests."""

import re

import numpy as np
import pytest

from analysis.apps.makers.motion_plan import Arc
from analysis.apps.session.session_plan import (
    BY_HAND,
    ELSEWHERE,
    planned,
    programs_for,
    separating,
    stage_rig,
    stage_text,
)
from analysis.apps.session.session_state import Stage
from analysis.robot.geometry.driven_programs import circle_laps
from rigs.arms import load_arm
from rigs.load import load, parse
from tests.support.refusals import refused

MAIN = Stage(name="yaw", words="the ball")


@pytest.fixture(scope="module")
def rig():
    return load("paper-fanuc")[0]


def test_time_of_a_program_is_that_of_its_motion(rig):
    program = programs_for(rig, MAIN, "yaw")[0]
    stands_s = 6.0
    assert program.seconds == pytest.approx(circle_laps(rig, "acw").end_s + stands_s, rel=0.03)


def test_short_arcs_are_the_same_circle(rig):
    whole, fine = (programs_for(rig, MAIN, "yaw", arc_deg=arc)[1].plan for arc in (90.0, 5.0))
    arcs = [[step for step in plan.steps if isinstance(step, Arc)] for plan in (whole, fine)]
    assert len(arcs[1]) > 15 * len(arcs[0])
    np.testing.assert_allclose(arcs[1][-1].end.T, arcs[0][-1].end.T, atol=1e-6)
    np.testing.assert_allclose(arcs[1][-1].end.q, arcs[0][-1].end.q, atol=1e-6)


def test_judging_place_is_another_and_finds_nothing(rig):
    stages, steps = planned(rig, "faults", 50, BY_HAND, lambda _: None)
    other = next(stage for stage in stages if stage.name == ELSEWHERE)
    assert np.linalg.norm(np.subtract(other.circle.centre_mm, rig.tests.circle.centre_mm)) > 50
    assert other.circle.radius_mm == rig.tests.circle.radius_mm
    assert {step.purpose for step in steps if step.stage == ELSEWHERE} == {"judge", "verify"}
    order = [step.stage for step in steps if step.purpose in ("judge", "verify")]
    assert order == sorted(order, key=[ELSEWHERE, "yaw"].index), "the ball is moved once"


def test_text_of_a_stage_gives_its_rig(rig):
    text = load("paper-fanuc")[1]
    stages, _ = planned(rig, "faults", 50, BY_HAND, lambda _: None)
    for stage in stages:
        assert parse(stage_text(text, stage), "here") == stage_rig(rig, stage)


def test_test_with_another_link_is_not_inserted(rig):
    assert separating(rig, "circle of radius 50 mm", ("yaw",), 3) is None
    assert separating(rig, "circle with the ball 40 mm off axis 6", ("yaw",), 3) is None
    assert separating(rig, "no test of this name", ("yaw",), 3) is None
    found = separating(rig, "hemisphere (radial)", ("yaw",), 3)
    assert [step.test for step in found[1]] == ["radial"]


def test_shortest_session_fits_into_the_time_that_its_refusal_states(rig):
    with refused("usage", "shortest session of this cell takes") as refusal:
        planned(rig, "faults", 10, BY_HAND, lambda _: None)
    shortest_min = float(re.findall(r"[\d.]+", refusal.value.what)[0])
    assert planned(rig, "faults", shortest_min + 0.1, BY_HAND, lambda _: None)
    with refused("usage", "shortest session of this cell takes"):
        planned(rig, "faults", shortest_min - 0.1, BY_HAND, lambda _: None)


def test_a_rig_without_gauges_is_refused():
    bare = parse(f"name: cell\nrobot: {load_arm('ur5').robot.model_dump_json()}\n", "cell.yaml")
    with refused("rig_file.invalid", "have gauges, but a session needs") as refusal:
        planned(bare, "faults", 50, BY_HAND, lambda _: None)
    assert refusal.value.remedy.startswith("measure poses")
