"""What a UART makes of characters that were sent at another baud: why wrong line settings look as they do."""

from __future__ import annotations

from collections.abc import Iterator

from rigs.schema.links import Line

_LOOKS = 16
"""A bit time: how often a UART looks for the edge that begins a character."""


def heard(data: bytes, sent: Line, at: Line) -> bytes:
    """Return characters sent with one line's settings as the other end receives them with its own.

    Parity is not checked, and a character without its stop bit is passed on, as most drivers do.
    """
    return b"".join(bytes(_characters(_levels(character, sent), sent.baud, at)) for character in data)


def _levels(character: int, line: Line) -> list[int]:
    """The wire during one character, a bit time each: start, data with the lowest bit first, parity, stop."""
    data = [character >> n & 1 for n in range(line.bits)]
    parity = {"N": [], "E": [sum(data) % 2], "O": [1 - sum(data) % 2]}[line.parity]
    return [0, *data, *parity, *[1] * line.stop]


def _characters(levels: list[int], baud: int, at: Line) -> Iterator[int]:
    """Characters that a receiver finds, sampling each bit in its middle; the wire is idle afterwards."""

    def level(bits: float) -> int:
        """Return the level of the line at a time in the receiver's bit times."""
        sent = int(bits * baud / at.baud)
        return levels[sent] if sent < len(levels) else 1

    now, end = 0.0, len(levels) * at.baud / baud
    while now < end:
        if level(now):
            now += 1 / _LOOKS
            continue
        yield sum(level(now + 1.5 + n) << n for n in range(at.bits))
        now += at.bits + 1.5
        while now < end and not level(now):  # no stop bit: a new character cannot begin before the wire is idle
            now += 1 / _LOOKS
