"""Detection of changes in a figure beyond the scatter between runs.

The score of a shape is its log-likelihood ratio to no change, both with their best noise, so slow noise is no change.
The runs before and after a detection are searched in the same way (binary segmentation: A. J. Scott and M. Knott,
Biometrics 30 (1974)), without single outliers (F. R. Hampel, J. Am. Stat. Assoc. 69 (1974)). The false alarm
probability of a robot is divided among its figures; docs/evidence/history.md has the measured one.

A shape is a plateau, a straight ramp and a second plateau: a step is the shortest ramp. The noise is white plus a slow
part common to neighbouring runs, on a grid of shares and lengths, as in decision 0011.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from analysis.robot.kinematics.arm import Array, Integers, Mask

FEWEST = 4
"""Fewest runs on either side of a change: fewer may be a burst of outliers, or a single set-up."""
_STARTS = 100
"""Positions of a change in the first search; the best is refined to single runs."""
_ENDS = 25
_SHARES = (0.25, 0.5, 0.75, 0.9, 0.97)
_LENGTHS = (1.5, 5.0, 15.0, 50.0)
"""Share of the slow part in the variance, and correlation length in runs."""


@dataclass(frozen=True)
class Whitening:
    rows: Array
    half_log_det: float
    level: Array

    @classmethod
    def of(cls, covariance: Array) -> Whitening:
        lower = np.linalg.cholesky(covariance)
        rows = np.linalg.inv(lower)
        level = rows @ np.ones(len(rows))
        return cls(rows, float(np.log(np.diag(lower)).sum()), level / np.linalg.norm(level))

    def without_level(self, values: Array) -> Array:
        """Whitened values (n, m) without their least-squares constant."""
        white = self.rows @ values
        without: Array = white - np.outer(self.level, self.level @ white)
        return without


@dataclass(frozen=True)
class Shapes:
    """Ramps between the runs first (c,) and last (c,), whitened for each noise to length 1 (n, c)."""

    first: Integers
    last: Integers
    noises: tuple[Whitening, ...]
    directions: tuple[Array, ...]


@lru_cache(maxsize=3)  # About 80 MB each for the longest series
def shapes_of(count: int) -> Shapes:
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
    """Ramps near a ramp of `shapes_of`."""
    reach = 2 * max(1, count // _STARTS) + (last - first) // 2
    near = [np.arange(max(0, at - reach), min(count, at + reach + 1)) for at in (first, last)]
    if len(near[0]) > _ENDS:  # A long ramp: noise hides the ends anyway
        near = [np.unique(np.linspace(ends[0], ends[-1], _ENDS).round().astype(int)) for ends in near]
    a, b = (grid.ravel() for grid in np.meshgrid(*near, indexing="ij"))
    return _allowed(np.stack([a, b], axis=1)[a < b], count)


def rises(count: int, first: Integers, last: Integers) -> Array:
    """(count, c): 0 up to run first (c,), 1 from run last (c,) on."""
    shape: Array = np.clip((np.arange(count)[:, None] - first) / (last - first), 0.0, 1.0)
    return shape


def directions(noise: Whitening, first: Integers, last: Integers) -> Array:
    white = noise.without_level(rises(len(noise.level), first, last))
    lengths = np.linalg.norm(white, axis=0)
    unit: Array = white / np.where(lengths > 1e-9, lengths, np.inf)
    return unit


def _allowed(pairs: Integers, count: int) -> tuple[Integers, Integers]:
    first, last = pairs.T
    within = (last - first - 1) // 2
    enough = (first + 1 + within >= FEWEST) & (count - last + within >= FEWEST)
    return first[enough], last[enough]


@lru_cache(maxsize=3)  # About 80 MB each for the longest series
def whitenings(count: int) -> tuple[Whitening, ...]:
    apart = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    kinds = [np.eye(count)]
    kinds += [share * np.exp(-apart / length) + (1 - share) * np.eye(count) for share in _SHARES for length in _LENGTHS]
    return tuple(map(Whitening.of, kinds))


FALSE_ALARMS = 0.01
"""Probability that an unchanged robot reports a change."""
NEWEST = 500
"""Runs searched: time and memory are quadratic."""
_CHANCE = 6.5
"""P(score > s) <= exp(_CHANCE - s) if nothing changes; simulated for 10 to 300 runs, white noise and slow parts of 50
to 90 % over 1.5 to 50 runs. The worst 99 % quantile was 11.2.
"""
_WINDOW, _OUTLIER_SPREADS = 7, 4.0
"""Runs of the running median, and distance of an outlier from it in spreads."""
_SLOWER = 2.0
_TO_SD, _MEAN_TO_SD = 1.4826, 1.2533
"""Standard deviation of a normal distribution over its median and mean absolute deviation."""


@dataclass(frozen=True)
class Change:
    """A change between two runs, by index.

    u: by the scatter of the runs. chance: probability of such a series if nothing changes, over all figures of the
    robot. is_last: the ramp reaches the last run and may continue.
    """

    first: int
    last: int
    before: float
    after: float
    u: float
    chance: float
    is_last: bool


@dataclass(frozen=True)
class Trend:
    """wild (n,): outliers. spread: standard deviation between runs without changes; zero if most repeat a value, NaN
    for a single run.
    """

    changes: tuple[Change, ...]
    wild: Mask
    spread: float


@dataclass(frozen=True)
class _Best:
    first: int
    last: int
    score: float
    noise: Whitening


def trend_of(values: Array, u: Array, series: int) -> Trend:
    """series: number of series searched for the robot."""
    wild = outlying_runs(values, u)
    # Standard deviation between successive runs, hardly affected by a step or slow ramp; NaN for a single run.
    steps = np.abs(np.diff(values[~wild]))
    spread = float(_TO_SD * np.median(steps) / np.sqrt(2)) if len(steps) else float("nan")
    kept = np.flatnonzero(~wild)[-NEWEST:]
    candidates = _changes(values[kept], series)
    if spread == 0:
        # Most runs repeat the previous value: clipped at zero, or quantised. Differences below the uncertainty are then
        # ignored: among many zeros a few small values may be adjacent.
        least = float(np.median(u[~wild]))
        candidates = [change for change in candidates if abs(change.after - change.before) > least > 0]
    changes = [replace(change, first=int(kept[change.first]), last=int(kept[change.last])) for change in candidates]
    return Trend(tuple(changes), wild, spread)


def outlying_runs(values: Array, u: Array) -> Mask:
    count = len(values)
    if count < _WINDOW:
        return np.zeros(count, dtype=np.bool_)
    medians = np.median(np.lib.stride_tricks.sliding_window_view(values, _WINDOW), axis=1)
    half = _WINDOW // 2
    away = np.abs(values - medians[np.clip(np.arange(count) - half, 0, len(medians) - 1)])
    # The mean is used if most runs repeat a value.
    usual = _TO_SD * float(np.median(away)) or _MEAN_TO_SD * float(np.mean(away))
    scale = max(usual, float(np.median(u)))
    wild: Mask = away > _OUTLIER_SPREADS * scale
    return wild


def _changes(values: Array, series: int) -> list[Change]:
    count = len(values)
    if count < 2 * FEWEST or np.ptp(values) == 0:
        return []
    step, rise = _best(values)
    chance = series * np.exp(_CHANCE - max(step.score, rise.score))
    if chance > FALSE_ALARMS:
        return []
    step, rise = _refined(values, step), _refined(values, rise)
    best = rise if rise.score > step.score + _SLOWER else step
    # The change with the levels, by generalised least squares
    shape = rises(count, np.array([best.first]), np.array([best.last]))
    design = best.noise.rows @ np.concatenate([np.ones((count, 1)), shape], axis=1)
    white = best.noise.rows @ values
    (level, size), *_ = np.linalg.lstsq(design, white, rcond=None)
    residuals = white - design @ np.array([level, size])
    variance = float(residuals @ residuals) / max(count - 4, 1) * np.linalg.inv(design.T @ design)[1, 1]
    is_last = best.last == count - 1 and best.last - best.first > 1
    change = Change(
        best.first, best.last, float(level), float(level + size), float(np.sqrt(variance)), float(chance), is_last
    )
    earlier = _changes(values[: best.first + 1], series)
    later = _changes(values[best.last :], series)
    # A ramp that ends before the next change has not reached the last run.
    return [
        *(replace(change, is_last=False) for change in earlier),
        change,
        *(replace(change, first=change.first + best.last, last=change.last + best.last) for change in later),
    ]


def _best(values: Array) -> tuple[_Best, _Best]:
    """Step and longer ramp with the highest scores."""
    shapes = shapes_of(len(values))
    without, scores = -np.inf, []
    for noise, unit in zip(shapes.noises, shapes.directions, strict=True):
        level, score = _likelihoods(values, noise, unit)
        without = max(without, level)
        scores.append(score)
    table = np.array(scores) - without
    is_step = shapes.last - shapes.first == 1

    def best(which: Mask) -> _Best:
        k, shape = np.unravel_index(np.argmax(np.where(which, table, -np.inf)), table.shape)
        return _Best(int(shapes.first[shape]), int(shapes.last[shape]), float(table[k, shape]), shapes.noises[k])

    return best(is_step), best(~is_step)


def _refined(values: Array, best: _Best) -> _Best:
    """The false alarm probability ignores the increase of the score."""
    first, last = refined(len(values), best.first, best.last)
    is_alike = (last - first == 1) == (best.last - best.first == 1)
    first, last = first[is_alike], last[is_alike]
    _, scores = _likelihoods(values, best.noise, directions(best.noise, first, last))
    _, before = _likelihoods(values, best.noise, directions(best.noise, np.array([best.first]), np.array([best.last])))
    k = int(np.argmax(scores))
    return _Best(int(first[k]), int(last[k]), best.score + float(scores[k] - before[0]), best.noise)


def _likelihoods(values: Array, noise: Whitening, unit: Array) -> tuple[float, Array]:
    """Log-likelihood of no change, and of each whitened shape (n, c), maximised over noise and size."""
    count = len(values)
    white = noise.without_level(values[:, None])[:, 0]
    total = float(white @ white)
    squares = np.maximum(total - (unit.T @ white) ** 2, 1e-12 * total)
    scores: Array = -count / 2 * np.log(squares) - noise.half_log_det
    return -count / 2 * float(np.log(total)) - noise.half_log_det, scores
