"""What a diagnosis found, in sentences that a person can act on."""

from __future__ import annotations

import math
from dataclasses import replace

from analysis.reporting.page.findings import diagnosis_words, findings_of, micrometres, open_question
from analysis.reporting.page.texts import texts_of
from rigs.effects import BallForm
from tests.support.handmade_diagnosis import PLAY, ZERO, diagnosis

ENGLISH = texts_of("en")


def test_a_finding_says_what_where_how_much_and_what_to_do() -> None:
    (one,) = findings_of(diagnosis("named"), ENGLISH)
    assert one.what == "Theta (axis 1) has play of 0.0521 ± 0.0011 °."
    assert "at 237° of the circle" in one.where and "14 µm" in one.where
    # Of 6.12 µm before, 5.94 with the effect alone taken out again, 1.91 after: √(5.94² - 1.91²).
    assert one.share == "It makes 5.6 µm of the 6.1 µm of the error (rms)."
    assert one.remedy.startswith("take up the play") and "5.8 µm" in one.worth and "from 6.1 µm to 1.9 µm" in one.worth
    assert one.rivals == ""


def test_rivals_that_cannot_be_excluded_are_named() -> None:
    (one,) = findings_of(diagnosis("ambiguous"), ENGLISH)
    assert one.what == "The zero of Beta (axis 5) is off by 0.1032 ± 0.0041 °."
    assert one.rivals.startswith(
        "These tests cannot exclude: Length a of axis 5 (beta) in the rig file: 0.587 ± 0.023 mm"
    )


def test_the_one_that_is_worth_most_comes_first_and_what_is_slight_is_left_out() -> None:
    both = findings_of(diagnosis("named", effects=(ZERO, PLAY, replace(PLAY, material=False))), ENGLISH)
    assert [one.what.partition(" ")[0] for one in both] == ["Theta", "The"]
    assert "from" not in both[0].worth  # of two effects neither alone brings the gap down


def test_an_effect_without_a_sentence_uses_its_own_words_and_its_number() -> None:
    ball = replace(PLAY, effect=BallForm(lobes=3, amplitude_mm=0.002), sd={}, gap_without_um=math.nan)
    (one,) = findings_of(diagnosis("named", effects=(ball,)), texts_of("de"))
    assert one.what == "Form of the ball, 3 lobes: 0.002 mm."
    assert one.where == "" and one.share == ""


def test_nothing_unknown_is_shown_as_a_number() -> None:
    assert micrometres(math.nan) == "–"
    assert (micrometres(9.96), micrometres(9.94)) == ("10 µm", "9.9 µm")
    assert "Next test: circle of radius 140 mm" in diagnosis_words(diagnosis("ambiguous"))


def test_what_the_diagnosis_cannot_answer_is_never_shown_as_healthy() -> None:
    assert "cannot show" in open_question(diagnosis("not_testable_here"))
    assert "not explained by any known effect" in open_question(diagnosis("outside_library"))
    assert open_question(diagnosis("within_tolerance")) == open_question(diagnosis("named")) == ""
