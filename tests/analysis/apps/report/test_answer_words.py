"""The answer in sentences: the same decisions in every language, and none that contradicts another."""

from __future__ import annotations

import io
from dataclasses import replace
from typing import Any, get_args

import pytest
from rich.console import Console

from analysis.apps.report.act_words import ActWords, acts_in_words
from analysis.apps.report.answer_words import AnswerWords
from analysis.apps.report.diagnosis_screen import as_screen
from analysis.apps.report.diagnosis_words import micrometres
from analysis.apps.report.texts import LANGUAGES, Language, texts_of
from analysis.diagnosis.judge.acts import Act, Against, Cost, Doubt, JudgedOn, NamingTest, Objection, is_done
from analysis.diagnosis.judge.result import Accuracy, BudgetPart, Condition, GroupMember
from rigs.effects import VOCABULARY
from rigs.schema.effect import PartKind
from tests.support.handmade_diagnosis import PLAY, REPAIR, SMALL, ZERO, diagnosis

CONDITIONS: tuple[Condition, ...] = get_args(Condition)
NEED: dict[str, Any] = {
    "axis": 2, "field": "d", "gauge": "g1", "from_axis": 4, "to_axis": 5, "order": 8, "lobes": 3, "period_mm": 0.5,
    "frequency_hz": 8.5,
}  # fmt: skip


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("condition", CONDITIONS)
def test_every_condition_has_its_sentences_in_every_language(condition: Condition, language: Language) -> None:
    found = diagnosis(condition)
    words = AnswerWords(found, texts_of(language))
    acts = acts_in_words(found, texts_of(language))
    for sentence in (words.headline, words.accuracy, words.judged, *acts, words.texts(f"badge_{condition}")):
        assert len(sentence) > 2 and not {"{", "}"} & set(sentence) and "None" not in sentence
    for doubt in get_args(Doubt):
        assert words.texts(f"doubt_{doubt}")


def test_a_fault_is_in_the_first_sentence_with_its_size_and_what_it_makes_of_the_error() -> None:
    words = AnswerWords(diagnosis("named"))
    assert words.headline == "One fault was found: play of axis 1 (Theta), 0.0521 ± 0.0011 °, 90 % of the error."
    assert ActWords(words.diagnosis).next == (
        "Find and repair the cause of the play of axis 1 (Theta) (0.0521 ± 0.0011 °). The error then falls from "
        "6.1 µm to 2.0 ± 0.2 µm rms in readings not used to fit the model."
    )
    many = AnswerWords(diagnosis("named", effects=(PLAY, PLAY, PLAY, PLAY, PLAY)))
    assert many.headline.startswith("5 faults were found: ") and many.headline.endswith("; and 2 more.")


@pytest.mark.parametrize("language", LANGUAGES)
def test_what_a_rig_file_corrects_is_not_in_the_arm_until_it_is_loaded(language: Language) -> None:
    held, texts = diagnosis("nothing_unusual"), texts_of(language)
    judged = replace(held.accuracy, standing="fail", limit="tolerance")
    held = replace(held, accuracy=judged, rig=held.rig.model_copy(update={"effects": (PLAY.effect,)}))
    words = AnswerWords(held, texts)
    assert words.judged == texts("accuracy_uncorrected", standing=texts("standing_fail"), by=texts("limit_tolerance"))
    left = {"now": micrometres(judged.now_um), "largest": micrometres(judged.now_largest_um)}
    assert words.accuracy.startswith(texts("error_corrected", **left))


def test_nothing_is_missing_only_where_runs_repeat_and_no_place_differs() -> None:
    """The residual of a single run may repeat in every run; several runs may still differ between places."""
    scatter = BudgetPart("scatter", 28.0, 0.0, 0.98)
    found = diagnosis("nothing_unusual", effects=(), budget=(scatter,), runs=("a", "b"), repeated=True)
    found = replace(found, rig=found.rig.model_copy(update={"effects": (PLAY.effect,)}))
    for change, begins in (
        ({"where": ()}, "The model is complete"),
        (
            {},
            "The model is almost complete: most of the remaining error is scatter between runs. At "
            f"{len(found.where)} ",
        ),
        ({"where": (), "runs": ("a",)}, "The model explains these readings"),
        ({"where": (), "repeated": False}, "The model explains these readings"),
    ):
        assert AnswerWords(replace(found, **change)).headline.startswith(begins)


