"""The answer of a diagnosis as blocks: every section, the same for terminal, page and JSON."""

import json
import re
from dataclasses import replace
from typing import get_args

import pytest

from analysis.apps.report.blocks import (
    Block,
    Heading,
    Segments,
    Sentence,
    Table,
    as_object,
)
from analysis.apps.report.diagnosis_answer import diagnosis_answer, sections_of, summary_blocks
from analysis.apps.report.html_page import environment
from analysis.apps.report.summary_words import summarise
from analysis.apps.report.texts import Language, keys_of, texts_of
from analysis.diagnosis.judge.budget_part import BudgetPart
from analysis.diagnosis.judge.result import Condition, Diagnosis
from rigs.effects import JointOffset, TransmissionError
from tests.support.answers import printed
from tests.support.every import in_every_language
from tests.support.handmade_diagnosis import LOAD, PLAY, SMALL, diagnosis

EN = texts_of("en")
CONDITIONS = get_args(Condition)
ALWAYS = ["details", "gaps", "inseparable", "undetectable", "where", "doubts"]


def table_of(found: Diagnosis, section: str, language: Language = "en") -> Table:
    return next(block for block in sections_of(found, texts_of(language))[section] if isinstance(block, Table))


def texts_in(block: Block) -> list[str]:
    """Every text of a block."""
    match block:
        case Heading():
            return [block.text]
        case Segments():
            return [part.name for part in block.parts]
        case Sentence():
            return [block.lead, block.text]
        case Table():
            return [text for row in block.cells() for cell in row for text in (cell.text, *cell.lines)]
    return [block.words]


@in_every_language
@pytest.mark.parametrize("condition", CONDITIONS)
def test_every_condition_has_its_sections_in_order(condition, language):
    sections = sections_of(diagnosis(condition), texts_of(language))
    assert [name for name in sections if name in ALWAYS] == ALWAYS
    testable = condition != "not_testable_here"
    assert ("budget" in sections) == ("unexplained" in sections) == testable
    assert ("faults" in sections) == (condition in ("named", "ambiguous", "outside_library", "out_of_range"))
    assert all(isinstance(blocks[0], Heading) and len(blocks) > 1 for blocks in sections.values())
    text = printed(sum(sections.values(), list[Block]()))
    assert not re.search(r"\b(nan|None|inf)\b", text) and not {"{", "}"} & set(text)


@pytest.mark.parametrize("width", [20, 30, 40, 80, 200])
def test_a_terminal_of_any_width_shows_every_letter(width):
    found = diagnosis("undecided", effects=(replace(PLAY, doubt="usual"),), acts=(LOAD,))
    summary = summarise(found)
    text = printed(summary_blocks(summary, EN), width)
    assert max(map(len, text.splitlines())) <= width
    letters = "".join(text.split())
    for shown in (summary.badge, summary.headline, *summary.unknowns, summary.next, summary.error.basis):
        assert "".join(shown.split()) in letters, shown


@in_every_language
def test_shown_shares_add_up_to_100_percent(language):
    thirds = tuple(BudgetPart("curve", 10.0, 1.0, 1 / 3, axis=k, rank="usual") for k in (1, 2, 3))
    for found in (diagnosis(), diagnosis(effects=(PLAY, SMALL)), diagnosis(budget=thirds)):
        shares = [row[1] for row in table_of(found, "budget", language).cells()]
        assert sum(float(share.text.removesuffix(" %")) for share in shares) == pytest.approx(100.0, abs=1e-9)
        assert max(share.bar or 0.0 for share in shares) == 1


def test_small_parts_share_a_row_unless_they_are_unusual():
    parts = (
        BudgetPart("scatter", 10.0, 0.0, 0.9989),
        BudgetPart("gravity", 0.2, 0.01, 0.0006, times_usual=12.0, rank="unusual"),
        BudgetPart("warming", 0.1, 0.2, 0.0004, times_usual=0.01, rank="undecided"),
        BudgetPart("gauges", 0.1, 0.2, 0.0001, rank="undecided"),
    )
    table = table_of(diagnosis(budget=parts), "budget")
    names = [keys_of(row[0].text)[0] for row in table.cells()]
    assert names == ["part_scatter", "part_gravity", "smaller_parts"]
    assert table.ranks == ["other", "unusual", "other"] and table.cells()[1][3].lines == ["12.0 × usual"]


def test_parts_that_cancel_a_part_are_below_it():
    large, *_ = diagnosis().budget
    curve_of_2 = BudgetPart("curve", 3.96, 0.26, -0.1, axis=2)
    both = replace(large, together=(replace(large, um=7.2, u_um=0.2), curve_of_2))
    below = table_of(diagnosis(budget=(both,)), "budget").cells()[0][0].lines
    assert any("7.2 ± 0.2" in line for line in below) and any("4.0 ± 0.3" in line for line in below)
    doubted = replace(both, together=(both.together[0], replace(curve_of_2, u_um=2.0)))
    assert len(table_of(diagnosis(budget=(doubted,)), "budget").cells()[0][0].lines) == len(below) - 2
    assert both.to_dict()["cancelled"] == ("curve 2",) and len(both.to_dict()["together"]) == 2


def test_a_fault_has_size_contribution_probability_rest_parameters_and_place():
    ((name, *cells),) = table_of(diagnosis("named"), "faults").cells()
    assert [cell.text for cell in cells] == ["0.0521 ± 0.0011 °", "5.8", "> 99.9 %", "2.0"]
    assert any("0.310 ± 0.042" in line for line in name.below) and any("237°" in line for line in name.below)


def test_rivals_and_twins_are_below_the_fault():
    ((name, *_),) = table_of(diagnosis("ambiguous"), "faults").cells()
    assert "0.587 ± 0.023 mm" in name.lines[-1] and "(36 %)" in name.lines[-1]
    twin = replace(PLAY, twins=(JointOffset(axis=2, offset_deg=0.1),))
    ((name, *_),) = table_of(diagnosis("named", effects=(twin,)), "faults").cells()
    assert keys_of(name.lines[-1])[0] == "twins"


def test_an_unconfirmed_effect_has_its_reason_and_no_act():
    wave = replace(SMALL, effect=TransmissionError(axis=1, order=60, amplitude_deg=0.01), doubt="unexplained")
    sections = sections_of(diagnosis("named", effects=(PLAY, SMALL, wave)), EN)
    last = sections["faults"][-1]
    assert isinstance(last, Sentence) and {"unconfirmed", "doubt_unexplained"} <= set(keys_of(last.text))
    assert len(sections["acts"]) == 2


def test_terminal_page_and_json_show_the_same_texts():
    found = diagnosis("named", doubts=("a <i>doubt</i>",))
    blocks = diagnosis_answer(found)
    plain = json.loads(json.dumps(as_object(blocks)))
    page = environment().from_string('{% from "blocks.html" import show %}{{ show(blocks) }}').render(blocks=blocks)
    screen = "".join(printed(blocks, 300).split())
    assert "<i>doubt" not in page and [block["kind"] for block in plain] == [
        type(block).__name__.lower() for block in blocks
    ]
    for text in (text for block in blocks for text in texts_in(block)):
        assert "".join(text.split()) in screen
        assert environment().from_string("{{ text }}").render(text=text) in page
    assert plain[0]["keys"] == list(keys_of(summarise(found).headline))
    ids = re.findall(r'<h2 id="([^"]*)"', page)
    assert "budget" in ids and len(ids) == len(set(ids))
    assert set(re.findall(r'aria-labelledby="([^"]*)"', page)) <= set(ids)
