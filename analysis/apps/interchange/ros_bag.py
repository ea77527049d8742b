"""Conversion of a ROS 2 bag to the table of a circle.

Joints come from the topic of `sensor_msgs/msg/JointState` given in the rig file, and gauges from `/g1` and `/g2` of
`std_msgs/msg/Float64`, in mm. A topic is treated like the stream of an instrument (`analysis.runs.align`): by the
stamps of the sender, or by the pace of its messages. Irregular reception contributes to the uncertainty of the times.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from analysis.apps.interchange.bags import JOINT_STATE, NO_STAMP, NUMBER, Bag, bag_of, decoded, joint_state, messages_of
from analysis.robot.kinematics.arm import Array, Integers, Mask
from analysis.runs.align import align
from analysis.runs.clocks import Columns
from analysis.runs.written_files import csv_text
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.feedback import ROS2JointStates
from rigs.schema.vocabulary import CIRCLES, TestName

_MOST_MESSAGES = 5_000_000
"""Maximum number of messages per topic; half an hour at 1 kHz has 1.8 million."""
_JOINT_COLUMNS = tuple(f"q{axis}_deg" for axis in range(1, 7))
_LEAP_NS = 1e9
"""Maximum delay of a message: a network that delays messages longer loses the connection."""
_LARGEST = 1e6
"""Limit for the values of messages: lengths in m or mm, angles in rad or degrees."""
Message = tuple[int, list[float]]


@dataclass
class Track:
    """Times of reception, stamps of the sender and values of the messages of a topic."""

    log_ns: list[int] = field(default_factory=list)
    sent_ns: list[int] = field(default_factory=list)
    values: list[Sequence[float]] = field(default_factory=list)
    lacking: int = 0
    """Messages with missing values or a different layout."""

    def add(self, log_ns: int, sent_ns: int, values: Sequence[float]) -> None:
        alike = not self.values or len(values) == len(self.values[0])
        if not values or not alike or not all(abs(value) < _LARGEST for value in values):
            self.lacking += 1
            return
        self.log_ns.append(log_ns)
        self.sent_ns.append(sent_ns)
        self.values.append(values)

    def doubts(self, name: str, fresh: Mask) -> list[str]:
        """Describe the messages that are not used; a mask (n,) of those with a new stamp."""
        unused = f"of {len(fresh) + self.lacking} messages not used, because"
        doubts = []
        if self.lacking:
            doubts.append(f"{name}: {self.lacking} {unused} a joint, a turn or a finite number is missing")
        if stale := int((~fresh).sum()):
            why = "their timestamps are not newer than the previous message (a second publisher, or repeated messages)"
            doubts.append(f"{name}: {stale} {unused} {why}")
        return doubts


def table_of_bag(data: bytes, where: str, rig: Rig, test: TestName = CIRCLES[0]) -> tuple[bytes, tuple[str, ...]]:
    """Convert a bag to CSV, with doubts in words. Raises FileError."""
    bag = bag_of(data, where)
    tracks = _read(bag, rig)
    doubts = [] if bag.has_checksums else ["the bag has no checksums: damage cannot be detected"]
    begin_ns = min(min(track.log_ns) for track in tracks.values())  # Since 1970, a float has steps of 256 ns.
    streams: dict[str, Columns] = {}
    for topic, track in tracks.items():
        streams[topic], of_topic = _stream(topic, track, begin_ns)
        doubts += of_topic
    # Use the rig with gauges on a network, like every topic: the messages do not have the length of serial lines.
    gauges = {name: gauge.model_copy(update={"port": "tcp://topic:1"}) for name, gauge in rig.gauges}
    aligned = align(Path(where), streams, test, rig.model_copy(update={"gauges": rig.gauges.model_copy(update=gauges)}))
    # A message can only be late. The common delay is therefore as uncertain as the variation of the delays.
    u_lag_s = float(np.hypot(aligned.u_lag_s, np.sqrt(np.mean(aligned.u_t_s**2))))
    doubts += [
        *aligned.doubts,
        "times are the times of reception: u includes the variation of the delay, but not a constant delay",
    ]
    gauge_columns = [f"g{number}_mm" for number in range(1, aligned.g_mm.shape[1] + 1)]
    shared = np.full(len(aligned.t_s), u_lag_s)
    rows = np.column_stack([aligned.t_s, np.degrees(aligned.q), aligned.g_mm, aligned.u_t_s, shared])
    head = ["t_s", *_JOINT_COLUMNS, *gauge_columns, "u_t_s", "u_lag_s"]
    return csv_text([head, *rows.tolist()]).encode(), tuple(doubts)


def _stream(topic: str, track: Track, begin_ns: int) -> tuple[Columns, list[str]]:
    """Convert the messages on a topic to stream columns in order of time, with doubts."""
    order = np.argsort(np.array(track.log_ns), kind="stable")
    ns, sent_ns = (np.array(times, dtype=np.int64)[order] for times in (track.log_ns, track.sent_ns))
    values = np.array(track.values)[order]
    has_clock = bool((sent_ns != NO_STAMP).all() and np.ptp(sent_ns) > 0)
    doubts = []
    if has_clock and (uneven := uneven_header(ns, sent_ns)):
        has_clock, doubts = False, [f"{topic}: {uneven}"]
    fresh = newest(ns, sent_ns) if has_clock else np.ones(len(ns), dtype=bool)
    doubts += track.doubts(topic, fresh)
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
    columns = _JOINT_COLUMNS if values.shape[1] > 1 else (f"{topic[1:]}_mm",)
    return {**fixed, **dict(zip(columns, values.T, strict=True))}, doubts


_EVEN, _UNEVEN = 0.2, 0.5
"""Limits for even and uneven steps between messages: range from the 5th to the 95th percentile, as a share of the
median step. Chosen: a network makes times of reception uneven, and never evens them out."""


def uneven_header(ns: Integers, sent_ns: Integers) -> str:
    """Describe messages (n,) that came evenly although the stamps in their headers are uneven: their clock is wrong.

    Empty if the stamps are plausible, or explained by two publishers that both send evenly.
    """
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
"""Minimum number of messages for meaningful percentiles of the steps."""


def _spread(steps: Array) -> float:
    low, middle, high = np.percentile(steps, [5, 50, 95])
    return float((high - low) / middle) if middle > 0 else np.inf


def newest(ns: Integers, sent_ns: Integers) -> Mask:
    """Mask (n,) of the messages with a later stamp than all previous messages.

    An isolated stamp from the future is excluded, because all following messages would count as old.
    """
    early_ns = ns - sent_ns  # A message is never received before it was sent, whatever the offset of the clocks.
    possible = early_ns > np.quantile(early_ns, 0.01) - _LEAP_NS
    newest = np.maximum.accumulate(np.where(possible, sent_ns, np.iinfo(np.int64).min))
    return np.asarray(possible & (sent_ns > np.concatenate([[np.iinfo(np.int64).min], newest[:-1]])))


def _read(bag: Bag, rig: Rig) -> dict[str, Track]:
    """Track of the joints, then the tracks of the gauges, by topic."""
    where = bag.where
    if not isinstance(rig.feedback, ROS2JointStates):
        remedy = "add the joints to the rig file: feedback: {interface: ros2_joint_states, joints: [six names]}"
        raise FileError(where, "is a bag, but the rig file does not name the joints", remedy, code="table.invalid")
    names = rig.feedback.joints

    def angles_deg(data: bytes) -> Message:
        stamp_ns, angles = joint_state(data)
        return stamp_ns, [math.degrees(angles[name]) for name in names if set(names) <= angles.keys()]

    def reading_mm(data: bytes) -> Message:
        message = decoded(data, NUMBER)
        return NO_STAMP, [] if message is None else [message.data]

    decoders: dict[str, tuple[str, Callable[[bytes], Message]]] = {
        "/" + rig.feedback.topic.lstrip("/"): (JOINT_STATE, angles_deg),
        **{f"/{name}": (NUMBER, reading_mm) for name, _ in rig.gauges},
    }
    tracks = {topic: Track() for topic in decoders}
    kinds: dict[str, str] = {}
    for message in messages_of(bag):
        kinds[message.topic] = message.kind
        if message.topic not in tracks or message.kind != decoders[message.topic][0]:
            continue
        track = tracks[message.topic]
        stamp_ns, values = decoders[message.topic][1](message.data)
        sent_ns = NO_STAMP if message.sent_ns == message.log_ns else message.sent_ns
        track.add(message.log_ns, stamp_ns or sent_ns, values)
        if len(track.log_ns) > _MOST_MESSAGES:
            problem = f"contains more than {_MOST_MESSAGES} messages of {message.topic}"
            raise FileError(where, problem, "import the file in several runs", code="file.too_large")
    for topic, track in tracks.items():
        if len(track.log_ns) < 2:
            has = ", ".join(f"{name} ({kind})" for name, kind in sorted(kinds.items()))[:300] or "no messages"
            problem = f"contains fewer than two usable messages of {topic} ({decoders[topic][0]}); its topics: {has}"
            remedy = "set the topic and the joints in the rig file, and publish the gauges on /g1, /g2"
            raise FileError(where, problem, remedy, code="table.invalid")
    return tracks
