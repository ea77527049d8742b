import csv
import io
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from analysis.apps.plant.history import history_of
from analysis.apps.plant.history_sentences import remarks, sentences
from tests.support.changed_rigs import shipped
from tests.support.command_line import errors_of, failure_of, json_of, succeeded
from tests.support.dated_runs import dated_run
from tests.support.figure_histories import GREW, STILL, collected


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    directory = tmp_path_factory.mktemp("runs")
    for day in range(10):
        dated_run(directory, day, 0.01 if day < 5 else 0.02)
    (directory / "deeper" / "odd").mkdir(parents=True)
    (directory / "deeper" / "odd" / "manifest.json").write_text("{")
    return directory


def printed(*words: str | Path) -> str:
    return succeeded(*words, COLUMNS="100").stdout


def test_recorded_files_become_a_sentence_a_table_and_a_page(runs, tmp_path):
    page = tmp_path / "page.html"
    shown = " ".join(printed(f"history ur10e --runs {runs} -o {page}").split())
    assert re.search(r"axis 3 rose from 0\.010?\d* to 0\.0[12]\d* ° between 5 and 6 May 2026", shown)
    assert re.search("1 run .*: deeper/odd: ", shown)
    html = page.read_text()
    assert html.count("<svg") >= 5 and "axis 3 rose" in html
    assert not re.search(r'(src|href)="(?!#)', re.sub(r'xlink:href="#', 'xlink:here="#', html))  # needs no other file


def test_limit_is_in_table_and_page_with_its_day(runs, tmp_path):
    limited = tmp_path / "limited.yaml"
    limited.write_text(yaml.safe_dump(shipped() | {"limits": {"yaw": {"circular_deviation_mm": 0.02}}}))
    page = tmp_path / "page.html"
    shown = " ".join(printed(f"history ur10e --runs {runs} --rig {limited} -o {page}").split())
    told = "0.02 mm since 1 May 2026 (run 000-acw)"
    assert told in shown and "beyond 0.02" in shown.partition("limit")[2]
    assert told in page.read_text() and "limit: beyond 0.02 since 2026-05-01" in page.read_text()
    limited.write_text(yaml.safe_dump(shipped() | {"limits": {}}))
    assert "limit" not in printed(f"history ur10e --runs {runs} --rig {limited}")  # this rig file has none


def test_json_and_csv_hold_every_point(runs):
    answer = json_of(f"history ur10e --runs {runs} --figure play_j3_deg")
    (series,) = answer["series"]
    assert [point["run"] for point in series["points"]] == [f"{day:03d}-acw" for day in range(10)]
    assert (series["changes"][0]["after_run"], series["changes"][0]["by_run"]) == ("004-acw", "005-acw")
    assert set(answer["without_figures"]) == {"deeper/odd"}
    rows = list(csv.DictReader(io.StringIO(printed(f"history ur10e --runs {runs} --csv"))))
    own = [row for row in rows if row["figure"] == "play_j3_deg"]
    assert [float(row["value"]) for row in own] == [point["value"] for point in series["points"]]


def test_since_and_figure_select_and_unknown_ones_are_refused(runs):
    answer = json_of(f"history ur10e --runs {runs} --since 2026-05-08")
    assert {len(series["points"]) for series in answer["series"]} == {3}
    assert "fewer than 8 runs" in " ".join(answer["remarks"])
    assert all("limit" in sentence for sentence in answer["sentences"])  # no change is found in so few
    for options, code in (
        (f"ur10e --runs {runs} --since 2027-01-01", "run.missing"),
        (f"ur10e --runs {runs} --figure nothing", "usage"),
        (f"ur10e --runs {runs} --csv", "usage"),
        (runs, "usage"),
    ):
        assert failure_of(f"history {options}")[1] == code


def test_a_page_has_the_name_of_a_page(runs, tmp_path):
    letter = tmp_path / "letter.txt"
    letter.write_text("Dear all,")
    errors_of(f"history ur10e --runs {runs} -o {letter}", exit_code=2)
    assert letter.read_text() == "Dear all,"


def test_a_copy_is_no_run_after_a_repair(runs, tmp_path):
    run = next(path for path in sorted(runs.iterdir()) if path.is_dir())
    copy = shutil.copytree(run, tmp_path / "copy")
    for words in (f"compare {run} --against {copy}", f"calibrate {run} --hold-out {copy} --fit backlash:1"):
        assert "copy" in errors_of(words)


def test_compare_takes_every_run_after_against(runs):
    after, before = ([runs / f"{day:03d}-acw" for day in days] for days in ((7, 8, 9), (0, 1, 2)))
    answer = json_of("compare", *after, "--against", *before)
    larger = {one["figure"] for one in answer["differences"] if one["is_larger"]}
    assert "play_j3_deg" in larger
    assert {(one["runs_before"], one["runs_after"]) for one in answer["differences"]} == {(3, 3)}
    assert "acw rose" in " ".join(printed("compare", *after, "--against", *before).split())
    assert failure_of("compare", *after, "--rig", "ur10e-cell", "--against", *before)[1] == "usage"


def test_options_with_runs_of_a_comparison_take_urls(runs):
    for option in ("--against", "--unseen"):
        assert failure_of(f"compare {runs}/000-acw {option} s3://bucket/runs")[1] in (
            "package.missing",
            "file.unreadable",
        )


def test_change_shown_by_several_tests_is_one_sentence():
    history = history_of(collected(GREW))
    (play,) = [one for one in sentences(history) if "axis 2" in one]
    assert "axis 2 rose" in play and "also show" in play


def test_unchanged_robot_is_reported_as_such():
    history = history_of(collected(STILL))
    (line,) = sentences(history)
    assert "within" in line
    assert "32 series of 160 runs evaluated" in remarks(history)[0]


def test_other_programs_and_placements_are_series_of_their_own():
    half = len(STILL) // 2
    moved = [replace(run, program="other", placement="north") for run in STILL[half:]]
    titles = {series.title for series in history_of(collected([*STILL[:half], *moved])).series}
    assert "yaw acw, placement north" in titles and len(titles) == 8
