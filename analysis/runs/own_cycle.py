"""Reading times of a gauge with an internal cycle, determined from the readings.

Such a gauge answers with the last reading of the cycle, regardless of age. The value can change only at a tick, so
there is a tick between two different answers. Each change therefore bounds a tick. If the cycle is steady, ticks are
numbered and fitted, which determines each tick much better than the bounds (`CycleLine`). If the cycle is uneven, only
the bounds are used. If answers are not more frequent than ticks, ticks cannot be detected, and the age of a reading is
up to one cycle.

The fit is interval-censored least squares by the EM algorithm (Dempster, Laird, Rubin 1977). Each tick is estimated
within the bounds, given the line and the scatter about it. The line is then fitted to the estimated ticks. The scatter
is the maximum-likelihood estimate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from analysis.robot.kinematics.arm import Array, Integers, Mask

FEW = 16
"""Smallest number of changes sufficient for a period, a phase and a scatter."""
_JUMP = 4.0
"""Change between readings of a moving gauge, in steps of the resolution, that makes equal readings rare."""
_REPEATS = 0.85
"""Largest fraction of changed answers that suggests an internal cycle."""
_REST_FACTOR = 4.0
"""Multiple of the usual number of equal answers above which the gauge was at rest."""
_NEAR = 8


@dataclass(frozen=True)
class Bounds:
    """Changes of the value, with a tick in each interval (low_ns, high_ns], (m,).

    row (m,): first answer with the new value. jumps (m,): whether the gauge was moving.
    """

    low_ns: Array
    high_ns: Array
    row: Integers
    jumps: Mask

    def of(self, chosen: Mask) -> Bounds:
        return Bounds(self.low_ns[chosen], self.high_ns[chosen], self.row[chosen], self.jumps[chosen])

    @property
    def middle_ns(self) -> Array:
        return (self.low_ns + self.high_ns) / 2

    @property
    def width_ns(self) -> Array:
        return self.high_ns - self.low_ns

    @property
    def usual_ns(self) -> float:
        lag = min(_NEAR, len(self.row) // 2)
        return float(np.quantile(self.middle_ns[lag:] - self.middle_ns[:-lag], 0.3)) / lag

    @property
    def repeating(self) -> bool:
        runs = np.diff(self.row)[self.jumps[1:]]
        if len(runs) < FEW or self.jumps.mean() < 0.5 or self.usual_ns <= 0:
            return False
        on_the_move = runs[runs <= _REST_FACTOR * np.median(runs)]
        return bool(on_the_move.mean() > 1 / _REPEATS)


def changes(asked_ns: Array, values: Array) -> Bounds:
    """Changes of values (n, k) between consecutive answers at asked_ns (n,). NaN equals NaN."""
    row = np.flatnonzero(_changed(values)) + 1
    with np.errstate(over="ignore"):  # the difference of very large doubles is infinite
        steps = np.nan_to_num(np.abs(values[row] - values[row - 1])).max(axis=1, initial=0.0)
    resolution = steps[steps > 0].min(initial=np.inf)
    near = np.lib.stride_tricks.sliding_window_view(np.pad(steps, 2, mode="edge"), 5) if len(steps) else steps[:, None]
    jumps = np.median(near, axis=1) / _JUMP >= resolution
    return Bounds(asked_ns[row - 1], asked_ns[row], row, jumps)


def repeats(values: Array) -> bool:
    return bool(np.count_nonzero(_changed(values)) < _REPEATS * len(values))


def _changed(values: Array) -> Mask:
    before, after = values[:-1], values[1:]
    return np.asarray(((before != after) & ~(np.isnan(before) & np.isnan(after))).any(axis=1))


_LAGS = (8, 32, 128)
"""Numbers of changes between which distances are compared with multiples of the cycle. Each step refines the period
by the ratio of these numbers.
"""
_BLOCK = 32
"""Number of changes with a common phase during numbering. A drift of half a cycle within a block causes errors."""
_KNOT = 50
"""Number of ticks between the knots of the cycle's drift, a few seconds. A crystal's rate is almost constant then."""
_ROUNDS = 8
_STEPS = 5
_WRONG = 0.01
"""Assumed fraction of changes that are not ticks, such as garbled digits on a line."""
_SHIFTS = 81
_SCATTERS = 60
_LOG_LIKELY = 2.0
"""Largest decrease of the log likelihood from the maximum for a likely scatter: two standard deviations."""
_SAMPLE = 2000
"""Number of ticks used for the common phase, and of requests used to detect synchronisation with the cycle. More
give the same result.
"""


def period_of(middle_ns: Array, usual_ns: float, within: float) -> float:
    """Period of which the distances of changes at middle_ns (m,) are multiples, within a relative range of usual_ns."""
    period_ns = usual_ns
    for lag in _LAGS:
        if 2 * lag > len(middle_ns):
            break
        lags = range(1, lag + 1) if lag == _LAGS[0] else (lag,)
        within = min(within, 1.0 if lag == _LAGS[0] else 0.25 / lag)
        trial = 1 / (1 + np.linspace(-within, within, max(41, 2 * math.ceil(8 * within * lag) + 1)))
        whole = np.zeros(len(trial))
        for k in lags:
            apart = middle_ns[k:] - middle_ns[:-k]
            turns = apart[apart < 2 * k * usual_ns][:_SAMPLE] / period_ns
            whole += np.cos(2 * np.pi * trial[:, None] * turns).sum(axis=1)
        period_ns /= float(trial[np.argmax(whole)])
    return period_ns


def numbered(middle_ns: Array, period_ns: float) -> Integers:
    """Tick number of each change (m,). The phase is tracked from block to block, as the cycle drifts."""
    turns = middle_ns / period_ns
    starts = np.arange(0, max(len(turns) - _BLOCK // 2, 1), _BLOCK)
    count = np.diff(np.append(starts, len(turns)))
    phase = np.unwrap(np.angle(np.add.reduceat(np.exp(2j * np.pi * turns), starts))) / (2 * np.pi)
    at = np.add.reduceat(turns, starts) / count
    return np.round(turns - np.interp(turns, at, phase)).astype(np.int64)


@dataclass(frozen=True)
class CycleLine:
    """A fitted cycle.

    knots (k,): tick numbers. at_ns (k,): their times.
    period_ns, scatter_ns: period, and scatter of ticks about the line. u_phase_ns: uncertainty of the phase.
    agreeing (m,): mask of the changes that agree with the cycle.
    number, ns, u_ns (m,): number, most likely time and individual uncertainty of the tick of each change.
    """

    knots: Array
    at_ns: Array
    period_ns: float
    scatter_ns: float
    u_phase_ns: float
    agreeing: Mask
    number: Integers
    ns: Array
    u_ns: Array

    def tick_ns(self, number: Array) -> Array:
        """Times in ns of ticks, extrapolated beyond both ends."""
        inside = np.clip(number, self.knots[0], self.knots[-1])
        return np.asarray(np.interp(inside, self.knots, self.at_ns) + (number - inside) * self.period_ns)

    def number_at(self, at_ns: Array) -> Array:
        inside = np.clip(at_ns, self.at_ns[0], self.at_ns[-1])
        return np.asarray(np.interp(inside, self.at_ns, self.knots) + (at_ns - inside) / self.period_ns)


def fitted(bounds: Bounds, number: Integers, period_ns: float) -> CycleLine:
    """Fit a polyline in ns through the ticks with the given numbers (m,) within their bounds."""
    each = np.linspace(0, len(number) - 1, max(2, len(number) // _KNOT + 1)).astype(int)
    knots = np.unique(np.sort(number)[each]).astype(float)
    width_ns = bounds.width_ns
    ticks, weight = bounds.middle_ns, np.ones(len(number))
    scatter_ns = float(np.median(width_ns)) / 2
    at_ns = knots * period_ns
    for _ in range(_ROUNDS):
        for _ in range(_STEPS):
            at_ns = _broken(number.astype(float), ticks, weight, knots)
            line_ns = np.interp(number, knots, at_ns)
            ticks, _, inside = _expected(bounds.low_ns - line_ns, bounds.high_ns - line_ns, scatter_ns)
            ticks, weight = ticks + line_ns, _likely(inside, width_ns / period_ns)
        # Range of likely scatters. Wide bounds determine the scatter poorly.
        low, high = _sampled(bounds, np.interp(number, knots, at_ns))
        scatters = np.geomspace(1e-4, 0.5, _SCATTERS) * period_ns
        log = np.array([_log_likelihood(low, high, scatter, period_ns) for scatter in scatters])
        likely = scatters[log >= log.max() - _LOG_LIKELY]
        least_ns, scatter_ns = float(likely[0]), float(likely[-1])
    line_ns = np.interp(number, knots, at_ns)
    phases = (_phase(bounds, line_ns, likely_ns, period_ns) for likely_ns in (least_ns, scatter_ns))
    u_phase_ns, shift_ns = max(phases)
    line_ns = np.interp(number, knots, at_ns) + shift_ns
    ticks, u_ns, inside = _expected(bounds.low_ns - line_ns, bounds.high_ns - line_ns, scatter_ns)
    mean_ns = float((at_ns[-1] - at_ns[0]) / (knots[-1] - knots[0]))
    agreeing = _likely(inside, width_ns / period_ns) >= 0.5
    return CycleLine(knots, at_ns + shift_ns, mean_ns, scatter_ns, u_phase_ns, agreeing, number, ticks + line_ns, u_ns)


def _broken(x: Array, y: Array, weight: Array, knots: Array) -> Array:
    """Heights (k,) of the polyline closest to y (n,) at x (n,)."""
    from scipy.linalg import solveh_banded  # noqa: PLC0415 - slow to import, needed for such gauges only

    weight = weight + 1e-6  # a knot may have no agreeing change
    knot = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, len(knots) - 2)
    right_share = (x - knots[knot]) / (knots[knot + 1] - knots[knot])
    left_share = 1 - right_share
    diagonal = _summed(knot, weight * left_share**2, knots) + _summed(knot + 1, weight * right_share**2, knots)
    off_diagonal = _summed(knot + 1, weight * left_share * right_share, knots)
    pull = _summed(knot, weight * left_share * y, knots) + _summed(knot + 1, weight * right_share * y, knots)
    return np.asarray(solveh_banded(np.stack([off_diagonal, diagonal]), pull))


def _summed(place: Integers, values: Array, knots: Array) -> Array:
    return np.bincount(place, values, len(knots)).astype(float)


def _expected(low: Array, high: Array, scatter: float) -> tuple[Array, Array, Array]:
    """Mean and standard deviation (n,) of a normal variable within bounds (n,), and their probability."""
    from scipy.special import ndtr  # noqa: PLC0415 - as above

    a, b = low / scatter, high / scatter
    inside = np.maximum(np.where(a > 0, ndtr(-a) - ndtr(-b), ndtr(b) - ndtr(a)), 1e-12)
    at_a, at_b = (np.exp(-(edge**2) / 2) / math.sqrt(2 * math.pi) for edge in (a, b))
    mean = np.clip((at_a - at_b) / inside, a, b)
    variance = 1 + (a * at_a - b * at_b) / inside - mean**2
    return scatter * mean, scatter * np.sqrt(np.clip(variance, 0.0, (b - a) ** 2 / 12)), inside


def _likely(inside: Array, by_chance: Array) -> Array:
    tick = (1 - _WRONG) * inside
    return np.asarray(tick / (tick + _WRONG * by_chance))


def _sampled(bounds: Bounds, line_ns: Array) -> tuple[Array, Array]:
    each = np.linspace(0, len(line_ns) - 1, min(len(line_ns), _SAMPLE)).astype(int)
    return bounds.low_ns[each] - line_ns[each], bounds.high_ns[each] - line_ns[each]


def _log_likelihood(low: Array, high: Array, scatter_ns: float, period_ns: float) -> float:
    inside = _expected(low, high, scatter_ns)[2]
    return float(np.log((1 - _WRONG) * inside + _WRONG * (high - low) / period_ns).sum())


def _phase(bounds: Bounds, line_ns: Array, scatter_ns: float, period_ns: float) -> tuple[float, float]:
    """Standard deviation and mean of a shift common to all ticks of the line.

    If requests are synchronous with the cycle, any phase within the bounds is possible.
    """
    low, high = _sampled(bounds, line_ns)
    reach, mean, sd = float(np.median(high - low)) + 2 * scatter_ns, 0.0, 0.0
    for _ in range(2):
        shifts = np.linspace(mean - reach, mean + reach, _SHIFTS)
        log = np.array([_log_likelihood(low - shift, high - shift, scatter_ns, period_ns) for shift in shifts])
        chance = np.exp((log - log.max()) * len(line_ns) / len(low))
        mean = float(np.average(shifts, weights=chance))
        sd = math.sqrt(float(np.average((shifts - mean) ** 2, weights=chance)) + (2 * reach / _SHIFTS) ** 2 / 12)
        reach = min(reach, 6 * sd)
    return sd, mean


_WIDE = 0.7
"""Widest bounds of a tick, as a fraction of the cycle. Changes with wider bounds are not used."""
_STATED = 0.02
"""Relative tolerance of a stated cycle. A crystal is more accurate, but the manufacturer may round the value."""
_SOUGHT = 0.3
"""Relative search range of an unstated cycle around the usual distance of changes."""
_AGREE = 0.8
"""Smallest fraction of agreeing changes for an accepted cycle."""
_STEADY = 0.15
"""Largest scatter of ticks, as a fraction of the cycle, for a cycle that serves as a clock."""


@dataclass(frozen=True)
class Ticks:
    """Reading times of n answers. own_u_s (n,), u_s: individual and common uncertainty."""

    ns: Array
    own_u_s: Array
    u_s: float
    period_ns: float
    steady: bool


def through_cycle(asked_ns: Array, values: Array, cycle_ns: float | None) -> Ticks | None:
    """Ticks of answers at asked_ns (n,) with values (n, k), or None if they cannot be detected.

    An unstated cycle is accepted only if values repeated while the gauge moved by more than its resolution.
    """
    start_ns = float(asked_ns[0])
    asked_ns = asked_ns - start_ns
    bounds = changes(asked_ns, values)
    if len(bounds.row) < FEW or (cycle_ns is None and not bounds.repeating):
        return None
    usual_ns = bounds.usual_ns if cycle_ns is None else cycle_ns
    close = bounds.width_ns < _WIDE * usual_ns
    if close.sum() < max(FEW, len(close) / 2):
        return None
    narrow = bounds.of(close)
    period_ns = period_of(narrow.middle_ns, usual_ns, _SOUGHT if cycle_ns is None else _STATED)
    number = numbered(narrow.middle_ns, period_ns)
    if np.ptp(number) < FEW:
        return None
    line = fitted(narrow, number, period_ns)
    if line.agreeing.mean() >= _AGREE and line.scatter_ns < _STEADY * line.period_ns:
        ticks = _at_ticks(asked_ns, bounds, close, line)
        return replace(ticks, ns=start_ns + ticks.ns)
    if not bounds.repeating:
        return None
    # During motion, an answer was read when the value first appeared. Otherwise it was read within the last cycle.
    run = np.searchsorted(bounds.row, np.arange(len(asked_ns)), side="right") - 1
    seen = (run >= 0) & bounds.jumps[np.maximum(run, 0)]
    ns = np.where(seen, bounds.middle_ns[run], asked_ns - bounds.usual_ns / 2)
    own_ns = np.where(seen, bounds.width_ns[run], bounds.usual_ns) / math.sqrt(12)
    return Ticks(start_ns + ns, own_ns / 1e9, 0.0, bounds.usual_ns, steady=False)


def _at_ticks(asked_ns: Array, bounds: Bounds, close: Mask, line: CycleLine) -> Ticks:
    """Tick of each answer: the last change, or a later tick with an equal value."""
    # Changes that agree with no tick are garbled readings, and the correct readings after them.
    true = ~close
    true[close] = line.agreeing
    bounds, close = bounds.of(true), close[true]
    number = np.empty(len(bounds.row), dtype=np.int64)
    number[close] = line.number[line.agreeing]
    exact = line.number_at(bounds.high_ns[~close])
    number[~close] = np.floor(exact)
    tick_ns, u_ns = line.tick_ns(number.astype(float)), np.full(len(number), line.scatter_ns)
    tick_ns[close], u_ns[close] = line.ns[line.agreeing], line.u_ns[line.agreeing]
    # A change across a gap may belong to the previous tick if the gap ends close to a tick.
    unclear = np.abs(exact - np.round(exact)) * line.period_ns < 2 * line.scatter_ns
    u_ns[~close] = np.where(unclear, line.period_ns / math.sqrt(12), u_ns[~close])

    run = np.searchsorted(bounds.row, np.arange(len(asked_ns)), side="right")
    first = np.concatenate([[np.iinfo(np.int64).min // 2], number])[run]
    last = np.concatenate([number, [np.iinfo(np.int64).max // 2]])[run] - 1
    seen = np.minimum(np.floor(line.number_at(asked_ns)).astype(np.int64), last)
    # Consecutive readings differ during motion. An equal one means that the gauge missed a tick, and the answer is old.
    stale = np.concatenate([[False], bounds.jumps])[run] & (run < len(bounds.row))
    later = (seen > first) & ~stale
    of_run = np.maximum(run - 1, 0)
    ns = np.where(later, line.tick_ns(seen.astype(float)), tick_ns[of_run])
    own_ns = np.where(later, line.scatter_ns, u_ns[of_run])
    return Ticks(ns, own_ns / 1e9, line.u_phase_ns / 1e9, line.period_ns, steady=True)


def anywhere_in_a_cycle(asked_ns: Array, cycle_ns: float) -> tuple[Array, float]:
    """Individual (n,) and common standard uncertainty in s of readings half a cycle older than asked_ns (n,).

    If requests are synchronous with the cycle, all readings have the same age: the common part is the mean resultant
    length of the phases, maximised over cycles near the stated one.
    """
    each = asked_ns[np.linspace(0, len(asked_ns) - 1, min(len(asked_ns), _SAMPLE)).astype(int)] - asked_ns[0]
    off = np.linspace(-1e-3, 1e-3, 41)
    in_step = float(np.abs(np.exp(2j * np.pi * (1 + off[:, None]) * each / cycle_ns).mean(axis=1)).max())
    u_s = cycle_ns / math.sqrt(12) / 1e9
    return np.full(len(asked_ns), u_s * math.sqrt(1 - min(in_step, 1.0) ** 2)), u_s * in_step
