"""Map an instrument's timestamps to host time: by the clock of the instrument, or by the steady rate of the messages.

(host - instrument) is the offset of the clock plus a delay, and delays are positive: the lower envelope is the clock.
First the timestamps are cleaned: a wrapped counter is continued, single wrong timestamps are left out, and a restarted
clock is fitted in pieces.

An instrument with no clock that sends unprompted has a steady rate. Message n was sent at n periods and arrived with a
delay; with n as the clock the lower envelope determines the time. This works through an adapter that buffers bytes for
16 ms.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.robot.kinematics.arm import Array, Integers
from analysis.runs.lower_hull import TICK_S, Mask, floor

_LEAP_S = 1.0
"""No network or serial line delays a message this long without losing the link; a busy computer may."""
_WRAPS_S = (2**32 * 1e-3, 2**32 * 1e-6)
"""Counters of 32 bits, in ms and in µs."""

_LATEST_S = 1e11
"""Latest valid clock value; a later stamp means that there is no clock."""


_BLOCK = 1 << 15
"""Rows per block, to fit the processor's cache."""
_AROUND = 8
"""Stamps before and after a decrease, among which the wrong ones are searched."""


@dataclass(frozen=True)
class FittedClock:
    """Host times (n,) ns of an instrument's stamps; u_s (n,): only for times not given by its clock.

    restarted: rows at which the clock changes. wrong: number of stamps left out. wanders_s: permanent change of the
    delay of an instrument's pace; shared_u_s: resulting common uncertainty.
    """

    ns: Array
    u_s: Array
    restarted: tuple[int, ...] = ()
    wrong: int = 0
    wanders_s: float = 0.0
    shared_u_s: float = 0.0

    @property
    def restarts(self) -> int:
        """Number of restarts of the clock."""
        return len(self.restarted)


def stands(device_s: Array) -> bool:
    """Return whether a clock device_s (n,) does not advance, within the resolution of host stamps."""
    return len(device_s) > 1 and bool(device_s.max() <= device_s.min() + TICK_S)


def through_clock(device_s: Array, host_ns: Array) -> FittedClock:
    """Return the host times of instrument stamps device_s (n,) s; host_ns (n,): arrivals or other upper bounds.

    The host times themselves for an instrument without a clock.
    """
    if len(device_s) < 3 or not -_LATEST_S < device_s.min() <= device_s.max() < _LATEST_S:
        return FittedClock(host_ns, np.zeros(len(host_ns)))
    if (device_s[1:] >= device_s[:-1]).all():
        least, most = np.inf, -np.inf
        for begin in range(0, len(device_s), _BLOCK):
            rows = slice(begin, begin + _BLOCK)
            offset_s = (host_ns[rows] - host_ns[0]) / 1e9 - device_s[rows]
            least, most = min(least, offset_s.min()), max(most, offset_s.max())
        # monotone and continuous: the usual case, without further checks
        if most - least < _LEAP_S:
            return _by_arrival(*_fitted(device_s, host_ns), (), host_ns)
    device_s = unwrapped(device_s, host_ns)
    wrong = out_of_order(device_s)
    in_order_s, came_ns = (device_s[~wrong], host_ns[~wrong]) if wrong.any() else (device_s, host_ns)
    starts = _starts(in_order_s, came_ns)
    pieces = [_fitted(*piece) for piece in zip(np.split(in_order_s, starts), np.split(came_ns, starts), strict=True)]
    ns, low = (of[0] if len(of) == 1 else np.concatenate(of) for of in zip(*pieces, strict=True))
    if wrong.any():
        ns, low = _among(wrong, ns, 0.0), _among(wrong, low, True)
    return _by_arrival(ns, low, tuple(np.flatnonzero(~wrong)[starts].tolist()), host_ns)


def _among(wrong: Mask, kept: NDArray[Any], filler: float) -> NDArray[Any]:
    """Return values for all rows (n,): the kept ones, and a filler for wrong stamps."""
    values = np.full(len(wrong), filler, dtype=kept.dtype)
    values[~wrong] = kept
    return values


def _starts(device_s: Array, host_ns: Array) -> Integers:
    """Return the rows of the clock restarts: the clock decreased, or the offset from the host's clock changed
    permanently."""
    offset_s = (host_ns - host_ns[0]) / 1e9 - device_s
    leaps = np.flatnonzero((np.diff(device_s) < 0) | (np.abs(np.diff(offset_s)) > _LEAP_S)) + 1
    starts: list[int] = []
    least = offset_s[: leaps[0]].min() if len(leaps) else 0.0
    for leap, after in pairwise([*leaps.tolist(), len(device_s)]):
        least_after = offset_s[leap:after].min()
        if device_s[leap] < device_s[leap - 1] or abs(least_after - least) > _LEAP_S:
            starts.append(leap)
            least = least_after
        least = min(least, least_after)
    return np.array(starts, dtype=np.int64)


