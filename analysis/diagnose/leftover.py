"""What is still unexplained: lack of fit by bands of orders and at targets.

Where no effect of the library explains the residual, it is described instead. The test is one of evidence: how much
better a noise that is larger in some bands would explain what is left than the noise that the repeats showed does.
Faults of the library leave little (at most some 7 in log evidence on simulated cells, whatever their form), foreign
ones much more; LIMIT lies between.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from analysis.diagnose.blocks import Block
from analysis.diagnose.diagnosis import Leftover
from analysis.diagnose.evidence import Background
from analysis.diagnose.observed import ORDER_OF, ORDERS
from analysis.kinematics.arm import Array
from analysis.reading.tables import CircleTable, Integers, test_of
from rigs.vocabulary import Direction, TestName

LIMIT = 12.0
"""Log evidence for more noise from which on the library does not explain what is left."""
_EDGES = (0, 3, 8, 16, 30, 60, 120, ORDERS)
_PRICE = 2.0
"""Log evidence that each band's own strength must win."""
_TOLD = 4


@dataclass(frozen=True)
class _Band:
    block: Block
    part: str
    orders: tuple[int, int] | None
    energy: float
    expected: float
    count: int

    @property
    def excess(self) -> float:
        """Log evidence for more noise in this band, its price paid; not below 0."""
        ratio = self.ratio
        return max(0.0, 0.5 * self.count * (ratio - 1 - float(np.log(ratio))) - _PRICE) if ratio > 1 else 0.0

    @property
    def ratio(self) -> float:
        """Energy over what noise and a healthy arm's share of everything give."""
        return self.energy / self.expected


def excess(blocks: Sequence[Block], left: Array, background: Background) -> float:
    """Log evidence for more noise than repeats showed, in what is left (N,) standard deviations."""
    return sum(band.excess for band in _bands(blocks, left, background))


def unknown(blocks: Sequence[Block], left: Array) -> float:
    """Log density of what is left (N,) where something unknown adds noise of its own to each band."""
    total = 0.0
    nothing = Background(np.empty((len(left), 0)))
    for band in _bands(blocks, left, nothing):
        strength = max(1.0, band.ratio)
        total -= 0.5 * (band.energy / strength + band.count * float(np.log(strength))) + _PRICE * (strength > 1)
    return total


def whole(left: Array, background: Background) -> float:
    """Log evidence for more noise than that of the repeats and a strong background together, over all readings."""
    chi2, n = background.chi2(left), len(left)
    return 0.5 * (chi2 - n - n * float(np.log(chi2 / n))) if chi2 > n else 0.0


def leftovers(blocks: Sequence[Block], left: Array, background: Background) -> tuple[Leftover, ...]:
    """The bands that exceed their noise most, in words, worst first."""
    found = sorted(
        (band for band in _bands(blocks, left, background) if band.excess > 0), key=lambda band: -band.excess
    )
    parity = _parity(blocks, left)
    return tuple(_told(band, parity) for band in found[:_TOLD])


def _bands(blocks: Sequence[Block], left: Array, background: Background) -> Iterator[_Band]:
    begin, spread = 0, background.spread
    for block in blocks:
        rows = slice(begin, begin + len(block.y))
        own, more = left[rows] ** 2, spread[rows]
        begin += len(block.y)
        if not block.sampling:
            yield _Band(block, "targets", None, float(own.sum()), len(own) + float(more.sum()), len(own))
            continue
        half = len(ORDER_OF) // 2
        for part, entries in (("distance", np.arange(half)), ("angle", np.arange(half, 2 * half))):
            for low, high in pairwise(_EDGES):
                band: Integers = entries[(ORDER_OF[entries] >= low) & (ORDER_OF[entries] < high)]
                expected = len(band) + float(more[band].sum())
                yield _Band(block, part, (low, high - 1), float(own[band].sum()), expected, len(band))


def _parity(blocks: Sequence[Block], left: Array) -> dict[tuple[TestName, str], float]:
    """Correlation of what is left cw and acw at the same circle angles, by test and part."""
    parts: dict[tuple[TestName, Direction], Array] = {}
    begin = 0
    for block in blocks:
        table = block.one.table
        if isinstance(table, CircleTable):
            parts[table.test, table.direction] = left[begin : begin + len(ORDER_OF)]
        begin += len(block.y)
    half, found = len(ORDER_OF) // 2, {}
    for test in {test for test, _ in parts}:
        both = [parts.get((test, way)) for way in ("cw", "acw")]
        if both[0] is None or both[1] is None:
            continue
        for part, entries in (("distance", slice(0, half)), ("angle", slice(half, 2 * half))):
            a, b = both[0][entries], both[1][entries]
            slow = ORDER_OF[entries] < _EDGES[4]
            found[test, part] = float(np.corrcoef(a[slow], b[slow])[0, 1])
    return found


def _told(band: _Band, parity: dict[tuple[TestName, str], float]) -> Leftover:
    table, ratio = band.block.one.table, band.ratio
    if not isinstance(table, CircleTable):
        return Leftover(
            test_of(table), None, "targets", None, ratio, f"targets scatter {np.sqrt(ratio):.1f} times their noise"
        )
    assert band.orders is not None  # noqa: S101 - bands of circles have orders
    words = f"{band.orders[0]} to {band.orders[1]} cycles a lap, {np.sqrt(ratio):.1f} times the noise"
    same = parity.get((table.test, band.part))
    if same is not None and abs(same) > 0.5:
        words += ", alike in both directions" if same > 0 else ", of opposite sign in the other direction"
    return Leftover(table.test, table.direction, band.part, band.orders, ratio, words)  # type: ignore[arg-type]
