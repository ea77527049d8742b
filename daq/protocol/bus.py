"""Several instruments on a shared line or behind a gateway, polled in turn.

Each instrument has its own exchange (`daq.protocol.polled`), and the next turn goes to the one that has been due
longest. Answers name the instrument, so the next request can follow the time-out of a silent instrument immediately. It
then pauses, for longer after each further time-out, and costs the others a single time-out per pause.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from daq.protocol.conversation import Bursts, ConversationStep, Fault, FaultKind, Item, Sample
from daq.protocol.framing import Framer, Message
from daq.protocol.polled import Polled, Stirring

PATIENCE = 3
"""Time-outs in a row after which the pause of an instrument doubles each time."""
LONGEST_REST_NS = 2_000_000_000
"""After reconnecting a gauge, the operator expects readings within seconds."""
QUIET_NS = 20_000_000
"""Idle time after unreadable data: an adapter may delay the end of a message by 16 ms."""
_MOST_QUIET_NS = 200_000_000
"""Limit of the idle time on a line kept busy by a second host."""


@dataclass
class BusMember:
    name: str
    exchange: Polled
    timeout_ns: int
    wake_ns: int = 0
    """Time of the next request or of the time-out."""
    turns: int = 0
    silences: int = 0


class Bus:
    """Host side of the line. Each sample has the value of a single instrument; the others are nan."""

    def __init__(
        self, members: Sequence[BusMember], frames: Framer, stray: Callable[[Message], Fault], gap_ns: int
    ) -> None:
        """frames: framer used by all members. stray: creates the fault for an unrequested message."""
        self._members, self._frames, self._stray = members, frames, stray
        self.gap_ns = gap_ns
        """Idle time between two exchanges, by which instruments recognise the start of a frame."""
        self._asked: BusMember | None = None
        self._free_ns = self._idle_ns = 0
        """Time from which the line is available, and time since which no request is pending."""
        self._stirring = Stirring()
        self._bursts = Bursts()

    def connected(self, now_ns: int) -> ConversationStep:
        self._stirring.since_ns = now_ns
        self._idle_ns = now_ns
        for member in self._members:
            member.wake_ns = member.exchange.connected(now_ns).wake_ns or now_ns
        self._free_ns = max(member.wake_ns for member in self._members)
        return self._next([], now_ns)

    def received(self, data: bytes, now_ns: int) -> ConversationStep:
        if self._asked:
            return self._after(self._asked, self._asked.exchange.received(data, now_ns), now_ns)
        items = [
            message if isinstance(message, Fault) else self._stray(message)
            for message in self._frames.feed(data, now_ns)
        ]
        self._free_ns = max(self._free_ns, min(now_ns + QUIET_NS, self._idle_ns + _MOST_QUIET_NS))
        return self._next(self._bursts.merge(items, now_ns) if items else [], now_ns)

    def tick(self, now_ns: int) -> ConversationStep:
        if self._asked:
            return self._after(self._asked, self._asked.exchange.tick(now_ns), now_ns)
        return self._next([], now_ns)

    def handle_link_loss(self, now_ns: int) -> tuple[Item, ...]:
        items: list[Item] = [*self._bursts.end()]
        for member in self._members:
            items += self._items_of(member, member.exchange.handle_link_loss(now_ns))
            self._frames.clear()  # an unfinished message is counted only once
        return tuple(items)

    def _after(self, member: BusMember, step: ConversationStep, now_ns: int) -> ConversationStep:
        items = self._items_of(member, step.items)
        member.wake_ns = now_ns if step.wake_ns is None else step.wake_ns
        if member.exchange.asking:
            return ConversationStep(items=tuple(items), wake_ns=member.wake_ns)
        kinds = {item.kind for item in step.items if isinstance(item, Fault)}
        if FaultKind.SILENT in kinds:
            doublings = min(max(0, member.silences - PATIENCE), 16)
            member.wake_ns = now_ns + min(member.timeout_ns << doublings, max(member.timeout_ns, LONGEST_REST_NS))
            member.silences += 1
        else:
            member.silences = 0
        unread = bool(kinds & {FaultKind.GARBLED, FaultKind.STRANGER})
        rest_ns = max(self._stirring.rest_ns(now_ns), QUIET_NS if unread else self.gap_ns)
        self._asked, self._idle_ns, self._free_ns = None, now_ns, now_ns + rest_ns
        return self._next(items, now_ns)

    def _next(self, items: Sequence[Item], now_ns: int) -> ConversationStep:
        first = min(self._members, key=lambda member: (member.wake_ns, member.turns))
        due_ns = max(first.wake_ns, self._free_ns)
        if due_ns > now_ns:
            return ConversationStep(items=tuple(items), wake_ns=due_ns)
        step = first.exchange.tick(now_ns)
        self._stirring.requests += 1
        self._asked = first
        first.turns += 1
        first.wake_ns = now_ns if step.wake_ns is None else step.wake_ns
        return ConversationStep(step.send, (*items, *self._items_of(first, step.items)), first.wake_ns)

    def _items_of(self, member: BusMember, items: Sequence[Item]) -> list[Item]:
        place, placed = self._members.index(member), list[Item]()
        for item in items:
            if isinstance(item, Fault):
                placed.append(replace(item, detail=f"{member.name}: {item.detail}", column=place))
            elif isinstance(item, Sample):
                values = [math.nan] * len(self._members)
                (values[place],) = item.values
                placed.append(replace(item, values=tuple(values)))
        return placed
