"""An instrument that is asked by a modem line: DTR goes off for some time, and it sends a reading.

Cables of which the instrument cannot hear anything are made so. The exchange is that of a request and its answer
(`daq.protocol.polled`); here its request becomes the line. DTR is on between two requests for as long as it was off.
"""

from __future__ import annotations

from daq.protocol.conversation import Item, Step
from daq.protocol.polled import Polled
from daq.protocol.shapes import HeldShape


class AskedByLine:
    """The host's side. exchange: one that shares its line, so that it asks when it is let."""

    def __init__(self, exchange: Polled, off_ns: int) -> None:
        self._exchange = exchange
        self._off_ns = off_ns
        self._wake_ns = self._free_ns = 0
        """When the exchange is due, and when DTR may go off again."""
        self._on_ns: int | None = None
        """When DTR goes on again; None while it is."""

    @property
    def shapes(self) -> list[HeldShape]:
        """The shapes that its gauges' numbers are held to; none where they have no text."""
        return self._exchange.shapes

    @shapes.setter
    def shapes(self, shapes: list[HeldShape]) -> None:
        self._exchange.shapes = shapes

    def connected(self, now_ns: int) -> Step:
        return self._after(self._exchange.connected(now_ns), now_ns)

    def received(self, data: bytes, now_ns: int) -> Step:
        return self._after(self._exchange.received(data, now_ns), now_ns)

    def tick(self, now_ns: int) -> Step:
        if self._on_ns is not None and now_ns >= self._on_ns:
            self._on_ns = None
            return Step(wake_ns=self._due_ns(), dtr=True)
        if not self._exchange.asking and now_ns < self._free_ns:
            return Step(wake_ns=self._due_ns())
        return self._after(self._exchange.tick(now_ns), now_ns)

    def lost(self, now_ns: int) -> tuple[Item, ...]:
        return self._exchange.lost(now_ns)

    def _after(self, step: Step, now_ns: int) -> Step:
        self._wake_ns = now_ns if step.wake_ns is None else step.wake_ns
        if not step.send:
            return Step(items=step.items, wake_ns=self._due_ns())
        self._on_ns, self._free_ns = now_ns + self._off_ns, now_ns + 2 * self._off_ns
        return Step(items=step.items, wake_ns=self._due_ns(), dtr=False)

    def _due_ns(self) -> int:
        due_ns = self._wake_ns if self._exchange.asking else max(self._wake_ns, self._free_ns)
        return due_ns if self._on_ns is None else min(due_ns, self._on_ns)
