"""The ways to read the registers of a Modbus unit as the reading of a gauge that is being moved.

A number that is put together wrongly jumps over the whole range of its type, or does not move at all. One that moves
steadily within the range of a gauge, while its probe is moved by hand, is its reading, or else the higher part of one.
Among several such ways those are taken for which the least of the rig file would have to be wrong.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from daq.protocol.modbus import unpack
from daq.protocol.numerals import is_length
from rigs.schema.modbus import ModbusMap, Number, Order, Register
from rigs.schema.probe import MM_PER_UNIT

LIKELY_MM = 100.0
"""The longest probes measure so far; for a gauge without `range_mm`."""
_FEW = 5
"""Different readings that a probe shows at the least while it is moved."""
_RANDOM = 0.5
"""Mean square of the steps over twice the variance (von Neumann): 1 of numbers at random, 0.2 of a motion to and fro
that is seen ten times."""
_CUT = 2**-4
"""The first register of a number in double precision holds four bits of its fraction, in single precision seven."""
_LEVELS = np.linspace(0, 1, 9)
_SELDOM = {"value.type": 3}
"""How much seldomer than any other key this one is wrong in a rig file."""

Place = tuple[int, int]
"""Unit and function."""
Piece = tuple[int, int]
"""First register and number of registers of one read: a number that is put together from two is none."""
Seen = Mapping[int, Sequence[int]]
"""Address → what the register held, pass by pass."""


@dataclass(frozen=True)
class Way:
    """A way to read the value. changed: the keys of the rig file that differ from what it says; readings_mm: (n,).

    moving: those of its registers that changed, with unit and function.
    """

    changed: dict[str, Any]
    readings_mm: NDArray[np.float64]
    moving: frozenset[tuple[int, int, int]]

    @property
    def effort(self) -> int:
        """How much of the rig file would have to be wrong."""
        return sum(_SELDOM.get(key, 1) for key in self.changed)

    def is_part_of(self, other: Way) -> bool:
        """Return whether this is the higher part of another number: the same motion, but for what it cuts off.

        They may have been read one after the other, so that only their distributions are alike.
        """
        apart_mm = np.abs(np.quantile(self.readings_mm, _LEVELS) - np.quantile(other.readings_mm, _LEVELS)).mean()
        return self.moving < other.moving and bool(apart_mm <= _CUT * np.abs(other.readings_mm).max())

    def __str__(self) -> str:
        return ", ".join(f"{key}: {value}" for key, value in self.changed.items())


def ways(gauge: ModbusMap, seen: Mapping[tuple[Place, Piece], Seen]) -> list[Way]:
    """Return the ways in which registers of the pieces seen are a reading that moves; the likeliest first."""
    of_pieces = [way for (place, _), registers in seen.items() for way in _of_piece(gauge, *place, registers)]
    found = {str(way): way for way in of_pieces}.values()
    whole = [way for way in found if not any(way.is_part_of(other) for other in found)]
    return sorted(whole, key=lambda way: way.effort)


def _of_piece(gauge: ModbusMap, unit: int, function: int, seen: Seen) -> Iterator[Way]:
    """The ways in one piece of a unit."""
    orders = product(get_args(Order), repeat=2)
    for address, kind, (word_order, byte_order) in product(seen, get_args(Number), list(orders)):
        register = Register(address=address, type=kind)
        if register.count == 1 and word_order != gauge.word_order:
            continue
        if not all(address + k in seen for k in range(register.count)):
            continue
        said = {
            "unit": (unit, gauge.unit),
            "function": (function, gauge.function),
            "value.address": (address, gauge.value.address),
            "value.type": (kind, gauge.value.type),
            "word_order": (word_order, gauge.word_order),
            "byte_order": (byte_order, gauge.byte_order),
        }
        layout = gauge.model_copy(update={"address": address, "word_order": word_order, "byte_order": byte_order})
        passes = zip(*(seen[address + k] for k in range(register.count)), strict=True)
        raw = np.array([unpack(words, register, layout) for words in passes], dtype=float)
        with np.errstate(over="ignore", invalid="ignore"):  # in a wrong order a number may be infinite, or none
            readings_mm = (raw * gauge.value.scale + gauge.value.offset) * MM_PER_UNIT[gauge.units]
        if is_motion(readings_mm, gauge):
            changed = {key: read for key, (read, written) in said.items() if read != written}
            moving = [address + k for k in range(register.count) if len(set(seen[address + k])) > 1]
            yield Way(changed, readings_mm, frozenset((unit, function, place) for place in moving))


def is_motion(readings_mm: NDArray[np.float64], gauge: ModbusMap) -> bool:
    """Return whether readings (n,) are those of this gauge while its probe is moved to and fro."""
    lowest_mm, highest_mm = gauge.limits_mm or (-LIKELY_MM, LIKELY_MM)
    if not all(map(is_length, readings_mm.tolist())):
        return False
    if readings_mm.min() < lowest_mm or readings_mm.max() > highest_mm or len(np.unique(readings_mm)) < _FEW:
        return False
    return bool(np.mean(np.diff(readings_mm) ** 2) < 2 * _RANDOM * np.var(readings_mm))
