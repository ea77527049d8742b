"""When a figure of a robot changed: where its scatter from run to run does not explain a rise or a fall.

Each series is held against each shape of a change under each kind of noise (`shapes`); the score is the logarithm of
the likelihood ratio between the best shape and no change at all, both with the noise that suits them best, so that
slow noise is not taken for a change. Where a change is found, the runs before and after it are searched in the same way
(binary segmentation: A. J. Scott and M. Knott, Biometrics 30 (1974)). A single wild run is left out before (F. R.
Hampel, J. Am. Stat. Assoc. 69 (1974)).

Many figures of a robot are looked at: the probability of a false alarm is shared among them (Bonferroni), so that it
holds for the robot. `scripts/dev history` measures it, and how soon and how exactly changes are found.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from analysis.history.shapes import FEWEST, Whitening, directions, refined, rises, shapes_of
from analysis.kinematics.arm import Array, Mask

FALSE_ALARMS = 0.01
"""The probability that anything is reported of a robot that does not change."""
NEWEST = 500
"""Runs of a series in which changes are looked for, the newest: time and memory grow with their square."""
_CHANCE = 6.5
"""P(score > s) <= exp(_CHANCE - s) without a change: simulated for 10 to 300 runs, white noise and slow parts of 50 to
90 % over 1.5 to 50 runs, 1500 to 4000 series each; the worst had their 99 % at 11.2 and their 99.9 % at 14.1."""
_WINDOW, _WILD = 7, 4.0
"""Runs of the running median, and the spreads beyond which a single run is wild."""
_SLOWER = 2.0
"""The score of a longer rise has to be above that of the best step by so much."""
_TO_SD, _MEAN_TO_SD = 1.4826, 1.2533
"""Standard deviation of a normal law over its median, and over its mean, absolute deviation."""


@dataclass(frozen=True)
class Change:
    """A figure went from `before` to `after`, in its unit, between the runs of index first and last; u: standard
    uncertainty of the difference by the scatter of the runs; chance: how probable such a series is without a change,
    over all figures of the robot; is_last: the rise reaches the last run and may go on."""

    first: int
    last: int
    before: float
    after: float
    u: float
    chance: float
    is_last: bool


@dataclass(frozen=True)
class Trend:
    """What was found in a series: its changes in order of time; wild (n,): which runs were left out; spread: standard
    deviation from run to run, in the figure's unit, which changes and wild runs do not add to; zero where most runs
    repeat one value, and nan of a single run."""

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
    """The changes in a series of values (n,) with standard uncertainties u (n,), in one unit, in order of time; series:
    how many such series of the robot are looked at."""
    wild = wild_runs(values, u)
    spread = _spread(values[~wild])
    kept = np.flatnonzero(~wild)[-NEWEST:]
    candidates = _changes(values[kept], series)
    if spread == 0:
        # Most runs repeat the value before: one that is floored at zero, or read in steps. What is less than a run is
        # known by is no change then: among many zeros a few small values may lie side by side.
        least = float(np.median(u[~wild]))
        candidates = [change for change in candidates if abs(change.after - change.before) > least > 0]
    changes = [replace(change, first=int(kept[change.first]), last=int(kept[change.last])) for change in candidates]
    return Trend(tuple(changes), wild, spread)


def wild_runs(values: Array, u: Array) -> Mask:
    """Which runs (n,) differ from those about them by more than the scatter of runs explains; values and u (n,) in one
    unit."""
    count = len(values)
    if count < _WINDOW:
        return np.zeros(count, dtype=np.bool_)
    medians = np.median(np.lib.stride_tricks.sliding_window_view(values, _WINDOW), axis=1)
    half = _WINDOW // 2
    away = np.abs(values - medians[np.clip(np.arange(count) - half, 0, len(medians) - 1)])
    usual = _TO_SD * float(np.median(away)) or _MEAN_TO_SD * float(np.mean(away))  # where most runs repeat one value
    scale = max(usual, float(np.median(u)))
    wild: Mask = away > _WILD * scale
    return wild


def _spread(values: Array) -> float:
    """Standard deviation from one run to the next, which a step or a slow rise hardly changes."""
    if len(values) < 2:
        return float("nan")
    return float(_TO_SD * np.median(np.abs(np.diff(values))) / np.sqrt(2))


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
    change = _fitted(values, best, float(chance))
    earlier = _changes(values[: best.first + 1], series)
    later = _changes(values[best.last :], series)
    # A rise that ends where the runs before the next change end has not reached the last run.
    return [
        *(replace(change, is_last=False) for change in earlier),
        change,
        *(replace(change, first=change.first + best.last, last=change.last + best.last) for change in later),
    ]


def _best(values: Array) -> tuple[_Best, _Best]:
    """The step and the longer rise of the highest scores, each with the noise that suits it."""
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
    """The shape to single runs; its score rises by that, which the chance of a false alarm does not count."""
    first, last = refined(len(values), best.first, best.last)
    is_alike = (last - first == 1) == (best.last - best.first == 1)
    first, last = first[is_alike], last[is_alike]
    _, scores = _likelihoods(values, best.noise, directions(best.noise, first, last))
    _, before = _likelihoods(values, best.noise, directions(best.noise, np.array([best.first]), np.array([best.last])))
    k = int(np.argmax(scores))
    return _Best(int(first[k]), int(last[k]), best.score + float(scores[k] - before[0]), best.noise)


def _likelihoods(values: Array, noise: Whitening, unit: Array) -> tuple[float, Array]:
    """Log-likelihoods without a change, and (c,) with each of these whitened shapes (n, c), the size of the noise and
    of the change being those that suit best."""
    count = len(values)
    white = noise.without_level(values[:, None])[:, 0]
    total = float(white @ white)
    squares = np.maximum(total - (unit.T @ white) ** 2, 1e-12 * total)
    scores: Array = -count / 2 * np.log(squares) - noise.half_log_det
    return -count / 2 * float(np.log(total)) - noise.half_log_det, scores


def _fitted(values: Array, best: _Best, chance: float) -> Change:
    """The change with its levels, by generalised least squares."""
    count = len(values)
    shape = rises(count, np.array([best.first]), np.array([best.last]))
    design = best.noise.rows @ np.concatenate([np.ones((count, 1)), shape], axis=1)
    white = best.noise.rows @ values
    (level, size), *_ = np.linalg.lstsq(design, white, rcond=None)
    residuals = white - design @ np.array([level, size])
    variance = float(residuals @ residuals) / max(count - 4, 1) * np.linalg.inv(design.T @ design)[1, 1]
    is_last = best.last == count - 1 and best.last - best.first > 1
    return Change(best.first, best.last, float(level), float(level + size), float(np.sqrt(variance)), chance, is_last)
