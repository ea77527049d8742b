"""The shapes that a change of a figure may have, seen through the noise that runs of one robot may have.

A shape is a plateau, a straight rise and another plateau; a step is the shortest rise, slow growth one that reaches the
last run. The noise is white with a slow part that is alike in neighbouring runs (temperature, clamping, one set-up), a
grid of shares and lengths of it, as decision 0011 has it for laps. Position and size of a change are then those of
generalised least squares: A. C. Aitken, Proc. R. Soc. Edinburgh 55 (1935).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from analysis.kinematics.arm import Array, Integers

FEWEST = 4
"""Runs on either side of a step: fewer are a burst of wild runs, or one set-up."""
_STARTS = 100
"""Runs at which a change is looked for at first, evenly over the series; the best is refined to single runs."""
_ENDS = 25
"""Places of either end of a rise that are tried when it is refined."""
_SHARES = (0.25, 0.5, 0.75, 0.9, 0.97)
_LENGTHS = (1.5, 5.0, 15.0, 50.0)
"""Share of the slow part in the variance, and the number of runs over which it fades to 1/e."""


@dataclass(frozen=True)
class Whitening:
    """One kind of noise: rows (n, n) makes it white with variance 1, relative to the variance of a run; log_det: half
    the logarithm of its determinant; level (n,): the whitened constant, of length 1."""

    rows: Array
    half_log_det: float
    level: Array

    @classmethod
    def of(cls, covariance: Array) -> Whitening:
        """What makes noise of this covariance (n, n) white."""
        lower = np.linalg.cholesky(covariance)
        rows = np.linalg.inv(lower)
        level = rows @ np.ones(len(rows))
        return cls(rows, float(np.log(np.diag(lower)).sum()), level / np.linalg.norm(level))

    def without_level(self, values: Array) -> Array:
        """Whitened values (n, m), in any unit, less their least-squares constant."""
        white = self.rows @ values
        without: Array = white - np.outer(self.level, self.level @ white)
        return without


@dataclass(frozen=True)
class Shapes:
    """Rises between runs first (c,) and last (c,) as index numbers, and for each kind of noise their whitened
    directions (n, c) of length 1."""

    first: Integers
    last: Integers
    noises: tuple[Whitening, ...]
    directions: tuple[Array, ...]


@lru_cache(maxsize=3)  # at the most runs some 80 MB each
def shapes_of(count: int) -> Shapes:
    """The shapes looked for in a series of `count` runs."""
    stride = max(1, count // _STARTS)
    widths = [1]
    while widths[-1] * 2 < count:
        widths.append(widths[-1] * 2)
    pairs = [(a, a + w) for w in widths for a in range(0, count - w, stride)]
    pairs += [(a, count - 1) for a in range(0, count - 1, stride)]
    first, last = _allowed(np.array(sorted(set(pairs))), count)
    noises = whitenings(count)
    return Shapes(first, last, noises, tuple(directions(noise, first, last) for noise in noises))


def refined(count: int, first: int, last: int) -> tuple[Integers, Integers]:
    """Rises near one of `shapes_of`, to single runs: index numbers of their first (c,) and last (c,) runs."""
    reach = 2 * max(1, count // _STARTS) + (last - first) // 2
    near = [np.arange(max(0, at - reach), min(count, at + reach + 1)) for at in (first, last)]
    if len(near[0]) > _ENDS:  # a long rise: noise hides its ends by more than a run anyway
        near = [np.unique(np.linspace(ends[0], ends[-1], _ENDS).round().astype(int)) for ends in near]
    a, b = (grid.ravel() for grid in np.meshgrid(*near, indexing="ij"))
    return _allowed(np.stack([a, b], axis=1)[a < b], count)


def rises(count: int, first: Integers, last: Integers) -> Array:
    """Shapes (count, c), relative: 0 up to the run of index first (c,), 1 from last (c,) on, straight between."""
    shape: Array = np.clip((np.arange(count)[:, None] - first) / (last - first), 0.0, 1.0)
    return shape


def directions(noise: Whitening, first: Integers, last: Integers) -> Array:
    """Whitened rises (n, c) from run first (c,) to last (c,), as index numbers, of length 1."""
    white = noise.without_level(rises(len(noise.level), first, last))
    lengths = np.linalg.norm(white, axis=0)
    unit: Array = white / np.where(lengths > 1e-9, lengths, np.inf)
    return unit


def _allowed(pairs: Integers, count: int) -> tuple[Integers, Integers]:
    """Rises with enough runs on either side; those of a long rise count as such."""
    first, last = pairs.T
    within = (last - first - 1) // 2
    enough = (first + 1 + within >= FEWEST) & (count - last + within >= FEWEST)
    return first[enough], last[enough]


@lru_cache(maxsize=3)  # at the most runs some 80 MB each
def whitenings(count: int) -> tuple[Whitening, ...]:
    """White noise, and each kind with a slow part, for `count` runs."""
    apart = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    kinds = [np.eye(count)]
    kinds += [share * np.exp(-apart / length) + (1 - share) * np.eye(count) for share in _SHARES for length in _LENGTHS]
    return tuple(map(Whitening.of, kinds))