def unwrapped(device_s: Array, host_ns: Array) -> Array:
    """Timestamps (n,) s of a counter, continued after each wrap: a decrease by exactly the counter range."""
    ticks, passed = np.diff(device_s), np.diff(host_ns) / 1e9
    leaps = np.flatnonzero(np.abs(ticks - passed) > min(_WRAPS_S) - _LEAP_S)
    if not len(leaps):
        return device_s
    added, ticks, passed = np.zeros(len(device_s)), ticks[leaps], passed[leaps]
    for wrap_s in _WRAPS_S:
        added[leaps[(ticks < 0) & (np.abs(ticks + wrap_s - passed) < _LEAP_S)] + 1] = wrap_s
        # A late duplicate of an earlier message.
        added[leaps[(ticks > 0) & (np.abs(ticks - wrap_s - passed) < _LEAP_S)] + 1] = -wrap_s
    return np.asarray(device_s + np.cumsum(added))


def out_of_order(device_s: Array) -> Mask:
    """Return the wrong timestamps (n,): the fewest whose removal leaves increasing timestamps around them.

    If they are many, the clock restarted, and none is wrong.
    """
    wrong = np.zeros(len(device_s), dtype=bool)
    for fell in (np.flatnonzero(np.diff(device_s) < 0) + 1).tolist():
        around = np.arange(max(0, fell - _AROUND), min(len(device_s), fell + _AROUND))
        odd = np.delete(around, _longest_in_order(device_s[around].tolist()))
        if len(odd) <= _AROUND // 2:
            wrong[odd] = True
    return wrong


def _longest_in_order(values: Sequence[float]) -> list[int]:
    """Places of the longest part of some values that never falls, by patience sorting."""
    piles: list[float] = []
    tops: list[int] = []
    below: list[int] = []
    for place, value in enumerate(values):
        pile = bisect_right(piles, value)
        below.append(tops[pile - 1] if pile else -1)
        piles[pile : pile + 1], tops[pile : pile + 1] = [value], [place]
    longest, place = [], tops[-1]
    while place >= 0:
        longest.append(place)
        place = below[place]
    return longest


def _fitted(device_s: Array, host_ns: Array) -> tuple[Array, Mask]:
    if len(device_s) < 3 or stands(device_s):
        return host_ns, np.zeros(len(host_ns), dtype=bool)
    since_s = device_s - device_s[0]
    offset_s = (host_ns - host_ns[0]) / 1e9
    offset_s -= since_s
    ns, low = floor(since_s, offset_s)
    ns += since_s
    ns *= 1e9
    ns += host_ns[0]
    return ns, low


def _by_arrival(ns: Array, wrong: Mask, restarted: tuple[int, ...], host_ns: Array) -> FittedClock:
    """Replace wrong timestamps by the arrival minus the usual delay."""
    u_s = np.zeros(len(ns))
    if wrong.any() and not wrong.all():
        delay = (host_ns - ns)[~wrong]
        ns = np.where(wrong, host_ns - np.median(delay), ns)
        u_s[wrong] = delay.std() / 1e9
    return FittedClock(ns, u_s, restarted, int(wrong.sum()))


_AHEAD = 32
"""Messages of which at least a single message is hardly late: some beats of a period against an adapter's timer."""
_EARLY = 0.15
"""The share of a period by which the least delay may fall, by the beat and by a period not yet well known."""
_MOSTLY = 0.75
"""Share of steps between groups of messages with hardly any change of the smallest delay that proves a steady rate:
the other steps may be waits. Messages with no steady rate reach a third."""
_HARDLY = 8
"""A message is hardly ever earlier than the earliest of the `_AHEAD` before by such a part of their usual delay."""
_APART = (_AHEAD, 8 * _AHEAD, 64 * _AHEAD, 64 * _AHEAD)
"""Message distances that determine the period: between the nearest pairs hardly any message is missing, and between
the others the missing ones are then known; a quarter of a short run at most."""
_PAIRS = 100_000
"""Number of pairs; the uncertainty of their median is a three-hundredth of their scatter."""
_STAYS = 0.4
"""Ratio of the change of the delay between groups of messages to the scatter in the complete run (von Neumann's
ratio, 1 for independent values) below which a delay wanders, …"""
_WANDERS = 6.0
"""… or multiple of the scatter by which it leaves the median; …"""
_WANDERS_NS = 0.2e6
"""… and smallest change: a busy computer is slightly later for a longer time."""
_HELD_UP_NS = 0.5e9
"""Longest usual stall of a computer: of the messages in such a time, and of `_AHEAD`, hardly all are late."""

