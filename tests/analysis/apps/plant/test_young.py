import re
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from analysis.apps.plant.history import history_of
from analysis.apps.plant.history_report import as_object, history_answer, write_page
from analysis.apps.plant.history_sentences import origin, sentences, simulated_runs
from analysis.apps.plant.records import RunRecord
from analysis.procedures.shared.quantity import Quantity
from rigs.schema.limits import CircleLimits, Limit, Limits
from tests.support.answers import printed
from tests.support.figure_histories import collected

BEGAN = datetime(2026, 11, 25, 8, 5, tzinfo=UTC)
LIMITS = Limits(yaw=CircleLimits(band_deg=Limit(watch=0.1, fail=0.2)))


@pytest.fixture(autouse=True)
def in_utc(monkeypatch):
    monkeypatch.setattr(RunRecord, "when", property(lambda run: datetime.fromisoformat(run.started)))


def runs_at(minutes: Sequence[float], *, simulated: int = 0) -> list[RunRecord]:
    figures = {"band_deg": Quantity(0.25, 0.001, "deg"), "play_j1_deg": Quantity(0.02, 0.0005, "deg")}
    return [
        RunRecord(f"lap-{k}", "f", "ur10e", (BEGAN + timedelta(minutes=at)).isoformat(), "yaw", "acw", "", "p",
               figures=figures, readings=str(k), simulated=k < simulated)
        for k, at in enumerate(minutes)
    ]  # fmt: skip


def page_of(runs: Sequence[RunRecord], path: Path, limits: Limits | None = None) -> str:
    write_page(history_of(collected(runs, limits)), path)
    return path.read_text()


def axis_labels(html: str) -> list[str]:
    return re.findall(r">([^<>]+)</text>", html[html.index("<svg") : html.index("</svg>")])


def test_one_run_is_a_table_with_its_date_and_no_axis(tmp_path):
    html = page_of(runs_at([0]), tmp_path / "one.html")
    assert "<svg" not in html and html.count("2026-11-25 08:05") == 2
    assert "0.2500 ± 0.0010 °" in html and "0.02000 ± 0.00050 °" in html
    assert "only 1 run, on 25 Nov 2026" in html
    assert "histories report a change" not in html  # nothing was looked for


def test_one_run_beyond_its_limit_is_no_story_over_time():
    history = history_of(collected(runs_at([0]), LIMITS))
    (line,) = sentences(history)
    assert "0.2 °: run lap-0 of 25 Nov 2026 has 0.2500 ± 0.0010 °" in line
    shown = printed(history_answer(history), 100)
    assert "value ± u" in shown and "since" not in shown


def test_runs_of_one_day_have_times_of_that_day(tmp_path):
    html = page_of(runs_at([0, 40, 80, 120]), tmp_path / "day.html")
    labels = axis_labels(html)
    assert {"09:00", "10:00"} <= set(labels) and "2026-Nov-25" in labels
    assert not {label for label in labels if re.fullmatch(r"20\d\d", label)}
    assert "There are 4 runs, on 25 Nov 2026" in html


@pytest.mark.parametrize(
    ("simulated", "runs", "begins"), [(0, 3, ""), (1, 1, "This run"), (3, 3, "All runs"), (1, 3, "1 of 3 runs")]
)
def test_simulated_runs_are_called_so(tmp_path, simulated, runs, begins):
    said = simulated_runs(simulated, runs)
    assert said.startswith(begins) and bool(said) == bool(begins)
    history = history_of(collected(runs_at(range(runs), simulated=simulated)))
    assert (origin(history), as_object(history)["origin"]) == (said, said)
    html = page_of(runs_at(range(runs), simulated=simulated), tmp_path / "page.html")
    assert (said in printed(history_answer(history), 100)) and (said in html) and ("simulated" in html) == bool(said)
