"""Drawing finer than characters: two by four braille dots in each cell."""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Array, Mask
from analysis.live.canvas import Area

_BRAILLE = 0x2800
_BITS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
"""The bits of the dots of a cell, row by row (Unicode 4.0, chapter 14.9)."""


class Dots:
    """Dots over an area: x to the right and y downwards, from 0 to width_dots and height_dots."""

    def __init__(self, area: Area) -> None:
        self._area = area
        self.width_dots, self.height_dots = 2 * area.width, 4 * area.height

    def polyline(self, x: Array, y: Array, style: str, every: int = 1) -> None:
        """Draw the line through points (n,), whose unit is the dot; every: of its dots only each so many, which
        distinguishes lines where there are no colours."""
        if len(x) < 2:
            return
        steps = np.maximum(np.abs(np.diff(x)), np.abs(np.diff(y)))
        along = np.concatenate([[0.0], np.cumsum(np.maximum(steps, 1e-9))])
        at = np.linspace(0.0, along[-1], 2 + int(min(along[-1], 20_000)))
        self.points(np.interp(at, along, x)[::every], np.interp(at, along, y)[::every], style)

    def points(self, x: Array, y: Array, style: str) -> None:
        """Draw points (n,), whose unit is the dot, over what is there; those outside the area are left out."""
        if not self.width_dots or not self.height_dots:
            return
        finite = np.isfinite(x) & np.isfinite(y)
        column, row = np.floor(x[finite]).astype(np.int64), np.floor(y[finite]).astype(np.int64)
        inside = (column >= 0) & (column < self.width_dots) & (row >= 0) & (row < self.height_dots)
        lit: Mask = np.zeros((self.height_dots, self.width_dots), dtype=bool)
        lit[row[inside], column[inside]] = True
        cells = lit.reshape(self._area.height, 4, self._area.width, 2).transpose(0, 2, 1, 3)
        bits = (cells * _BITS).sum(axis=(2, 3))
        for r, c in zip(*np.nonzero(bits), strict=True):
            self._merge(int(r), int(c), int(bits[r, c]), style)

    def _merge(self, row: int, column: int, bits: int, style: str) -> None:
        before = self._area.canvas.at(self._area.top + row, self._area.left + column)
        old = ord(before) - _BRAILLE if len(before) == 1 and _BRAILLE <= ord(before) < _BRAILLE + 256 else 0
        self._area.put(row, column, chr(_BRAILLE + (old | bits)), style)
