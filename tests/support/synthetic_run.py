"""A synthetic yaw run of any length: two streaming gauges at 4 kHz and RTDE at 500 Hz, a single slow lap of the UR10e.

The store writes it chunk by chunk, like the daemon. The gauges have no clock, and their adapter delivers bytes every
millisecond. The clock of the controller runs 30 ppm fast, and the network adds delays.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import yaml

from analysis.procedures.simulate import simulate
from analysis.runs.tables import CircleTable
from daq.protocol.conversation import NO_TIME
from daq.store import RunWriter, new_manifest
from daq.store.chunk import Salvage, schema_of
from daq.store.ledger import LedgerEntry
from daq.store.stream_writer import store_chunk
from daq.store.writer import CHUNK_ROWS
from rigs.load import load

GAUGE_HZ, ROBOT_HZ = 4000, 500
BEGIN_NS = 1_000_000_000
ADAPTER_NS = 1_000_000
WHITE_MM = 0.001
STREAMS = {"g1": ("g1_mm",), "g2": ("g2_mm",), "robot": tuple(f"q{axis}_deg" for axis in range(1, 7))}
Columns = dict[str, np.ndarray]


def main(runs: Path, rows: int) -> None:
    """Write the run and print its directory."""
    rig, text = load("ur10e-cell")
    data = yaml.safe_load(text)
    for number, offset_mm in enumerate((25, -25), start=1):
        port = f"/dev/serial/by-id/usb-FTDI_gauge_{number}-if00-port0"
        gauge = {"interface": "micro_epsilon_ild1420", "port": port, "range_mm": 10}
        data["gauges"][f"g{number}"] = gauge | {"offset_mm": offset_mm, "accuracy_mm": 0.002}
    table = simulate(rig, "yaw", "acw", None)
    assert isinstance(table, CircleTable)
    writer = RunWriter.create(
        runs,
        new_manifest(
            name=f"rows-{rows}",
            test="yaw",
            direction="acw",
            rig_name="ur10e",
            rig_text=yaml.safe_dump(data),
            operator="rows",
            streams=STREAMS,
        ),
    )
    # private _writers, _ledger: chunks of millions of rows are stored at once, and not as they would come
    for stream, columns in STREAMS.items():
        rate = ROBOT_HZ if stream == "robot" else GAUGE_HZ
        schema = writer._writers[stream].schema
        count = max(2, rows * rate // GAUGE_HZ)
        for number, batch in enumerate(_batches(table, stream, count, rate), start=1):
            stored = pa.record_batch(batch, schema=schema_of(stream, columns))
            chunk = store_chunk(writer.path, stream, number, Salvage((stored,), True, 0, None), schema)
            writer._ledger.append(LedgerEntry(chunk=chunk))
            writer._writers[stream].rows += chunk.rows
    writer.close("complete", "written", {})
    print(writer.path)


def _batches(table: CircleTable, stream: str, count: int, rate: int) -> Iterator[Columns]:
    """Columns of a stream chunk by chunk, with the lap of the table stretched over all rows."""
    rng = np.random.default_rng(len(stream) + count)
    for first in range(0, count, CHUNK_ROWS):
        number = np.arange(first, min(first + CHUNK_ROWS, count))
        taken_s = number / rate
        lap_s = taken_s * (table.t_s[-1] * rate / count)
        if stream == "robot":
            came_ns = _in_order(taken_s * 1e9 + 200_000 + rng.exponential(300_000, len(number)))
            joints = [np.degrees(np.interp(lap_s, table.t_s, joint)) for joint in table.q.T]
            values = dict(zip(STREAMS["robot"], joints, strict=True))
            clock_s, size = 1000 + taken_s * (1 + 30e-6), 63
        else:
            sent_ns = taken_s * 1e9 * (1 + 20e-6) + rng.exponential(20_000, len(number))
            came_ns = _in_order(np.ceil(sent_ns / ADAPTER_NS) * ADAPTER_NS)
            exact_mm = np.interp(lap_s, table.t_s, table.g_mm[:, int(stream[1]) - 1])
            values = {f"{stream}_mm": exact_mm + rng.normal(0, WHITE_MM, len(number))}
            clock_s, size = np.full(len(number), np.nan), 3
        yield {
            "requested_ns": np.full(len(number), NO_TIME, dtype=np.int64),
            "first_byte_ns": came_ns,
            "last_byte_ns": came_ns,
            "size": np.full(len(number), size, dtype=np.int32),
            "device_time_s": clock_s,
            "status": np.zeros(len(number), dtype=np.int32),
            "sequence": number.astype(np.int64),
            **values,
        }


def _in_order(came_ns: np.ndarray) -> np.ndarray:
    return np.maximum.accumulate(BEGIN_NS + came_ns).astype(np.int64)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
