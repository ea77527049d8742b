"""The answer in sentences: the same decisions in every language, and none that contradicts another."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, get_args

import pytest

from analysis.inference.result import Accuracy, BudgetPart, Condition, Doubt
from analysis.reporting.answer_words import AnswerWords, NextStep, doubt_words, next_step
from analysis.reporting.texts import LANGUAGES, Language, texts_of
from rigs.effects import VOCABULARY
from rigs.schema.effect import PartKind
from tests.support.handmade_diagnosis import PLAY, SMALL, ZERO, diagnosis

CONDITIONS: tuple[Condition, ...] = get_args(Condition)
NEED: dict[str, Any] = {
    "axis": 2, "field": "d", "gauge": "g1", "from_axis": 4, "to_axis": 5, "order": 8, "lobes": 3, "period_mm": 0.5,
    "frequency_hz": 8.5, "way": "up",
}  # fmt: skip


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("condition", CONDITIONS)
def test_every_condition_has_its_sentences_in_every_language(condition: Condition, language: Language) -> None:
    words = AnswerWords(diagnosis(condition), texts_of(language))
    for sentence in (words.headline, words.accuracy, words.judged, words.next_step, words.texts(f"badge_{condition}")):
        assert len(sentence) > 2 and not {"{", "}"} & set(sentence) and "None" not in sentence
    for doubt in get_args(Doubt):
        assert doubt_words(doubt, words.texts)


def test_a_fault_is_in_the_first_sentence_with_its_size_and_what_it_makes_of_the_error() -> None:
    words = AnswerWords(diagnosis("named"))
    assert words.headline == "One fault was found: play of axis 1 (Theta), 0.0521 ± 0.0011 °, 90 % of the error."
    assert words.next_step.startswith("Do what is said below")
    many = AnswerWords(diagnosis("named", effects=(PLAY, ZERO, PLAY, ZERO, PLAY)))
    assert many.headline.startswith("5 faults were found: ") and many.headline.endswith("; and 2 more.")


def test_a_usual_part_that_makes_most_of_the_error_is_said_whatever_the_condition() -> None:
    usual = replace(PLAY, doubt="usual", times_usual=2.0)
    said = "90 % of the error comes from play of axis 1 (Theta) (0.0521 ± 0.0011 °, 2.0 × usual)."
    undecided = AnswerWords(diagnosis("undecided", effects=(usual,)))
    assert undecided.headline.startswith(said)  # what is certain comes before what is not known
    assert undecided.next_step == "Drive each test 3 times to decide it."
    assert AnswerWords(diagnosis("nothing_unusual", effects=(usual,))).headline.endswith(said)
    unsure = replace(usual, u_um=3.0)
    assert said not in AnswerWords(diagnosis("undecided", effects=(unsure,))).headline


def test_an_unusual_part_that_is_no_fault_is_said_too() -> None:
    part = BudgetPart("gravity", 80.0, 2.0, 0.8, times_usual=9.0, rank="unusual")
    headline = AnswerWords(diagnosis("nothing_unusual", budget=(part,))).headline
    assert headline.endswith("80 % of the error comes from what yields under load.")


def test_what_remains_after_the_calibration_is_said_of_where_it_was_found() -> None:
    words = AnswerWords(diagnosis())
    assert words.accuracy == (
        "The error is now 6.1 µm rms, at most 21 µm. After a calibration 1.9 µm remain of 6.3 µm rms on runs that had "
        "no part in it."
    )
    used = replace(words.found.accuracy, place="used")
    assert "how much elsewhere is not known" in AnswerWords(diagnosis(accuracy=used)).accuracy
    judged = replace(words.found.accuracy, standing="fail", limit="rig_file")
    assert AnswerWords(diagnosis(accuracy=judged)).judged == "Accuracy: FAIL, by the limits of the rig file."


@pytest.mark.parametrize(
    ("standing", "calibrated_um", "place", "step"),
    [
        ("fail", 20.0, "unseen", "calibrate"),
        ("fail", 95.0, "unseen", "nothing"),
        ("pass", 20.0, "used", "unseen"),
        (None, 20.0, "held_out", "nothing"),
    ],
)
def test_without_a_fault_the_next_step_is_that_of_accuracy(
    standing: Any, calibrated_um: float, place: Any, step: NextStep
) -> None:
    accuracy = Accuracy(standing, "rig_file" if standing else None, 100.0, 200.0, calibrated_um, 100.0, place)
    assert next_step(diagnosis("nothing_unusual", accuracy=accuracy)) == step


def test_rivals_without_a_test_are_measured_elsewhere() -> None:
    assert next_step(diagnosis("ambiguous")) == "separate"
    assert "circle of radius 140 mm" in AnswerWords(diagnosis("ambiguous")).next_step
    assert next_step(diagnosis("ambiguous", next_test=None)) == "elsewhere"


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_part_and_effect_has_a_noun_in_every_language(language: Language) -> None:
    words = AnswerWords(diagnosis(effects=(PLAY, SMALL)), texts_of(language))
    kinds = (*get_args(PartKind), "scatter", "unexplained")
    nouns = [words.part_name(BudgetPart(kind, 1.0, 0.1, 0.1, axis=3)) for kind in kinds]
    for name, kind in VOCABULARY.items():
        fields = {key: value for key, value in NEED.items() if key in kind.model_fields}
        nouns.append(words.noun(kind.model_validate({"effect": name} | fields)))
    assert all(noun and "{" not in noun and "_" not in noun for noun in nouns)
    assert language == "en" or texts_of(language).nouns.keys() == VOCABULARY.keys()
    assert len(set(nouns)) == len(nouns)


def test_what_imitates_something_else_is_no_cause_of_the_error() -> None:
    slipping = diagnosis("outside_library", effects=(replace(PLAY, doubt="series"),))
    assert "% of the error comes from" not in AnswerWords(slipping).headline
