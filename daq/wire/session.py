"""Runs a conversation on a link: the one loop behind every gauge, every robot and every emulator."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Protocol

from daq.protocol.conversation import Conversation, Item, Step

_LONGEST_WAIT_S = 0.2
"""The limit lets a request to stop take effect, and keeps the watchdog fed on a silent link."""


class ByteLink(Protocol):
    """What the loop needs from a link."""

    def read(self, timeout_s: float) -> bytes:
        """Return what has come within the time; empty if nothing came. Raises LinkLost."""

    def write(self, data: bytes) -> None:
        """Send all of the data. Raises LinkLost."""


def run_conversation(
    link: ByteLink,
    conversation: Conversation,
    deliver: Callable[[Sequence[Item]], None],
    ended: Callable[[], bool],
    alive: Callable[[], None] = lambda: None,
) -> None:
    """Run the conversation on the link until `ended` is true or the conversation hangs up. Raises LinkLost.

    The stamp is taken before a write and right after a read, so that the device's reading lies between
    the two whatever the scheduler does. `alive` is called at least every 0.2 s.
    """
    step = conversation.connected(time.monotonic_ns())
    while True:
        if step.items:
            deliver(step.items)
        if step.send:
            link.write(step.send)
        if step.hang_up or ended():
            return
        alive()
        data = link.read(_wait_s(step))
        now_ns = time.monotonic_ns()
        if data:
            step = conversation.received(data, now_ns)
        elif step.wake_ns is not None and now_ns >= step.wake_ns:
            step = conversation.tick(now_ns)
        else:
            step = Step(wake_ns=step.wake_ns)


def _wait_s(step: Step) -> float:
    if step.wake_ns is None:
        return _LONGEST_WAIT_S
    return min(_LONGEST_WAIT_S, max(0.0, (step.wake_ns - time.monotonic_ns()) / 1e9))
