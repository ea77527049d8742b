"""A clock out of nothing but messages that come at a steady pace: their number, where none is missing.

An instrument that speaks unasked and without a clock speaks at its own steady pace. Message n was sent at
n periods, and arrived some delay later; with n as its clock the floor of the delays tells when. An adapter that holds
bytes for 16 ms is seen through that way.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from analysis.kinematics.arm import Array
from analysis.reading.own_clock import Fitted, through_clock

_AHEAD = 32
"""Messages of which one is hardly late: some beats of a period against an adapter's timer."""
_EARLY = 0.15
"""Of a period: how much the least delay may fall, by the beat and by a period not yet well known."""
_ROUNDS = 3

Integers = NDArray[np.int64]


def through_pace(host_ns: Array) -> Fitted:
    """Host times (n,) ns of messages that arrived at host_ns (n,).

    The arrivals themselves where there is no steady pace in them: where the least delays of each few messages are not
    one. A host that stalls now and then delays many, but never all. How uneven the arrivals come is else their
    uncertainty.
    """
    as_come = Fitted(host_ns, _uneven_s(host_ns))
    if len(host_ns) < 2 * _AHEAD:
        return as_come
    number = np.arange(len(host_ns), dtype=np.int64)
    for _ in range(_ROUNDS):
        period_ns = float(np.median(_periods(number, host_ns)))
        if not period_ns > 0:
            return as_come  # most came at once, after a stall
        former, number = number, numbered(host_ns, period_ns)
        if np.array_equal(number, former):
            break
    fitted = through_clock(number.astype(float) * period_ns / 1e9, host_ns)
    return fitted if _steady(host_ns - fitted.ns, period_ns) and not fitted.restarts else as_come


def _steady(late_ns: Array, period_ns: float) -> bool:
    """Whether messages that are late by late_ns (n,) keep a pace: in most of a run the least late are equally so."""
    blocks = len(late_ns) // _AHEAD
    least = late_ns[: blocks * _AHEAD].reshape(blocks, _AHEAD).min(axis=1)
    return bool(np.quantile(np.abs(least - np.median(least)), 0.9) < _EARLY * period_ns)


def numbered(host_ns: Array, period_ns: float) -> Integers:
    """Which message of the series each arrival (n,) is, (n,): where one is missing all that follow are a period late.

    Any may be late for its own reasons, but hardly all of the next `_AHEAD`. Among the last of a run nothing missing
    can be seen. There are at least `_AHEAD` arrivals.
    """
    along = np.arange(len(host_ns), dtype=np.int64)
    missing = _missing(_least_of_next(host_ns - along * period_ns), period_ns)
    missing = np.pad(missing, (0, _AHEAD - 1), mode="edge")
    # What is missing stays so: a stall longer than the look ahead was none.
    return along + np.minimum.accumulate(missing[::-1])[::-1]


def _missing(least: Array, period_ns: float) -> Integers:
    """By how many periods each least delay (n,) lies behind those of the `_AHEAD` rows before it, as these are counted.

    Where those rows are counted alike, the count of the next one changes by what its delay rises, whatever their count
    is: such changes are found for all rows at once. Only the rows after a change are counted one by one.
    """
    before = np.concatenate([np.full(_AHEAD, least[0]), least[:-1]])
    rises = np.floor((least - _least_of_next(before)) / period_ns + _EARLY)
    missing, done, count = np.zeros(len(least), dtype=np.int64), 0, 0
    for change in np.flatnonzero(rises).tolist():
        if change >= done:
            missing[done:change] = count
            behind = before[change : change + _AHEAD] - count * period_ns
            counts = _counted(least[change:], behind, period_ns)
            done, count = change + len(counts), counts[-1]
            missing[change:done] = counts
    missing[done:] = count
    return missing


def _counted(least: Array, behind: Array, period_ns: float) -> list[int]:
    """Counts of the first rows of least (n,), until `_AHEAD` of them in turn are alike.

    behind (_AHEAD,): the least delays of the rows before, without the periods that were missing until then.
    """
    known, counts, alike = deque(behind.tolist(), maxlen=_AHEAD), list[int](), 0
    for row in range(len(least)):
        ahead = float(least[row])
        count = math.floor((ahead - min(known)) / period_ns + _EARLY)
        known.append(ahead - count * period_ns)
        alike = alike + 1 if counts and count == counts[-1] else 1
        counts.append(count)
        if alike == _AHEAD:
            break
    return counts


def _least_of_next(values: Array) -> Array:
    """The least of each `_AHEAD` values in turn, (n - _AHEAD + 1,)."""
    width = 1
    while width < _AHEAD:  # a power of two
        values = np.minimum(values[:-width], values[width:])
        width *= 2
    return values


def _uneven_s(host_ns: Array) -> Array:
    """Standard uncertainty (n,) s of arrivals that may be late by as much as they are uneven: as usual, and each."""
    if len(host_ns) < 2:
        return np.zeros(len(host_ns))
    steps = np.diff(host_ns)
    off = np.abs(steps - np.median(steps))
    usual = off[off <= np.quantile(off, 0.9)].mean()
    return np.asarray(np.hypot(usual, np.concatenate([off[:1], off])) / math.sqrt(3) / 1e9)


def _periods(number: Integers, host_ns: Array) -> Array:
    """Periods in ns by messages a quarter of a run apart."""
    apart = len(number) // 4
    return np.asarray((host_ns[apart:] - host_ns[:-apart]) / (number[apart:] - number[:-apart]))
