"""The verdict on accuracy: the worst figure decides, uncertainty leaves it open, and a diagnosis stands alike."""

from typing import get_args

import pytest
import yaml

from analysis import evaluate_runs, load_run
from analysis.apps.report.page.accuracy import PageVerdict, example_limits, figure_title, judge, verdict_sentence
from analysis.apps.report.texts import keys_of, texts_of
from analysis.diagnosis.judge.verdict import standing_of
from analysis.procedures.pooled import figure_columns
from rigs.load import load, load_hidden
from rigs.schema.limits import CircleLimits, Limit, Limits
from rigs.schema.vocabulary import TestName
from tests.support.every import in_every_language
from tests.support.handmade_diagnosis import diagnosis, judged
from tests.support.written_runs import write_simulated

TEXTS = texts_of("en")
RIG, TEXT = load("ur10e-cell")


@pytest.fixture(scope="module")
def laps(tmp_path_factory):
    """One yaw run in each direction of a robot with play."""
    folder = tmp_path_factory.mktemp("laps")
    runs = write_simulated(load_hidden("ur10e-cell").apply_to(RIG), TEXT, "yaw", ("acw", "cw"), [1], folder)
    return evaluate_runs([load_run(run) for run in runs])


def _limits(**of_yaw: Limit) -> Limits:
    return Limits(yaw=CircleLimits.model_validate({name: limit.model_dump() for name, limit in of_yaw.items()}))


def test_without_limits_nothing_is_judged(laps):
    verdict = judge(laps, Limits())
    assert (verdict.overall, verdict.judged) == ("unjudged", ())
    sentence = verdict_sentence(verdict, TEXTS)
    assert keys_of(sentence) == ("verdict_unjudged",) and TEXTS.test("yaw") in sentence


def test_the_example_of_limits_makes_every_test_judged():
    verdict = PageVerdict("unjudged", (), get_args(TestName))
    limits = Limits.model_validate(yaml.safe_load(example_limits(verdict))["limits"])
    with_limits = [test for test in verdict.tests if test in Limits.model_fields]  # a test of one's own may have none
    assert all(getattr(limits, test).model_fields_set for test in with_limits)


def test_each_direction_and_the_pair_are_judged_and_the_worst_decides(laps):
    wide, narrow = Limit(fail=100.0), Limit(fail=1e-4)
    verdict = judge(laps, _limits(band_deg=wide, circular_deviation_mm=narrow))
    assert verdict.overall == "fail"
    assert [one.column.direction for one in verdict.judged[:3]] != ["", "", ""]
    assert {one.standing for one in verdict.judged} == {"pass", "fail"}
    assert len(verdict.judged) == 5  # acw, cw and both together for G; acw and cw for the band
    assert verdict.judged[0].standing == "fail" and verdict.judged[-1].standing == "pass"
    sentence = verdict_sentence(verdict, TEXTS)
    assert sentence.startswith("3 of 5 figures with a limit fail. The worst: Yaw")
    assert sentence.count("fail above 0.0001 mm") == 1


@in_every_language
def test_the_worst_figure_is_named_and_the_others_counted(laps, language):
    texts = texts_of(language)
    narrow = Limit(fail=1e-6)
    verdict = judge(laps, _limits(band_deg=narrow, circular_deviation_mm=narrow))
    sentence = verdict_sentence(verdict, texts)
    assert sum(figure.standing == "fail" for figure in verdict.judged) == 5
    assert [figure_title(one, texts) in sentence for one in verdict.judged] == [True] + [False] * 4
    assert "5" in sentence


def test_a_fault_is_of_the_condition_and_not_of_the_accuracy(laps):
    wide = _limits(band_deg=Limit(fail=100.0))
    assert judge(laps, wide, diagnosis("named")).overall == "pass"
    assert judge(laps, Limits(), diagnosis("named")).overall == "unjudged"


def test_a_tolerance_that_was_given_decides(laps):
    found = judged(diagnosis("named"), standing="fail", limit="tolerance")
    verdict = judge(laps, _limits(band_deg=Limit(fail=100.0)), found)
    assert verdict.overall == "fail" and "--tolerance-um" in verdict_sentence(verdict, TEXTS)


@pytest.mark.parametrize(("factor", "standing"), [(0.5, "fail"), (1.0, "watch"), (3.0, "pass")])
def test_diagnosis_and_page_stand_alike(laps, factor, standing):
    """Single runs and the pair of them: the hysteresis is a figure of the pair alone."""
    of_pair = next(one.figures["hysteresis_max_deg"] for one in figure_columns(laps) if one.kind == "pairs")
    limits = _limits(hysteresis_max_deg=Limit(fail=factor * of_pair.value))
    rig = RIG.model_copy(update={"limits": limits})
    assert standing_of(rig, [one.measured for one in laps]) == (standing, "rig_file")
    assert judge(laps, limits).overall == standing


def test_data_sheet_is_named_if_it_is_the_limit(tmp_path):
    (run,) = write_simulated(RIG, TEXT, "repeatability", (None,), [1], tmp_path)
    judged = {one.name: one for one in judge(evaluate_runs([load_run(run)]), RIG.limits).judged}
    assert (judged["rp_mm"].of_data_sheet, judged["rp_mm"].standing) == (True, "pass")
    assert not judged["bi_mm"].of_data_sheet