def test_a_usual_part_that_makes_most_of_the_error_is_said_whatever_the_condition() -> None:
    usual = replace(PLAY, doubt="usual", times_usual=2.0)
    said = "90 % of the error is play of axis 1 (Theta), 0.0521 ± 0.0011 °, 2.0 × usual."
    undecided = AnswerWords(diagnosis("undecided", effects=(usual,)))
    assert undecided.headline.startswith(said)  # what is certain comes before what is not known
    assert ActWords(undecided.diagnosis).next == "Run each test 3 times."
    assert AnswerWords(diagnosis("nothing_unusual", effects=(usual,))).headline.startswith(said)
    unsure = replace(usual, u_um=3.0)
    assert said not in AnswerWords(diagnosis("undecided", effects=(unsure,))).headline


def test_what_makes_most_and_may_be_one_of_a_few_is_said_with_all_of_them() -> None:
    usual = replace(ZERO, doubt="usual")
    headline = AnswerWords(diagnosis("uncalibrated", effects=(usual,))).headline
    assert headline.startswith(
        "90 % of the error is zero of axis 5 (beta) or length a of axis 5 (beta) in the rig file. No part was found"
    )


def test_an_unusual_part_that_is_no_fault_is_said_too() -> None:
    part = BudgetPart("gravity", 80.0, 2.0, 0.8, times_usual=9.0, rank="unusual")
    headline = AnswerWords(diagnosis("nothing_unusual", budget=(part,))).headline
    assert headline.startswith("80 % of the error is deflection under load.")


def test_what_remains_after_the_calibration_is_said_of_where_it_was_found() -> None:
    words = AnswerWords(diagnosis())
    assert words.accuracy == (
        "The error in the readings used is 6.1 µm rms, with a maximum of 21 µm. In readings that were not used to fit "
        "the model, a calibration reduces the error from 6.3 µm to 1.9 µm rms."
    )
    used = replace(words.diagnosis.accuracy, place="used")
    assert "used to fit" in AnswerWords(diagnosis(accuracy=used)).accuracy
    few = diagnosis("not_testable_here", accuracy=used)  # four poses have fewer numbers than there are unknowns
    assert AnswerWords(few).accuracy.endswith("These runs cannot show the error after a calibration.")
    plain = few.to_dict()
    assert plain["accuracy"]["calibrated_um"] is None and plain["gap"]["train"]["calibrated"] is None
    judged = replace(words.diagnosis.accuracy, standing="fail", limit="rig_file")
    assert AnswerWords(diagnosis(accuracy=judged)).judged == "Accuracy: FAIL by the limits of the rig file."


def test_what_is_sure_is_counted_first_and_what_has_a_rival_is_said_of_it_alone() -> None:
    headline = AnswerWords(diagnosis("named", effects=(PLAY, PLAY, ZERO))).headline
    assert headline.startswith("2 faults were found: play of axis 1")
    assert headline.endswith(
        ". One further cause could not be identified: zero of axis 5 (beta) or length a of axis 5 (beta) in the rig "
        "file, 30 % of the error."
    )
    alone = AnswerWords(diagnosis("ambiguous", effects=(ZERO,))).headline
    assert alone.startswith("There is a fault, but these tests cannot identify the cause: zero of axis 5")


