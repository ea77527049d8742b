"""Spoiling good bytes: what lines, disks and hands do to them, and worse."""

from __future__ import annotations

from collections.abc import Sequence
from random import Random

HUGE = 3000
_DIGITS = b"0123456789"
_SPOILS = (
    "flip", "flip", "overwrite", "zero", "drop", "insert", "double", "cut", "splice", "append", "digit", "swell",
)  # fmt: skip


def mutated(dice: Random, corpus: Sequence[bytes], longest: int = 4096) -> bytes:
    """One of the good pieces, spoilt once or several times; one in fifty stays good."""
    data = bytearray(dice.choice(corpus))
    if dice.random() < 0.98:
        for _ in range(dice.choice((1, 1, 1, 2, 3, 8))):
            _spoil(dice, dice.choice(_SPOILS), data, corpus)
    return bytes(data[:longest])


def _spoil(dice: Random, how: str, data: bytearray, corpus: Sequence[bytes]) -> None:
    start, other = dice.randrange(len(data) + 1), dice.choice(corpus)
    span = slice(start, min(len(data), start + dice.choice((1, 1, 2, 4, 16, 64))))
    match how:
        case "flip" if start < len(data):
            data[start] ^= 1 << dice.randrange(8)
        case "overwrite":
            data[span] = dice.randbytes(span.stop - span.start)
        case "zero":
            data[span] = bytes([dice.choice((0, 0, 255))]) * (span.stop - span.start)
        case "drop":
            del data[span]
        case "insert":
            data[start:start] = dice.randbytes(dice.choice((1, 1, 3, 20)))
        case "double":
            data[span.stop : span.stop] = data[span] * dice.choice((1, 1, 1, 50))
        case "cut":
            del data[start:]
        case "splice":
            data[start:] = other[dice.randrange(len(other) + 1) :]
        case "append":
            data += other
        case "digit" if places := [place for place, byte in enumerate(data[:400]) if byte in _DIGITS]:
            place = dice.choice(places)
            data[place : place + 1] = dice.choice((b"9", b"0", b"-1", b"1e9", b"nan", b"9" * 400, b".", b"", b" "))
        case "swell" if dice.random() < 0.05:
            data[start:start] = bytes([dice.randrange(256)]) * HUGE
