"""Helpers of the store tests: samples with extreme values, and a small run being recorded."""

from __future__ import annotations

import hashlib
import json
import math
import os
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from daq.protocol.conversation import NO_TIME, Fault, FaultKind, Sample
from daq.store import Run, RunWriter, new_manifest
from daq.store.writer import DiskOperation

RIG_TEXT = "name: cell\r\n# ü, exactly as it was \n"
STREAMS = {"g1": ("g1_mm",), "robot": ("q1_deg", "q2_deg")}
ODD_NAN: float = struct.unpack("<d", struct.pack("<Q", 0x7FF8_0000_0000_0123))[0]
ODD = (0.1, -0.0, math.nan, ODD_NAN, math.inf, 5e-324)


def samples(count: int, width: int = 1, first: int = 0) -> list[Sample]:
    """Return samples whose fields all depend on their number."""
    return [
        Sample(
            values=tuple(ODD[(i + k) % len(ODD)] + i * (k + 1) for k in range(width)),
            requested_ns=NO_TIME if i % 5 == 0 else 1000 * i,
            first_byte_ns=1000 * i + 10,
            last_byte_ns=1000 * i + 20,
            size=i % 40,
            device_time_s=math.nan if i % 3 else i / 7,
            status=i % 2,
        )
        for i in range(first, first + count)
    ]


def fault(number: int = 1) -> Fault:
    return Fault(FaultKind.GARBLED, number, f"got b'\\xff' – {number}", number)


def start(runs: Path, chunk_rows: int = 1000, rig_text: str = RIG_TEXT) -> RunWriter:
    return RunWriter.create(
        runs,
        new_manifest(
            name="yaw-cw",
            test="yaw",
            direction="cw",
            rig_name="cell",
            rig_text=rig_text,
            operator="ada",
            streams=STREAMS,
        ),
        chunk_rows=chunk_rows,
    )


def record(runs: Path, batches: int = 3, chunk_rows: int = 1000) -> RunWriter:
    """An open run with some synced batches of 4 samples and a fault each."""
    writer = start(runs, chunk_rows)
    for i in range(batches):
        writer.append("g1", samples(4, 1, 4 * i))
        writer.append("robot", samples(4, 2, 4 * i))
        writer.append_faults("g1", [fault(i + 1)])
        sync(writer)
    return writer


def write_and_sync(writer: RunWriter) -> None:
    """Write all rows, and wait until they are on the disk."""
    writer.write()
    finish_work(writer, writer.begin_sync())


def write_and_roll(writer: RunWriter) -> bool:
    """Write all rows, and close an ended chunk. False if there is none."""
    writer.write()
    work = writer.begin_roll()
    if work:
        finish_work(writer, work)
    return work is not None


def finish_work(writer: RunWriter, work: DiskOperation) -> None:
    """Do disk work in this thread, as the daemon does it in another."""
    error = None
    try:
        work.wait()
    except (OSError, pa.ArrowException) as refused:
        error = refused
    writer.end_work(error)


def sync(writer: RunWriter) -> None:
    """Sync, and close all chunks that are due."""
    write_and_sync(writer)
    while write_and_roll(writer):
        pass


def finished(runs: Path, batches: int = 5, chunk_rows: int = 8) -> Path:
    writer = record(runs, batches, chunk_rows)
    writer.close("complete", "asked", {"g1": {"samples": 4 * batches, FaultKind.GARBLED: 15}})
    return writer.path


def crash(writer: RunWriter) -> Path:
    """A run as left by a killed process: unfinished files and a released lock."""
    # private _writers, _ledger, _lock: given up as the system does it when a process is killed
    for stream_writer in writer._writers.values():
        stream_writer.release()
    writer._ledger.close()
    os.close(writer._lock)
    return writer.path


def ledger_records(run: Path) -> list[dict[str, Any]]:
    lines = (run / "ledger.jsonl").read_text().splitlines()
    return [{key: value for key, value in json.loads(line).items() if key != "sha256"} for line in lines]


def put_ledger(run: Path, records: list[dict[str, Any]]) -> None:
    """Write records as a ledger with a valid chain, as an attacker with knowledge of the format could."""
    lines, last = [], ""
    for record in records:
        content = json.dumps(record)
        last = hashlib.sha256((last + content).encode()).hexdigest()
        lines.append(f'{{"sha256":"{last}",{content[1:]}\n')
    (run / "ledger.jsonl").write_text("".join(lines))


def edit_manifest(run: Path, change: dict[str, Any]) -> None:
    """Change the manifest, and update the ledger accordingly."""
    path = run / "manifest.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    put_ledger(run, [{"opening": hashlib.sha256(path.read_bytes()).hexdigest()}, *ledger_records(run)[1:]])


def edit_chunk(run: Path, file: str, change: dict[str, Any]) -> None:
    records = ledger_records(run)
    for record in records:
        if record.get("chunk", {}).get("file") == file:
            record["chunk"] |= change
    put_ledger(run, records)


def forget_chunk(run: Path, file: str) -> None:
    """Delete a chunk and its ledger record."""
    (run / file).unlink()
    put_ledger(run, [record for record in ledger_records(run) if record.get("chunk", {}).get("file") != file])


def bits(values: object) -> bytes:
    return np.asarray(values, dtype=np.float64).tobytes()


def assert_rows(stored: dict[str, np.ndarray], expected: list[Sample], columns: tuple[str, ...]) -> None:
    """Check that the columns of a stream contain exactly these samples, bit for bit."""
    assert stored["sequence"].tolist() == list(range(len(expected)))
    for name in ("requested_ns", "first_byte_ns", "last_byte_ns", "size", "status"):
        assert stored[name].tolist() == [getattr(s, name) for s in expected]
    assert stored["device_time_s"].tobytes() == bits([s.device_time_s for s in expected])
    for k, column in enumerate(columns):
        assert stored[column].tobytes() == bits([s.values[k] for s in expected])


def assert_holds(run: Run, rows: int) -> None:
    """Check that the run contains exactly the first rows written by `record`, bit for bit."""
    for stream, columns in STREAMS.items():
        assert_rows(run.streams[stream], samples(rows, len(columns)), columns)