def test_a_group_above_a_third_names_its_likeliest_members_and_the_test_that_names_one() -> None:
    members = (GroupMember(ZERO.effect, 40.0, 0.62), GroupMember(PLAY.effect, 10.0, 0.005))
    part = BudgetPart("constants", 80.0, 4.0, 0.77, times_usual=0.8, rank="usual", members=members)
    test = NamingTest("roll on the circle", "the tool's other tilt", 6.0, 0.998)
    act = Act("measure", "group", (0,), cost=Cost(4.8), test=test)
    found = diagnosis("named", effects=(), budget=(part,), acts=(act,))
    assert AnswerWords(found).headline == (
        "77 % of the error comes from geometry and zeros, most likely from zero of axis 5 (beta) (62 %)."
    )
    sure = replace(part, members=(replace(members[0], odds=0.9999, u_um=2.0), members[1]))
    assert AnswerWords(replace(found, budget=(sure,))).headline.endswith(
        "most likely from zero of axis 5 (beta) (0.1032 ± 0.0052 °, > 99.9 %)."
    )
    none = replace(part, members=(replace(members[1], odds=0.004),))
    assert AnswerWords(replace(found, budget=(none,))).headline == "77 % of the error is geometry and zeros."
    assert ActWords(found).next == (
        "Run roll on the circle (5 min) to find the single cause of geometry and zeros, 77 % of the error."
    )


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_act_and_everything_against_it_has_words(language: Language) -> None:
    words = ActWords(diagnosis(), texts_of(language))
    acts = [Act(kind, "fault", (0,), 3.0, 1.0, place, 2.0, 1.0, effect=PLAY.effect, u=0.001)
            for kind in ("repair", "remaster", "enter", "mount", "wait") for place in get_args(JudgedOn)]  # fmt: skip
    acts += [Act("repair", why, (0,), 3.0, 1.0, effect=PLAY.effect) for why in ("not_enough", "sure_and_large")]
    acts += [Act("approach", "history", (0,), effect=PLAY.effect)]
    acts += [Act("none", why, (0,)) for why in ("scatter", "unexplained", "too_small", "history", "gauges", "sound")]
    acts += [Act("measure", why, (0,), runs=3) for why in ("few_runs", "not_visible", "elsewhere", "rivals", "group")]
    acts += [Act("measure", "one_lap", (0,), effect=PLAY.effect, runs=2)]
    against = [Against(why, ("d",), "unsure", 3) for why in get_args(Objection)]
    said = [*map(words.sentence, acts), *(words.against(Act("none", "sound", against=(one,))) for one in against)]
    assert all(one and not {"{", "}"} & set(one) for one in said)


def test_what_remains_below_its_uncertainty_is_said_as_less_than_that() -> None:
    act = replace(diagnosis().acts[0], remains_um=0.4, remains_u_um=2.0, removes_um=9.6)
    assert "falls from 10 µm to < 2.0 µm rms" in ActWords(diagnosis(acts=(act,))).next


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_part_and_effect_has_a_noun_in_every_language(language: Language) -> None:
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


def test_what_imitates_something_else_is_no_cause_of_the_error() -> None:
    slipping = diagnosis("outside_library", effects=(replace(PLAY, doubt="series"),))
    assert "% of the error is" not in AnswerWords(slipping).headline


def test_what_speaks_against_an_act_stands_within_its_last_sentence() -> None:
    doubted = replace(REPAIR, place="used", against=(Against("not_judged_elsewhere"),))
    said = ActWords(diagnosis(acts=(doubted,))).next
    assert said.endswith("in the readings used to fit the model (the gain elsewhere is unknown).") and ". (" not in said


@pytest.mark.parametrize("language", LANGUAGES)
def test_an_axis_is_called_by_its_number_and_by_its_name_where_that_says_more(language: Language) -> None:
    robot, texts = diagnosis().rig.robot, texts_of(language)
    called = {"en": "axis 4 (gamma)", "de": "Achse 4 (gamma)", "ko": "축 4(gamma)"}
    assert texts.axis(robot, 4) == called[language]
    for name, says_more in (("J4", False), ("joint_a4", False), ("axis 4", False), ("A4", False), ("wrist 1", True)):
        axes = tuple(axis.model_copy(update={"name": name}) for axis in robot.axes)
        assert ("(" in texts.axis(robot.model_copy(update={"axes": axes}), 4)) == says_more, name


