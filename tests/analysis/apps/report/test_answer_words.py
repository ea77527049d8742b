"""Sentences of an answer: the same decisions in every language, and none that contradicts another."""

from dataclasses import replace
from typing import get_args

import pytest

from analysis.apps.report.act_words import ActWords
from analysis.apps.report.answer_words import AnswerWords
from analysis.apps.report.diagnosis_words import micrometres
from analysis.apps.report.summary_words import summarise
from analysis.apps.report.texts import keys_of, texts_of
from analysis.diagnosis.judge.acts import (
    Act,
    ActiveCorrection,
    Against,
    Cost,
    JudgedOn,
    NamingTest,
    Objection,
    open_acts,
)
from analysis.diagnosis.judge.budget_part import BudgetPart, GroupMember
from analysis.diagnosis.judge.result import Condition
from rigs.effects import VOCABULARY, Compliance, LinkGeometry
from rigs.schema.effect import PartKind
from tests.support.every import in_every_language
from tests.support.handmade_diagnosis import LOAD, PLAY, REPAIR, SMALL, ZERO, diagnosis, judged

CONDITIONS = get_args(Condition)
NEED = {
    "axis": 2, "field": "d", "gauge": "g1", "from_axis": 4, "to_axis": 5, "order": 8, "lobes": 3, "period_mm": 0.5,
    "frequency_hz": 8.5,
}  # fmt: skip
USUAL = replace(PLAY, doubt="usual", times_usual=2.0)


def test_an_act_states_the_error_after_it_and_the_place():
    act = ActWords(diagnosis("named")).next
    assert keys_of(act)[:1] == ("act_repair",) and {"act_changes", "place_held_out"} <= set(keys_of(act))
    assert "6.1 µm" in act and "2.0 ± 0.2 µm" in act


@in_every_language
def test_a_correction_in_the_rig_file_is_not_credited_to_the_arm(language):
    held, texts = judged(diagnosis("nothing_unusual"), standing="fail", limit="tolerance"), texts_of(language)
    held = replace(held, rig=held.rig.model_copy(update={"effects": (PLAY.effect,)}))
    words = AnswerWords(held, texts)
    assert keys_of(words.judged) == ("accuracy_uncorrected", "accuracy_fail", "limit_tolerance")
    left = {"now": micrometres(held.accuracy.now_um), "largest": micrometres(held.accuracy.now_largest_um)}
    assert words.accuracy.startswith(texts("error_corrected", **left))


def test_a_model_is_complete_only_if_runs_repeat_and_no_place_differs():
    scatter = BudgetPart("scatter", 28.0, 0.0, 0.98)
    found = diagnosis("nothing_unusual", effects=(), budget=(scatter,), runs=("a", "b"), repeated=True)
    found = replace(found, rig=found.rig.model_copy(update={"effects": (PLAY.effect,)}))
    for change, key in (
        ({"where": ()}, "model_complete"),
        ({}, "nearly_complete"),
        ({"where": (), "runs": ("a",)}, "model_sufficient"),
        ({"where": (), "repeated": False}, "model_sufficient"),
    ):
        assert keys_of(AnswerWords(replace(found, **change)).condition_sentence)[0] == f"finding_{key}"


def test_the_accuracy_states_the_present_error_and_its_verdict():
    words = AnswerWords(diagnosis())
    assert keys_of(words.accuracy) == ("error_now",) and "6.1 µm" in words.accuracy and "21 µm" in words.accuracy
    plain = judged(
        diagnosis("not_testable_here"), place="used"
    ).to_dict()  # four poses have fewer numbers than unknowns
    assert plain["accuracy"]["calibrated_um"] is None and plain["gap"]["train"]["calibrated"] is None
    keys = keys_of(AnswerWords(judged(diagnosis(), standing="fail", limit="rig_file")).judged)
    assert keys == ("accuracy_fail", "limit_rig_file")


def test_a_group_above_a_third_names_its_likeliest_members_and_the_test_that_identifies_one():
    members = (GroupMember(ZERO.effect, 40.0, 0.62), GroupMember(PLAY.effect, 10.0, 0.005))
    part = BudgetPart("constants", 80.0, 4.0, 0.77, times_usual=0.8, rank="usual", members=members)
    test = NamingTest("roll on the circle", "the tool's other tilt", 6.0, 0.998)
    act = Act("measure", "group", (0,), cost=Cost(4.8), test=test)
    found = diagnosis("named", effects=(), budget=(part,), acts=(act,))
    words, headline = AnswerWords(found), summarise(found).headline
    assert "probable_member" in keys_of(headline) and "62 %" in headline
    assert words.noun(ZERO.effect) in headline and words.noun(PLAY.effect) not in headline
    none = replace(part, members=(replace(members[1], odds=0.004),))
    assert "probable_member" not in keys_of(summarise(replace(found, budget=(none,))).headline)
    assert keys_of(ActWords(found).next)[0] == "act_group" and "77 %" in ActWords(found).next


