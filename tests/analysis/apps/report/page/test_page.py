"""The page is one file with the verdict first. It makes no request and escapes outside text."""

import base64
import errno
import gzip
import hashlib
import html
import json
import os
import re
from dataclasses import replace
from typing import get_args

import pytest

from analysis import evaluate_runs, load_run
from analysis.apps.report.chart import still
from analysis.apps.report.page.write_page import Report, gather, rendered, write_page
from analysis.apps.report.run_charts import circle_charts, target_charts
from analysis.apps.report.summary_words import summarise
from analysis.apps.report.texts import texts_of
from analysis.diagnosis.judge.residuals import HeldOutResidual, Residual
from analysis.diagnosis.judge.result import Condition
from rigs.load import load, load_hidden
from rigs.schema.limits import Limits
from tests.support.command_line import errors_of, succeeded
from tests.support.handmade_diagnosis import LOAD, diagnosis
from tests.support.nightly import cases
from tests.support.refusals import refused
from tests.support.written_runs import write_simulated

RIG, TEXT = load("ur10e-cell")
HIDDEN = load_hidden("ur10e-cell").apply_to(RIG)
MOST_BYTES = 3_000_000
EVIL = '<script>alert(1)</script>"\x1b[31m\u202e'

EN = texts_of("en")


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A run of each test of a robot with play in its base."""
    folder = tmp_path_factory.mktemp("runs")
    made = [*write_simulated(HIDDEN, TEXT, "yaw", ("acw", "cw"), [1], folder)]
    for test in ("radial", "repeatability"):
        made += write_simulated(HIDDEN, TEXT, test, (None,), [1], folder)
    return made


@pytest.fixture(scope="module")
def report(runs):
    results = evaluate_runs([load_run(run) for run in runs])
    return gather(results, diagnosis=diagnosis("named", rig=RIG), progress=lambda doing: None)


@pytest.fixture(scope="module")
def page(report):
    return rendered(report, texts_of("en"))


def _small(report: Report) -> Report:
    """Return a report of the last run without a finding, because pictures take most of the time."""
    return replace(report, results=report.results[-1:], found=diagnosis("not_testable_here", curves=(), maps=()))


def _text(page: str) -> str:
    body = re.sub(r"<(script|style)\b.*?</\1>|<[^>]*>", " ", page, flags=re.DOTALL)
    return " ".join(body.split())


def test_the_page_says_the_hidden_play_before_anything_else(page):
    text = _text(page)
    first = text[text.index("Verdict") :][:1500]
    size = r"0\.0521 ± 0\.0011 °"
    assert re.search(rf"Verdict: . {EN('badge_cause_found')} Play of axis 1 \(base\), {size}, ", first)
    headings = (
        "error_now_label", "main_causes", "do_next", "details", "budget", "limits", "trace",
    )  # fmt: skip
    places = [text.lower().index(EN(heading).lower()) for heading in headings]
    assert places == sorted(places)


def test_the_first_page_has_both_directions_of_a_circle_and_its_figures_once(page):
    sheet = page[page.index('class="sheet"') : page.index("<details>")]
    assert sheet.count('class="polar"') == 2 == sheet.count('class="live"') and "acw against cw" in sheet
    assert all(EN.label(name) in sheet for name in ("band_deg", "circular_deviation_mm", "hysteresis_max_mm"))
    titles = re.findall(r"<figcaption><b>(.*?)</b>", page)
    drawn = re.findall(r"<figcaption><b>(.*?)</b>", sheet)
    assert len(drawn) == 2 and all(titles.count(title) == 1 for title in drawn)


def test_the_tiles_show_the_words_of_the_summary_as_text_and_never_as_html(report):
    evil = replace(LOAD, command=("correct", "<script>x</script>.yaml", "-o", "D"))
    found = diagnosis("undecided", acts=(evil,), curves=(), maps=())
    page = rendered(replace(report, results=report.results[-1:], found=found), texts_of("en"))
    summary = summarise(found)
    assert "<script>x" not in page
    tiles = page[page.index('class="tiles"') : page.index("<details>")]
    assert html.escape(summary.command, quote=False) in tiles and html.escape(summary.next) in tiles
    assert summary.error.words in tiles and f'<p class="lead headline">{summary.headline}</p>' in page


def test_the_page_asks_for_nothing_and_allows_two_scripts_alone(page):
    assert len(page.encode()) < MOST_BYTES
    assert re.findall(r"""(?:src|href)=["'](?!data:)""", page) == []
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page)
    assert policy[1].startswith("default-src 'none'") and "unsafe-eval" not in policy[1]
    allowed = re.findall(r"'sha256-([^']*)'", policy[1])
    scripts = re.findall(r'<script type="text/javascript">(.*?)</script>', page, flags=re.DOTALL)
    packed = re.search(r'id="plotly">([^<]*)<', page)
    assert packed and len(scripts) == 1
    scripts.append(gzip.decompress(base64.b64decode(packed[1])).decode())
    assert [base64.b64encode(hashlib.sha256(one.encode()).digest()).decode() for one in scripts] == allowed


