"""What is still unexplained: the bands of orders, and the targets, in which more is left than noise gives, in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from analysis.diagnosis.blocks import EDGES, Block
from analysis.diagnosis.diagnosis import Leftover
from analysis.diagnosis.observed import ORDER_OF
from analysis.kinematics.arm import Array, Integers
from analysis.traces.tables import CircleTable, test_of
from rigs.schema.vocabulary import Direction, TestName

_TOLD = 4
_LEAST = 2.0
"""Times the energy of the noise from which on a band is worth a line."""
_CLEAR = 6.0
"""Standard deviations by which a band exceeds its noise, so that few readings are not told by chance: of five, noise
alone does once in some thousands."""
_SLOW = 30
"""Orders below this are compared between the directions."""


@dataclass(frozen=True)
class _Band:
    block: Block
    part: str
    orders: tuple[int, int] | None
    count: int
    energy_mm2: float
    ratio: float

    @property
    def is_clear(self) -> bool:
        """Whether it exceeds its noise by more than chance does."""
        return bool(self.ratio > max(_LEAST, 1 + _CLEAR * np.sqrt(2 / self.count)))


def leftovers(blocks: Sequence[Block], left: Array) -> tuple[Leftover, ...]:
    """The bands that exceed their noise, in words, those with most energy in mm² first; left (N,): in standard
    deviations."""
    found = [band for band in _bands(blocks, left) if band.is_clear]
    found.sort(key=lambda band: -band.energy_mm2)
    parity = _parity(blocks, left)
    return tuple(_told(band, parity) for band in found[:_TOLD])


def _bands(blocks: Sequence[Block], left: Array) -> Iterator[_Band]:
    begin = 0
    for block in blocks:
        own = left[begin : begin + len(block.y_mm)]
        begin += len(own)
        if not block.sampling:
            yield _band(block, "targets", None, own, np.arange(len(own)))
            continue
        half = len(ORDER_OF) // 2
        for part, entries in (("distance", np.arange(half)), ("angle", np.arange(half, 2 * half))):
            for low, high in pairwise(EDGES):
                here = entries[(ORDER_OF[entries] >= low) & (ORDER_OF[entries] < high)]
                yield _band(block, part, (low, high - 1), own, here)


def _band(block: Block, part: str, orders: tuple[int, int] | None, own: Array, here: Integers) -> _Band:
    energy = float(((own[here] * block.sd_mm[here]) ** 2).sum())
    return _Band(block, part, orders, len(here), energy, float(np.mean(own[here] ** 2)))


def _parity(blocks: Sequence[Block], left: Array) -> dict[tuple[TestName, str], float]:
    """Correlation of what is left cw and acw at the same circle angles, by test and part."""
    parts: dict[tuple[TestName, Direction], Array] = {}
    begin = 0
    for block in blocks:
        table = block.one.table
        if isinstance(table, CircleTable):
            parts[table.test, table.direction] = left[begin : begin + len(ORDER_OF)]
        begin += len(block.y_mm)
    half, found = len(ORDER_OF) // 2, {}
    for test in {test for test, _ in parts}:
        both = [parts.get((test, way)) for way in ("cw", "acw")]
        if both[0] is None or both[1] is None:
            continue
        for part, entries in (("distance", slice(0, half)), ("angle", slice(half, 2 * half))):
            a, b = both[0][entries], both[1][entries]
            slow = ORDER_OF[entries] < _SLOW
            found[test, part] = float(np.corrcoef(a[slow], b[slow])[0, 1])
    return found


def _told(band: _Band, parity: dict[tuple[TestName, str], float]) -> Leftover:
    table, times = band.block.one.table, f"{np.sqrt(band.ratio):.1f} times the noise"
    if not isinstance(table, CircleTable):
        return Leftover(test_of(table), None, "targets", None, band.ratio, f"targets scatter by {times}")
    assert band.orders is not None  # noqa: S101 - bands of circles have orders
    words = f"{band.orders[0]} to {band.orders[1]} cycles a lap, {times}"
    same = parity.get((table.test, band.part))
    if same is not None and abs(same) > 0.5:
        words += ", alike in both directions" if same > 0 else ", of opposite sign in the other direction"
    return Leftover(table.test, table.direction, band.part, band.orders, band.ratio, words)  # type: ignore[arg-type]
