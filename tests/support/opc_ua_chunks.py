"""Traffic of an OPC UA server chunk by chunk, and the resulting samples and faults."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from asyncua import ua

from daq.apps.opc_ua.channel import ACKNOWLEDGE, ERROR, MESSAGE, NO_STAMP, OPEN, Channel
from daq.protocol.conversation import Fault, Sample

_SERVER = Channel()


def _packed(kind: bytes, message: Any, request: int = 0) -> bytes:
    if hasattr(message, "ResponseHeader"):
        message.ResponseHeader.Timestamp = NO_STAMP
    return _SERVER.packed(kind, message, request)


def _fault(status: int) -> Any:
    fault = ua.ServiceFault()
    fault.ResponseHeader.ServiceResult = ua.StatusCode(status)
    return fault


_GIVEN = ua.OpenSecureChannelResponse()
_GIVEN.Parameters.SecurityToken = ua.ChannelSecurityToken(1, 1, NO_STAMP, 3_600_000)
OPENED = _packed(ACKNOWLEDGE, ua.Acknowledge()) + _packed(OPEN, _GIVEN, 1)
"""Answers to the hello message and to the request for a channel."""
REFUSED = _packed(MESSAGE, _fault(ua.StatusCodes.BadTooManySessions), 2)
UNREADABLE = _packed(MESSAGE, ua.ReadResponse(), 2)
ENDED = _packed(ERROR, ua.ErrorMessage(ua.StatusCode(ua.StatusCodes.BadTcpEndpointUrlInvalid), "no such path"))


def requests_in(sent: bytes) -> list[tuple[int, bytes]]:
    """All requests sent by a client in order: request number and content."""
    own, found = Channel(), list[tuple[int, bytes]]()
    while sent:
        size = int.from_bytes(sent[4:8], "little")
        received = own.read(sent[:size])
        sent = sent[size:]
        if received and received.request:
            found.append((received.request, received.body))
    return found


def faults(items: Sequence[object]) -> list[Fault]:
    return [item for item in items if isinstance(item, Fault)]


def samples(items: Sequence[object]) -> list[Sample]:
    return [item for item in items if isinstance(item, Sample)]
