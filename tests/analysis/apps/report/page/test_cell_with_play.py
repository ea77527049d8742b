"""The page of a cell with a hidden play of 0.02° in axis 1 and a gear error of axis 4: what its box and bars say."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from analysis import evaluate_runs, load_run
from analysis.apps.report.page.page_content import gather
from analysis.apps.report.page.write_page import rendered
from analysis.apps.report.texts import texts_of
from rigs.effects import Backlash, TransmissionError
from rigs.load import load, load_hidden
from rigs.schema.effect import name_of
from tests.support.written_runs import write_simulated

RIG, TEXT = load("paper-fanuc")
HIDDEN = load_hidden("paper-fanuc").apply_to(RIG)
EFFECTS = [
    one
    for one in HIDDEN.effects
    if (isinstance(one, Backlash) and one.axis == 1) or (isinstance(one, TransmissionError) and one.axis == 4)
]


@pytest.mark.cpu_limit(120)  # its diagnosis took 56 s on a busy computer
def test_one_lap_each_way_has_the_play_in_the_first_sentence_and_shares_that_add_up(tmp_path: Path) -> None:
    assert len(EFFECTS) == 2
    runs = write_simulated(
        HIDDEN.model_copy(update={"effects": tuple(EFFECTS)}), TEXT, "yaw", ("acw", "cw"), [0], tmp_path
    )
    report = gather(evaluate_runs([load_run(run) for run in runs]), progress=lambda doing: None)
    found, page = report.found, rendered(report, texts_of("en"))
    assert found is not None
    play = next(one for one in found.budget if one.name == "backlash 1")
    assert play.rank in ("usual", "unusual", "undecided") and play.share > 0.9
    assert found.condition != "undecided"  # what is sure, and of usual size, is not doubted for being driven once
    assert "lay of axis 1 (Theta)" in _first_sentence(page)
    assert sum(_shares(page)) == pytest.approx(100.0, abs=1e-9) and len(_shares(page)) >= 3
    for language, name in (("de", "Spiel von Achse 1 (Theta)"), ("ko", "축 1(Theta)의 백래시")):
        other = rendered(replace(report, results=report.results[:1]), texts_of(language))  # fewer pictures
        assert name in _first_sentence(other) and _shares(other) == _shares(page)
    repairs = {name_of(one.effect): one for one in found.acts if one.effect and one.place == "used"}
    for one in found.standing:
        act = repairs.get(name_of(one.effect))
        assert act is None or act.remains_um == pytest.approx(one.alone_um)


def _shares(page: str) -> list[float]:
    return [float(one.replace("−", "-")) for one in re.findall(r'share"[^>]*><div><span>([−\d.]+) %', page)]


def _first_sentence(page: str) -> str:
    sentence = re.search(r'<p class="lead headline">(.*?)</p>', page, flags=re.DOTALL)
    assert sentence
    return sentence[1]
