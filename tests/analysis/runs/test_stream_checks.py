from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest

from analysis.runs.loading import measured_of
from daq.store import Run, read_run
from tests.support.recorded_lap import recorded
from tests.support.refusals import refused

FIRST, LAST = np.iinfo(np.int64).min, np.iinfo(np.int64).max


@cache
def lap() -> Run:
    with TemporaryDirectory() as runs:
        return read_run(recorded(Path(runs)))


def with_column(stream: str, column: str, rows: Any, value: Any) -> Run:
    run = lap()
    new = run.streams[stream][column].copy()
    new[rows] = value
    return replace(run, streams={**run.streams, stream: {**run.streams[stream], column: new}})


@pytest.mark.parametrize(
    ("column", "row", "value", "named"),
    [
        ("first_byte_ns", 40, -7, "row 41 "),
        ("first_byte_ns", 0, FIRST, "row 1 "),
        ("last_byte_ns", -1, LAST, "row "),
        ("last_byte_ns", 40, 0, "row 41 "),
        ("requested_ns", 40, LAST, "row 41 "),
        ("last_byte_ns", 40, 2**60, "row 42 "),
        ("size", 40, -1, "row 41 "),
        ("size", 40, 2**31 - 1, "row 41 "),
    ],
)
@pytest.mark.parametrize("stream", ["g2", "robot"])
def test_stamps_that_rigd_cannot_have_written_are_refused(stream, column, row, value, named):
    with refused("run.damaged") as error:
        measured_of(with_column(stream, column, row, value))
    assert error.value.what.startswith(named)


@pytest.mark.parametrize("value", [np.nan, -np.inf, 200.0])
def test_invalid_readings_are_ignored_and_counted(value):
    """200 mm is further than a link between the two sides of the circle can be."""
    measured = measured_of(with_column("g1", "g1_mm", [100, 200, 201], value))
    assert any(doubt.startswith("g1: 3 rows") for doubt in measured.doubts)
    usual = measured_of(lap())
    assert len(usual.table.q) - 3 <= len(measured.table.q) < len(usual.table.q)
    assert not [doubt for doubt in usual.doubts if "no reading" in doubt]


@pytest.mark.parametrize("value", [np.nan, 1e300])
@pytest.mark.parametrize(("stream", "column"), [("g1", "g1_mm"), ("g2", "g2_mm"), ("robot", "q6_deg")])
def test_an_instrument_without_a_reading_is_missed(stream, column, value):
    with refused("readings.unsuitable", "contains no readings of"):
        measured_of(with_column(stream, column, slice(None), value))


@pytest.mark.parametrize("clock_s", [-1e300, 5e-324, np.nan])
def test_a_controllers_clock_that_shows_nonsense_is_none(clock_s):
    measured = measured_of(with_column("robot", "device_time_s", [7, 8, 500], clock_s))
    assert np.isfinite(measured.table.q).all() and np.ptp(measured.table.q, axis=0).max() > 1


def test_restarted_clock_and_impossible_stamps_are_reported():
    clock_s = lap().streams["robot"]["last_byte_ns"] * 1e-9
    clock_s[len(clock_s) // 2 :] -= clock_s[len(clock_s) // 2] - 5.0
    clock_s[-2:] = 1.0, 1.1
    doubts = measured_of(with_column("robot", "device_time_s", slice(None), clock_s)).doubts
    robot = [doubt.removeprefix("robot: ") for doubt in doubts if doubt.startswith("robot: ")]
    assert robot[0].startswith("the clock restarted 1 times") and robot[1].startswith("2 stamps of the clock")


@pytest.mark.parametrize("step_s", [0.0, 1e-13])
@pytest.mark.parametrize("stream", ["g1", "robot"])
def test_stopped_clock_is_ignored_with_a_doubt(stream, step_s):
    count = len(lap().streams[stream]["device_time_s"])
    measured = measured_of(
        with_column(stream, "device_time_s", slice(None), 77 * (step_s == 0) + np.arange(count) * step_s)
    )
    without = measured_of(with_column(stream, "device_time_s", slice(None), np.nan))
    (doubt,) = set(measured.doubts) - set(without.doubts)
    assert doubt.startswith(f"{stream}: the instrument")
    assert measured.u_lag_s == without.u_lag_s and np.array_equal(measured.table.q, without.table.q)


def test_run_of_a_replay_out_of_step_is_refused():
    manifest = lap().manifest.model_copy(update={"counters": {"robot": {"out_of_step": 4}}})
    with refused("readings.unsuitable", "so the results would be wrong"):
        measured_of(replace(lap(), manifest=manifest))
