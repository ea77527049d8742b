"""Reading times of a gauge with an internal cycle, found from the readings themselves.

Such a gauge answers with the last reading of the cycle, of any age. The value can change only at a tick; two different
answers therefore have a tick between them. Each such change bounds a tick; a steady cycle, numbered and fitted through
all of them, determines each far better than the bounds (`CycleLine`). In an uneven cycle only the bounds are valid. If
answers are hardly more frequent than ticks, ticks are invisible, and the age of a reading is anything up to a cycle.

The fit is interval-censored least squares by the EM algorithm (Dempster, Laird, Rubin 1977): each tick is expected
within the bounds according to the line and the scatter about it, the line is fitted to the expected ticks, and the
scatter is the likeliest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from analysis.robot.kinematics.arm import Array, Integers, Mask

FEW = 16
"""Changes from which a period, a phase and a scatter can be determined."""
_JUMP = 4.0
"""Steps of the resolution by which a gauge on the move changes from tick to tick: by chance it repeats itself …"""
_REPEATS = 0.85
"""… in less than the rest of this share of its answers."""
_STAND = 4.0
"""Multiple of the usual number of answers with the same value from which the gauge was at rest."""
_NEAR = 8


@dataclass(frozen=True)
class Bounds:
    """Changes of the value: tick in (low_ns, high_ns] (m,), visible from answer `row` (m,) on; jumps (m,): whether
    the gauge was moving there."""

    low_ns: Array
    high_ns: Array
    row: Integers
    jumps: Mask

    def of(self, chosen: Mask) -> Bounds:
        """The changes that a mask (m,) selects."""
        return Bounds(self.low_ns[chosen], self.high_ns[chosen], self.row[chosen], self.jumps[chosen])

    @property
    def middle_ns(self) -> Array:
        """The middles (m,) of the bounds."""
        return (self.low_ns + self.high_ns) / 2

    @property
    def width_ns(self) -> Array:
        """The widths (m,) of the bounds."""
        return self.high_ns - self.low_ns

    @property
    def usual_ns(self) -> float:
        """Distance of neighbouring ticks during motion."""
        lag = min(_NEAR, len(self.row) // 2)
        return float(np.quantile(self.middle_ns[lag:] - self.middle_ns[:-lag], 0.3)) / lag

    @property
    def repeating(self) -> bool:
        """Whether a gauge repeated values during motion more often than the resolution explains."""
        runs = np.diff(self.row)[self.jumps[1:]]
        if len(runs) < FEW or self.jumps.mean() < 0.5 or self.usual_ns <= 0:
            return False
        on_the_move = runs[runs <= _STAND * np.median(runs)]
        return bool(on_the_move.mean() > 1 / _REPEATS)


def changes(asked_ns: Array, values: Array) -> Bounds:
    """Return the changes of values (n, k) between consecutive answers at asked_ns (n,); NaN equals NaN."""
    row = np.flatnonzero(_changed(values)) + 1
    with np.errstate(over="ignore"):  # readings may be as large as a double: their difference is then infinite
        steps = np.nan_to_num(np.abs(values[row] - values[row - 1])).max(axis=1, initial=0.0)
    resolution = steps[steps > 0].min(initial=np.inf)
    near = np.lib.stride_tricks.sliding_window_view(np.pad(steps, 2, mode="edge"), 5) if len(steps) else steps[:, None]
    jumps = np.median(near, axis=1) / _JUMP >= resolution
    return Bounds(asked_ns[row - 1], asked_ns[row], row, jumps)


def repeats(values: Array) -> bool:
    """Return whether readings (n, k) mm repeat often enough to search for an internal cycle."""
    return bool(np.count_nonzero(_changed(values)) < _REPEATS * len(values))


def _changed(values: Array) -> Mask:
    before, after = values[:-1], values[1:]
    return np.asarray(((before != after) & ~(np.isnan(before) & np.isnan(after))).any(axis=1))


_LAGS = (8, 32, 128)
"""Numbers of changes over which distances are compared with the cycle: each step improves the estimate by that
factor."""
_BLOCK = 32
"""Changes that share a phase while they are being numbered: half a cycle of drift over these would lose count."""
_KNOT = 50
"""Ticks from knot to knot of the cycle's drift: some seconds, in which a crystal's rate hardly changes."""
_ROUNDS = 8
_STEPS = 5
_WRONG = 0.01
"""Share of the changes that may not be a tick, such as garbled digits on a line."""
_SHIFTS = 81
_SCATTERS = 60
_LOG_LIKELY = 2.0
"""Largest difference in log likelihood from the best scatter: two standard deviations."""
_SAMPLE = 2000
"""Ticks that determine the common phase, and requests that show synchronisation with the cycle: more show the same."""


def period_of(middle_ns: Array, usual_ns: float, within: float) -> float:
    """The period of which all distances of changes at middle_ns (m,) are multiples, within a share of the usual."""
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
    """Which tick each change (m,) is: the phase is followed from block to block, since a cycle drifts."""
    turns = middle_ns / period_ns
    starts = np.arange(0, max(len(turns) - _BLOCK // 2, 1), _BLOCK)
    count = np.diff(np.append(starts, len(turns)))
    phase = np.unwrap(np.angle(np.add.reduceat(np.exp(2j * np.pi * turns), starts))) / (2 * np.pi)
    at = np.add.reduceat(turns, starts) / count
    return np.round(turns - np.interp(turns, at, phase)).astype(np.int64)


@dataclass(frozen=True)
class CycleLine:
    """A cycle: at_ns (k,) of the knots by their number (k,), period and scatter, uncertainty of the phase, and for
    the changes (m,) the agreement with the cycle, the number and the likeliest time of the tick, and the separate
    uncertainty."""

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
        """Time of ticks by their number (n,); beyond the ends the cycle is extrapolated."""
        inside = np.clip(number, self.knots[0], self.knots[-1])
        return np.asarray(np.interp(inside, self.knots, self.at_ns) + (number - inside) * self.period_ns)

    def number_at(self, at_ns: Array) -> Array:
        """Numbers of ticks (n,), with their fraction, at times (n,)."""
        inside = np.clip(at_ns, self.at_ns[0], self.at_ns[-1])
        return np.asarray(np.interp(inside, self.at_ns, self.knots) + (at_ns - inside) / self.period_ns)


def fitted(bounds: Bounds, number: Integers, period_ns: float) -> CycleLine:
    """The broken line in ns through the ticks of a number (m,) that lie within bounds, and their scatter about it."""
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
        # Smallest and largest likely scatter of ticks about the line, since wide bounds show little of it.
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
    """Heights (k,) at increasing knots of the broken line closest to y (n,) at x (n,), by the normal equations."""
    from scipy.linalg import solveh_banded  # noqa: PLC0415 - slow to import, needed for such gauges only

    weight = weight + 1e-6  # a knot with no change agreeing with a tick
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
    """Mean (n,) and standard deviation (n,) of a normal variable within bounds (n,), and the probability of the
    interval."""
    from scipy.special import ndtr  # noqa: PLC0415 - as above

    a, b = low / scatter, high / scatter
    inside = np.maximum(np.where(a > 0, ndtr(-a) - ndtr(-b), ndtr(b) - ndtr(a)), 1e-12)
    at_a, at_b = (np.exp(-(edge**2) / 2) / math.sqrt(2 * math.pi) for edge in (a, b))
    mean = np.clip((at_a - at_b) / inside, a, b)
    variance = 1 + (a * at_a - b * at_b) / inside - mean**2
    return scatter * mean, scatter * np.sqrt(np.clip(variance, 0.0, (b - a) ** 2 / 12)), inside


def _likely(inside: Array, by_chance: Array) -> Array:
    """Chance (n,) that a change is a tick of the cycle and not anything else."""
    tick = (1 - _WRONG) * inside
    return np.asarray(tick / (tick + _WRONG * by_chance))


def _sampled(bounds: Bounds, line_ns: Array) -> tuple[Array, Array]:
    """Bounds (m,) against the line, of no more changes than are needed."""
    each = np.linspace(0, len(line_ns) - 1, min(len(line_ns), _SAMPLE)).astype(int)
    return bounds.low_ns[each] - line_ns[each], bounds.high_ns[each] - line_ns[each]


def _log_likelihood(low: Array, high: Array, scatter_ns: float, period_ns: float) -> float:
    inside = _expected(low, high, scatter_ns)[2]
    return float(np.log((1 - _WRONG) * inside + _WRONG * (high - low) / period_ns).sum())


def _phase(bounds: Bounds, line_ns: Array, scatter_ns: float, period_ns: float) -> tuple[float, float]:
    """Standard deviation and mean of the shift common to all ticks of the line.

    If requests are synchronous with the cycle, every change has the same bounds, and the phase may be anywhere in them.
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
"""Changes that are not seen to this share of a cycle do not bound a tick, …"""
_STATED = 0.02
"""Relative tolerance of a stated cycle (far less for a crystal, this for a manufacturer's round figure), …"""
_SOUGHT = 0.3
"""… and of an unstated cycle relative to the usual distance of changes."""
_AGREE = 0.8
"""Share of the changes that must agree with a cycle before it is believed."""
_STEADY = 0.15
"""Ticks that scatter by more than this share of a cycle cannot serve as a clock."""


