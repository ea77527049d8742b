"""ROS 2 joint states from a rosbridge server: JSON over WebSocket (rosbridge v2.0; the origin lists open questions).

Each `sensor_msgs/msg/JointState` contains joint names, positions in radians in the same order, and the header stamp,
which is used as the controller clock; zero means that the driver does not set it. Several nodes may publish on a topic.
After the first complete message, a message that contains none of the six joints belongs to another device, such as a
hand, and is ignored. A message not later than the previous one was published twice or by a second node, and is also
ignored (LATE).
"""

from __future__ import annotations

import json
import math
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from daq.feedback import Read
from daq.protocol.conversation import ConversationStep, Device, FaultKind, Host
from daq.protocol.positions import (
    ClockOrder,
    Datagrams,
    Position,
    Positions,
    SteadyDevice,
    SteadyRate,
    UnusableDatagram,
)
from daq.protocol.streamed import Reaction, Streamed
from daq.protocol.websocket import LIMIT, WebSocketDevice, WebSocketHost
from rigs.schema.feedback import ROS2JointStates

RATE_HZ = 100.0
"""Rate of the emulated driver: the default update rate of ros2_control. The host assumes no rate."""
_TYPE = "sensor_msgs/msg/JointState"


class _Part(BaseModel):
    """Text in place of numbers and true in place of 1 are refused."""

    model_config = ConfigDict(strict=True)


class _Stamp(_Part):
    """builtin_interfaces/msg/Time with int32 and uint32. Clocks of robots are never before 1970."""

    sec: int = Field(ge=0, lt=2**31)
    nanosec: int = Field(ge=0, lt=2**32)


class _Header(_Part):
    stamp: _Stamp


class _JointState(_Part):
    header: _Header
    name: list[str]
    position: list[float | None]
    """rosbridge writes nan and infinity as null."""


class _Published(_Part):
    op: Literal["publish"]
    topic: str
    msg: _JointState


class _Status(_Part):
    op: Literal["status"]
    level: str
    msg: str


_MESSAGE: TypeAdapter[_Published | _Status] = TypeAdapter(Annotated[_Published | _Status, Field(discriminator="op")])


def host(feedback: ROS2JointStates) -> Host:
    address = feedback.port.removeprefix("tcp://")
    return WebSocketHost(Streamed(_JointStates(feedback), feedback.timeout_s), address, feedback.timeout_s)


def device(feedback: ROS2JointStates, read: Read) -> Device:
    return WebSocketDevice(_Bridge(feedback, read))


class _JointStates(Positions):
    def __init__(self, feedback: ROS2JointStates) -> None:
        subscription = json.dumps({"op": "subscribe", "topic": feedback.topic, "type": _TYPE}).encode()
        check = f"check that the robot's driver publishes on {feedback.topic}"
        super().__init__(self._message, check, ClockOrder(), subscription, Datagrams(LIMIT))
        self._topic = feedback.topic
        self._joints = feedback.joints
        self._found = False

    def silent(self) -> Reaction:
        return Reaction()

    def _message(self, data: bytes) -> Position | UnusableDatagram | None:
        try:
            received = _MESSAGE.validate_json(data)
        except ValidationError as error:
            problem = error.errors(include_url=False, include_input=False)[0]["msg"]
            return UnusableDatagram(FaultKind.GARBLED, f"message {data[:60]!r} is not a joint state: {problem}")
        if isinstance(received, _Published):
            return self._state(received.msg) if received.topic == self._topic else None
        if received.level not in {"error", "warning"}:
            return None
        return UnusableDatagram(FaultKind.DEVICE_ERROR, f"{received.level} of rosbridge: {received.msg[:200]}")

    def _state(self, state: _JointState) -> Position | UnusableDatagram | None:
        placed = dict(zip(state.name, state.position, strict=False))
        angles_rad = [placed.get(joint) for joint in self._joints]
        known_rad = [angle for angle in angles_rad if angle is not None]
        if len(known_rad) < len(self._joints):
            if self._found and not set(self._joints) & set(state.name):
                return None
            missing = self._joints[angles_rad.index(None)]
            has = ", ".join(state.name)[:200] or "no joints"
            detail = f"message without an angle of {missing}; available: {has}; check `joints`"
            return UnusableDatagram(FaultKind.MISSING, detail)
        self._found = True
        stamp = state.header.stamp
        clock_s = stamp.sec + stamp.nanosec * 1e-9 if stamp.sec or stamp.nanosec else math.nan
        return Position(tuple(map(math.degrees, known_rad)), clock_s)


class _Bridge(SteadyDevice):
    """rosbridge server with a driver that also publishes a hand joint, in a different order."""

    EPOCH_S = 1_700_000_000

    def __init__(self, feedback: ROS2JointStates, read: Read) -> None:
        super().__init__(read)
        self._feedback = feedback

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        try:
            asked = json.loads(data) if data else {}
        except (ValueError, RecursionError):
            asked = {}
        if isinstance(asked, dict) and asked.get("op") == "subscribe" and asked.get("topic") == self._feedback.topic:
            self._pace = SteadyRate(RATE_HZ, now_ns)
        return self._step()

    def _message(self, instant_ns: int) -> bytes:
        angles_deg = self._read(instant_ns)
        passed_ns = instant_ns - self._connected_ns
        stamp = {"sec": self.EPOCH_S + passed_ns // 10**9, "nanosec": passed_ns % 10**9}
        state = {
            "header": {"stamp": stamp, "frame_id": "base_link"},
            "name": ["finger_joint", *reversed(self._feedback.joints)],
            "position": [0.02, *map(math.radians, reversed(angles_deg))],
            "velocity": [],
            "effort": [],
        }
        return json.dumps({"op": "publish", "topic": self._feedback.topic, "msg": state}).encode()
