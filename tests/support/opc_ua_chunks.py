"""Requests to an OPC UA server, and the resulting samples and faults."""

from __future__ import annotations

from collections.abc import Sequence

from daq.opc_ua.channel import Channel
from daq.protocol.conversation import Fault, Sample


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
