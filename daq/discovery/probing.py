"""A conversation that is only tried: what it may send is limited, and it ends once nothing can come of it."""

from __future__ import annotations

from dataclasses import replace

from daq.discovery.attempts import Sends
from daq.protocol.conversation import Fault, FaultKind, Host, Item, Step

_MOST_FAULTS = 3
"""Faults before the first reading after which an attempt ends; one is normal where a stream is joined midway."""


class Probing:
    """Our side of a conversation, on trial.

    What a conversation opens with, before it has heard anything, sets the instrument (`OUT0`, `OUTPUT RS422`): where
    only requests may be sent, it is left out whenever it comes.
    """

    def __init__(self, host: Host, sends: Sends, silences: int = 1) -> None:
        """silences: how many time-outs without a word end it."""
        self._host = host
        self._silences = silences
        self._sends = sends
        self._opening = b""
        self._faults = 0
        self._has_read = False

    def connected(self, now_ns: int) -> Step:
        step = self._host.connected(now_ns)
        self._opening = step.send
        return self._limited(step)

    def received(self, data: bytes, now_ns: int) -> Step:
        return self._limited(self._host.received(data, now_ns))

    def tick(self, now_ns: int) -> Step:
        return self._limited(self._host.tick(now_ns))

    def lost(self, now_ns: int) -> tuple[Item, ...]:
        return self._host.lost(now_ns)

    def _limited(self, step: Step) -> Step:
        for item in step.items:
            if not isinstance(item, Fault):
                self._has_read = True
            elif item.kind is not FaultKind.DEVICE_ERROR:
                self._faults += 1
                self._silences -= item.kind is FaultKind.SILENT
        hopeless = not self._has_read and (self._faults >= _MOST_FAULTS or self._silences <= 0)
        return replace(step, send=self._allowed(step.send), hang_up=step.hang_up or hopeless)

    def _allowed(self, send: bytes) -> bytes:
        if self._sends == "all":
            return send
        return b"" if self._sends == "nothing" or send == self._opening else send
