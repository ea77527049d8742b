"""The table of the budget: every part that matters has a line, and the shares that are read add up to 100 %."""

from __future__ import annotations

import pytest

from analysis.inference.result import BudgetPart
from analysis.reporting.page.findings import BudgetTable, budget_table
from analysis.reporting.texts import LANGUAGES, Language, texts_of
from tests.support.handmade_diagnosis import PLAY, SMALL, diagnosis


def _percents(table: BudgetTable) -> list[float]:
    return [float(row.share.replace("−", "-").removesuffix(" %")) for row in table.rows]


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_shares_that_are_read_add_up(language: Language) -> None:
    thirds = tuple(BudgetPart("curve", 10.0, 1.0, 1 / 3, axis=k, rank="usual") for k in (1, 2, 3))
    for found in (diagnosis(), diagnosis(effects=(PLAY, SMALL)), diagnosis(budget=thirds)):
        table = budget_table(found, texts_of(language))
        assert table and sum(_percents(table)) == pytest.approx(100.0, abs=1e-9)


def test_small_parts_share_a_line_and_what_is_unusual_never_does() -> None:
    parts = (
        BudgetPart("scatter", 10.0, 0.0, 0.9989),
        BudgetPart("gravity", 0.2, 0.01, 0.0006, times_usual=12.0, rank="unusual"),
        BudgetPart("warming", 0.1, 0.2, 0.0004, times_usual=0.01, rank="undecided"),
        BudgetPart("gauges", 0.1, 0.2, 0.0001, rank="undecided"),
    )
    table = budget_table(diagnosis(budget=parts), texts_of("en"))
    assert table
    assert [row.part for row in table.rows] == [
        "scatter from run to run, and noise", "deflection under load", "2 smaller parts together"
    ]  # fmt: skip
    assert (table.rows[1].rank, table.rows[1].rank_words, table.rows[1].times) == ("unusual", "unusual", "12.0 × usual")


def test_bars_begin_at_zero_and_a_share_below_it_is_explained() -> None:
    table = budget_table(diagnosis(), texts_of("en"))
    assert table and table.negative
    first, last = table.rows[0], next(row for row in table.rows if row.share.startswith("−"))
    assert first.part == "play of axis 1 (Theta)" and first.beside == ("0.0521 ± 0.0011 °",)
    assert first.start == pytest.approx(table.zero) and first.start + first.width == pytest.approx(100)
    assert last.start + last.width == pytest.approx(table.zero)
    positive = budget_table(diagnosis(budget=(BudgetPart("scatter", 1.0, 0.0, 1.0),)), texts_of("en"))
    assert positive and not positive.negative and positive.zero == 0


def test_runs_that_show_nothing_have_no_table() -> None:
    assert budget_table(diagnosis("not_testable_here"), texts_of("en")) is None
