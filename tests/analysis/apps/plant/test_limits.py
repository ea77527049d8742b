import time
from dataclasses import replace
from datetime import UTC, date, datetime, timedelta

import numpy as np
import pytest

from analysis.apps.plant.changes import Trend
from analysis.apps.plant.history import Series, history_of, judge
from analysis.apps.plant.history_report import as_object
from analysis.apps.plant.history_sentences import against_limit, sentences
from analysis.apps.plant.records import RunRecord
from analysis.procedures.shared.quantity import Quantity
from rigs.schema.limits import Limit, Limits
from tests.support.figure_histories import collected

BEGAN = datetime(2026, 5, 1, 9, tzinfo=UTC)
LIMITS = Limits.model_validate({"yaw": {"range_deg": {"watch": 0.01, "fail": 0.02}}})


def runs_of(values: list[float], u: float = 0.0005) -> list[RunRecord]:
    """A run a day from 1 May on."""
    return [
        RunRecord(f"lap-{day}", str(day), "ur10e", (BEGAN + timedelta(days=day - 1)).isoformat(), "yaw", "acw", "",
               figures={"range_deg": Quantity(value, u, "deg")})
        for day, value in enumerate(values, 1)
    ]  # fmt: skip


def judged_words(values: list[float], u: float = 0.0005) -> tuple[str, list[str]]:
    """Table and sentences about limits, without the search for changes."""
    history = history_of(collected(runs_of(values, u), LIMITS))
    (series,) = history.series
    return against_limit(series), [line for line in sentences(history) if "limit" in line]


@pytest.mark.parametrize(
    ("values", "told", "words"),
    [
        # on the 3rd and 5th the uncertainty reaches over the limit
        ([0.024, 0.006, 0.0205, 0.024, 0.0205, 0.026], "beyond 0.02 since 2026-05-04",
         ["0.02 ° since 4 May 2026 (run lap-4)", "0.02600 ± 0.00050 °", "3 of 6 runs"]),
        ([0.005, 0.0096, 0.024, 0.015], "watch 0.01 since 2026-05-02", ["0.01 ° since 2 May 2026 (run lap-2)"]),
        ([0.025, 0.024, 0.005, 0.006], "within 0.01",
         ["within 0.01 ° since 3 May 2026 (run lap-3)", "2 of 4 runs outside, from 1 May 2026 to 2 May 2026"]),
        *(([*[0.005] * 20, *[0.5] * last], "beyond 0.02 since 2026-05-21", ["0.02 ° since 21 May 2026 (run lap-21)"])
          for last in (1, 2, 3, 5)),
    ],
    ids=["crosses", "unproven: watched since the last pass", "repaired", *["sudden damage"] * 4],
)  # fmt: skip
def test_a_figure_outside_its_limit_is_told_with_its_day(values, told, words):
    table, (line,) = judged_words(values)
    assert table == told and all(part in line for part in words)


def test_figure_within_or_without_limit_has_no_sentence():
    assert judged_words([0.005, 0.006]) == ("within 0.01", [])
    history = history_of(collected(runs_of([0.025, 0.025])), "range_deg")
    assert judge(history.series[0]) is None and sentences(history) == []
    assert as_object(history)["series"][0]["limit"] is None


def test_an_unknown_uncertainty_proves_nothing():
    assert judged_words([0.005, 0.5], float("nan"))[0] == "watch 0.01 since 2026-05-01"


def test_wild_run_that_later_ones_contradict_crosses_no_limit():
    runs = runs_of([0.005, 0.5, 0.005])
    trend = Trend((), np.array([False, True, False]), 0.0)
    judged = judge(Series("yaw acw", "range_deg", tuple(runs), trend, Limit(fail=0.02)))
    assert judged.standing == "pass" and not judged.beyond and judged.count == 2


def test_days_are_those_of_the_computers_time_zone(monkeypatch):
    """Six in the morning of 21 May in Tokyo is 20 May in UTC, in which runs are stored."""
    monkeypatch.setenv("TZ", "Asia/Tokyo")
    time.tzset()
    try:
        run = replace(runs_of([0.5])[0], started="2026-05-20T21:00:00+00:00")
        assert run.when.date().isoformat() == "2026-05-21"
        assert len(history_of(collected([run], LIMITS), since=date(2026, 5, 21)).series) == 1
    finally:
        monkeypatch.undo()
        time.tzset()


@pytest.mark.parametrize("given", [None, Limits()])
def test_limits_of_a_given_rig_file_replace_those_of_the_newest_run(given):
    history = history_of(collected(runs_of([0.025, 0.025]), LIMITS), "range_deg", limits=given)
    assert (judge(history.series[0]) is None) == (given is not None)
    assert as_object(history)["sentences"] == ([] if given else sentences(history))
