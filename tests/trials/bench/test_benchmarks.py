"""`scripts/bench`: its lines and its page, without measuring."""

import math
from pathlib import Path

import pytest

from tests.support.benchmarks import BEGIN, END, HEAD, Line, Peer, beside, page_with, table
from tests.trials.bench.__main__ import ROWS

PAGE = Path(__file__).parents[3] / "docs" / "benchmarks.md"


def test_line_is_judged_by_its_goal_and_its_peer():
    line = Line("forward", "an arm", "µs a pose", goal=0.4, figure=0.4, peer="another", peer_figure=0.8)
    assert line.reached and line.cells()[-2:] == ("0.5", "reached")
    alone = Line("circle", "effects", "µs a reading", goal=3.3, figure=3.4)
    assert not alone.reached and alone.cells()[-3:] == ("-", "-", "missed")
    rows = table([line, alone]).splitlines()
    assert len(rows) == 4 and {row.count("|") for row in rows} == {len(HEAD) + 1}


def test_calls_alternate_and_a_missing_peer_has_no_figure():
    called: list[str] = []
    ours, theirs = beside(lambda: called.append("rig"), Peer("it", lambda: called.append("peer")), count=10, turns=3)
    assert 0 < ours < 1e3 and 0 < theirs < 1e3
    runs = [name for name, before in zip(called, ["", *called], strict=False) if name != before]
    assert runs == ["rig", "peer"] * 4
    assert math.isnan(beside(lambda: None, Peer("it", missing="no wheel"), count=1, turns=1)[1])


def test_results_go_between_the_marks_of_the_page():
    page = page_with(f"before\n{BEGIN}\nold\n{END}\nafter\n", "new")
    assert page == f"before\n{BEGIN}\n\nnew\n\n{END}\nafter\n"
    with pytest.raises(ValueError, match="marks"):
        page_with("a page without", "new")


def test_the_page_has_every_row_of_the_program():
    measured = PAGE.read_text(encoding="utf-8").partition(BEGIN)[2].partition(END)[0]
    rows = {line.split("|")[1].strip() for line in measured.splitlines() if line.startswith("| ")}
    assert rows == {*ROWS, "row", "---"}
