"""Conversation over a WebSocket (RFC 6455), with a text message per step. wsproto implements the protocol.

A message has the timestamp of the last piece. A refused, closed or invalid WebSocket, or a message above `LIMIT`, ends
the link.
"""

from __future__ import annotations

from dataclasses import replace

from wsproto import ConnectionType, WSConnection
from wsproto.events import (
    AcceptConnection,
    CloseConnection,
    Event,
    Message,
    Ping,
    RejectConnection,
    Request,
    TextMessage,
)
from wsproto.utilities import RemoteProtocolError

from daq.protocol.conversation import Conversation, ConversationStep, Device, Fault, FaultKind, Host, Item

LIMIT = 1 << 16
"""Ten times the joint states of an arm with a hand."""


class _WebSocket(Conversation):
    """A side of the connection. The inner conversation starts when the WebSocket is open."""

    def __init__(self, side: ConnectionType, carried: Conversation) -> None:
        self._socket = WSConnection(side)
        self._carried = carried
        self._open = self._over = False
        self._message = bytearray()

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        if self._over:
            return ConversationStep(hang_up=True)
        if not data:  # wsproto interprets empty data as the end
            return self._waiting(ConversationStep(), now_ns)
        try:
            self._socket.receive_data(data)
            whole = ConversationStep()
            for event in self._socket.events():
                whole = _after(whole, self._meaning(event, now_ns))
                if whole.hang_up:
                    return whole
        except (RemoteProtocolError, UnicodeError) as error:
            return self._finish(FaultKind.GARBLED, now_ns, f"not a WebSocket: {error}")
        return self._waiting(whole, now_ns)

    def tick(self, now_ns: int) -> ConversationStep:
        if self._over:
            return ConversationStep(hang_up=True)
        return self._carry(self._carried.tick(now_ns)) if self._open else self._waiting(ConversationStep(), now_ns)

    def _waiting(self, step: ConversationStep, now_ns: int) -> ConversationStep:
        """A step with the wake-up time of the carried protocol, if it contains none."""
        if step.wake_ns is not None or step.hang_up or not self._open:
            return step
        return _after(step, self._carry(self._carried.tick(now_ns)))

    def _meaning(self, event: Event, now_ns: int) -> ConversationStep:
        match event:
            case Request() | AcceptConnection():
                accepted = self._socket.send(AcceptConnection()) if isinstance(event, Request) else b""
                self._open = True
                step = self._carry(self._carried.connected(now_ns))
                return replace(step, send=accepted + step.send)
            case RejectConnection(status_code=status):
                return self._finish(
                    FaultKind.DEVICE_ERROR, now_ns, f"the server rejects a WebSocket: HTTP status {status}"
                )
            case Message(data=data, message_finished=finished):
                return self._read(data.encode() if isinstance(data, str) else data, finished, now_ns)
            case Ping():
                return ConversationStep(self._socket.send(event.response()))
            case CloseConnection(code=code, reason=reason):
                why = f"{int(code)} {reason or 'without a reason'}"
                return self._finish(FaultKind.DEVICE_ERROR, now_ns, f"the WebSocket was closed: {why}")
        return ConversationStep()

    def _read(self, data: bytes | bytearray, finished: bool, now_ns: int) -> ConversationStep:
        self._message += data
        if len(self._message) > LIMIT:
            return self._finish(FaultKind.GARBLED, now_ns, f"a message of more than {LIMIT} bytes")
        if not finished:
            return ConversationStep()
        message, self._message = bytes(self._message), bytearray()
        return self._carry(self._carried.received(message, now_ns))

    def _finish(self, kind: FaultKind, now_ns: int, detail: str) -> ConversationStep:
        self._over = True
        return ConversationStep(items=(Fault(kind, now_ns, detail),), hang_up=True)

    def _carry(self, step: ConversationStep) -> ConversationStep:
        return replace(step, send=self._socket.send(TextMessage(step.send.decode()))) if step.send else step


def _after(step: ConversationStep, following: ConversationStep) -> ConversationStep:
    return replace(following, send=step.send + following.send, items=step.items + following.items)


class WebSocketHost(_WebSocket):
    """Client side. address: of the server, for example `robot:9090`."""

    def __init__(self, carried: Host, address: str, timeout_s: float) -> None:
        super().__init__(ConnectionType.CLIENT, carried)
        self._host = carried
        self._address = address
        self._timeout_s = timeout_s
        self._wake_ns = 0

    def connected(self, now_ns: int) -> ConversationStep:
        self._wake_ns = now_ns + round(self._timeout_s * 1e9)
        return ConversationStep(self._socket.send(Request(host=self._address, target="/")), wake_ns=self._wake_ns)

    def handle_link_loss(self, now_ns: int) -> tuple[Item, ...]:
        return self._host.handle_link_loss(now_ns)

    def _waiting(self, step: ConversationStep, now_ns: int) -> ConversationStep:
        if self._open or step.hang_up:
            return super()._waiting(step, now_ns)
        if now_ns >= self._wake_ns:
            detail = f"no WebSocket within {self._timeout_s:g} s; check that the port belongs to a WebSocket server"
            return self._finish(FaultKind.SILENT, now_ns, detail)
        return replace(step, wake_ns=self._wake_ns)


class WebSocketDevice(_WebSocket):
    def __init__(self, carried: Device) -> None:
        super().__init__(ConnectionType.SERVER, carried)
        self._device = carried

    @property
    def sent(self) -> int:
        return self._device.sent