@dataclass(frozen=True)
class Ticks:
    """Reading times of n answers. ns (n,); own_u_s (n,); u_s: shared by all; period_ns; steady: whether the cycle is
    steady."""

    ns: Array
    own_u_s: Array
    u_s: float
    period_ns: float
    steady: bool


def through_cycle(asked_ns: Array, values: Array, cycle_ns: float | None) -> Ticks | None:
    """Return the ticks of the answers given at asked_ns (n,) with values (n, k); None if they are invisible.

    cycle_ns: as stated. If unstated, a cycle is accepted only for a gauge that repeated values while it moved by more
    than the resolution.
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
    # During motion every answer was read at the first appearance of the value; otherwise within a usual cycle.
    run = np.searchsorted(bounds.row, np.arange(len(asked_ns)), side="right") - 1
    seen = (run >= 0) & bounds.jumps[np.maximum(run, 0)]
    ns = np.where(seen, bounds.middle_ns[run], asked_ns - bounds.usual_ns / 2)
    own_ns = np.where(seen, bounds.width_ns[run], bounds.usual_ns) / math.sqrt(12)
    return Ticks(start_ns + ns, own_ns / 1e9, 0.0, bounds.usual_ns, steady=False)


def _at_ticks(asked_ns: Array, bounds: Bounds, close: Mask, line: CycleLine) -> Ticks:
    """Return the tick of every answer at asked_ns (n,): of the preceding change, or a later tick with no change."""
    # A change agreeing with no tick is not a tick: a garbled reading, and the next correct reading.
    true = ~close
    true[close] = line.agreeing
    bounds, close = bounds.of(true), close[true]
    number = np.empty(len(bounds.row), dtype=np.int64)
    number[close] = line.number[line.agreeing]
    exact = line.number_at(bounds.high_ns[~close])
    number[~close] = np.floor(exact)
    tick_ns, u_ns = line.tick_ns(number.astype(float)), np.full(len(number), line.scatter_ns)
    tick_ns[close], u_ns[close] = line.ns[line.agreeing], line.u_ns[line.agreeing]
    # A change across a gap that ends close to a tick may show that tick or the previous tick.
    unclear = np.abs(exact - np.round(exact)) * line.period_ns < 2 * line.scatter_ns
    u_ns[~close] = np.where(unclear, line.period_ns / math.sqrt(12), u_ns[~close])

    run = np.searchsorted(bounds.row, np.arange(len(asked_ns)), side="right")
    first = np.concatenate([[np.iinfo(np.int64).min // 2], number])[run]
    last = np.concatenate([number, [np.iinfo(np.int64).max // 2]])[run] - 1
    seen = np.minimum(np.floor(line.number_at(asked_ns)).astype(np.int64), last)
    # No two readings are equal during motion: the gauge missed a tick, and the answer is as old as it appears.
    stale = np.concatenate([[False], bounds.jumps])[run] & (run < len(bounds.row))
    later = (seen > first) & ~stale
    of_run = np.maximum(run - 1, 0)
    ns = np.where(later, line.tick_ns(seen.astype(float)), tick_ns[of_run])
    own_ns = np.where(later, line.scatter_ns, u_ns[of_run])
    return Ticks(ns, own_ns / 1e9, line.u_phase_ns / 1e9, line.period_ns, steady=True)


def anywhere_in_a_cycle(asked_ns: Array, cycle_ns: float) -> tuple[Array, float]:
    """Separate (n,) and shared standard uncertainty in s of readings taken half a cycle before asked_ns (n,).

    If requests are synchronous with the cycle, all readings are equally old: the shared part is the length of their
    mean phase, at the cycle near the stated value that maximises it.
    """
    each = asked_ns[np.linspace(0, len(asked_ns) - 1, min(len(asked_ns), _SAMPLE)).astype(int)] - asked_ns[0]
    off = np.linspace(-1e-3, 1e-3, 41)
    in_step = float(np.abs(np.exp(2j * np.pi * (1 + off[:, None]) * each / cycle_ns).mean(axis=1)).max())
    u_s = cycle_ns / math.sqrt(12) / 1e9
    return np.full(len(asked_ns), u_s * math.sqrt(1 - min(in_step, 1.0) ** 2)), u_s * in_step
