from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from analysis.intake.read import read_file
from analysis.procedures.checks.check_runs import doubts_of
from analysis.procedures.shared.test_kind import evaluate
from analysis.robot.geometry.driven_programs import repeatability_stops, stops
from analysis.runs.align import align
from analysis.runs.loading import measured_of
from analysis.runs.tables import CircleTable, RepeatabilityTable, columns_of
from analysis.runs.written_files import write_csv, write_new
from daq.protocol.conversation import NO_TIME, Sample
from daq.store import RunWriter, new_manifest, read_run, recover, verify
from rigs.errors import FileError
from rigs.load import load
from rigs.schema.vocabulary import Direction, TestName
from tests.support.refusals import refused
from tests.support.table_cases import JOINTS, RIG_FILE, circle_values, csv_text, plain, rig
from tests.support.written_runs import import_table

STREAMS = {"g1": ("g1_mm",), "g2": ("g2_mm",), "robot": tuple(JOINTS)}


def recorded(
    runs: Path, test: TestName, direction: Direction | None, *, hole: bool = False, exchanged: bool = False
) -> Path:
    """A lap as rigd would have recorded it, each stream with stamps of its own; with a hole in gauge 2 or the gauges
    exchanged if asked."""
    t_s, q, g_mm = circle_values("roll" if test == "roll" else "yaw", direction or "acw")
    g_mm = g_mm[:, ::-1] if exchanged else g_mm
    writer = RunWriter.create(
        runs,
        new_manifest(
            name="lap",
            test=test,
            direction=direction,
            rig_name=RIG_FILE,
            rig_text=load(RIG_FILE)[1],
            operator="ada",
            streams=STREAMS,
        ),
    )
    for k, at in enumerate((t_s * 1e9).astype(int).tolist()):
        for g in (0, 1):
            if not (hole and g == 1 and 50 < k < 60):
                writer.append(f"g{g + 1}", [Sample((g_mm[k, g],), NO_TIME, at, at, 7, math.nan, 0)])
        writer.append("robot", [Sample(tuple(np.degrees(q[k])), NO_TIME, at, at, 60, math.nan, 0)])
    writer.close("complete", "told to", {})
    return writer.path


@pytest.mark.parametrize("direction", ["acw", "cw"])
@pytest.mark.parametrize("test", ["yaw", "roll"])
def test_a_recorded_circle_is_a_circle_table(tmp_path: Path, test: TestName, direction: Direction) -> None:
    run = read_run(recorded(tmp_path, test, direction))
    table = measured_of(run).table
    t_s, q, g_mm = circle_values(test, direction)
    assert isinstance(table, CircleTable)
    assert (table.test, table.direction) == (test, direction)
    # A reading was taken before its seven characters set out: the first one before the robot's first sample.
    taken_s = t_s[1:] - 7 * rig().gauges.g1.line.character_ns / 1e9
    np.testing.assert_allclose(table.t_s, taken_s - taken_s[0], atol=1e-8)
    np.testing.assert_array_equal(table.g_mm, g_mm[1:])
    expected = np.stack([np.interp(taken_s, t_s, joint) for joint in q.T], axis=1)
    np.testing.assert_allclose(table.q, expected, atol=1e-7)


def test_the_time_is_as_uncertain_as_the_slower_gauge_and_the_robots_cycle(tmp_path: Path) -> None:
    """Unasked readings are latched within a character before they set out, a position within a cycle."""
    slow = rig().gauges.g1.line.model_copy(update={"baud": 300})
    pair = rig().gauges.model_copy(update={"g2": rig().gauges.g2.model_copy(update={"line": slow})})  # type: ignore[union-attr]
    run = read_run(recorded(tmp_path, "yaw", "acw"))
    found = align(tmp_path, run.streams, run.manifest.test, rig().model_copy(update={"gauges": pair}))
    assert found.u_lag_s == pytest.approx(np.hypot(slow.character_ns / 1e9, 0.1) / np.sqrt(3))


def test_exported_run_is_imported_again(tmp_path: Path) -> None:
    run = read_run(recorded(tmp_path, "yaw", "cw"))
    measured = measured_of(run)
    columns, notes = measured.to_table(), list(measured.doubts)
    assert notes == []
    assert columns.column_names == list(plain("yaw"))
    write_new(tmp_path / "t.csv", lambda out: write_csv(columns, out))
    back = read_file(tmp_path / "t.csv", "yaw", rig())
    assert back.direction == "cw"
    assert back.table.to_pydict() == columns.to_pydict()
    imported = {"rig_file": RIG_FILE, "test": "yaw", "direction": None, "operator": ""}
    assert import_table(tmp_path / "t.csv", tmp_path / "again", **imported) == []  # type: ignore[arg-type]
    again = columns_of(measured_of(read_run(tmp_path / "again")).table)
    for name in JOINTS:
        assert again[name].to_pylist() == pytest.approx(columns[name].to_pylist(), rel=1e-15)


