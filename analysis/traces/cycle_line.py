"""A steady cycle through ticks of which each is known to lie within bounds, and no better.

Interval-censored least squares by the EM algorithm (Dempster, Laird, Rubin 1977): each tick is expected within its
bounds where the line and the scatter about it put it, the line goes through the expected ticks, and the scatter is the
likeliest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from analysis.kinematics.arm import Array, Integers, Mask
from analysis.traces.value_changes import Bounds

_LAGS = (8, 32, 128)
"""Over so many changes distances are compared with the cycle: each step makes it as many times better known."""
_BLOCK = 32
"""Changes that share a phase while they are being numbered: half a cycle of drift over these would lose count."""
_KNOT = 50
"""Ticks from knot to knot of the cycle's drift: some seconds, in which a crystal's rate hardly changes."""
_ROUNDS = 8
_STEPS = 5
_WRONG = 0.01
"""Share of the changes that may not be a tick, as where a line garbles a digit."""
_SHIFTS = 81
_SCATTERS = 60
_LOG_LIKELY = 2.0
"""A scatter is likely whose log likelihood falls short of the best by no more: two standard deviations."""
_SAMPLE = 2000
"""Ticks that determine the common phase: more of them show the same."""


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
    """A cycle: at_ns (k,) of its knots by their number (k,), its period and scatter, what its phase is uncertain by,
    and of the changes (m,) which agree with it, the number and the likeliest time of the tick, and its own
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
        """Time of ticks by their number (n,); beyond the ends the cycle goes on."""
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
        # How far ticks lie from the line: the least and the most that are likely, since wide bounds show little of it.
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

    weight = weight + 1e-6  # a knot whose changes all agree with no tick
    knot = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, len(knots) - 2)
    right_share = (x - knots[knot]) / (knots[knot + 1] - knots[knot])
    left_share = 1 - right_share
    diagonal = _summed(knot, weight * left_share**2, knots) + _summed(knot + 1, weight * right_share**2, knots)
    beside = _summed(knot + 1, weight * left_share * right_share, knots)
    pull = _summed(knot, weight * left_share * y, knots) + _summed(knot + 1, weight * right_share * y, knots)
    return np.asarray(solveh_banded(np.stack([beside, diagonal]), pull))


def _summed(place: Integers, values: Array, knots: Array) -> Array:
    return np.bincount(place, values, len(knots)).astype(float)


def _expected(low: Array, high: Array, scatter: float) -> tuple[Array, Array, Array]:
    """Mean (n,) and standard deviation (n,) of a normal variable within bounds (n,), and the chance to lie there."""
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
    """Standard deviation and mean of the shift that all ticks of the line share.

    Where requests keep step with the cycle every change has the same bounds, and the phase may lie anywhere in them.
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
