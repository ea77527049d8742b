"""Controller side of OPC UA for Robotics: a server with a single robot in the address space, for a single client."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any

from asyncua import ua

from daq.opc_ua.channel import (
    ACKNOWLEDGE,
    CHUNK,
    CHUNKS,
    CLOSE,
    HELLO,
    LIMIT,
    MESSAGE,
    NO_SECURITY,
    NO_STAMP,
    OPEN,
    Channel,
    Unreadable,
    chunks,
    decoded,
    type_of,
)
from daq.opc_ua.nodes import (
    CELSIUS,
    DEGREE,
    DRIVES,
    EMERGENCY,
    KILOGRAM,
    MASS,
    MODE,
    OBJECTS,
    OVERRIDE,
    PROTECTIVE,
    READY,
    STATE,
    shown_of,
)
from daq.protocol.conversation import Conversation, ConversationStep, Fault
from daq.protocol.framing import Message
from daq.protocol.positions import SteadyRate
from rigs.schema.condition import TEMPERATURES, UNDISTURBED
from rigs.schema.feedback import OPCUARobotics, are_nodes, condition_columns

_OURS = 4
_UNIT_NAMES = {DEGREE: "°", CELSIUS: "°C", KILOGRAM: "kg"}


@dataclass
class Space:
    below: dict[Any, list[tuple[str, Any]]] = field(default_factory=dict)
    """Children of each node as (browse name, node)."""
    variables: dict[Any, str] = field(default_factory=dict)
    units: dict[Any, int] = field(default_factory=dict)

    def add(self, path: str, shows: str | None = None, unit: int | None = None, node: Any | None = None) -> Any:
        above, _, name = path.rpartition("/")
        parent = self.add(above) if above else OBJECTS
        node = node or ua.NodeId(path, _OURS)
        if (name, node) not in self.below.setdefault(parent, []):
            self.below[parent].append((name, node))
        if shows is not None:
            self.variables[node] = shows
        if unit is not None:
            self.units[ua.NodeId(f"{path}/EngineeringUnits", _OURS)] = unit
            self.below.setdefault(node, []).append(("EngineeringUnits", ua.NodeId(f"{path}/EngineeringUnits", _OURS)))
        return node

    def browsed(self, node: Any) -> Any:
        references = [
            ua.ReferenceDescription(NodeId=child, BrowseName=ua.QualifiedName(name, _OURS))
            for name, child in self.below.get(node, [])
        ]
        return ua.BrowseResult(References=references)

    def constant(self, node: Any) -> Any:
        if node not in self.units:
            return ua.DataValue(StatusCode=ua.StatusCode(ua.StatusCodes.BadAttributeIdInvalid))
        unit = self.units[node]
        return ua.DataValue(ua.Variant(ua.EUInformation(UnitId=unit, DisplayName=ua.LocalizedText(_UNIT_NAMES[unit]))))


def robot_space(feedback: OPCUARobotics) -> Space:
    """Address space of a robot. If the rig file states the angle unit, the server omits it."""
    space, unit = Space(), None if feedback.units else DEGREE
    system, robot = "DeviceSet/System", f"DeviceSet/System/MotionDevices/{feedback.device or 'Robot'}"
    # Names of q1 … q6, or the position nodes listed in the rig file
    axes: Sequence[str] = feedback.axes or [f"Axis_{number}" for number in range(1, 7)]
    by_nodes = bool(feedback.axes) and are_nodes(axes)
    for number, declared in enumerate(axes, 1):
        name, node = (f"Axis_{number}", ua.NodeId.from_string(declared)) if by_nodes else (declared, None)
        axis = space.add(f"{robot}/Axes/{name}")
        space.add(f"{robot}/Axes/{name}/ParameterSet/ActualPosition", f"q{number}", unit, node)
        train = f"{robot}/PowerTrains/PowerTrain_{number}"
        space.add(f"{train}/Motor_1/ParameterSet/MotorTemperature", TEMPERATURES[number - 1], CELSIUS)
        space.add(f"{train}/{name}", node=axis)
    for name in (DRIVES, OVERRIDE):
        space.add(f"{robot}/ParameterSet/{name}", name)
    space.add(f"{robot}/FlangeLoad/Mass", MASS, KILOGRAM)
    for name in (MODE, EMERGENCY, PROTECTIVE):
        space.add(f"{system}/SafetyStates/SafetyState/ParameterSet/{name}", name)
    machine = f"{system}/Controllers/Controller/TaskControls/Task/TaskControlOperation/TaskControlStateMachine"
    space.add(f"{machine}/CurrentState", STATE)
    space.add(f"{machine}/{READY.replace('.', '/')}", READY)
    return space


_REQUESTS = {
    kind().TypeId.Identifier: kind
    for kind in (
        ua.CreateSessionRequest,
        ua.ActivateSessionRequest,
        ua.CloseSessionRequest,
        ua.BrowseRequest,
        ua.ReadRequest,
        ua.CreateSubscriptionRequest,
        ua.ModifySubscriptionRequest,
        ua.CreateMonitoredItemsRequest,
        ua.PublishRequest,
    )
}
_FASTEST_MS, _SLOWEST_MS = 1.0, 1000.0
_LONGEST_TOKEN_MS = 3_600_000


class RobotServer(Conversation):
    """OPC UA server of a robot.

    read: axis angles and the columns of `condition_columns` at a time. subscriptions: False if the client must poll.
    space: in place of the default robot of `feedback`.
    """

    EPOCH = datetime(2023, 11, 14, 22, 13, 20, tzinfo=UTC)

    def __init__(
        self,
        feedback: OPCUARobotics,
        read: Callable[[int], Sequence[float]],
        *,
        subscriptions: bool = True,
        space: Space | None = None,
    ) -> None:
        self.sent = 0
        self._feedback = feedback
        self._read = read
        self._subscriptions = subscriptions
        self._frames, self._channel = chunks(), Channel()
        self._space = space or robot_space(feedback)
        self._start_ns = 0
        self._pace: SteadyRate | None = None
        self._interval_ms = _SLOWEST_MS
        self._items: dict[int, str] = {}
        self._waiting: list[tuple[int, Any]] = []
        self._notes = 0

    def connected(self, now_ns: int) -> ConversationStep:
        self._start_ns = now_ns
        return ConversationStep()

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        answers = b""
        for chunk in self._frames.feed(data, now_ns):
            try:
                if isinstance(chunk, Fault):
                    raise Unreadable(chunk.detail)
                answers += self._answer(chunk, now_ns)
            except Unreadable:
                return ConversationStep(answers, hang_up=True)
        return self._step(answers)

    def tick(self, now_ns: int) -> ConversationStep:
        if self._pace is None or not self._waiting:
            return ConversationStep()
        instant_ns = self._pace.step(now_ns)
        if instant_ns is None:
            return self._step(b"")
        self.sent += 1
        self._notes = self._notes % (2**32 - 1) + 1
        number, request = self._waiting.pop(0)
        values = self._values(instant_ns)
        items = [
            ua.MonitoredItemNotification(handle, self._value(values, node, instant_ns))
            for handle, node in self._items.items()
        ]
        response = ua.PublishResponse()
        response.Parameters.SubscriptionId = 1
        response.Parameters.MoreNotifications = False
        response.Parameters.NotificationMessage = ua.NotificationMessage(
            self._notes, self._clock(instant_ns), [ua.DataChangeNotification(MonitoredItems=items)]
        )
        return self._step(self._reply(request, number, response))

    def _step(self, send: bytes) -> ConversationStep:
        return ConversationStep(send, wake_ns=self._pace.next_ns if self._pace and self._waiting else None)

    def _answer(self, chunk: Message, now_ns: int) -> bytes:
        received = self._channel.read(chunk.data)
        if received is None:
            return b""
        if received.kind == HELLO:
            self._channel.agree(decoded(ua.Hello, received.body).ReceiveBufferSize)
            return self._channel.packed(ACKNOWLEDGE, ua.Acknowledge(0, CHUNK, CHUNK, LIMIT, CHUNKS))
        if received.kind == OPEN:
            request = decoded(ua.OpenSecureChannelRequest, received.body)
            self._channel.number, self._channel.token = 1, self._channel.token + 1
            lifetime_ms = min(request.Parameters.RequestedLifetime, _LONGEST_TOKEN_MS)
            response = ua.OpenSecureChannelResponse()
            response.Parameters.SecurityToken = ua.ChannelSecurityToken(
                self._channel.number, self._channel.token, self._clock(now_ns), lifetime_ms
            )
            response.ResponseHeader.Timestamp = NO_STAMP
            return self._channel.packed(OPEN, response, received.request)
        if received.kind == CLOSE:
            raise Unreadable("the channel is closed")
        kind = _REQUESTS.get(type_of(received.body))
        if kind is None:
            fault = ua.ServiceFault()
            fault.ResponseHeader.ServiceResult = ua.StatusCode(ua.StatusCodes.BadServiceUnsupported)
            fault.ResponseHeader.Timestamp = NO_STAMP
            return self._channel.packed(MESSAGE, fault, received.request)
        request = decoded(kind, received.body)
        if kind is ua.PublishRequest:
            self._waiting.append((received.request, request))
            return b""
        return self._reply(request, received.request, self._served(request, now_ns))

    def _reply(self, request: Any, number: int, response: Any) -> bytes:
        response.ResponseHeader.RequestHandle = request.RequestHeader.RequestHandle
        response.ResponseHeader.Timestamp = NO_STAMP
        return self._channel.packed(MESSAGE, response, number)

    def _served(self, request: Any, now_ns: int) -> Any:
        response = getattr(ua, type(request).__name__.removesuffix("Request") + "Response")()
        asked: Any = getattr(request, "Parameters", None)
        match request:
            case ua.CreateSessionRequest():
                response.Parameters.AuthenticationToken = ua.NodeId("session", 1)
                response.Parameters.RevisedSessionTimeout = asked.RequestedSessionTimeout
                anonymous = ua.UserTokenPolicy(PolicyId="anonymous", TokenType=ua.UserTokenType.Anonymous)
                endpoint = ua.EndpointDescription(
                    EndpointUrl=asked.EndpointUrl,
                    SecurityMode=ua.MessageSecurityMode.None_,
                    SecurityPolicyUri=NO_SECURITY,
                    UserIdentityTokens=[anonymous],
                )
                response.Parameters.ServerEndpoints = [endpoint]
            case ua.BrowseRequest():
                response.Results = [self._space.browsed(description.NodeId) for description in asked.NodesToBrowse]
            case ua.ReadRequest():
                values = self._values(now_ns)
                response.Results = [self._value(values, item.NodeId, now_ns) for item in asked.NodesToRead]
                read = [self._space.variables.get(item.NodeId) or "" for item in asked.NodesToRead[:1]]
                self.sent += any(name.startswith("q") for name in read)
            case ua.CreateSubscriptionRequest() if not self._subscriptions:
                response.ResponseHeader.ServiceResult = ua.StatusCode(ua.StatusCodes.BadServiceUnsupported)
            case ua.CreateSubscriptionRequest() | ua.ModifySubscriptionRequest():
                wanted_ms = asked.RequestedPublishingInterval
                self._interval_ms = wanted_ms if _FASTEST_MS <= wanted_ms <= _SLOWEST_MS else _SLOWEST_MS
                revised = response.Parameters
                revised.SubscriptionId = 1
                revised.RevisedPublishingInterval = self._interval_ms
                revised.RevisedMaxKeepAliveCount = asked.RequestedMaxKeepAliveCount
                revised.RevisedLifetimeCount = asked.RequestedLifetimeCount
            case ua.CreateMonitoredItemsRequest():
                for item in asked.ItemsToCreate:
                    self._items[item.RequestedParameters.ClientHandle] = item.ItemToMonitor.NodeId
                response.Results = [ua.MonitoredItemCreateResult() for _ in asked.ItemsToCreate]
                self._pace = SteadyRate(1e3 / self._interval_ms, now_ns)
        return response

    def _clock(self, now_ns: int) -> datetime:
        return self.EPOCH + timedelta(microseconds=(now_ns - self._start_ns) / 1e3)

    def _values(self, now_ns: int) -> dict[str, Any]:
        values = self._read(now_ns)
        condition = UNDISTURBED | dict(zip(condition_columns(self._feedback), values[6:], strict=True))
        in_rad = self._feedback.units == "rad"
        angles = map(math.radians if in_rad else float, values[:6])
        return {f"q{axis}": angle for axis, angle in enumerate(angles, 1)} | shown_of(condition)

    def _value(self, values: dict[str, Any], node: Any, now_ns: int) -> Any:
        name = self._space.variables.get(node)
        if name is None:
            return self._space.constant(node)
        plain = values[name]
        variant = ua.Variant(ua.LocalizedText(plain)) if isinstance(plain, str) else ua.Variant(plain)
        return ua.DataValue(variant, SourceTimestamp=self._clock(now_ns))
