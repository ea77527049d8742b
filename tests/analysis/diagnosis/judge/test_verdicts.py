from dataclasses import replace
from datetime import date

import pytest

from analysis.diagnosis.diagnose import diagnose
from analysis.diagnosis.evidence.gather import prepare_runs
from analysis.diagnosis.evidence.setups import FittedRuns
from analysis.diagnosis.fit.refine import size_limits
from analysis.diagnosis.judge.doubts import doubts_of_limits
from analysis.diagnosis.judge.named import Named
from analysis.diagnosis.judge.result import Gap
from analysis.diagnosis.judge.verdict import Gaps, accuracy_of, standing_within
from rigs.effects import Backlash, ClockRate, JointOffset, LinkGeometry
from rigs.schema.effect import EffectProvenance, name_of
from tests.support.diagnosis_cells import RIG, circles, found_in


def test_a_healthy_robot_draws_no_name():
    found = diagnose(RIG, circles(seed=11), (), (), lambda doing: None, 0.0)
    assert (found.accuracy.standing, found.accuracy.limit) == ("fail", "tolerance")
    assert found.condition == "nothing_unusual"
    assert found.standing == () and found.next_test is None
    assert found.repeated and found.doubts == ()
    assert found.train.before_um < 2 * found.train.noise_floor_um


def test_a_diagnosis_goes_on_about_effects_that_an_earlier_one_found():
    there = (Backlash(axis=1, width_deg=0.02), LinkGeometry(axis=3, field="d", delta=0.1), ClockRate(ppm=200))
    origin = EffectProvenance(date=date(2026, 11, 2), runs=("yaw-cw-0",), sd={"size": 0.001})
    known = tuple(one.model_copy(update={"found": origin}) for one in there)
    found = diagnose(RIG.model_copy(update={"effects": known}), circles(there, seed=14), (), (), lambda doing: None)
    assert found.condition == "nothing_unusual" and not found.standing


def test_a_tolerance_judges_the_arm_as_it_drives_without_the_model_of_its_rig_file():
    zero = (JointOffset(axis=3, offset_deg=0.12),)
    (runs,), _ = prepare_runs(RIG.model_copy(update={"effects": zero}), circles(zero, seed=14)[:1])
    used = FittedRuns(runs)
    assert used.residual_um(()) < 30 and standing_within(30.0, used) == ("fail", "tolerance")
    assert standing_within(1000.0, used) == ("pass", "tolerance")


def test_a_name_that_ends_at_the_limit_of_its_size_is_doubted():
    most = size_limits(JointOffset(axis=3))[1]
    one = Named(JointOffset(axis=3, offset_deg=most), {}, 1.0, (), 1.0, "", 500.0, None)
    assert doubts_of_limits([one])[0].startswith("the zero")
    inside = replace(one, effect=JointOffset(axis=3, offset_deg=0.95 * most))
    assert doubts_of_limits([inside, replace(one, doubt="usual")]) == ()
    nearly = replace(one, effect=JointOffset(axis=3, offset_deg=-most * (1 - 1e-15)))
    assert doubts_of_limits([nearly])
    # A play cannot be narrower than none.
    assert doubts_of_limits([replace(one, effect=Backlash(axis=1, width_deg=0.0))]) == ()


def test_exact_twins_are_one_name():
    """d2 and d3 move the arm along axes that are parallel: only what they make together is known."""
    truth = LinkGeometry(axis=2, field="d", delta=3.0)
    found = found_in(circles((truth,), seed=52, count=1, tests=("yaw", "roll"), ways=("cw",)))
    assert found.condition == "uncalibrated"  # twins are no rivals, and a difference from the data sheet is no fault
    (one,) = found.effects
    assert {name_of(one.effect), *map(name_of, one.twins)} == {"link_geometry 2.d", "link_geometry 3.d"}
    assert one.rivals == () and one.effect.delta == pytest.approx(3.0, abs=0.03)


def test_readings_left_out_of_the_fit_count_only_without_other_readings():
    few, other = (Gap((name,), 430.0, 35.0, 5.0, 35.0) for name in ("few", "other"))
    left_out = accuracy_of(Gaps(few, None, None, 310.0, 40.0), None, None)
    assert (left_out.place, left_out.left_out_um, left_out.left_out_u_um) == ("used", 310.0, 40.0)
    assert left_out.to_dict()["left_out_um"] == 310.0
    assert accuracy_of(Gaps(few, other, None, 310.0, 40.0), None, None).left_out_um is None
