"""What joint columns may hold in place of what their labels say: one mistake of a person or a program at a time.

Axis 3 counted from the horizontal or from axis 2; an axis that counts the other way; two columns exchanged; a zero
elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from analysis.kinematics.arm import Array

_ZEROS_DEG = (90.0, -90.0, 180.0)
"""Where people and makers put another zero: a quarter or half a turn away."""


@dataclass(frozen=True)
class Meaning:
    """Joint columns read in another way: q (n, axes) as labelled to q = q M' + c, with M (axes, axes), c (axes,) rad.

    words: what is read in place of what is labelled; remedy: what to do if it is right.
    """

    columns: tuple[str, ...]
    words: str
    remedy: str
    matrix: Array
    offset: Array

    def of(self, q: Array) -> Array:
        """The angles (n, axes) rad that are meant by angles q (n, axes) rad."""
        axes = len(self.offset)
        return np.column_stack([q[:, :axes] @ self.matrix.T + self.offset, q[:, axes:]])


def meanings(axes: int) -> list[Meaning]:
    """Return every other way in which the columns of so many joints may have been meant."""
    return [*_couplings(axes), *_directions(axes), *_orders(axes), *_zeros(axes)]


def _couplings(axes: int) -> list[Meaning]:
    ways = []
    for sign, word in ((1.0, "+"), (-1.0, "-")):
        matrix = np.eye(axes)
        matrix[2, 1] = sign
        do = f"give the coupling of axes 2 and 3 in the rig file (robot.coupling), or q3_deg {word} q2_deg as q3_deg"
        ways.append(_meaning((2, 3), f"J3 {word} J2 in place of J3", do, matrix))
    return ways


def _directions(axes: int) -> list[Meaning]:
    ways = []
    for axis in range(1, axes + 1):
        matrix = np.eye(axes)
        matrix[axis - 1, axis - 1] = -1.0
        do = f"change the sign of q{axis}_deg, or correct axis {axis} of the rig file"
        ways.append(_meaning((axis,), f"J{axis} counted the other way", do, matrix))
    return ways


def _orders(axes: int) -> list[Meaning]:
    ways = []
    for first, second in combinations(range(1, axes + 1), 2):
        rows = list(range(axes))
        rows[first - 1], rows[second - 1] = second - 1, first - 1
        words, do = f"J{first} and J{second} exchanged", f"exchange the columns q{first}_deg and q{second}_deg"
        ways.append(_meaning((first, second), words, do, np.eye(axes)[rows]))
    return ways


def _zeros(axes: int) -> list[Meaning]:
    ways = []
    for axis in range(1, axes + 1):
        for off_deg in _ZEROS_DEG:
            offset = np.zeros(axes)
            offset[axis - 1] = np.radians(off_deg)
            words = f"{off_deg:+.0f}° on J{axis}"
            do = f"add {off_deg:.0f}° to q{axis}_deg, or to offset_deg of axis {axis} in the rig file"
            ways.append(_meaning((axis,), words, do, np.eye(axes), offset))
    return ways


def _meaning(axes: tuple[int, ...], words: str, remedy: str, matrix: Array, offset: Array | None = None) -> Meaning:
    columns = tuple(f"q{axis}_deg" for axis in axes)
    return Meaning(columns, words, remedy, matrix, np.zeros(len(matrix)) if offset is None else offset)