_COMES_BACK = 8
"""Number of blocks of that time after which a recovered delay was a stall of some seconds: an instrument that waited
never catches up. A quarter of a short run at most."""


def through_pace(host_ns: Array) -> FittedClock:
    """Return host times (n,) ns of messages that arrived at host_ns (n,).

    A crystal keeps the rate regardless of the computer. A temporary delay is therefore a transmission delay, and the
    lower envelope is the clock. An instrument that waits, like a program with no crystal, never catches up: a permanent
    delay belongs to the instrument. If the delay wanders, the lower envelope of the arrivals determines the times, and
    the shared uncertainty covers both interpretations.

    The result is the arrivals themselves if they have no steady rate: the smallest delays differ between groups of
    messages. A host that stalls sometimes delays many messages, but never all. The scatter of the arrivals is then
    their uncertainty.
    """
    if len(host_ns) < 2 * _AHEAD:
        return FittedClock(host_ns, _uneven_s(host_ns))
    number = np.arange(len(host_ns), dtype=np.int64)
    for apart in _APART:
        # Pairs of messages at these distances, `_PAIRS` or a few more.
        lag, every = min(apart, len(number) // 4), max(1, len(host_ns) // _PAIRS)
        later, earlier = slice(lag, None, every), slice(None, -lag, every)
        period_ns = float(np.median((host_ns[later] - host_ns[earlier]) / (number[later] - number[earlier])))
        if not period_ns > 0:
            return FittedClock(host_ns, _uneven_s(host_ns))  # most arrived at once, after a stall
        former, number = number, numbered(host_ns, period_ns)
        if apart > _APART[0] and np.array_equal(number, former):
            break
    number = _not_early(number, host_ns, period_ns)
    fitted = through_clock(np.asarray(number * (period_ns / 1e9), dtype=np.float64), host_ns)
    late_ns = host_ns - fitted.ns
    steps_ns = np.abs(np.diff(_least_of_blocks(late_ns, _AHEAD)))
    if fitted.restarts or np.quantile(steps_ns, _MOSTLY) >= _EARLY * period_ns:
        return FittedClock(host_ns, _uneven_s(host_ns))
    return _wandering(fitted, late_ns, min(max(_AHEAD, round(_HELD_UP_NS / period_ns)), len(late_ns) // 2))


def _not_early(number: Integers, host_ns: Array, period_ns: float) -> Integers:
    """Return the numbers (n,) with the last few before a missing message corrected: very late messages are mistaken
    for the first ones after it, and would then be earlier than all before."""
    number = number.copy()
    for row in (np.flatnonzero(np.diff(number) > 1) + 1).tolist():
        before, after = slice(max(0, row - _AHEAD), row), slice(row, row + _AHEAD)
        late_ns = host_ns[before] - number[before] * period_ns
        first_ns = late_ns.min() - (np.median(late_ns) - late_ns.min()) / _HARDLY
        early = np.append(host_ns[after] - number[after] * period_ns < first_ns, False)
        few = int(early.argmin())
        if few < _AHEAD:  # else the instrument waited
            number[row : row + few] = number[row - 1] + 1 + np.arange(few)
    return number


def _wandering(fitted: FittedClock, late_ns: Array, block: int) -> FittedClock:
    """Return times of messages that are late_ns (n,) late; the minimum of each block shows whether a delay is
    permanent."""
    least_ns = _least_of_blocks(late_ns, block)
    steps_ns = np.diff(least_ns)
    level_ns = np.median(np.lib.stride_tricks.sliding_window_view(np.pad(least_ns, 1, mode="edge"), 3), axis=1)
    few = max(1, min(_COMES_BACK, len(level_ns) // 4))
    stayed_ns = _floor_around(np.pad(level_ns, few, mode="edge"), few)[few:-few]  # at an end no recovery can be seen
    off_ns = np.abs(stayed_ns - np.median(stayed_ns)).max()
    # 0.6745: median absolute value of a normal variable
    scatter_ns = np.median(np.abs(steps_ns)) / 0.6745 / math.sqrt(2)
    stays = np.mean(steps_ns**2) < _STAYS * 2 * np.var(least_ns) or off_ns > _WANDERS * scatter_ns
    if not (stays and off_ns > _WANDERS_NS):
        return replace(fitted, shared_u_s=float(stayed_ns.std()) / 1e9)
    wanders_s = float(np.ptp(level_ns)) / 1e9
    # Either interpretation is true: root mean square error of the chosen interpretation.
    ns = fitted.ns + _floor_around(late_ns, block)
    return replace(fitted, ns=ns, shared_u_s=wanders_s / math.sqrt(2), wanders_s=wanders_s)


def _least_of_blocks(values: Array, block: int) -> Array:
    blocks = len(values) // block
    return np.asarray(values[: blocks * block].reshape(blocks, block).min(axis=1))


def _floor_around(late_ns: Array, width: int) -> Array:
    """Return the smallest delay (n,) of `width` messages before or after each; it steps exactly at the start of a
    permanent delay."""
    least = _least_of_next(late_ns, width)
    return np.maximum(np.pad(least, (0, width - 1), mode="edge"), np.pad(least, (width - 1, 0), mode="edge"))


def numbered(host_ns: Array, period_ns: float) -> Integers:
    """Return the sequence number (n,) of each arrival (n,): after a missing message all following ones are a period
    late.

    Any message may be late for other reasons, but hardly all of the next `_AHEAD`. Among the last messages of a run a
    missing message is not detected. There are at least `_AHEAD` arrivals.
    """
    least = np.empty(len(host_ns) - _AHEAD + 1)  # the least of `_AHEAD` delays against the period in turn
    for begin in range(0, len(least), _BLOCK):
        rows = slice(begin, begin + _BLOCK + _AHEAD - 1)
        delays_ns = host_ns[rows] - np.arange(begin, begin + len(host_ns[rows])) * period_ns
        least[begin : begin + _BLOCK] = _least_of_next(delays_ns)
    missing = _missing(least, period_ns)
    along = np.arange(len(host_ns), dtype=np.int64)
    if not missing.any():
        return along
    missing = np.pad(missing, (0, _AHEAD - 1), mode="edge")
    # A missing message is permanent: a stall longer than the look-ahead is not.
    along += np.minimum.accumulate(missing[::-1])[::-1]
    return along


def _missing(least: Array, period_ns: float) -> Integers:
    """Return the number of periods by which each smallest delay (n,) lags behind those of the `_AHEAD` rows before, as
    these are counted.

    If those rows are counted alike, the count of the next changes with the rise of the delay, regardless of their
    count: such changes are found for all rows at once. Only the rows after a change are counted singly.
    """
    missing, done, count = np.zeros(len(least), dtype=np.int64), 0, 0
    changes: list[int] = []
    for begin in range(0, len(least), _BLOCK):
        rows = least[begin : begin + _BLOCK]
        before = least[max(begin - _AHEAD, 0) : begin + len(rows) - 1]
        if begin < _AHEAD:
            before = np.concatenate([np.full(_AHEAD - begin, least[0]), before])
        over = (rows - _least_of_next(before)) / period_ns
        changes += (begin + np.flatnonzero((over >= 1 - _EARLY) | (over < -_EARLY))).tolist()
    for change in changes:
        if change >= done:
            missing[done:change] = count
            before = least[max(change - _AHEAD, 0) : change]
            behind = np.append(np.full(_AHEAD - len(before), least[0]), before) - count * period_ns
            counts = _counted(least[change:], behind, period_ns)
            done, count = change + len(counts), counts[-1]
            missing[change:done] = counts
    missing[done:] = count
    return missing


def _counted(least: Array, behind: Array, period_ns: float) -> list[int]:
    """Return the counts of the first rows of least (n,), until `_AHEAD` consecutive counts are equal.

    behind (_AHEAD,): smallest delays of the rows before, with the periods missing until then subtracted.
    """
    before, counts, alike = deque(behind.tolist(), maxlen=_AHEAD), list[int](), 0
    lowest = min(before)
    for row in range(len(least)):
        ahead = float(least[row])
        count = math.floor((ahead - lowest) / period_ns + _EARLY)
        leaves, comes = before[0], ahead - count * period_ns
        before.append(comes)
        if comes <= lowest:
            lowest = comes
        elif leaves == lowest:
            lowest = min(before)
        alike = alike + 1 if counts and count == counts[-1] else 1
        counts.append(count)
        if alike == _AHEAD:
            break
    return counts


def _least_of_next(values: Array, width: int = _AHEAD) -> Array:
    """Running minimum of values (n,) over `width` values, (n - width + 1,)."""
    covered = 1
    while covered < width:
        step = min(covered, width - covered)
        values = np.minimum(values[:-step], values[step:])
        covered += step
    return values


def _uneven_s(host_ns: Array) -> Array:
    """Standard uncertainty (n,) s of arrivals with delays of the size of their scatter: the usual scatter, and that
    of each."""
    if len(host_ns) < 2:
        return np.zeros(len(host_ns))
    steps = np.diff(host_ns)
    off = np.abs(steps - np.median(steps))
    usual = off[off <= np.quantile(off, 0.9)].mean()
    return np.asarray(np.hypot(usual, np.concatenate([off[:1], off])) / math.sqrt(3) / 1e9)
