"""Export of a run as MCAP, for Foxglove and PlotJuggler: the streams, and the moving arm.

Each stream is a channel of JSON messages. Log times are the first-byte stamps shifted by the clock anchor of the
manifest; `t_s` of an imported table counts from 1970, and a negative start becomes zero. The arm is
`foxglove.JointStates` (docs.foxglove.dev/docs/sdk/schemas) and a URDF with the same joint names.
"""

from __future__ import annotations

import heapq
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, BinaryIO, NamedTuple

import numpy as np
import pyarrow as pa
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import Writer
from numpy.typing import NDArray

from analysis.apps.interchange.urdf_text import urdf_text
from analysis.robot.kinematics.arm import arm_of
from analysis.runs.written_files import ROWS_AT_ONCE
from daq.store import Run
from daq.store.chunk import FAULT_COLUMNS, FAULTS, TABLE
from rigs.errors import FileError, RigError
from rigs.load import parse
from rigs.rig import Rig

JOINT_STATES, DESCRIPTION = "foxglove.JointStates", "std_msgs/String"
JOINTS_TOPIC, DESCRIPTION_TOPIC = "/joint_states", "/robot_description"
_TIME = {"type": "object", "title": "time", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}
_JOINT = {
    "type": "object",
    "title": "foxglove.JointState",
    "properties": {"name": {"type": "string"}, "position": {"type": "number"}},
}
SCHEMAS: dict[str, dict[str, Any]] = {
    JOINT_STATES: {
        "type": "object",
        "title": JOINT_STATES,
        "properties": {"timestamp": _TIME, "joints": {"type": "array", "items": _JOINT}},
    },
    DESCRIPTION: {"type": "object", "title": DESCRIPTION, "properties": {"data": {"type": "string"}}},
}
"""The schemas by name. Positions are in radians."""


def urdf_of(rig: Rig) -> str:
    """URDF of the nominal arm of a rig, empty if it cannot be written."""
    try:
        return urdf_text(rig.robot, arm_of(rig.robot), rig.name)
    except RigError:
        return ""


def joint_states(names: Sequence[str], q_deg: Sequence[float | None], at_ns: int) -> dict[str, Any]:
    """Message for joint angles in degrees at a time in ns since 1970. Unknown angles are omitted."""
    sec, nsec = divmod(at_ns, 1_000_000_000)
    joints = [
        {"name": name, "position": math.radians(deg)}
        for name, deg in zip(names, q_deg, strict=True)
        if deg is not None and math.isfinite(deg)
    ]
    return {"timestamp": {"sec": sec, "nsec": nsec}, "joints": joints}


_JSON_TYPES = {"double": "number", "int64": "integer", "int32": "integer", "string": "string"}
_JOINTS = [f"q{axis}_deg" for axis in range(1, 7)]
_ARM_CHANNELS = ((JOINTS_TOPIC, JOINT_STATES), (DESCRIPTION_TOPIC, DESCRIPTION))
_END_NS = 2**64


class _Message(NamedTuple):
    """A message, ordered by log time, channel, and number within the channel, and therefore never by the content."""

    log_ns: int
    channel: int
    number: int
    values: dict[str, Any]


def write_mcap(run: Run, file: BinaryIO) -> None:
    """Write every row of every stream, every fault and the complete manifest: an exported run may be deleted.

    Raises FileError for a table with no times that fit MCAP.
    """
    writer = Writer(file)
    writer.start(library=f"rig {run.manifest.software.get('rig', '')}")
    about = ("name", "test", "direction", "operator", "host", "started", "rig_name", "exit_status", "reason")
    writer.add_metadata("run", {key: str(getattr(run.manifest, key) or "") for key in about})
    began = run.manifest.clock.unix_ns
    writer.add_attachment(began, began, "rig.yaml", "application/yaml", run.manifest.rig_text.encode())
    writer.add_attachment(began, began, "manifest.json", "application/json", run.manifest.to_json())
    if run.table is not None:
        if "t_s" not in run.table.column_names or not pa.types.is_floating(run.table.schema.field("t_s").type):
            problem = "the column t_s is missing, but MCAP needs the time of each row"
            raise FileError(str(run.path), problem, "export the run as CSV or Parquet", code="output.invalid")
        tables = {TABLE: run.table}
    else:
        faults = pa.Table.from_pylist(run.faults, schema=pa.schema(list(FAULT_COLUMNS.items())))
        tables = {name: pa.table(columns) for name, columns in run.streams.items()} | {FAULTS: faults}
    streams = []
    for name, table in tables.items():
        properties = {field.name: {"type": _JSON_TYPES[str(field.type)]} for field in table.schema}
        schema = {"type": "object", "title": name, "properties": properties}
        streams.append(_messages(table, _channel(writer, f"/{name}", f"rig.{name}", schema), name, run))
    streams += _arm(writer, run, tables)
    for message in heapq.merge(*streams):
        data = json.dumps(message.values, allow_nan=False).encode()
        writer.add_message(message.channel, message.log_ns, data, message.log_ns, message.number)
    writer.finish()  # type: ignore[no-untyped-call]


