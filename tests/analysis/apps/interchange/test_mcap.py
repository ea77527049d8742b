"""A run as MCAP, read back by mcap's own reader: every row, every value, at its wall-clock time."""

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
from mcap.reader import make_reader

from analysis.apps.interchange.mcap_export import write_mcap
from analysis.runs.written_files import write_new
from daq.protocol.conversation import NO_TIME, Fault, FaultKind, Sample
from daq.store import Manifest, Run, RunWriter, new_manifest, read_run
from tests.support.refusals import refused
from tests.support.table_cases import RIG_FILE, csv_text, plain
from tests.support.written_runs import import_table

OF_THE_ARM = ("/joint_states", "/robot_description")
"""Held against by an independent reader in test_mcap_arm.py."""
Messages = dict[str, list[tuple[int, int, dict[str, object]]]]


def recorded(runs: Path) -> Run:
    writer = RunWriter.create(
        runs,
        new_manifest(
            name="m",
            test="yaw",
            direction="acw",
            rig_name="cell",
            rig_text="name: cell # ü\n",
            operator="ada",
            streams={"g1_g2": ("g1_mm", "g2_mm"), "robot": ("q1_deg",)},
        ),
    )
    at = writer.manifest.clock.monotonic_ns
    for k in range(40):
        odd = (0.1 + k, math.nan, -0.0, 5e-324)
        gauge = Sample((odd[k % 4], 1 / 3), at + 300 * k, at + 300 * k + 1, at + 300 * k + 9, 12, math.nan, k % 2)
        writer.append("g1_g2", [gauge])
    for k in range(90):
        writer.append("robot", [Sample((k / 7,), NO_TIME, at + 133 * k, at + 133 * k, 8, 1e5 + k / 125, 0)])
    writer.append_faults("g1_g2", [Fault(FaultKind.GARBLED, at + 777, "got b'\\xff' – ü", 3)])
    writer.close("complete", "told to", {})
    return read_run(writer.path)


def written(run: Run, file: Path) -> Messages:
    write_new(file, lambda out: write_mcap(run, out))
    messages = {}
    with file.open("rb") as source:
        for schema, channel, message in make_reader(source, validate_crcs=True).iter_messages():
            if channel.topic in OF_THE_ARM:
                continue
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            values = json.loads(message.data, parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
            _fits(json.loads(schema.data), values)
            messages.setdefault(channel.topic, []).append((message.log_time, message.sequence, values))
    return messages


def _fits(schema: dict[str, dict[str, dict[str, str]]], values: dict[str, object]) -> None:
    kinds = {"number": float, "integer": int, "string": str}
    for name, value in values.items():
        assert type(value) is kinds[schema["properties"][name]["type"]], name


def test_every_row_and_value_comes_back_at_its_time_in_the_order_of_time(tmp_path):
    run = recorded(tmp_path)
    messages = written(run, tmp_path / "run.mcap")
    clock = run.manifest.clock
    assert {topic: len(rows) for topic, rows in messages.items()} == {"/g1_g2": 40, "/robot": 90, "/faults": 1}
    for stream, columns in run.streams.items():
        for log_ns, number, values in messages[f"/{stream}"]:
            assert log_ns - clock.unix_ns == columns["first_byte_ns"][number] - clock.monotonic_ns
            for name, column in columns.items():
                expected = column[number].item()
                if isinstance(expected, float) and math.isnan(expected):
                    assert name not in values
                else:
                    assert repr(values[name]) == repr(expected)
    ((log_ns, _, fault),) = messages["/faults"]
    assert log_ns == clock.unix_ns + 777
    assert (fault["stream"], fault["kind"], fault["count"], fault["detail"]) == (
        "g1_g2",
        "garbled",
        3,
        "got b'\\xff' – ü",
    )
    with (tmp_path / "run.mcap").open("rb") as source:
        reader = make_reader(source)
        summary = reader.get_summary()
        assert summary.statistics.message_count == 131
        assert summary.chunk_indexes
        times = [message.log_time for _, _, message in reader.iter_messages(log_time_order=False)]
        assert times == sorted(times)  # streams are merged by time as they are written
        (about,) = reader.iter_metadata()
        assert (about.name, about.metadata["operator"], about.metadata["direction"]) == ("run", "ada", "acw")
        rig_file, manifest = reader.iter_attachments()
        assert (rig_file.name, rig_file.data) == ("rig.yaml", b"name: cell # \xc3\xbc\n")
        assert manifest.name == "manifest.json"
        assert Manifest.model_validate_json(manifest.data) == run.manifest


def test_channel_without_rows_exists(tmp_path):
    writer = RunWriter.create(
        tmp_path,
        new_manifest(
            name="m", test="yaw", direction=None, rig_name="cell", rig_text="", operator="", streams={"g1": ("g1_mm",)}
        ),
    )
    writer.close("interrupted", "", {})
    assert written(read_run(writer.path), tmp_path / "run.mcap") == {}


def imported(folder: Path, test: str, since_s: float = 0.0) -> Run:
    kind = "yaw" if test == "yaw" else "pose"
    rows = plain(kind)
    if since_s:
        rows["t_s"] = [repr(float(t_s) - since_s) for t_s in rows["t_s"]]
    (folder / "t.csv").write_text(csv_text(rows))
    import_table(folder / "t.csv", folder / "r", rig_file=RIG_FILE, test=kind, direction=None, operator="")
    return read_run(folder / "r")


def test_unordered_rows_in_parts_keep_time_and_number(tmp_path, monkeypatch):
    run = imported(tmp_path, "yaw")
    reversed_ = run.table.take(list(range(len(run.table)))[::-1])
    monkeypatch.setattr("analysis.apps.interchange.mcap_export.ROWS_AT_ONCE", 7)
    rows = written(replace(run, table=reversed_), tmp_path / "run.mcap")["/table"]
    assert [values for _, _, values in rows] == run.table.to_pylist()
    assert [number for _, number, _ in rows] == list(range(len(run.table)))[::-1]
    assert [log_ns for log_ns, _, _ in rows] == [round(t_s * 1e9) for t_s in run.table["t_s"].to_pylist()]


def test_a_table_whose_time_begins_below_zero_keeps_its_steps(tmp_path):
    run = imported(tmp_path, "yaw", since_s=1.0)
    messages = written(run, tmp_path / "run.mcap")
    times = [log_ns for log_ns, _, _ in messages["/table"]]
    assert times == [round((t_s + 1.0) * 1e9) for t_s in run.table["t_s"].to_pylist()]


@pytest.mark.parametrize(("test", "since_s"), [("yaw", -9e10), ("pose", 0.0)], ids=["beyond", "none"])
def test_a_time_that_mcap_cannot_hold_is_refused_and_leaves_no_file(test, since_s, tmp_path):
    run = imported(tmp_path, test, since_s)
    with refused("output.invalid"):
        written(run, tmp_path / "run.mcap")
    assert not (tmp_path / "run.mcap").exists()
