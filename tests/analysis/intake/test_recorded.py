import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from analysis.robot.geometry.driven_programs import repeatability_stops, stops
from analysis.runs.align import align
from analysis.runs.loading import load_measured, measured_of
from daq.store import read_run, recover, verify
from rigs.load import load
from rigs.schema.vocabulary import Direction, TestName
from tests.support.refusals import refused
from tests.support.table_cases import RIG_FILE, circle_values, csv_text, plain, rig
from tests.support.written_runs import import_table, lap_samples, recorded_run


def recorded(runs: Path, test: TestName, direction: Direction) -> Path:
    """A lap as rigd would have recorded it."""
    return recorded_run(runs, load(RIG_FILE)[1], test, direction, lap_samples(*circle_values(test, direction)))


@pytest.mark.parametrize("direction", ["acw", "cw"])
@pytest.mark.parametrize("test", ["yaw", "roll"])
def test_a_recorded_circle_is_a_circle_table(tmp_path, test, direction):
    run = read_run(recorded(tmp_path, test, direction))
    table = measured_of(run).table
    t_s, q, g_mm = circle_values(test, direction)
    assert (table.test, table.direction) == (test, direction)
    # A reading was taken before its seven characters set out: the first one before the robot's first sample.
    taken_s = t_s[1:] - 7 * rig().gauges.g1.line.character_ns / 1e9
    np.testing.assert_allclose(table.t_s, taken_s - taken_s[0], atol=1e-8)
    np.testing.assert_array_equal(table.g_mm, g_mm[1:])
    expected = np.stack([np.interp(taken_s, t_s, joint) for joint in q.T], axis=1)
    np.testing.assert_allclose(table.q, expected, atol=1e-7)


def test_the_time_is_as_uncertain_as_the_slower_gauge_and_the_robots_cycle(tmp_path):
    """Unasked readings are latched within a character before they set out, a position within a cycle."""
    slow = rig().gauges.g1.line.model_copy(update={"baud": 300})
    pair = rig().gauges.model_copy(update={"g2": rig().gauges.g2.model_copy(update={"line": slow})})
    run = read_run(recorded(tmp_path, "yaw", "acw"))
    found = align(tmp_path, run.streams, run.manifest.test, rig().model_copy(update={"gauges": pair}))
    assert found.u_lag_s == pytest.approx(np.hypot(slow.character_ns / 1e9, 0.1) / np.sqrt(3))


def stopped(runs: Path, *, share: float = 1.0) -> Path:
    """A repeatability program with gauge 1 alone, as rigd records it where gauge 2 is not plugged in; its gauge falls
    silent after a share of it. For the first third of each stand the arm still swings, by 1 mm."""
    rig, text = load("paper-errors")
    t_s, q = stops(repeatability_stops(rig), dwell_s=1.0)
    stopped_s = t_s[np.flatnonzero(np.diff(t_s) > 0.9)]
    at_s = np.arange(0.0, t_s[-1], 0.05)
    since_s = at_s - stopped_s[np.maximum(np.searchsorted(stopped_s, at_s, side="right") - 1, 0)]
    g_mm = (since_s < 0.3) + 1e-3 * (np.arange(len(at_s)) % 2)
    joints = np.stack([np.interp(at_s, t_s, joint) for joint in q.T], axis=1)
    both = lap_samples(5 + at_s, joints, np.stack([g_mm, g_mm], axis=1))
    until_ns = int(1e9 * (5 + share * t_s[-1]))
    samples = (one for one in both if one[0] == "robot" or (one[0] == "g1" and one[1].last_byte_ns < until_ns))
    return recorded_run(runs, text, "repeatability", None, samples)


def test_at_targets_gauge_1_is_enough(tmp_path):
    measured = measured_of(read_run(stopped(tmp_path)))
    assert measured.table.target.tolist() == [target for target in (1, 14, 29, 35) for _ in range(7)]
    assert measured.table.approach.tolist() == 4 * ["none", *3 * ["out", "in"]]
    assert np.abs(measured.table.g_mm).max() < 1e-3  # what is read while the arm swings does not count
    assert measured.doubts == ()


def test_unread_targets_of_repeatability_are_reported(tmp_path):
    measured = measured_of(read_run(stopped(tmp_path, share=0.5)))
    assert set(measured.table.target.tolist()) == {1, 14}
    assert len(measured.doubts) == 1 and measured.doubts[0].endswith("target 29, 35")


def test_an_import_that_never_held_its_table(tmp_path):
    (tmp_path / "t.csv").write_text(csv_text(plain("pose")))
    imported = {"rig_file": RIG_FILE, "test": "pose", "direction": None, "operator": ""}
    import_table(tmp_path / "t.csv", tmp_path / "r", **imported)
    ledger = tmp_path / "r" / "ledger.jsonl"
    ledger.write_bytes(ledger.read_bytes().splitlines(keepends=True)[0])
    (tmp_path / "r" / "table-0001.parquet").unlink()
    with refused("run.in_use", "the recording crashed"):
        read_run(tmp_path / "r")
    recover(tmp_path / "r")
    (problem,) = verify(tmp_path / "r")
    assert problem.startswith(f"{tmp_path / 'r'}: ") and "import t.csv" in problem
    with refused("table.invalid", "the table has no rows"):
        measured_of(read_run(tmp_path / "r"))


def _garbage(run: Path, content: bytes) -> None:
    (run / "ledger.jsonl").write_bytes((run / "ledger.jsonl").read_bytes() + content)


SURPLUS: dict[str, Callable[[Path], object]] = {
    "garbage behind the seal": lambda run: _garbage(run, b"\xff\x00garbage"),
    "a line behind the seal": lambda run: _garbage(run, b'{"chunk": {}}\n'),
    "a repeated line": lambda run: _garbage(run, (run / "ledger.jsonl").read_bytes().splitlines(keepends=True)[-1]),
    "a second table": lambda run: shutil.copy(run / "table-0001.parquet", run / "table-0002.parquet"),
    "a table of another stream": lambda run: (run / "g1-0001.parquet").write_bytes(b"PAR1"),
    "an unfinished file": lambda run: (run / "table-0002.parquet.tmp").touch(),
}


@pytest.mark.parametrize("name", SURPLUS)
def test_content_that_the_seal_does_not_cover_is_a_doubt(tmp_path, name):
    (tmp_path / "t.csv").write_text(csv_text(plain("pose")))
    run = tmp_path / "r"
    import_table(tmp_path / "t.csv", run, rig_file=RIG_FILE, test="pose", direction=None, operator="")
    before = load_measured(run)
    SURPLUS[name](run)
    after = load_measured(run)
    assert after.table.q.tolist() == before.table.q.tolist()
    (doubt,) = set(after.doubts) - set(before.doubts)
    assert verify(run) == [doubt] and "rig recover" in doubt
