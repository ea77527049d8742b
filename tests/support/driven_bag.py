"""ROS 2 bags written by the rosbags library: an independently simulated arm moves between stops, a driver publishes
its joints, and a tracker, or a camera on the tool, publishes its measurements.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from tests.worlds.arms import soft_arm

Array = NDArray[np.float64]
STORE = get_typestore(Stores.ROS2_HUMBLE)
JOINTS = [f"{part}_joint" for part in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")]
BEGIN_S = 1_700_000_000.0
STOP_S, MOVE_S = 1.2, 0.8
NOISE_M = 2e-5
POSE, POINT, TRANSFORM, TF = (
    "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PointStamped", "geometry_msgs/msg/TransformStamped",
    "tf2_msgs/msg/TFMessage",
)  # fmt: skip


@dataclass(frozen=True)
class Driven:
    """True content of a bag: joint angles (n, 6) rad at the stops, and positions (n, 3) m of the measured object."""

    q: Array
    place_m: Array


def time_of(at_s: float) -> object:
    return STORE.types["builtin_interfaces/msg/Time"](sec=int(at_s), nanosec=int(at_s % 1 * 1e9))


def header(at_s: float, frame: str) -> object:
    return STORE.types["std_msgs/msg/Header"](stamp=time_of(at_s), frame_id=frame)


def message(kind: str, at_s: float, place: Array, turn: Rotation) -> object:
    """A message with a pose in the frame of the instrument."""
    new = {name.rpartition("/")[2]: one for name, one in STORE.types.items() if name.startswith("geometry_msgs/")}
    quaternion = new["Quaternion"](*turn.as_quat())
    if kind == POSE:
        return STORE.types[kind](header(at_s, "tracker"), new["Pose"](new["Point"](*place), quaternion))
    if kind == POINT:
        return STORE.types[kind](header(at_s, "tracker"), new["Point"](*place))
    moved = new["Transform"](new["Vector3"](*place), quaternion)
    stamped = STORE.types[TRANSFORM](header(at_s, "tracker"), "target", moved)
    if kind == TRANSFORM:
        return stamped
    links = [STORE.types[TRANSFORM](header(at_s, "base_link"), f"link_{k}", moved) for k in (1, 2)]
    return STORE.types[TF]([links[0], stamped, links[1]])


def drive(
    path: Path, rng: np.random.Generator, *, kind: str = POSE, storage: StoragePlugin = StoragePlugin.MCAP,
    stops: int = 20, on_tool: bool = False, clock_off_s: float = 0.0, blind: tuple[int, ...] = (), stamped: bool = True,
) -> Driven:  # fmt: skip
    """Write a bag and return its true content.

    on_tool: the instrument is a camera on the flange that measures a board in the cell. clock_off_s: delay of its
    timestamps. blind: stops without a measurement. stamped: whether joint messages have timestamps.
    """
    arm = soft_arm.wrong(soft_arm.nominal("ur10"), rng)
    q = np.radians(rng.uniform((-90, -120, -110, -120, -80, -150), (90, -40, 110, 120, 80, 150), (stops, 6)))
    tool = Rotation.from_euler("xyz", [0.3, -0.2, 1.0])
    instrument, away = Rotation.from_euler("xyz", [0.1, -0.15, 2.0]), np.array([2500.0, -800.0, 300.0])
    t_s, leg, share = _ways(stops)
    joints = _between(q, leg, share)
    T = arm.frames(joints)[:, -1]
    flange = Rotation.from_matrix(T[:, :3, :3])
    ball = arm.tool_mm(joints, np.array([30.0, -20.0, 90.0]))
    if on_tool:  # pose of the board relative to the camera, which is mounted on the flange
        camera = flange * tool
        board, turned = np.array([900.0, 200.0, 100.0]), Rotation.from_euler("z", 0.4)
        place, turn = camera.inv().apply(board - ball), camera.inv() * turned
    else:
        place, turn = instrument.apply(ball) + away, instrument * flange * tool
    sight = Sight(kind, place / 1e3, turn, clock_off_s, frozenset(blind))
    _write(path, rng, storage, (t_s, leg), JOINTS, joints, sight, stamped=stamped)
    return Driven(q, place[_first(t_s, stops)] / 1e3)


def drive_points(
    path: Path, rng: np.random.Generator, names: list[str], q: Array, place_mm: Array, topic: str = "/seen",
    beside: tuple[str, list[str]] | None = None,
) -> Driven:  # fmt: skip
    """Write a bag of an arm that stops at angles q (n, axes) rad with the ball at place_mm (n, 3).

    beside: topic and joint names of a second arm, which does not move.
    """
    t_s, leg, share = _ways(len(q))
    sight = Sight(
        POINT, _between(place_mm / 1e3, leg, share), Rotation.identity(len(t_s)), 0.0, frozenset(), topic, beside
    )
    _write(path, rng, StoragePlugin.MCAP, (t_s, leg), names, _between(q, leg, share), sight, stamped=True)
    return Driven(q, place_mm / 1e3)


@dataclass(frozen=True)
class Sight:
    """Measurements of an instrument: positions (n, 3) m and rotations at all times, clock delayed by clock_off_s.

    blind: stops without a measurement.
    """

    kind: str
    place_m: Array
    turn: Rotation
    clock_off_s: float
    blind: frozenset[int]
    topic: str = "/seen"
    beside: tuple[str, list[str]] | None = None


def _ways(stops: int) -> tuple[Array, Array, Array]:
    """Return times (n,) s, index of the last stop, and share (n, 1) of the motion to the next stop."""
    t_s = np.arange(0, stops * (STOP_S + MOVE_S), 0.01)
    leg, since = np.divmod(t_s, STOP_S + MOVE_S)
    share = np.clip((since - STOP_S) / MOVE_S, 0, 1)
    return t_s, leg.astype(int), (share**2 * (3 - 2 * share))[:, None]


def _between(values: Array, leg: Array, share: Array) -> Array:
    return np.asarray(values[leg] + share * (values[np.minimum(leg + 1, len(values) - 1)] - values[leg]))


def _first(t_s: Array, stops: int) -> Array:
    return np.searchsorted(t_s, np.arange(stops) * (STOP_S + MOVE_S))


def _write(
    path: Path, rng: np.random.Generator, storage: StoragePlugin, times: tuple[Array, Array], names: list[str],
    joints: Array, sight: Sight, *, stamped: bool,
) -> None:  # fmt: skip
    with Writer(path, version=9, storage_plugin=storage) as bag:
        to = {
            name: bag.add_connection(name, of, typestore=STORE)
            for name, of in (("/joint_states", "sensor_msgs/msg/JointState"), (sight.topic, sight.kind))
        }
        named, empty = ["finger", *reversed(names)] if names else [], np.array([])
        other, others = sight.beside or ("", [])
        if other and other not in to:
            to[other] = bag.add_connection(other, "sensor_msgs/msg/JointState", typestore=STORE)
        for k, (at, leg) in enumerate(zip(*times, strict=True)):
            log = int((BEGIN_S + at) * 1e9) + int(rng.uniform(2e5, 4e6))
            angles = np.array([0.01, *(joints[k, ::-1] + rng.normal(0, 2e-6, joints.shape[1]))])
            stamp = header(BEGIN_S + at if stamped else 0.0, "base")
            state = STORE.types["sensor_msgs/msg/JointState"](stamp, named, angles, empty, empty)
            bag.write(to["/joint_states"], log, STORE.serialize_cdr(state, state.__msgtype__))
            if other:
                still = STORE.types["sensor_msgs/msg/JointState"](stamp, others, np.ones(len(others)), empty, empty)
                bag.write(to[other], log + 500, STORE.serialize_cdr(still, still.__msgtype__))
            if k % 3 == 0 and leg not in sight.blind:
                place = sight.place_m[k] + rng.normal(0, NOISE_M, 3)
                seen = message(sight.kind, BEGIN_S + at + sight.clock_off_s, place, sight.turn[k])
                bag.write(to[sight.topic], log + 1000, STORE.serialize_cdr(seen, sight.kind))
