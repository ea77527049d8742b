"""Runs a conversation on a link: the one loop behind every gauge, every robot and every emulator.

Between the arrival of bytes and their stamp stand one `select` and one `read`. Where a conversation gathers
(`daq.protocol.conversation.Gathering`) nothing else happens for some time: bytes are stamped as they come, and read
together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from daq import clock
from daq.protocol.conversation import Arrival, Conversation, Gathering, Item, Step
from daq.wire.links import LinkLost

_LONGEST_WAIT_S = 0.2
"""The limit lets a request to stop take effect, and keeps the watchdog fed on a silent link."""
_ALIVE_NS = 5_000_000
"""How seldom a loop that turns faster says so: what is done then (the watchdog's beat, the port's counts, giving way)
would take a tenth of a poll."""
_MOST_GATHERED_BYTES = 65_536
"""As much as one read of a link brings: a peer that floods is decoded in pieces of some 2 ms each."""


class ByteLink(Protocol):
    """What the loop needs from a link."""

    def read(self, timeout_s: float) -> bytes:
        """Return what has come within the time; empty if nothing came. Raises LinkLost."""

    def write(self, data: bytes) -> None:
        """Send all of the data. Raises LinkLost."""

    def set_dtr(self, on: bool) -> None:
        """Set the modem line DTR, where there is one. Raises LinkLost."""


def run_conversation(
    link: ByteLink,
    conversation: Conversation,
    deliver: Callable[[Sequence[Item]], None],
    ended: Callable[[], bool],
    alive: Callable[[], None] = lambda: None,
) -> None:
    """Run the conversation on the link until `ended` is true or the conversation hangs up. Raises LinkLost.

    The stamp is taken before a write and right after a read, so that the device's reading lies between
    the two whatever the scheduler does. `alive` is called at least every 0.2 s, as much later as is gathered, and at
    most every 5 ms.
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
        due_s = _LONGEST_WAIT_S if step.wake_ns is None else max(0.0, (step.wake_ns - clock.now_ns()) / 1e9)
        data = link.read(min(_LONGEST_WAIT_S, due_s))
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
            step = Step(wake_ns=step.wake_ns)


def _gathered(link: ByteLink, first: Arrival, gather_ns: int) -> tuple[list[Arrival], LinkLost | None]:
    """Read on, and do nothing but stamp; return what came, and how the link was lost if it was."""
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
