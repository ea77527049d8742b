"""The faults of a diagnosis, in sentences that a person can act on; and the table of its budget, in which every part
that matters has a line and the shares that are read add up to 100 %."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from analysis.apps.report.page.findings import BudgetRow, budget_rows, diagnosis_words, findings_of, micrometres
from analysis.apps.report.texts import LANGUAGES, Language, texts_of
from analysis.diagnosis.judge.result import BudgetPart
from rigs.effects import BallForm, JointOffset, TransmissionError
from tests.support.handmade_diagnosis import PLAY, SMALL, ZERO, diagnosis

ENGLISH = texts_of("en")


def test_a_finding_says_what_where_and_how_much() -> None:
    (one,) = findings_of(diagnosis("named"), ENGLISH)
    assert one.what == "Axis 1 (Theta) has play of 0.0521 ± 0.0011 °."
    assert "on the circle at 237°" in one.where
    assert one.share == "It accounts for 5.8 µm rms, 90 % of the error."
    assert one.others == ()


def test_rivals_that_cannot_be_excluded_and_twins_are_said() -> None:
    (one,) = findings_of(diagnosis("ambiguous"), ENGLISH)
    assert one.what == "The zero of axis 5 (beta) is off by 0.1032 ± 0.0041 °."
    (rivals,) = one.others
    assert rivals.startswith("These tests cannot exclude: Length a of axis 5 (beta) in the rig file: 0.587 ± 0.023 mm")
    twin = replace(PLAY, twins=(JointOffset(axis=2, offset_deg=0.1),))
    (one,) = findings_of(diagnosis("named", effects=(twin,)), ENGLISH)
    assert one.others == ("These tests cannot separate it from zero of axis 2 (W); only the sum is known.",)


def test_the_one_that_moves_most_comes_first_and_what_is_no_fault_is_left_out() -> None:
    both = findings_of(diagnosis("named", effects=(ZERO, PLAY, SMALL)), ENGLISH)
    assert [one.what.partition(" ")[0] for one in both] == ["Axis", "The"]


def test_a_gear_has_whole_teeth() -> None:
    gear = TransmissionError(axis=4, order=8.001, amplitude_deg=0.03, phase_deg=40)
    (one,) = findings_of(diagnosis("named", effects=(replace(PLAY, effect=gear, sd={"amplitude_deg": 1e-4}),)), ENGLISH)
    assert one.what.endswith(", 8 times a turn."), one.what


def test_an_effect_without_a_sentence_is_said_by_its_noun_and_its_number() -> None:
    ball = replace(PLAY, effect=BallForm(lobes=3, amplitude_mm=0.002), sd={}, alone_um=math.nan)
    (one,) = findings_of(diagnosis("named", effects=(ball,), budget=()), texts_of("de"))
    assert one.what == "Form der Kugel, 3 Bögen: 0.002 mm."
    assert one.where == one.share == ""


def test_nothing_unknown_is_shown_as_a_number() -> None:
    assert micrometres(math.nan) == "–"
    assert (micrometres(9.96), micrometres(9.94)) == ("10 µm", "9.9 µm")
    assert "Most useful next test: circle of radius 140 mm" in diagnosis_words(diagnosis("ambiguous"))


def _percents(table: list[BudgetRow]) -> list[float]:
    return [float(row.share.removesuffix(" %")) for row in table]


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_shares_that_are_read_add_up(language: Language) -> None:
    thirds = tuple(BudgetPart("curve", 10.0, 1.0, 1 / 3, axis=k, rank="usual") for k in (1, 2, 3))
    for found in (diagnosis(), diagnosis(effects=(PLAY, SMALL)), diagnosis(budget=thirds)):
        table = budget_rows(found, texts_of(language))
        assert table and sum(_percents(table)) == pytest.approx(100.0, abs=1e-9)


def test_small_parts_share_a_line_and_what_is_unusual_never_does() -> None:
    parts = (
        BudgetPart("scatter", 10.0, 0.0, 0.9989),
        BudgetPart("gravity", 0.2, 0.01, 0.0006, times_usual=12.0, rank="unusual"),
        BudgetPart("warming", 0.1, 0.2, 0.0004, times_usual=0.01, rank="undecided"),
        BudgetPart("gauges", 0.1, 0.2, 0.0001, rank="undecided"),
    )
    table = budget_rows(diagnosis(budget=parts), texts_of("en"))
    assert [row.part for row in table] == [
        "scatter between runs and noise", "deflection under load", "2 smaller parts"
    ]  # fmt: skip
    assert (table[1].rank, table[1].rank_words, table[1].times) == ("unusual", "unusual", "12.0 × usual")


def test_the_largest_part_has_the_longest_bar() -> None:
    first, *others = budget_rows(diagnosis(), texts_of("en"))
    assert first.part == "play of axis 1 (Theta)" and first.beside == ("0.0521 ± 0.0011 °",)
    assert first.width == pytest.approx(100) and all(row.width < 10 for row in others)


def test_runs_that_show_nothing_have_no_table() -> None:
    assert not budget_rows(diagnosis("not_testable_here"), texts_of("en"))
