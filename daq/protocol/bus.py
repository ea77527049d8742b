"""Several instruments on one line, or behind one gateway, that are asked in turn.

Each has its own exchange of requests and answers (`daq.protocol.polled`), with its own time-out, rate and faults; here
is decided whose turn it is. The line goes to the one that has waited longest since it may ask, so instruments of one
rate are asked equally often. An answer names its instrument, so the next one is asked as soon as the time-out of a
silent one has passed. The silent one rests for its time-out, and after `PATIENCE` silences in a row twice as long each
time, up to `LONGEST_REST_NS`: what it costs the others is one time-out in each of these.

Between two exchanges the line rests for `gap_ns`, by which the instruments know where a frame begins, and for
`QUIET_NS` after anything that could not be read, lest the rest of it meet the next request. What comes while no
instrument is asked belongs to none of them, and is reported.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from daq.protocol.conversation import Bursts, Fault, FaultKind, Item, Sample, Step
from daq.protocol.framing import Framer, Message
from daq.protocol.polled import Polled, Stirring

PATIENCE = 3
LONGEST_REST_NS = 2_000_000_000
"""A gauge that was plugged in again is missed by its owner after some seconds."""
QUIET_NS = 20_000_000
"""An adapter may hold the end of a message for 16 ms."""
_MOST_QUIET_NS = 200_000_000
"""For a line that another host keeps busy."""


@dataclass
class Member:
    """One instrument on the line. name: for a person; exchange: with it; timeout_ns: how long its answer may take.

    wake_ns: when it may ask again, or is given up. turns: how often it was asked; silences: time-outs in a row.
    """

    name: str
    exchange: Polled
    timeout_ns: int
    wake_ns: int = 0
    turns: int = 0
    silences: int = 0


class Bus:
    """The host's side of a line with several instruments; each sample has the value of one, the others are nan."""

    def __init__(
        self, members: Sequence[Member], frames: Framer, stray: Callable[[Message], Fault], gap_ns: int
    ) -> None:
        """frames: which all members use; stray: gives the fault for a message that answers no request."""
        self._members = members
        self._frames = frames
        self._stray = stray
        self.gap_ns = gap_ns
        """The rest between two exchanges."""
        self._asked: Member | None = None
        self._free_ns = self._idle_ns = 0
        """When the line may be used again, and since when no request is on it."""
        self._stirring = Stirring()
        self._bursts = Bursts()

    def connected(self, now_ns: int) -> Step:
        self._stirring.begin(now_ns)
        self._idle_ns = now_ns
        for member in self._members:
            member.wake_ns = member.exchange.connected(now_ns).wake_ns or now_ns
        self._free_ns = max(member.wake_ns for member in self._members)
        return self._next([], now_ns)

    def received(self, data: bytes, now_ns: int) -> Step:
        if self._asked:
            return self._after(self._asked, self._asked.exchange.received(data, now_ns), now_ns)
        items = [
            message if isinstance(message, Fault) else self._stray(message)
            for message in self._frames.feed(data, now_ns)
        ]
        self._free_ns = max(self._free_ns, min(now_ns + QUIET_NS, self._idle_ns + _MOST_QUIET_NS))
        return self._next(self._bursts.merge(items, now_ns) if items else [], now_ns)

    def tick(self, now_ns: int) -> Step:
        if self._asked:
            return self._after(self._asked, self._asked.exchange.tick(now_ns), now_ns)
        return self._next([], now_ns)

    def lost(self, now_ns: int) -> tuple[Item, ...]:
        items: list[Item] = [*self._bursts.end()]
        for member in self._members:
            items += self._items_of(member, member.exchange.lost(now_ns))
            self._frames.clear()  # what has begun is counted once
        return tuple(items)

    def _after(self, member: Member, step: Step, now_ns: int) -> Step:
        """What follows a step of the member that was asked: nothing more until its turn is over."""
        items = self._items_of(member, step.items)
        member.wake_ns = now_ns if step.wake_ns is None else step.wake_ns
        if member.exchange.asking:
            return Step(items=tuple(items), wake_ns=member.wake_ns)
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

    def _next(self, items: Sequence[Item], now_ns: int) -> Step:
        """Let the member ask whose turn it is, if the line is free."""
        first = min(self._members, key=lambda member: (member.wake_ns, member.turns))
        due_ns = max(first.wake_ns, self._free_ns)
        if due_ns > now_ns:
            return Step(items=tuple(items), wake_ns=due_ns)
        step = first.exchange.tick(now_ns)
        self._stirring.count()
        self._asked = first
        first.turns += 1
        first.wake_ns = now_ns if step.wake_ns is None else step.wake_ns
        return Step(step.send, (*items, *self._items_of(first, step.items)), first.wake_ns)

    def _items_of(self, member: Member, items: Sequence[Item]) -> list[Item]:
        """A member's items as those of the line: its value in its own column, its faults under its name and column."""
        place, placed = self._members.index(member), list[Item]()
        for item in items:
            if isinstance(item, Fault):
                placed.append(replace(item, detail=f"{member.name}: {item.detail}", column=place))
            elif isinstance(item, Sample):
                values = [math.nan] * len(self._members)
                (values[place],) = item.values
                placed.append(replace(item, values=tuple(values)))
        return placed
