"""OPC UA for Robotics (OPC 40010-1): axes and condition of a robot, by an anonymous, unencrypted, read-only session.

The host browses for the robot and subscribes to the positions of the six axes, whose stamps (SourceTimestamp) become
the controller clock. If the server refuses, or the stamps do not change while the robot is at rest, the values are read
`rate_hz` times a second. The time is then between request and answer.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from asyncua import ua

from daq.feedback import Read
from daq.opc_ua.channel import (
    ACKNOWLEDGE,
    ERROR,
    HELLO,
    MESSAGE,
    NO_STAMP,
    OPEN,
    Channel,
    Received,
    Unreadable,
    chunks,
    decoded,
    type_of,
)
from daq.opc_ua.nodes import (
    RequestRefused,
    RobotNodes,
    Talk,
    Unfit,
    channel_request,
    hello,
    publish_request,
    robot_nodes,
    session,
    subscribed,
)
from daq.opc_ua.server import RobotServer
from daq.opc_ua.values import RobotValues
from daq.protocol.conversation import NO_TIME, ConversationStep, Device, Fault, FaultKind, Host
from daq.protocol.framing import Message
from daq.protocol.streamed import Reaction, Streamed, StreamedDialect
from rigs.schema.feedback import OPCUARobotics

_PUBLISH = 3
"""Simultaneous publish requests: one for each answer in transit."""
_RENEW = 0.75
"""Share of the token lifetime before renewal (OPC 10000-4, 5.6.2)."""
_SHORTEST_MS = 1000
"""Shortest renewal interval, also for shorter token lifetimes."""


def host(feedback: OPCUARobotics) -> Host:
    return _Host(_Client(feedback), feedback.timeout_s)


def device(feedback: OPCUARobotics, read: Read) -> Device:
    return RobotServer(feedback, read)


class _Host(Streamed):
    def __init__(self, client: _Client, timeout_s: float) -> None:
        super().__init__(client, timeout_s)
        self._client = client

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        return self._polling(super().received(data, now_ns), now_ns)

    def tick(self, now_ns: int) -> ConversationStep:
        return self._polling(super().tick(now_ns), now_ns)

    def _polling(self, step: ConversationStep, now_ns: int) -> ConversationStep:
        if step.hang_up or self._client.due_ns is None:
            return step
        if now_ns >= self._client.due_ns:
            return replace(step, send=step.send + self._client.poll(now_ns))
        return replace(step, wake_ns=min(self._client.due_ns, step.wake_ns or self._client.due_ns))


class _Client(StreamedDialect):
    """Requests and interpretation of the answers. due_ns: next poll; None if not polling."""

    def __init__(self, feedback: OPCUARobotics) -> None:
        self.frames = chunks()
        self.check = "check that the robot is on, and that the port belongs to an OPC UA server"
        self.due_ns: int | None = None
        self._polls = False
        self._feedback = feedback
        self._channel = Channel()
        self._session = ua.NodeId()
        self._requests = 0
        self._asked: dict[int, tuple[Any, int]] = {}
        self._talk = _prepared(feedback)
        self._values: RobotValues | None = None
        self._renew_ns: int | None = None

    def start(self) -> bytes:
        return self._channel.packed(HELLO, hello(self._feedback))

    def silent(self) -> Reaction:
        return Reaction(hang_up=True)

    def poll(self, now_ns: int) -> bytes:
        self.due_ns = None
        return self._request(self._values.request(), asked_ns=now_ns) if self._values else b""

    def garbled(self, fault: Fault) -> Reaction:
        return Reaction((replace(fault, detail=f"{fault.detail}; {self.check}"),), hang_up=True)

    def read(self, message: Message) -> Reaction:
        try:
            received = self._channel.read(message.data)
            reaction = Reaction() if received is None else self._meaning(received, message)
        except Unreadable as error:
            return _hang_up(FaultKind.GARBLED, f"{error}; reconnecting", message)
        except Unfit as error:
            return _hang_up(FaultKind.MISSING, str(error), message)
        except RequestRefused as error:
            return _hang_up(FaultKind.DEVICE_ERROR, f"the server answers {error}", message)
        renewal = b""
        if self._renew_ns is not None and message.last_byte_ns >= self._renew_ns:
            self._renew_ns = None
            renewal = self._request(channel_request(renew=True), OPEN)
        return replace(reaction, send=reaction.send + renewal)

    def _meaning(self, received: Received, message: Message) -> Reaction:
        if received.kind == ACKNOWLEDGE and not self._requests:
            self._channel.agree(decoded(ua.Acknowledge, received.body).ReceiveBufferSize)
            return Reaction(send=self._request(channel_request(renew=False), OPEN))
        if received.kind == ERROR:
            reply = decoded(ua.ErrorMessage, received.body)
            raise RequestRefused(f"{reply.Error.name} ({(reply.Reason or '')[:100]}); check port and `path`")
        if received.kind not in (OPEN, MESSAGE) or received.request not in self._asked:
            raise Unreadable(f"an answer {received.kind!r} without a request")
        request, asked_ns = self._asked.pop(received.request)
        response = _response(request, received.body)
        if isinstance(request, ua.OpenSecureChannelRequest):
            if isinstance(response, ua.ServiceFault):
                raise RequestRefused(f"{_name(response)} instead of a channel")
            token, begins = response.Parameters.SecurityToken, self._channel.number == 0
            self._channel.number, self._channel.token = token.ChannelId, token.TokenId
            self._renew_ns = message.last_byte_ns + round(_RENEW * max(token.RevisedLifetime, _SHORTEST_MS) * 1e6)
            return Reaction(send=self._request(next(self._talk)) if begins else b"")
        if self._values is None:
            return self._next(response, message)
        if isinstance(request, ua.PublishRequest):
            return self._published(self._values, response, message)
        if isinstance(response, ua.ServiceFault):
            raise RequestRefused(f"{_name(response)} instead of values")
        self.due_ns = max(asked_ns + round(1e9 / self._feedback.rate_hz), message.last_byte_ns)
        return Reaction(tuple(self._values.polled(response.Results or (), asked_ns, message)))

    def _next(self, response: Any, message: Message) -> Reaction:
        """Continue the set-up, which ends with a subscription or polling."""
        if isinstance(response, ua.CreateSessionResponse):
            self._session = response.Parameters.AuthenticationToken
        try:
            if isinstance(response, ua.ServiceFault):
                return Reaction(send=self._request(self._talk.throw(RequestRefused(_name(response)))))
            return Reaction(send=self._request(self._talk.send(response)))
        except StopIteration as end:
            nodes, subscribed_to = end.value
        self._values = RobotValues(self._feedback, nodes)
        if subscribed_to:
            return Reaction(send=b"".join(self._request(publish_request()) for _ in range(_PUBLISH)))
        self.due_ns = message.last_byte_ns
        return Reaction()

    def _request(self, request: Any, kind: bytes = MESSAGE, asked_ns: int = NO_TIME) -> bytes:
        self._requests += 1
        request.RequestHeader.AuthenticationToken = self._session
        request.RequestHeader.Timestamp = NO_STAMP
        request.RequestHeader.RequestHandle = self._requests
        self._asked[self._requests] = (request, asked_ns)
        return self._channel.packed(kind, request, self._requests)

    def _published(self, values: RobotValues, response: Any, message: Message) -> Reaction:
        if isinstance(response, ua.ServiceFault):
            if _name(response) == "BadTooManyPublishRequests":
                return Reaction()
            raise RequestRefused(f"{_name(response)}; reconnecting")
        if self._polls:  # an earlier answer
            return Reaction()
        note = response.Parameters.NotificationMessage
        if ended := [data for data in note.NotificationData or () if isinstance(data, ua.StatusChangeNotification)]:
            raise RequestRefused(f"{ended[0].Status.name}, which ends the subscription; reconnecting")
        if values.stand_still(note):
            self._polls, self.due_ns = True, message.last_byte_ns
            return Reaction()
        acknowledged = response.Parameters if note.NotificationData else None
        return Reaction(tuple(values.published(note, message)), self._request(publish_request(acknowledged)))


def _prepared(feedback: OPCUARobotics) -> Talk[tuple[RobotNodes, bool]]:
    """Open a session, find the robot and subscribe. True if the subscription succeeded."""
    try:
        yield from session(feedback)
    except RequestRefused as error:
        remedy = "allow anonymous reading without encryption in the settings, or close other clients"
        raise RequestRefused(f"{error} instead of a session; {remedy}") from None
    nodes = yield from robot_nodes(feedback)
    try:
        yield from subscribed(nodes, feedback)
    except RequestRefused:
        return nodes, False
    return nodes, True


def _response(request: Any, body: bytes) -> Any:
    kind = getattr(ua, type(request).__name__.removesuffix("Request") + "Response")
    number = type_of(body)
    if number not in (kind().TypeId.Identifier, ua.ObjectIds.ServiceFault_Encoding_DefaultBinary):
        raise Unreadable(f"an answer of type {number} instead of {kind.__name__}")
    begin = decoded(ua.ServiceFault, body)  # every answer begins with a type and a header
    good = number == kind().TypeId.Identifier and begin.ResponseHeader.ServiceResult.is_good()
    return decoded(kind, body) if good else begin


def _name(fault: Any) -> str:
    return str(fault.ResponseHeader.ServiceResult.name)


def _hang_up(kind: FaultKind, detail: str, message: Message) -> Reaction:
    return Reaction((message.fault(kind, detail),), hang_up=True)
