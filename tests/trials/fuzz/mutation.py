"""Spoiling good bytes: what lines, disks and hands do to them, and worse."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from random import Random

HUGE = 3000
_DIGITS = b"0123456789"
_Spoil = Callable[[Random, bytearray, Sequence[bytes]], None]


def mutated(dice: Random, corpus: Sequence[bytes], longest: int = 4096) -> bytes:
    """One of the good pieces, spoilt once or several times; one in fifty stays good."""
    data = bytearray(dice.choice(corpus))
    if dice.random() < 0.98:
        for _ in range(dice.choice((1, 1, 1, 2, 3, 8))):
            dice.choice(_SPOILS)(dice, data, corpus)
    return bytes(data[:longest])


def _span(dice: Random, data: bytearray) -> slice:
    start = dice.randrange(len(data) + 1)
    return slice(start, min(len(data), start + dice.choice((1, 1, 2, 4, 16, 64))))


def _flip(dice: Random, data: bytearray, _: Sequence[bytes]) -> None:
    if data:
        data[dice.randrange(len(data))] ^= 1 << dice.randrange(8)


def _overwrite(dice: Random, data: bytearray, _: Sequence[bytes]) -> None:
    span = _span(dice, data)
    data[span] = dice.randbytes(span.stop - span.start)


def _zero(dice: Random, data: bytearray, _: Sequence[bytes]) -> None:
    span = _span(dice, data)
    data[span] = bytes([dice.choice((0, 0, 255))]) * (span.stop - span.start)


def _drop(dice: Random, data: bytearray, _: Sequence[bytes]) -> None:
    del data[_span(dice, data)]


def _insert(dice: Random, data: bytearray, _: Sequence[bytes]) -> None:
    start = dice.randrange(len(data) + 1)
    data[start:start] = dice.randbytes(dice.choice((1, 1, 3, 20)))


def _double(dice: Random, data: bytearray, _: Sequence[bytes]) -> None:
    span = _span(dice, data)
    data[span.stop : span.stop] = data[span] * dice.choice((1, 1, 1, 50))


def _cut(dice: Random, data: bytearray, _: Sequence[bytes]) -> None:
    del data[dice.randrange(len(data) + 1) :]


def _splice(dice: Random, data: bytearray, corpus: Sequence[bytes]) -> None:
    other = dice.choice(corpus)
    data[dice.randrange(len(data) + 1) :] = other[dice.randrange(len(other) + 1) :]


def _append(dice: Random, data: bytearray, corpus: Sequence[bytes]) -> None:
    data += dice.choice(corpus)


def _digit(dice: Random, data: bytearray, _: Sequence[bytes]) -> None:
    places = [place for place, byte in enumerate(data[:400]) if byte in _DIGITS]
    if places:
        place = dice.choice(places)
        data[place : place + 1] = dice.choice((b"9", b"0", b"-1", b"1e9", b"nan", b"9" * 400, b".", b"", b" "))


def _swell(dice: Random, data: bytearray, _: Sequence[bytes]) -> None:
    if dice.random() < 0.05:
        start = dice.randrange(len(data) + 1)
        data[start:start] = bytes([dice.randrange(256)]) * HUGE


_SPOILS: Sequence[_Spoil] = (
    _flip,
    _flip,
    _overwrite,
    _zero,
    _drop,
    _insert,
    _double,
    _cut,
    _splice,
    _append,
    _digit,
    _swell,
)