def test_what_changes_the_arm_is_done_instead_of_a_correction_and_not_after_it() -> None:
    load = Act("load", "correction", (0,), 9.0, 1.0, remains_um=1.0, remains_u_um=0.5)
    repair = Act("repair", "fault", (0,), 8.0, 1.0, remains_um=2.0, remains_u_um=0.5, effect=PLAY.effect)
    words = [ActWords(diagnosis(acts=acts)).sentence(repair) for acts in ((load, repair), (repair, load))]
    assert ["repeat the measurement, and correct the remaining error" in sentence for sentence in words] == [
        True,
        False,
    ]
    assert "With corrected programs the error" in ActWords(diagnosis(acts=(load,))).next


def test_who_entered_the_zeros_is_not_sent_to_master_again() -> None:
    assert is_done("remaster", "fault", way="entries", elsewhere=True)
    assert not is_done("remaster", "fault", way="programs", elsewhere=True)
    assert not is_done("load", "correction", way=None, elsewhere=True)
    assert [is_done("measure", "elsewhere", way=None, elsewhere=judged) for judged in (True, False)] == [True, False]


@pytest.mark.parametrize("language", LANGUAGES)
def test_what_is_done_after_a_correction_has_words_in_every_language(language: Language) -> None:
    texts = texts_of(language)
    for key in ("after_cause_programs", "after_cause_entries", "corrected_now", "path_error", "then"):
        assert len(texts(key)) > 2


def test_a_measurement_that_no_test_does_is_said_first_and_once() -> None:
    group = Act("measure", "group", (0,), against=(Against("no_place"),))
    said = ActWords(diagnosis(acts=(group,))).next
    assert said.startswith("Declare a second circle") and "(" not in said.replace("(Theta)", "")


@pytest.mark.parametrize(
    ("removes_um", "said"),
    [(1.0, "falls from"), (-1.0, "increases the error"), (0.8, "may reduce"), (0.2, "hardly changes")],
)
def test_what_an_act_takes_away_is_said_as_what_it_is(removes_um: float, said: str) -> None:
    """A fall by a quarter that was not certain was "hardly changes"."""
    act = replace(REPAIR, removes_um=removes_um, removes_u_um=0.45, remains_um=4.0)
    assert said in ActWords(diagnosis(acts=(act,))).next


def test_a_later_act_says_what_is_left_with_those_before_it() -> None:
    """Who read 106 to 46, then 106 to 96, took the second for the error after both."""
    alone = ActWords(diagnosis(acts=(REPAIR,))).next
    both = ActWords(diagnosis(acts=(replace(REPAIR, with_before_um=1.2, with_before_u_um=0.3),))).next
    assert "repairs and entries, the remaining error is 1.2 ± 0.3 µm" in both and "before it" not in alone


def test_what_another_place_judged_is_said_where_its_runs_joined() -> None:
    """The screen of a session stated the error at another place, but the page called it unknown."""
    used = replace(diagnosis("named"), accuracy=Accuracy(None, None, 6.12, 21.4, 1.9, 6.3, "used"))
    assert "used to fit" in AnswerWords(used).accuracy
    told = AnswerWords(used, judged_elsewhere=(93.0, 1.7)).accuracy
    assert "different place" in told and "reduces the error from 93 µm to 1.7 µm rms" in told and "unknown" not in told
    act = Act("load", "correction", removes_um=4.0, remains_um=2.0, against=(Against("not_judged_elsewhere"),))
    assert "elsewhere is unknown" in ActWords(used).sentence(act)
    assert "elsewhere" not in ActWords(used, is_judged_elsewhere=True).sentence(act)


def test_noise_that_no_run_repeats_is_said_to_be_assumed() -> None:
    told = "The noise is assumed for tests that were not repeated."
    for shows_noise in (True, False):
        screen = io.StringIO()
        Console(width=200, file=screen).print(as_screen(diagnosis("named", shows_noise=shows_noise)))
        assert (told in screen.getvalue()) != shows_noise