def test_every_picture_is_there_live_and_still(page):
    packed = re.search(r'id="data">([^<]*)<', page)
    pictures = json.loads(gzip.decompress(base64.b64decode(packed[1])))["pictures"]
    assert page.count('class="live"') == page.count('class="still"') == len(pictures) > 10
    assert all(f'id="{name}"' in page for name in pictures)
    assert {picture["frame"] for picture in pictures.values()} == {"straight", "polar", "targets", "sphere"}


def test_the_trace_has_the_hash_of_each_file(page, runs):
    for run in runs:
        for file in run.glob("*.parquet"):
            assert hashlib.sha256(file.read_bytes()).hexdigest() in page
    assert "none stated" in _text(page)  # the gauges of the shipped rig have no certificate


@pytest.mark.parametrize(
    ("language", "words", "play"),
    [
        ("de", "Alle Schritte, in dieser Reihenfolge", "Spiel von Achse 1 (base)"),
        ("ko", "모든 조치(이 순서대로)", "축 1(base)의 백래시"),
    ],
)
def test_fixed_texts_are_in_the_language_asked_for(report, page, language, words, play):
    text = rendered(replace(report, results=report.results[-1:]), texts_of(language))
    assert words in text and f'<html lang="{language}">' in text
    assert play in _first_sentence(text) and "lay of axis 1 (base)" in _first_sentence(page)
    assert _shares(text) == _shares(page)
    assert len(_shares(page)) >= 3 and sum(_shares(page)) == pytest.approx(100.0, abs=1e-9)


def _shares(page: str) -> list[float]:
    return [float(one.replace("−", "-")) for one in re.findall(r'share"[^>]*><div><span>([−\d.]+) %', page)]


def _first_sentence(page: str) -> str:
    sentence = re.search(r'<p class="lead headline">(.*?)</p>', page, flags=re.DOTALL)
    return sentence[1]


def test_foreign_text_is_shown_as_text(report):
    robot = report.rig.robot.model_copy(update={"name": EVIL})
    page = rendered(replace(_small(report), rig=report.rig.model_copy(update={"robot": robot})), texts_of("en"))
    assert "<script>" not in page and "\x1b" not in page and "\u202e" not in page
    assert "&lt;script&gt;alert(1)" in page


def test_runs_that_show_nothing_are_not_called_faultless(report):
    text = _text(rendered(_small(report), texts_of("en")))
    assert f"? {EN('badge_not_testable_here')} {EN('finding_not_testable_here')}" in text
    assert "Error budget" not in text


def test_remaining_error_has_a_row_for_each_comparison(report):
    looked = {"posture": 0.004, "approach": 0.31, "temperature": None}
    residual = Residual(1.4, held_out=HeldOutResidual(108.0, 25.0, looked))
    found = diagnosis("named", curves=(), maps=(), residual=residual)
    last = report.results[-1]
    manifest = last.measured.run.manifest.model_copy(update={"placement": last.test})
    last = replace(last, measured=replace(last.measured, run=replace(last.measured.run, manifest=manifest)))
    text = _text(rendered(replace(report, results=(last,), found=found), texts_of("en")))
    assert f"· {last.test} " not in text
    for key in ("remains_posture", "remains_undetected", "remains_approach", "remains_unknown"):
        assert EN(key) in text
    assert "108 µm" in text and "25 µm" in text and "31 %" in text