@in_every_language
def test_every_act_and_every_objection_has_words(language):
    words = ActWords(diagnosis(), texts_of(language))
    acts = [Act(kind, "fault", (0,), 3.0, 1.0, place, 2.0, 1.0, effect=PLAY.effect, u=0.001)
            for kind in ("repair", "remaster", "enter", "mount", "wait") for place in get_args(JudgedOn)]  # fmt: skip
    acts += [Act("repair", why, (0,), 3.0, 1.0, effect=PLAY.effect) for why in ("not_enough", "sure_and_large")]
    acts += [Act("approach", "history", (0,), effect=PLAY.effect)]
    acts += [Act("none", why, (0,)) for why in ("scatter", "unexplained", "too_small", "history", "gauges", "sound")]
    acts += [Act("measure", why, (0,), runs=3) for why in ("few_runs", "not_visible", "elsewhere", "rivals", "group")]
    acts += [Act("measure", "one_lap", (0,), effect=PLAY.effect, runs=2)]
    whys = [why for why in get_args(Objection) if why != "not_judged_elsewhere"]
    against = [words.against(Act("none", "sound", against=(Against(why, ("d",), "unsure", 3),))) for why in whys]
    assert all(text and not {"{", "}"} & set(text) for text in (*map(words.sentence, acts), *against))


def test_an_error_below_its_uncertainty_is_a_bound():
    act = replace(diagnosis().acts[0], remains_um=0.4, remains_u_um=2.0, removes_um=9.6)
    assert "< 2.0 µm" in ActWords(diagnosis(acts=(act,))).next


@in_every_language
def test_every_part_and_effect_has_a_noun_in_every_language(language):
    words = AnswerWords(diagnosis(effects=(PLAY, SMALL)), texts_of(language))
    kinds = (*get_args(PartKind), "scatter", "unexplained")
    nouns = [words.part_name(BudgetPart(kind, 1.0, 0.1, 0.1, axis=3)) for kind in kinds]
    for name, kind in VOCABULARY.items():
        need = NEED | {"way": kind.PLACE.every.get("way", [""])[0]}
        fields = {key: value for key, value in need.items() if key in kind.model_fields}
        nouns.append(words.noun(kind.model_validate({"effect": name} | fields)))
    assert all(noun and "{" not in noun and "_" not in noun for noun in nouns)
    assert language == "en" or {noun.split()[0] for noun in texts_of(language).nouns} == VOCABULARY.keys()
    assert len(set(nouns)) == len(nouns)


@in_every_language
def test_an_axis_has_its_number_and_a_name_that_adds_information(language):
    robot, texts = diagnosis().rig.robot, texts_of(language)
    called = {"en": "axis 4 (gamma)", "de": "Achse 4 (gamma)", "ko": "축 4(gamma)"}
    assert texts.axis(robot, 4) == called[language]
    for name, says_more in (("J4", False), ("joint_a4", False), ("axis 4", False), ("A4", False), ("wrist 1", True)):
        axes = tuple(axis.model_copy(update={"name": name}) for axis in robot.axes)
        assert ("(" in texts.axis(robot.model_copy(update={"axes": axes}), 4)) == says_more, name


def test_a_repair_after_a_correction_replaces_it():
    load = Act("load", "correction", (0,), 9.0, 1.0, remains_um=1.0, remains_u_um=0.5)
    repair = Act("repair", "fault", (0,), 8.0, 1.0, remains_um=2.0, remains_u_um=0.5, effect=PLAY.effect)
    for acts, is_instead in (((load, repair), True), ((repair, load), False)):
        assert ("act_instead" in keys_of(ActWords(diagnosis(acts=acts)).sentence(repair))) == is_instead
    assert "act_load_changes" in keys_of(ActWords(diagnosis(acts=(load,))).next)


_MASTER = Act("remaster", "fault", removes_um=48.0, remains_um=46.5, remains_u_um=1.0, effect=ZERO.effect)
_ELSEWHERE = Act("measure", "elsewhere")


