"""Conversations without a link: with a scripted partner, or with both sides joined in simulated time."""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable

from daq.protocol.conversation import Conversation, ConversationStep, Device, Item

S = 1_000_000_000


class Script:
    """A conversation with a scripted partner. Stores sent bytes and reported items."""

    def __init__(self, conversation: Conversation, now_ns: int = 0) -> None:
        self.conversation = conversation
        self.now_ns = now_ns
        self.sent = b""
        self.items: list[Item] = []
        self.step = self._keep(conversation.connected(now_ns))

    def _keep(self, step: ConversationStep) -> ConversationStep:
        self.step = step
        self.sent += step.send
        self.items += step.items
        return step

    def receive(self, data: bytes, now_ns: int | None = None) -> ConversationStep:
        self.now_ns = self.now_ns if now_ns is None else now_ns
        return self._keep(self.conversation.received(data, self.now_ns))

    def wake(self) -> ConversationStep:
        """Advance the time to the next requested wake-up."""
        assert self.step.wake_ns is not None
        self.now_ns = max(self.now_ns, self.step.wake_ns)
        return self._keep(self.conversation.tick(self.now_ns))

    def taken(self) -> list[Item]:
        """Items since the previous call."""
        items, self.items = self.items, []
        return items


def asked(conversation: Conversation) -> Script:
    """A polled conversation just after its first request."""
    script = Script(conversation)
    script.wake()
    script.sent = b""
    script.taken()
    return script


def simulate(
    host: Conversation,
    device: Device,
    until_ns: int,
    *,
    character_ns: int = 0,
    delay_ns: Callable[[], int] = lambda: 0,
) -> list[Item]:
    """Join both sides in simulated time and return the items in order.

    Bytes from the host arrive immediately. Bytes from the device are paced, and each answer is delayed.
    """
    items: list[Item] = []
    arrivals: deque[tuple[int, bytes]] = deque()
    wakes: list[tuple[int, int, Conversation]] = []
    latest: dict[int, int | None] = {}
    free_ns = 0

    def schedule(side: Conversation, step: ConversationStep, now_ns: int) -> None:
        latest[id(side)] = None if step.wake_ns is None else max(step.wake_ns, now_ns)
        if step.wake_ns is not None:
            at_ns = max(step.wake_ns, now_ns, free_ns if side is device else 0)
            latest[id(side)] = at_ns
            heapq.heappush(wakes, (at_ns, 0 if side is device else 1, side))

    def from_device(step: ConversationStep, now_ns: int) -> None:
        nonlocal free_ns
        if step.send:
            free_ns = max(free_ns, now_ns) + character_ns * len(step.send) + delay_ns()
            arrivals.append((free_ns, step.send))
        schedule(device, step, now_ns)

    def from_host(step: ConversationStep, now_ns: int) -> None:
        items.extend(step.items)
        schedule(host, step, now_ns)
        if step.send:
            from_device(device.received(step.send, now_ns), now_ns)

    from_device(device.connected(0), 0)
    from_host(host.connected(0), 0)
    while True:
        next_wake = wakes[0][0] if wakes else until_ns + 1
        next_arrival = arrivals[0][0] if arrivals else until_ns + 1
        now_ns = min(next_wake, next_arrival)
        if now_ns > until_ns:
            return items
        if next_arrival <= next_wake:
            from_host(host.received(arrivals.popleft()[1], now_ns), now_ns)
            continue
        _, _, side = heapq.heappop(wakes)
        if latest[id(side)] == now_ns:
            latest[id(side)] = None
            (from_device if side is device else from_host)(side.tick(now_ns), now_ns)


def held(thing: object, depth: int = 5) -> int:
    """Total length of all buffers of a conversation."""
    total = len(thing) if isinstance(thing, bytearray | list | dict | deque) else 0
    for value in vars(thing).values() if hasattr(thing, "__dict__") and depth else ():
        total += held(value, depth - 1)
    return total