@pytest.mark.parametrize("condition", cases(get_args(Condition), ("named", "undecided", "nothing_unusual")))
def test_condition_and_accuracy_have_a_badge_each(report, condition):
    text = _text(rendered(replace(report, results=report.results[-1:], found=diagnosis(condition)), texts_of("en")))
    badge = summarise(diagnosis(condition)).badge
    assert f"{badge} · PASS" in text.partition("Verdict")[0]  # in the title
    assert text.index("Do next") < text.index("Error budget") if condition != "not_testable_here" else True
    assert (f"✓ {badge}" in text) == (condition in ("uncalibrated", "nothing_unusual"))


def test_a_report_is_about_one_robot(runs):
    other = load("paper-fanuc")[0]
    with refused("robot.other", "--rig describes FANUC-like elbow arm, uncoupled"):
        gather(evaluate_runs([load_run(runs[0])]), other, progress=lambda doing: None)


def test_a_page_without_a_verdict_says_which_limits_it_needs(report):
    unlimited = report.rig.model_copy(update={"limits": Limits(data_sheet_rp_mm=0.05)})
    text = _text(rendered(replace(_small(report), rig=unlimited, results=report.results[:1]), texts_of("en")))
    assert "limits: yaw: circular_deviation_mm: {watch: 0.05" in text and EN("or_repeatability") in html.unescape(text)


def test_a_full_disk_keeps_the_old_page(report, tmp_path, monkeypatch):
    file, small = tmp_path / "page.html", _small(report)
    write_page(small, file, "de")
    old, write_full = file.read_bytes(), os.pwrite

    def full(fd: int, data: bytes | memoryview, offset: int) -> int:
        if offset:
            raise OSError(errno.ENOSPC, "No space left on device")
        return write_full(fd, memoryview(data)[:1000], offset)

    with monkeypatch.context() as disk:
        disk.setattr(os, "pwrite", full)
        with refused("output.not_writable", "No space left on device"):
            write_page(small, file)
    assert file.read_bytes() == old and list(tmp_path.iterdir()) == [file]
    write_page(small, file)
    assert '<html lang="en">' in file.read_text()


def test_the_command_writes_the_page_and_refuses_another_name(runs, tmp_path):
    arguments = ["report", *runs[:2], "--no-diagnosis", "-o"]
    succeeded(*arguments, tmp_path / "page.html")
    assert "--no-diagnosis" in _text((tmp_path / "page.html").read_text())
    assert "FILE.html" in errors_of(*arguments, tmp_path / "page.txt", exit_code=2)


def test_diagnose_writes_the_same_page(runs, report, page, tmp_path, monkeypatch):
    monkeypatch.setattr("analysis.diagnosis.diagnose.diagnose", lambda *_: report.found)
    succeeded("diagnose", *runs, "-o", tmp_path / "page.html")
    written = _text((tmp_path / "page.html").read_text())
    first = slice(written.index("Verdict"), written.index("Verdict") + 1500)
    assert written[first] in _text(page) and "play of axis 1 (base)" in written[first]


def test_acw_and_cw_are_laid_over_each_other_straight_and_polar(report):
    circles = [result for result in report.results if result.test == "yaw"]
    charts = circle_charts(circles, texts_of("en"))
    assert [chart.frame for chart in charts] == ["straight", "straight", "polar", "polar"]
    assert all([line.role for line in chart.lines] == ["acw", "cw"] for chart in charts)
    at_deg = [at for at, _ in charts[0].marks]
    assert at_deg == [one.phi_deg for one in circles[0].reversals]
    named = [text for _, text in charts[0].marks if text]
    assert all(text.startswith("axis ") for text in named) and {"1", "5"} <= {*" ".join(named).replace(",", "").split()}


def test_a_still_picture_keeps_its_numbers_and_is_the_same_each_time(report):
    (sphere, targets) = target_charts(next(one for one in report.results if one.test == "radial"), texts_of("en"))
    first = still(targets)
    assert first == still(targets) and first.startswith("<svg") and len(first) < 60_000
    assert "least-squares sphere" in still(sphere)
