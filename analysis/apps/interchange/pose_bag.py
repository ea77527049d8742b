"""Conversion of a ROS 2 bag to a table of poses: joint angles, and positions of the tool measured at the same time.

The times are the stamps of the senders, or those of reception if stamps are missing or come from different clocks. Each
standstill of the robot becomes a row of a table of unknown layout (`analysis.intake.map_proposal`).
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np

from analysis.apps.interchange.bags import (
    JOINT_STATE,
    NO_STAMP,
    PLACED,
    TF,
    BagMessage,
    bag_of,
    decoded,
    joint_state,
    messages_of,
    numbers,
    stamp_ns,
)
from analysis.apps.interchange.ros_bag import Track, newest, uneven_header
from analysis.intake.readers import StandTable
from analysis.robot.kinematics.arm import Array, Integers
from analysis.runs.stands import stands_of
from analysis.runs.written_files import csv_text
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.feedback import ROS2JointStates

_JOINT = re.compile(r"[\w./-]{1,100}")
_FEWEST = 3
"""Minimum number of readings in a standstill for a mean and a scatter."""
_APART_S = 0.1
"""Maximum difference between the delays of two senders' stamps; a larger difference indicates two clocks. Network
delays are smaller."""
_UNIT_WITHIN = 0.01
"""Tolerance for the length of a quaternion. Drivers publish float32, and zeros if they see nothing."""
_MOST_JOINTS, _LONGEST_NAME = 50, 200
_GAP_S = 1.0
"""Maximum gap in the joint angles: the robot may have moved in a longer gap."""
_DRIFTS, _LEAST_M = 6.0, 5e-5
"""Reported drift of an instrument during a standstill: between the means of its halves, in uncertainties and in m."""


def stands_of_bag(data: bytes, where: str, rig: Rig, topic: str = "") -> StandTable:
    """Tabulate the standstills of the robot in a bag.

    topic: topic of the poses; `/tf:CHILD` for a transform; by default the only candidate. Raises FileError.
    """
    bag = bag_of(data, where)
    names, joints, placed = _read(_of_use(messages_of(bag)), where, rig)
    topic, poses = _chosen(placed, topic, where)
    doubts = [] if bag.has_checksums else ["the bag has no checksums: damage cannot be detected"]
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

    (joint_ns, q), (pose_ns, seen), notes = _timed({"joints": joints, topic: poses})
    t_s = (joint_ns - joint_ns[0]) / 1e9
    stands = stands_of(t_s, q, np.zeros((len(q), 0)))
    turn = ["qx", "qy", "qz", "qw"] if seen.shape[1] == 7 else []
    rows, lost = [], Counter[str]()
    for stand in stands:
        at = joint_ns[stand.settled]
        of_stand = slice(*np.searchsorted(pose_ns, [at[0], at[-1] + 1]))
        why = _unusable(t_s[stand.begin : stand.end], pose_ns[of_stand], seen[of_stand], topic)
        if why:
            lost[why] += 1
        else:
            read, q_scatter = seen[of_stand], np.degrees(q[stand.settled].std(axis=0).max())
            turned = Rotation.from_quat(read[:, 3:]).mean().as_quat() if turn else ()
            place, scatter_mm = read[:, :3].mean(axis=0), 1e3 * read[:, :3].std(axis=0, ddof=1)
            numbers = (stand.t_s, *stand.q, *place, *turned, *scatter_mm, q_scatter)
            rows.append([*map(float, numbers), len(read)])
    notes += [f"{count} of {len(stands)} stops of the robot not used: {why}" for why, count in lost.items()]
    if not rows:
        reasons = "; ".join(notes) or "the robot never stopped for 0.3 s"
        raise FileError(
            where,
            f"contains no usable stop of the robot ({reasons})",
            "stop the robot at each pose",
            code="table.invalid",
        )
    scatter = ["std_x_mm", "std_y_mm", "std_z_mm", "std_joints_deg", "readings"]
    head = ["t_s", *(f"{name}_rad" for name in names), "x_m", "y_m", "z_m", *turn, *scatter]
    return StandTable(csv_text([head, *rows]).encode(), topic, (*doubts, *notes))


def _of_use(messages: Iterable[BagMessage]) -> list[BagMessage]:
    """Keep the relevant messages, and an empty message per other topic, such as images."""
    seen = set[str]()
    kept = []
    for message in messages:
        if message.kind == JOINT_STATE or message.kind in PLACED:
            kept.append(message)
        elif message.topic not in seen:
            kept.append(message._replace(data=b""))
        seen.add(message.topic)
    return kept


def _read(messages: Sequence[BagMessage], where: str, rig: Rig) -> tuple[list[str], Track, dict[str, Track]]:
    ros = rig.feedback if isinstance(rig.feedback, ROS2JointStates) else None
    topic = "/" + (ros.topic if ros else "joint_states").lstrip("/")
    joint_topics = {message.topic for message in messages if message.kind == JOINT_STATE}
    if topic not in joint_topics and not ros and len(joint_topics) == 1:
        (topic,) = joint_topics
    if topic not in joint_topics:
        has = ", ".join(sorted({f"{message.topic} ({message.kind})" for message in messages}))[:300] or "no messages"
        problem = f"{JOINT_STATE} on {topic} is missing; available: {has}"
        raise FileError(where, problem, "set the topic in the rig file", code="table.invalid")
    states = [message for message in messages if message.topic == topic and message.kind == JOINT_STATE]
    names = list(ros.joints) if ros else _names(states, len(rig.robot.axes), where)
    if odd := [name for name in names if not _JOINT.fullmatch(name)]:
        problem = f"contains an invalid joint name {odd[0][:40]!r}"
        raise FileError(where, problem, "name the six joints in the rig file", code="table.invalid")
    joints, placed = Track(), dict[str, Track]()
    for message in states:
        sent_ns, angles = joint_state(message.data)
        joints.add(message.log_ns, sent_ns, [angles[name] for name in names if set(names) <= angles.keys()])
    for message in messages:
        if message.kind not in PLACED:
            continue
        found = decoded(message.data, message.kind)
        if found is None:
            placed.setdefault(message.topic, Track()).lacking += 1
            continue
        for one in found.transforms if message.kind == TF else [found]:
            name = f"{message.topic}:{one.child_frame_id}" if message.kind == TF else message.topic
            if len(name) <= _LONGEST_NAME:
                place, *turns = (numbers(one, field) for field in PLACED[message.kind])
                is_turn = not turns or abs(math.hypot(*turns[0]) - 1) < _UNIT_WITHIN
                values = [*place, *(turns[0] if turns else [])] if is_turn else []
                placed.setdefault(name, Track()).add(message.log_ns, stamp_ns(one), values)
    if len(joints.log_ns) < 2:
        problem = f"contains fewer than two messages of {topic} with the joints {', '.join(names)}"
        raise FileError(
            where,
            problem,
            "name the joints in the rig file: feedback: {interface: ros2_joint_states, …}",
            code="table.invalid",
        )
    return names, joints, placed


def _names(messages: Sequence[BagMessage], axes: int, where: str) -> list[str]:
    named = [names for message in messages if axes <= len(names := list(joint_state(message.data)[1])) <= _MOST_JOINTS]
    if not named:
        problem = f"a message with {axes} to {_MOST_JOINTS} named joints is missing"
        remedy = "give the rig file of the measured arm, and publish JointState with names"
        raise FileError(where, problem, remedy, code="table.invalid")
    if others := next((names for names in named if not set(names) & set(named[0])), None):
        arms = "; ".join(", ".join(names[:_MOST_JOINTS]) for names in (named[0], others))
        problem = f"contains the joints of two arms on a single topic ({arms[:300]})"
        remedy = "give the joints of the measured arm in the rig file: feedback.joints"
        raise FileError(where, problem, remedy, code="table.invalid")
    return named[0]


def _chosen(placed: dict[str, Track], topic: str, where: str) -> tuple[str, Track]:
    """Topic of the instrument: the given topic, the only topic, or the only one that is not a transform."""
    tracks = {name: track for name, track in placed.items() if len(track.log_ns) > 1}
    has = ", ".join(sorted(tracks))[:300]
    if not tracks:
        kinds = ", ".join(kind.rpartition("/")[2] for kind in PLACED)
        raise FileError(
            where,
            f"a topic with positions is missing ({kinds})",
            "also record the topic of the measuring instrument",
            code="table.invalid",
        )
    if topic:
        if topic not in tracks:
            raise FileError(
                where, f"contains no positions on {topic!r}", f"choose --topic from {has}", code="table.invalid"
            )
        return topic, tracks[topic]
    no_transforms = {name: track for name, track in tracks.items() if ":" not in name} or tracks
    if len(no_transforms) > 1:
        raise FileError(
            where,
            f"contains {len(tracks)} topics or frames with positions ({has})",
            "choose the instrument's topic with --topic",
            code="table.invalid",
        )
    return next(iter(no_transforms.items()))


def _timed(tracks: dict[str, Track]) -> tuple[tuple[Integers, Array], tuple[Integers, Array], list[str]]:
    """Times in ns (n,) and values (n, k) of both tracks by the same clock, in order, and doubts in words."""
    doubts: list[str] = []
    log = {name: np.array(track.log_ns) for name, track in tracks.items()}
    sent = {name: np.array(track.sent_ns) for name, track in tracks.items()}
    stamped = [name for name in tracks if (sent[name] != NO_STAMP).all() and np.ptp(sent[name]) > 0]
    late_s = [float(np.median(log[name] - sent[name])) / 1e9 for name in stamped]
    uneven = {name: uneven_header(log[name], sent[name]) for name in stamped}
    doubts += [f"{name}: {words}" for name, words in uneven.items() if words]
    by = sent
    if len(stamped) < len(tracks):
        without = " and ".join(name for name in tracks if name not in stamped)
        doubts.append(f"{without}: the messages have no timestamps; the times of reception are used")
        by = log
    elif abs(late_s[0] - late_s[1]) > _APART_S:
        fact = f"times of joints and {stamped[1]} differ by {late_s[1] - late_s[0]:+z.3f} s, so their clocks differ"
        doubts.append(f"{fact}; the times of reception are used")
        by = log
    elif any(uneven.values()):
        by = log
    timed = []
    for name, track in tracks.items():
        order = np.argsort(log[name], kind="stable")
        log_ns, ns, values = log[name][order], by[name][order], np.array(track.values)[order]
        fresh = newest(log_ns, ns)
        timed.append((ns[fresh], values[fresh]))
        doubts += track.doubts(name, fresh)
    return timed[0], timed[1], doubts


def _unusable(t_s: Array, pose_ns: Integers, seen: Array, topic: str) -> str:
    """Reason for not using a standstill at times t_s (n,) with readings seen (m, k); empty if usable."""
    if np.diff(t_s).max() > _GAP_S:
        return f"joint angles are missing for more than {_GAP_S:g} s"
    if len(pose_ns) < _FEWEST:
        return f"fewer than {_FEWEST} readings of {topic}"
    halves = np.array_split(seen[:, :3], 2)
    apart = np.linalg.norm(halves[1].mean(axis=0) - halves[0].mean(axis=0))
    scatter = float(np.sqrt(sum(((half - half.mean(axis=0)) ** 2).sum() for half in halves) / len(seen)))
    if apart > max(_LEAST_M, _DRIFTS * scatter * 2 / np.sqrt(len(seen))):
        return f"{topic} was still moving; if this affects all stops, check the clocks"
    return ""
