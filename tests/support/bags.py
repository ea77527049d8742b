"""ROS 2 bags in memory: CDR-encoded messages, written as MCAP."""

from __future__ import annotations

import io
import struct
from collections.abc import Sequence
from typing import Any

import yaml
from mcap.writer import CompressionType, Writer

from rigs.load import SHIPPED, parse
from rigs.rig import Rig

JOINTS = [f"joint_{axis}" for axis in range(1, 7)]
MS = 1_000_000
BEGIN_NS = 1_700_000_000_000_000_000
STATE, NUMBER = "sensor_msgs/msg/JointState", "std_msgs/msg/Float64"


def rig(**feedback: object) -> Rig:
    data = yaml.safe_load((SHIPPED / "ur10e-cell.yaml").read_text())
    ros = {"interface": "ros2_joint_states", "port": "tcp://robot:9090", "joints": JOINTS}
    return parse(yaml.safe_dump(data | {"feedback": ros | feedback}), "rig.yaml")


def joint_state(
    names: Sequence[str], angles_rad: Sequence[float], order: str = "<", stamp_ns: int = 5 * 10**9 + 7
) -> bytes:
    """Encode a JointState message by hand as CDR: encapsulation, stamp, frame, names, positions, two empty
    sequences.
    """
    body = b""

    def put(code: str, *values: Any) -> None:
        nonlocal body
        body += bytes(-len(body) % struct.calcsize(code)) + struct.pack(f"{order}{len(values)}{code}", *values)

    def text(words: str) -> None:
        nonlocal body
        put("I", len(words) + 1)
        body += words.encode() + b"\0"

    put("I", *divmod(stamp_ns, 10**9))
    text("base")
    put("I", len(names))
    for name in names:
        text(name)
    put("I", len(angles_rad))
    if angles_rad:
        put("d", *angles_rad)
    put("I", 0, 0)
    return bytes([0, order == "<", 0, 0]) + body


def number(mm: float) -> bytes:
    return b"\0\1\0\0" + struct.pack("<d", mm)


def bag(*messages: tuple[str, str, float, bytes], compression: CompressionType = CompressionType.ZSTD) -> bytes:
    """An MCAP file with messages, each given as topic, type, time in ms and data."""
    out = io.BytesIO()
    writer = Writer(out, compression=compression)
    writer.start(profile="ros2")
    channels: dict[str, int] = {}
    for topic, kind, ms, data in messages:
        if topic not in channels:
            channels[topic] = writer.register_channel(topic, "cdr", writer.register_schema(kind, "ros2msg", b""))
        writer.add_message(channels[topic], BEGIN_NS + round(ms * MS), data, BEGIN_NS + round(ms * MS))
    writer.finish()  # type: ignore[no-untyped-call]
    return out.getvalue()
