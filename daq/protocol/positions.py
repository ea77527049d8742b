"""A controller that sends its joint angles by datagrams, each with a number and a stamp of its own clock.

What the interfaces differ in is how a datagram is taken apart, and what makes the controller send.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from daq.protocol.conversation import NO_TIME, Fault, FaultKind, Sample
from daq.protocol.datagrams import Datagrams
from daq.protocol.framing import Message
from daq.protocol.numerals import are_angles
from daq.protocol.order import Order
from daq.protocol.streamed import Reaction

_MAX_CLOCK_S = 1e11
"""A later stamp is invalid: three thousand years, whether since 1970 or since the controller was switched on."""


@dataclass(frozen=True, slots=True)
class Position:
    """The position in one datagram: six joint angles (deg), the controller's clock (s) and the datagram's number, and
    the columns of the robot's condition that the interface has."""

    angles_deg: tuple[float, ...]
    clock_s: float
    number: int
    condition: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Refused:
    """The reason why a datagram holds no position, in words."""

    kind: FaultKind
    detail: str


class Positions:
    """Receives positions in datagrams; `start` is sent at first, and again whenever the controller is silent."""

    def __init__(
        self, decode: Callable[[bytes], Position | Refused], check: str, order: Order, start: bytes = b""
    ) -> None:
        self.frames = Datagrams()
        self.check = check
        self._decode = decode
        self._order = order
        self._start = start

    def start(self) -> bytes:
        return self._start

    def silent(self) -> Reaction:
        self._order.forget()
        return Reaction(send=self._start)

    def read(self, message: Message | Fault) -> Reaction:
        if isinstance(message, Fault):
            return Reaction((message,))
        position, at_ns = self._decode(message.data), message.last_byte_ns
        if isinstance(position, Position) and not _sound(position):
            detail = f"time {position.clock_s:g} s and angles {position.angles_deg}; left out"
            position = Refused(FaultKind.GARBLED, detail)
        if isinstance(position, Refused):
            detail = f"datagram of {message.size} bytes: {position.detail}"
            return Reaction((Fault(position.kind, at_ns, detail),))
        stamps = (NO_TIME, message.first_byte_ns, at_ns)
        values = (*position.angles_deg, *position.condition)
        sample = Sample(values, *stamps, message.size, position.clock_s)
        return Reaction(self._order.admit(sample, position.number))


def _sound(position: Position) -> bool:
    return 0 <= position.clock_s < _MAX_CLOCK_S and are_angles(position.angles_deg)
