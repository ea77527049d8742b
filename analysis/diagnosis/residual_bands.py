"""The unexplained residual: the bands of orders, and the targets, where more remains than noise explains, with a
description."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from analysis.diagnosis.blocks import BAND_EDGES, Block
from analysis.diagnosis.diagnosis import ResidualBand
from analysis.diagnosis.observed_run import ORDER_OF
from analysis.kinematics.arm import Array, Integers
from analysis.traces.tables import CircleTable, test_of
from rigs.schema.vocabulary import Direction, TestName

_REPORTED = 4
"""Number of bands that are reported. Chosen: more do not help a reader."""
_LEAST = 2.0
"""Ratio of the energy to that of the noise above which a band is reported. Chosen: at 2 the residual beyond the noise
is as large as the noise."""
_CLEAR = 6.0
"""Standard deviations of chi-square by which a band must exceed its noise, so that bands of few readings are not
reported by chance: among bands of five readings, noise alone exceeds it once in some thousands."""
_SLOW = 30
"""Orders below this are compared between the directions. Chosen: as for the level of slow noise in `repeat_noise`."""


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
        """Whether it exceeds its noise by more than chance explains."""
        return bool(self.ratio > max(_LEAST, 1 + _CLEAR * np.sqrt(2 / self.count)))


def bands_above_noise(blocks: Sequence[Block], left: Array) -> tuple[ResidualBand, ...]:
    """Return the bands that exceed their noise, those with the largest energy in mm² first, given the residual `left`
    (N,) in standard deviations of the noise."""
    found = [band for band in _bands(blocks, left) if band.is_clear]
    found.sort(key=lambda band: -band.energy_mm2)
    parity = _parity(blocks, left)
    return tuple(_described(band, parity) for band in found[:_REPORTED])


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
            for low, high in pairwise(BAND_EDGES):
                here = entries[(ORDER_OF[entries] >= low) & (ORDER_OF[entries] < high)]
                yield _band(block, part, (low, high - 1), own, here)


def _band(block: Block, part: str, orders: tuple[int, int] | None, own: Array, here: Integers) -> _Band:
    energy = float(((own[here] * block.sd_mm[here]) ** 2).sum())
    return _Band(block, part, orders, len(here), energy, float(np.mean(own[here] ** 2)))


def _parity(blocks: Sequence[Block], left: Array) -> dict[tuple[TestName, str], float]:
    """Return the correlation of the residual cw and acw at the same circle angles, by test and part."""
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


def _described(band: _Band, parity: dict[tuple[TestName, str], float]) -> ResidualBand:
    table, times = band.block.one.table, f"{np.sqrt(band.ratio):.1f} times the noise"
    if not isinstance(table, CircleTable):
        return ResidualBand(test_of(table), None, "targets", None, band.ratio, f"targets scatter by {times}")
    assert band.orders is not None  # noqa: S101 - bands of circles have orders
    words = f"{band.orders[0]} to {band.orders[1]} cycles a lap, {times}"
    same = parity.get((table.test, band.part))
    if same is not None and abs(same) > 0.5:
        words += ", alike in both directions" if same > 0 else ", of opposite sign in the other direction"
    return ResidualBand(table.test, table.direction, band.part, band.orders, band.ratio, words)  # type: ignore[arg-type]
