"""Conversation loop for every gauge, robot and emulator.

A single `select` and `read` lie between the arrival of bytes and the timestamp. While a conversation gathers
(`daq.protocol.conversation.Gathering`), bytes are only stamped on arrival and decoded together later.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from daq import clock
from daq.protocol.conversation import Arrival, Conversation, ConversationStep, Gathering, Item
from daq.wire.links import WAIT_S, LinkLost

_ALIVE_NS = 5_000_000
"""Shortest interval between calls of `alive`: otherwise they would take a tenth of the time."""
_MOST_GATHERED_BYTES = 65_536
"""Data of a flooding peer is decoded in pieces of about 2 ms each."""


class ByteLink(Protocol):
    def read(self, timeout_s: float) -> bytes:
        """Data received within the time-out; empty after it."""

    def write(self, data: bytes) -> None:
        """Send all data. Raises LinkLost."""

    def set_dtr(self, on: bool) -> None:
        """Set the modem line DTR if present. Raises LinkLost."""


def run_conversation(
    link: ByteLink,
    conversation: Conversation,
    deliver: Callable[[Sequence[Item]], None],
    ended: Callable[[], bool],
    alive: Callable[[], None] = lambda: None,
    *,
    longest_s: float = WAIT_S,
) -> None:
    """Run the conversation until `ended` returns True or the conversation hangs up. Raises LinkLost.

    Stamps are taken immediately before a write and after a read, so the reading of the device always lies between them.
    `ended` and `alive` are called at least every `longest_s` plus the gathering time, and `alive` at most every 5 ms.
    """
    gathering = conversation if isinstance(conversation, Gathering) else None
    step = conversation.connected(clock.now_ns())
    alive_ns = now_ns = 0
    while True:
        if step.items:
            deliver(step.items)
        if step.dtr is not None:
            link.set_dtr(step.dtr)
        if step.send:
            link.write(step.send)
        if step.hang_up or ended():
            return
        if now_ns >= alive_ns:
            alive()
            alive_ns = now_ns + _ALIVE_NS
        due_s = longest_s if step.wake_ns is None else max(0.0, (step.wake_ns - clock.now_ns()) / 1e9)
        data = link.read(min(longest_s, due_s))
        now_ns = clock.now_ns()
        if data and gathering:
            arrivals, lost = _gathered(link, (data, now_ns), gathering.gather_ns)
            step = gathering.received_all(arrivals)
            if lost:
                deliver(step.items)
                raise lost
        elif data:
            step = conversation.received(data, now_ns)
        elif step.wake_ns is not None and now_ns >= step.wake_ns:
            step = conversation.tick(now_ns)
        else:
            step = ConversationStep(wake_ns=step.wake_ns)


def _gathered(link: ByteLink, first: Arrival, gather_ns: int) -> tuple[list[Arrival], LinkLost | None]:
    """Read and stamp data for a time, and defer decoding. Returns the arrivals, and the error if the link was lost."""
    arrivals, size = [first], len(first[0])
    now_ns, until_ns = first[1], first[1] + gather_ns
    try:
        while now_ns < until_ns and size < _MOST_GATHERED_BYTES:
            data = link.read((until_ns - now_ns) / 1e9)
            now_ns = clock.now_ns()
            if data:
                arrivals.append((data, now_ns))
                size += len(data)
    except LinkLost as error:
        return arrivals, error
    return arrivals, None