def _arm(writer: Writer, run: Run, tables: Mapping[str, pa.Table]) -> list[Iterator[_Message]]:
    """Messages of the arm and its angles, if the run has both. The URDF is also an attachment."""
    name = next((name for name, table in tables.items() if set(_JOINTS) <= set(table.column_names)), None)
    try:
        rig = parse(run.manifest.rig_text, "the rig file of the run")
    except RigError:
        return []
    if name is None or not (urdf := urdf_of(rig)):
        return []
    began = run.manifest.clock.unix_ns
    writer.add_attachment(began, began, "robot.urdf", "application/xml", urdf.encode())
    joints, described = (_channel(writer, topic, schema, SCHEMAS[schema]) for topic, schema in _ARM_CHANNELS)
    times = _log_times(name, tables[name], run)
    first_ns = int(times.min(initial=_END_NS - 1)) if len(times) else began
    axes, q_deg = [axis.name for axis in rig.robot.axes], [tables[name][joint].to_numpy() for joint in _JOINTS]
    rows, at_ns = np.stack(q_deg, axis=1), times.tolist()
    angles = (
        _Message(at_ns[row], joints, row, joint_states(axes, rows[row].tolist(), at_ns[row]))
        for row in np.argsort(times, kind="stable").tolist()
    )
    return [iter([_Message(first_ns, described, 0, {"data": urdf})]), angles]


def _channel(writer: Writer, topic: str, name: str, schema: Mapping[str, Any]) -> int:
    schema_id = writer.register_schema(name, SchemaEncoding.JSONSchema, json.dumps(schema).encode())
    return writer.register_channel(topic, MessageEncoding.JSON, schema_id)


def _messages(table: pa.Table, channel: int, name: str, run: Run) -> Iterator[_Message]:
    """Yield the messages of a stream in order of time, with a limited number in memory."""
    log_ns = _log_times(name, table, run)
    order = np.argsort(log_ns, kind="stable")
    if (order[1:] < order[:-1]).any():
        table = table.take(pa.array(order))
    following = 0
    for batch in table.to_batches(max_chunksize=ROWS_AT_ONCE):
        numbers = order[following : following + len(batch)]
        following += len(batch)
        rows = zip(*(column.to_pylist() for column in batch.columns), strict=True)
        for at_ns, number, row in zip(log_ns[numbers].tolist(), numbers.tolist(), rows, strict=True):
            values = zip(table.column_names, row, strict=True)
            finite = {key: value for key, value in values if not isinstance(value, float) or math.isfinite(value)}
            yield _Message(at_ns, channel, number, finite)


def _log_times(name: str, table: pa.Table, run: Run) -> NDArray[np.uint64]:
    """Time (n,) of each row in ns since 1970, never negative; for a table, in ns since the first row or zero.

    Raises FileError for a time beyond the range of MCAP.
    """
    if name != TABLE:
        stamps = table["at_ns" if name == FAULTS else "first_byte_ns"].to_pylist()
        wall = (max(0, run.manifest.wall_ns(stamp)) for stamp in stamps)
        return np.fromiter(wall, dtype=np.uint64, count=len(stamps))
    t_s = table["t_s"].to_numpy()
    since_ns = (t_s - t_s.min(initial=0.0)) * 1e9
    beyond = np.flatnonzero(~(since_ns < _END_NS))
    if beyond.size:
        problem = f"t_s of {t_s[beyond[0]]:g} s is after the year 2554, the maximum in MCAP"
        raise FileError(
            str(run.path),
            problem,
            "import the table with t_s in seconds, or export as csv or parquet",
            code="output.invalid",
        )
    return np.asarray(np.rint(since_ns), dtype=np.uint64)
