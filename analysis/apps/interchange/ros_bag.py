"""A bag of ROS 2 (MCAP, rosbag2's own format) as the table of a circle, which is then read like any other.

Joints come from the topic of `sensor_msgs/msg/JointState` that the rig file names (`ros2_joint_states`), gauges from
topics of `std_msgs/msg/Float64` by their names, `/g1` and `/g2`, in mm. The messages of a topic are a stream like that
of an instrument, so that times and rows are made as those of a recorded run (`analysis.runs.align`): by the stamps of
the sender where a topic has them, and by the pace of the messages where it has none. How uneven they came is in the
uncertainty of each row's time and of what all rows share.
"""

from __future__ import annotations

import csv
import io
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from analysis.apps.interchange.bags import JOINT_STATE, NO_STAMP, NUMBER, Bag, bag_of, joint_state, messages_of, number
from analysis.robot.kinematics.arm import Array, Integers, Mask
from analysis.runs.align import align_streams
from analysis.runs.clocks import Columns
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.feedback import ROS2JointStates
from rigs.schema.vocabulary import CIRCLES, TestName

_MOST_MESSAGES = 5_000_000
"""The most that are read of one topic; half an hour at 1 kHz has 1.8 million."""
_JOINT_COLUMNS = tuple(f"q{axis}_deg" for axis in range(1, 7))
_LEAP_NS = 1e9
"""No network holds a message back for so long without losing its link."""
Message = tuple[int, list[float]]
"""The sender's stamp in ns, 0 for none, and values."""


@dataclass
class _Track:
    """Messages of one topic: log times and the sender's stamps in ns, and values. read: None for a message that lacks a
    joint. lacking: how many have no such values or are not of this layout."""

    schema: str
    columns: tuple[str, ...]
    read: Callable[[bytes], Message | None]
    ns: list[int] = field(default_factory=list)
    sent_ns: list[int] = field(default_factory=list)
    values: list[list[float]] = field(default_factory=list)
    lacking: int = 0

    def add(self, log_ns: int, sent_ns: int, data: bytes) -> None:
        try:
            message = self.read(data)
        except (struct.error, IndexError):
            message = None
        if message is None or not np.isfinite(message[1]).all():
            self.lacking += 1
            return
        stamp_ns, values = message
        self.ns.append(log_ns)
        self.sent_ns.append(stamp_ns or (NO_STAMP if sent_ns == log_ns else sent_ns))
        self.values.append(values)


def table_of_bag(data: bytes, where: str, rig: Rig, test: TestName = CIRCLES[0]) -> tuple[bytes, tuple[str, ...]]:
    """Return the CSV of a bag's bytes, and doubts in words. Raises FileError."""
    bag = bag_of(data, where)
    tracks = _read(bag, rig)
    doubts = [] if bag.has_checksums else ["the bag was written without checksums: damage to it would not be seen"]
    begin_ns = min(min(track.ns) for track in tracks.values())  # since 1970, a float has steps of 256 ns
    streams: dict[str, Columns] = {}
    for topic, track in tracks.items():
        streams[topic], of_topic = _stream(topic, track, begin_ns)
        doubts += of_topic
    # The rig with its gauges behind a network, as every topic is: no message has the length of a line's bytes
    gauges = {name: gauge.model_copy(update={"port": "tcp://topic:1"}) for name, gauge in rig.gauges}
    aligned = align_streams(
        Path(where), streams, test, rig.model_copy(update={"gauges": rig.gauges.model_copy(update=gauges)})
    )
    # A message can only be late. So what all are late by is no better known than how unevenly they are.
    u_lag_s = float(np.hypot(aligned.u_lag_s, np.sqrt(np.mean(aligned.u_t_s**2))))
    doubts += [
        *aligned.doubts,
        "times are of messages that the bag received: how unevenly they came is in u, how late all of them were is not",
    ]
    gauge_columns = [f"g{number}_mm" for number in range(1, aligned.g_mm.shape[1] + 1)]
    shared = np.full(len(aligned.t_s), u_lag_s)
    rows = np.column_stack([aligned.t_s, np.degrees(aligned.q), aligned.g_mm, aligned.u_t_s, shared])
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["t_s", *_JOINT_COLUMNS, *gauge_columns, "u_t_s", "u_lag_s"])
    writer.writerows(rows.tolist())
    return text.getvalue().encode(), tuple(doubts)


