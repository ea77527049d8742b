"""The values in a block of Modbus registers: numbers of 16 to 64 bits, in either order of registers and of bytes.

Modbus itself knows registers of 16 bits alone, the higher byte first. How a longer number lies in them is up to the
instrument, and both orders are met: `word_order` is that of the registers of a value, `byte_order` that of the bytes of
each register.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from typing import Protocol

from rigs.schema.modbus import Number, Order, Register

_CODES: dict[Number, str] = {
    "int16": "h",
    "uint16": "H",
    "float16": "e",
    "int32": "i",
    "uint32": "I",
    "float32": "f",
    "int64": "q",
    "uint64": "Q",
    "float64": "d",
}
_NUMBER = {name: struct.Struct(f">{code}") for name, code in _CODES.items()}
_WORDS = {
    (order, count): struct.Struct(f"{mark}{count}H")
    for order, mark in (("big", ">"), ("little", "<"))
    for count in (1, 2, 4)
}
_LARGEST: dict[Number, float] = {"float16": 65504.0, "float32": (2 - 2**-23) * 2.0**127, "float64": math.inf}
"""The largest number of each floating type (IEEE 754)."""


class Layout(Protocol):
    """Where a block begins, and how the numbers lie in it."""

    @property
    def address(self) -> int:
        """The first register."""

    @property
    def word_order(self) -> Order:
        """The order of the registers of a value."""

    @property
    def byte_order(self) -> Order:
        """The order of the bytes of a register."""


def unpack(registers: Sequence[int], register: Register, layout: Layout) -> float:
    """Return one value of the block."""
    number = _NUMBER[register.type]
    start = register.address - layout.address
    words = registers[start : start + number.size // 2]
    in_order = words if layout.word_order == "big" else words[::-1]
    value: float = number.unpack(_WORDS[layout.byte_order, len(words)].pack(*in_order))[0]
    return value


def pack(registers: list[int], register: Register, layout: Layout, value: float) -> None:
    """Put one value into the block."""
    start = register.address - layout.address
    data = _NUMBER[register.type].pack(value if register.type in _LARGEST else round(value))
    words = _WORDS[layout.byte_order, register.count].unpack(data)
    registers[start : start + register.count] = words if layout.word_order == "big" else words[::-1]


def fits(raw: float, register: Register) -> bool:
    """Return whether the register's type can hold the value."""
    if not math.isfinite(raw):
        return False
    if register.type in _LARGEST:
        return abs(raw) <= _LARGEST[register.type]
    bits = 16 * register.count
    lowest = -(1 << bits - 1) if register.type.startswith("int") else 0
    return lowest <= round(raw) < lowest + (1 << bits)