@pytest.mark.parametrize(
    ("way", "um", "to_do", "instead"),
    [
        (None, None, ["load", "remaster", "measure"], []),
        ("programs", 2.9, ["measure"], ["remaster"]),  # the corrected robot had 2.9 µm, and mastering left 46.5 µm
        ("programs", 46.0, ["measure"], ["remaster"]),
        ("programs", 80.0, ["remaster", "measure"], []),
        ("programs", None, ["remaster", "measure"], []),
        ("entries", 80.0, ["measure"], []),  # entered values include the zero
    ],
)
def test_corrected_robot_is_changed_only_if_less_error_remains(way, um, to_do, instead):
    active = way and ActiveCorrection(way, um, 1.0)
    acts = (LOAD, _MASTER, Act("measure", "group"))
    divided = open_acts(acts, active, elsewhere=False)
    assert [[act.kind for act in some] for some in divided] == [to_do, instead]


def test_all_repairs_together_may_improve_a_corrected_robot():
    second = replace(_MASTER, with_before_um=1.0)
    to_do, instead = open_acts((_MASTER, second), ActiveCorrection("programs", 5.0, 0.1), elsewhere=False)
    assert to_do == (_MASTER, second) and not instead


@pytest.mark.parametrize("with_before_um", [None, 1.0])
def test_values_that_the_correction_contains_are_no_reason_to_repair(with_before_um):
    enter = replace(_MASTER, kind="enter", remains_um=0.0)
    repair = replace(_MASTER, kind="repair", with_before_um=with_before_um)
    divided = open_acts((enter, repair), ActiveCorrection("programs", 5.0, 0.1), elsewhere=False)
    assert divided == ((), (repair,))


def test_repair_that_leaves_no_error_improves_a_corrected_robot():
    perfect = replace(_MASTER, remains_um=0.0)
    assert open_acts((perfect,), ActiveCorrection("programs", 5.0, 0.1), elsewhere=False) == ((perfect,), ())


def test_measurement_elsewhere_is_done_if_another_place_validated():
    assert [open_acts((_ELSEWHERE,), None, elsewhere=done)[0] for done in (True, False)] == [(), (_ELSEWHERE,)]


@in_every_language
def test_constants_of_parallel_axes_have_one_name(language):
    words, texts = AnswerWords(diagnosis(), texts_of(language)), texts_of(language)
    first, *others = (LinkGeometry(axis=axis, field="d", delta=1.0) for axis in (4, 2, 3))
    assert texts("axes_numbered", axes="2, 3, 4") in words.noun_with_twins(first, others)
    assert words.noun_with_twins(first, [ZERO.effect]) == texts("or").join(map(words.noun, (first, ZERO.effect)))
    assert words.noun_with_twins(first, ()) == words.noun(first)


@pytest.mark.parametrize(("stated_kg", "payload_kg", "is_stated"), [(0, 5.0, True), (0, 0.0, False), (4, 5.0, False)])
def test_softness_that_depends_on_an_unstated_payload_states_it(stated_kg, payload_kg, is_stated):
    soft = replace(PLAY, effect=Compliance(axis=2, deg_per_Nm=0.01, payload_kg=payload_kg), sd={})
    found = diagnosis()
    rig = found.rig.model_copy(update={"robot": found.rig.robot.model_copy(update={"payload_kg": stated_kg})})
    assert ("5 kg" in AnswerWords(replace(found, rig=rig)).size_words(soft)) == is_stated


def test_a_measurement_without_a_declared_test_says_so_once():
    group = Act("measure", "group", (0,), against=(Against("no_place"),))
    keys = keys_of(ActWords(diagnosis(acts=(group,))).next)
    assert keys[0] == "act_group_no_test" and "against_no_place" not in keys


@pytest.mark.parametrize(
    ("removes_um", "key"), [(1.0, "act_changes"), (-1.0, "act_grows"), (0.8, "act_may_change"), (0.2, "act_hardly")]
)
def test_the_gain_of_an_act_is_stated_with_its_certainty(removes_um, key):
    act = replace(REPAIR, removes_um=removes_um, removes_u_um=0.45, remains_um=4.0)
    assert key in keys_of(ActWords(diagnosis(acts=(act,))).next)


def test_a_later_act_states_the_error_after_all_acts_before_it():
    alone = ActWords(diagnosis(acts=(REPAIR,))).next
    both = ActWords(diagnosis(acts=(replace(REPAIR, with_before_um=1.2, with_before_u_um=0.3),))).next
    assert "act_with_before" in keys_of(both) and "1.2 ± 0.3 µm" in both
    assert "act_with_before" not in keys_of(alone)


def test_an_act_that_alone_increases_the_error_comes_only_after_those_before_it():
    act = replace(REPAIR, removes_um=-2.0, remains_um=7.0, with_before_um=1.2, with_before_u_um=0.3)
    keys = keys_of(ActWords(diagnosis(acts=(act,))).next)
    assert "act_only_with_before" in keys and "act_grows" not in keys