def _stream(topic: str, track: _Track, begin_ns: int) -> tuple[Columns, list[str]]:
    """The columns of an instrument's stream from the messages of a topic, in order of time, and doubts in words."""
    order = np.argsort(np.array(track.ns), kind="stable")
    ns, sent_ns = (np.array(times, dtype=np.int64)[order] for times in (track.ns, track.sent_ns))
    values = np.array(track.values)[order]
    has_clock = bool((sent_ns != NO_STAMP).all() and np.ptp(sent_ns) > 0)
    doubts = []
    if has_clock and (uneven := uneven_header(ns, sent_ns)):
        has_clock, doubts = False, [f"{topic}: {uneven}"]
    fresh = newest(ns, sent_ns) if has_clock else np.ones(len(ns), dtype=bool)
    total = len(ns) + track.lacking
    if track.lacking:
        doubts.append(f"{topic}: left out {track.lacking} of {total} messages, which lack a joint or a finite number")
    if stale := int((~fresh).sum()):
        why = (
            "whose stamps are no later than that of a message before: a second publisher, or messages sent again; the "
            f"newest is used; see ros2 topic info {topic} --verbose"
        )
        doubts.append(f"{topic}: left out {stale} of {total} messages, {why}")
    ns, sent_ns, values = ns[fresh] - begin_ns, sent_ns[fresh], values[fresh]
    device_s = (sent_ns - sent_ns[0]) / 1e9 if has_clock else np.full(len(ns), np.nan)
    none = np.zeros(len(ns), dtype=np.int64)
    fixed: dict[str, np.ndarray[Any, Any]] = {
        "requested_ns": none - 1,
        "first_byte_ns": ns,
        "last_byte_ns": ns,
        "size": none,
        "status": none,
        "device_time_s": device_s,
    }
    return {**fixed, **dict(zip(track.columns, values.T, strict=True))}, doubts


_EVEN, _UNEVEN = 0.2, 0.5
"""Spread of the steps between messages, from the 5th to the 95th percentile, as a share of the median step: up to here
they are even, and from here on uneven. Chosen: a network makes receive times uneven, and never evens them out."""


def uneven_header(ns: Integers, sent_ns: Integers) -> str:
    """Return what to say of messages (n,) that came evenly although their headers have uneven stamps: the clock of the
    header is at fault. Empty if it is not, or if two publishers explain the stamps, each of which is even."""
    fresh = newest(ns, sent_ns)
    if np.count_nonzero(fresh) < _FEWEST_STEPS:
        return ""
    came, stamped = np.diff(ns) / 1e6, np.diff(sent_ns[fresh]) / 1e6
    if _spread(came) > _EVEN or _spread(stamped) < _UNEVEN:
        return ""
    low, high = np.percentile(np.diff(sent_ns) / 1e6, [5, 95])
    return (
        f"the clock of the header is uneven: stamps are {low:.3g} to {high:.3g} ms apart, while the messages came "
        f"evenly, {np.median(came):.3g} ms apart; times are those at which the bag received them; check which clock "
        "stamps them at the sender"
    )


_FEWEST_STEPS = 20
"""Messages from which percentiles of their steps mean something."""


def _spread(steps: Array) -> float:
    """Return the spread of steps (n,) as a share of their median."""
    low, middle, high = np.percentile(steps, [5, 50, 95])
    return float((high - low) / middle) if middle > 0 else np.inf


def newest(ns: Integers, sent_ns: Integers) -> Mask:
    """Which messages (n,) have a later stamp than all before. A stamp from the future by itself is none of them: it
    would make all that follow old ones."""
    early_ns = ns - sent_ns  # a message is never received before it was sent, whatever the offset of the two clocks
    possible = early_ns > np.quantile(early_ns, 0.01) - _LEAP_NS
    newest = np.maximum.accumulate(np.where(possible, sent_ns, np.iinfo(np.int64).min))
    return np.asarray(possible & (sent_ns > np.concatenate([[np.iinfo(np.int64).min], newest[:-1]])))


def _read(bag: Bag, rig: Rig) -> Mapping[str, _Track]:
    """The topic of the joints, then those of the gauges."""
    where = bag.where
    if not isinstance(rig.feedback, ROS2JointStates):
        remedy = "describe it in the rig file: feedback: {interface: ros2_joint_states, joints: [six names]}"
        raise FileError(where, "is a bag, and the rig file does not say which joints to take", remedy)
    names = rig.feedback.joints
    topic = "/" + rig.feedback.topic.lstrip("/")
    tracks = {topic: _Track(JOINT_STATE, _JOINT_COLUMNS, lambda message: _angles_deg(message, names))}
    tracks |= {
        f"/{name}": _Track(NUMBER, (f"{name}_mm",), lambda message: (NO_STAMP, [number(message)]))
        for name, _ in rig.gauges
    }
    kinds: dict[str, str] = {}
    for message in messages_of(bag):
        kinds[message.topic] = message.kind
        track = tracks.get(message.topic)
        if track and message.kind == track.schema:
            track.add(message.log_ns, message.sent_ns, message.data)
            if len(track.ns) > _MOST_MESSAGES:
                problem = f"has more than {_MOST_MESSAGES} messages of {message.topic}"
                raise FileError(where, problem, "import the file in several runs")
    for topic, track in tracks.items():
        if len(track.ns) < 2:
            has = ", ".join(f"{name} ({kind})" for name, kind in sorted(kinds.items()))[:300] or "no messages"
            problem = f"contains fewer than two usable messages of {topic} ({track.schema}); it has {has}"
            remedy = "name the topic and the joints in the rig file, and the gauges' topics /g1, /g2"
            raise FileError(where, problem, remedy)
    return tracks


def _angles_deg(data: bytes, names: tuple[str, ...]) -> Message | None:
    """The stamp and the six angles of a JointState; None where it lacks one."""
    stamp_ns, placed = joint_state(data)
    if not set(names) <= placed.keys():
        return None
    return stamp_ns, [float(np.degrees(placed[name])) for name in names]
