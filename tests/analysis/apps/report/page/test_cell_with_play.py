"""The page of a cell with a hidden play of 0.02° in axis 1 and a gear error of axis 4: what its box and bars say."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from analysis import evaluate_runs, load_run
from analysis.apps.report.diagnosis_words import micrometres
from analysis.apps.report.page.page_content import Report, gather
from analysis.apps.report.page.write_page import rendered
from analysis.apps.report.texts import texts_of
from analysis.diagnosis.judge.result import Diagnosis
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
PLAY = "play of axis 1 (Theta)"


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two runs each way."""
    assert len(EFFECTS) == 2
    rig = HIDDEN.model_copy(update={"effects": tuple(EFFECTS)})
    return [*write_simulated(rig, TEXT, "yaw", ("acw", "cw"), [0, 1], tmp_path_factory.mktemp("runs"))]


def _report(runs: list[Path]) -> Report:
    return gather(evaluate_runs([load_run(run) for run in runs]), progress=lambda doing: None)


def _found(report: Report) -> Diagnosis:
    assert report.found is not None
    return report.found


def _box(page: str) -> str:
    box = page[page.index('<section class="verdict">') :].partition("</section>")[0]
    return " ".join(re.sub(r"<[^>]*>", " ", box).split())


def _shares(page: str) -> list[float]:
    return [float(one.replace("−", "-")) for one in re.findall(r'class="share"><div><span>([−\d.]+) %', page)]


def _first_sentence(page: str) -> str:
    sentence = re.search(r'<p class="lead headline">(.*?)</p>', page, flags=re.DOTALL)
    assert sentence
    return sentence[1]


@pytest.mark.nightly
@pytest.mark.cpu_limit(120)  # its diagnosis of four runs takes some 60 s on a busy computer
def test_two_laps_each_way_have_the_play_in_the_first_sentence_and_shares_that_add_up(runs: list[Path]) -> None:
    report = _report(runs)
    found, page = _found(report), rendered(report, texts_of("en"))
    assert "play of axis 1" in _box(page).lower()
    assert re.search(r'<tr class="usual"><th scope="row">play of axis 1 \(Theta\)', page)  # twice what is usual
    _assert_each_language_says_the_play_and_the_shares(report, page)
    _assert_promises_are_of_one_remedy(found, page)


@pytest.mark.cpu_limit(120)  # its diagnosis took 56 s on a busy computer
def test_one_lap_each_way_has_the_play_in_the_first_sentence_too(runs: list[Path]) -> None:
    report = _report(runs[:2])
    found, page = _found(report), rendered(report, texts_of("en"))
    play = next(one for one in found.budget if one.name == "backlash 1")
    assert play.rank in ("usual", "unusual", "undecided") and play.share > 0.9
    assert found.condition != "undecided"  # what is sure, and of usual size, is not doubted for being driven once
    _assert_each_language_says_the_play_and_the_shares(report, page)
    _assert_promises_are_of_one_remedy(found, page)


@pytest.mark.nightly
def test_one_lap_of_one_direction_promises_no_more_than_each_remedy_alone(runs: list[Path]) -> None:
    report = _report(runs[:1])
    found, page = _found(report), rendered(report, texts_of("en"))
    assert PLAY in _first_sentence(page)
    _assert_promises_are_of_one_remedy(found, page)


def _assert_each_language_says_the_play_and_the_shares(report: Report, page: str) -> None:
    assert PLAY in _first_sentence(page)
    assert sum(_shares(page)) == pytest.approx(100.0, abs=1e-9) and len(_shares(page)) >= 3
    for language, play in (("de", "Spiel von Achse 1 (Theta)"), ("ko", "축 1(Theta)의 백래시")):
        other = rendered(replace(report, results=report.results[:1]), texts_of(language))  # fewer pictures
        assert play in _first_sentence(other)
        assert _shares(other) == _shares(page)


def _assert_promises_are_of_one_remedy(found: Diagnosis, page: str) -> None:
    """Check the error stated for each action: it is the error after this action and no other."""
    promised = re.findall(r"The error then falls from ([\d.]+ µm) to ((?:&lt; )?[\d.]+(?: ± [\d.]+)? µm)", _box(page))
    stated = [one for one in found.acts if one.removes]
    assert [after for _, after in promised] == [
        micrometres(one.remains_um, one.remains_u_um).replace("<", "&lt;") for one in stated
    ]
    repairs = {name_of(one.effect): one for one in found.acts if one.effect and one.place == "used"}
    for one in found.standing:
        act = repairs.get(name_of(one.effect))
        assert act is None or act.remains_um == pytest.approx(one.alone_um)