def test_ignored_rows_are_reported(tmp_path: Path) -> None:
    measured = measured_of(read_run(recorded(tmp_path, "yaw", "acw", hole=True)))
    columns, notes = measured.to_table(), list(measured.doubts)
    assert len(notes) == 1 and notes[0].startswith(("g2: 9 rows", "g2: 10 rows"))
    assert columns.num_rows < len(circle_values("yaw", "acw")[0])


def test_exchanged_gauges_are_doubted_and_the_figures_given(tmp_path: Path) -> None:
    """Recorded or imported: every command prints the doubts of a run before it uses it."""
    own = measured_of(read_run(recorded(tmp_path, "yaw", "acw", exchanged=True)))
    (doubt,) = doubts_of(own)
    assert doubt.startswith("g1 and g2 may")
    write_new(tmp_path / "t.csv", lambda out: write_csv(own.to_table(), out))
    imported = {"rig_file": RIG_FILE, "test": "yaw", "direction": None, "operator": ""}
    assert import_table(tmp_path / "t.csv", tmp_path / "again", **imported) == [doubt]  # type: ignore[arg-type]
    again = measured_of(read_run(tmp_path / "again"))
    assert doubts_of(again) == (doubt,)
    assert "eccentricity_mm" in evaluate(again.table, again.rig, again.u_lag_s, "again").figures


def test_a_recorded_circle_without_direction_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="lacks a direction"):
        measured_of(read_run(recorded(tmp_path, "yaw", None)))


def stopped(runs: Path, *, share: float = 1.0) -> Path:
    """A repeatability program with gauge 1 alone, as rigd records it where gauge 2 is not plugged in; its gauge falls
    silent after a share of it. For the first third of each stand the arm still swings, by 1 mm."""
    writer = RunWriter.create(
        runs,
        new_manifest(
            name="stops",
            test="repeatability",
            direction=None,
            rig_name="paper-errors",
            rig_text=load("paper-errors")[1],
            operator="ada",
            streams=STREAMS,
        ),
    )
    t_s, q = stops(repeatability_stops(load("paper-errors")[0]), dwell_s=1.0)
    stopped_s = t_s[np.flatnonzero(np.diff(t_s) > 0.9)]
    joints_deg = np.degrees(q).T.copy()
    for number, at_s in enumerate(np.arange(0.0, t_s[-1], 0.05).tolist()):
        at = 5_000_000_000 + int(at_s * 1e9)
        if at_s < share * t_s[-1]:
            swings = at_s - stopped_s[stopped_s <= at_s].max(initial=0.0) < 0.3
            writer.append("g1", [Sample((float(swings) + 1e-3 * (number % 2),), NO_TIME, at, at, 7, math.nan, 0)])
        joints = tuple(float(np.interp(at_s, t_s, joint)) for joint in joints_deg)
        writer.append("robot", [Sample(joints, NO_TIME, at, at, 60, math.nan, 0)])
    writer.close("complete", "told to", {})
    return writer.path


def test_at_targets_gauge_1_is_enough(tmp_path: Path) -> None:
    measured = measured_of(read_run(stopped(tmp_path)))
    assert isinstance(measured.table, RepeatabilityTable)
    assert measured.table.target.tolist() == [target for target in (1, 14, 29, 35) for _ in range(7)]
    assert measured.table.approach.tolist() == 4 * ["none", *3 * ["out", "in"]]
    assert np.abs(measured.table.g_mm).max() < 1e-3  # what is read while the arm swings does not count
    assert measured.doubts == ()


def test_unread_targets_of_repeatability_are_reported(tmp_path: Path) -> None:
    measured = measured_of(read_run(stopped(tmp_path, share=0.5)))
    assert isinstance(measured.table, RepeatabilityTable)
    assert set(measured.table.target.tolist()) == {1, 14}
    assert len(measured.doubts) == 1 and measured.doubts[0].endswith("target 29, 35")


def test_an_import_that_never_held_its_table(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text(csv_text(plain("pose")))
    imported = {"rig_file": RIG_FILE, "test": "pose", "direction": None, "operator": ""}
    import_table(tmp_path / "t.csv", tmp_path / "r", **imported)  # type: ignore[arg-type]
    ledger = tmp_path / "r" / "ledger.jsonl"
    ledger.write_bytes(ledger.read_bytes().splitlines(keepends=True)[0])
    (tmp_path / "r" / "table-0001.parquet").unlink()
    with refused("run.not_closed"):
        read_run(tmp_path / "r")
    recover(tmp_path / "r")
    (problem,) = verify(tmp_path / "r")
    assert problem.startswith(f"{tmp_path / 'r'}: ") and "import t.csv" in problem
    with refused("table.columns"):
        measured_of(read_run(tmp_path / "r"))
