"""Map an instrument's timestamps to host time, by the instrument's clock or by the steady rate of the messages.

The difference (host - instrument) is the clock offset plus a delay. Delays are positive, so the lower envelope of the
differences is the offset. Timestamps are cleaned first: wrapped counters are continued, single wrong timestamps are
ignored, and a clock that restarted is fitted in pieces.

An instrument without a clock that sends unprompted has a steady rate. Message n was sent at n periods, and arrived with
a delay. With n as the clock, the lower envelope determines the times. This also works with an adapter that buffers
bytes for 16 ms.

The lower envelope is the line below all points with the smallest mean distance (Olson, A Passive Solution to the Sensor
Synchronization Problem, IROS 2010). Over a long span a clock's rate follows the temperature, and the envelope is a
continuous polyline with a knot per window.
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

from analysis.robot.kinematics.arm import Array, Integers, Mask

_TOLERANCE = 1e-12
"""Relative size below which a direction, its rise at a corner, or a Lagrange multiplier counts as zero."""
_MOST_STEPS = 20
"""Most steps per knot. Trials took 1 to 1.8."""


def highest_under(pull: Array, right: Integers, share: Array, corners: Array) -> Array | None:
    """Heights (k,) below all corners that maximise pull @ heights, or None if there is no solution.

    pull (k,): at least 0. A corner lies between knots right - 1 and right, at the relative position share, at the
    height corners, (m,) each.

    An active-set method for this linear program: it climbs along the projected gradient from corner to corner. The
    import of scipy.optimize takes as long as the rest of a run of a million rows.
    """

    def at_corners(heights: Array) -> Array:
        return np.asarray(heights[right - 1] * (1 - share) + heights[right] * share)

    gradient, heights = pull / pull.sum(), np.full(len(pull), corners.min())
    active: list[int] = []
    for _ in range(_MOST_STEPS * len(pull)):
        normals = np.zeros((len(pull), len(active)))
        for column, corner in enumerate(active):
            normals[right[corner] - 1 : right[corner] + 1, column] = 1 - share[corner], share[corner]
        basis, factors = np.linalg.qr(normals)
        along = basis.T @ gradient
        direction = gradient - basis @ along
        direction -= basis @ (basis.T @ direction)  # again, because a short direction consists of rounding errors
        if np.abs(direction).max() < _TOLERANCE:
            multipliers = np.linalg.solve(factors, along)
            if multipliers.min(initial=0.0) > -_TOLERANCE:
                return heights
            del active[int(multipliers.argmin())]
            continue
        rise = at_corners(direction)
        rise[active] = 0.0
        rising = np.flatnonzero(rise > _TOLERANCE * np.abs(direction).max())
        if not len(rising):
            return None
        steps = np.maximum(corners - at_corners(heights), 0.0)[rising] / rise[rising]
        heights = heights + steps.min() * direction
        active.append(int(rising[steps.argmin()]))
    return None


TICK_S = 1e-9
"""Resolution of host timestamps: 1 ns. A clock that advances by less is not advancing."""
WINDOW_S = 120.0
"""Interval of the knots. With the temperature of a hall, a crystal's rate changes by less than 0.01 ppm/s: 18 µs
over half of this window.
"""
_HULL_ROWS = 8
_BLOCKS = 400
_HULL_BLOCK = 64
"""Initial block size in the search for hull corners. Only the lowest point of a block is examined."""
_NEIGHBOURS = 9
_SPREADS = 4.0
_SHORT_S = 50e-6
_FEW = 0.002
"""Largest share of points below their neighbours that are treated as errors. More numerous low points are valid."""


def floor(x: Array, y: Array, window: float = WINDOW_S) -> tuple[Array, Mask]:
    """Lower envelope (n,) of y (n,) at increasing x (n,), both in s, and a mask of impossibly low points."""
    low = low_outliers(x, y)
    under = (x[~low], y[~low]) if low.any() else (x, y)
    windows = int(np.clip((x[-1] - x[0]) // window, 1, max(1, len(x) // _HULL_ROWS)))
    if windows == 1:
        offset, rate = lower_line(*under)
        line: Array = rate * x
        line += offset
        return line, low
    knots = np.linspace(x[0], x[-1], windows + 1)
    # The polyline is below all points of a window if it is below the corners of their hull. This keeps the linear
    # program small.
    under_x, under_y = under
    edges = np.searchsorted(under_x, knots[1:-1], side="left")
    pieces = list(zip(np.split(under_x, edges), np.split(under_y, edges), strict=True))
    corners = [lower_hull(*piece) for piece in pieces if len(piece[0])]
    corner_x, corner_y = (np.concatenate(of) for of in zip(*corners, strict=True))
    pull = np.zeros(len(knots))
    for k, (inside, _) in enumerate(pieces):
        # Each point contributes to the two adjacent knots, weighted by its position.
        share = float((inside - knots[k]).sum() / (knots[k + 1] - knots[k]))
        pull[k : k + 2] += len(inside) - share, share
    offset, rate = lower_line(corner_x, corner_y)
    right = np.clip(np.searchsorted(knots, corner_x), 1, len(knots) - 1)
    share_at = (corner_x - knots[right - 1]) / (knots[right] - knots[right - 1])
    rises = highest_under(pull, right, share_at, corner_y - offset - rate * corner_x)
    heights = offset + rate * knots + (0.0 if rises is None else rises)
    return np.interp(x, knots, heights), low


def low_outliers(x: Array, y: Array) -> Mask:
    """Mask of wrong timestamps y (n,) at x (n,), in s: isolated minima well below those of the neighbouring blocks.

    At most one in 500 points, or three, is wrong, because repeated low points are short delays.
    """
    none = np.zeros(len(x), dtype=bool)
    size = max(_HULL_ROWS, len(x) // _BLOCKS)
    blocks = len(x) // size
    if blocks < _NEIGHBOURS:
        return none
    least = np.minimum.reduceat(y, np.arange(blocks) * size)
    at = x[np.arange(blocks) * size]
    half = blocks // 2
    apart = at[-half:] - at[:half]
    advances = apart >= TICK_S
    if not advances.any():
        return none
    slope = float(np.median((least[-half:] - least[:half])[advances] / apart[advances]))
    level = least - slope * at
    mirrored = np.pad(level, _NEIGHBOURS // 2, mode="reflect")
    around = np.median(np.lib.stride_tricks.sliding_window_view(mirrored, _NEIGHBOURS), axis=1)
    spread = float(np.quantile(np.abs(level - around), 0.95))
    level = around - _SPREADS * spread - _SHORT_S
    low = none.copy()
    # The points of a block are not below its minimum minus the larger value of the line at the two ends of the block.
    above = least - np.maximum(slope * at, slope * x[np.arange(1, blocks + 1) * size - 1])
    for block in np.flatnonzero(above < level).tolist():
        rows = slice(block * size, (block + 1) * size)
        low[rows] = y[rows] - slope * x[rows] < level[block]
    tail = slice(blocks * size, None)
    low[tail] = y[tail] - slope * x[tail] < level[-1]
    return low if low.sum() <= max(3, _FEW * len(x)) else none


def lower_line(x: Array, y: Array) -> tuple[float, float]:
    """Intercept and slope of the line below all points (n,) with the smallest mean distance: the edge of the lower
    convex hull at the mean of x.
    """
    hx, hy = lower_hull(x, y)
    if len(hx) == 1:
        return float(hy[0]), 0.0
    right = int(np.clip(np.searchsorted(hx, x.mean()), 1, len(hx) - 1))
    slope = float((hy[right] - hy[right - 1]) / (hx[right] - hx[right - 1]))
    return float(hy[right] - slope * hx[right]), slope


def lower_hull(x: Array, y: Array) -> tuple[Array, Array]:
    """Corners (m,) of the lower convex hull of points (n,), with increasing x."""
    blocks = len(x) // _HULL_BLOCK
    if not (x[1:] > x[:-1]).all():
        order = np.lexsort((y, x))
        x, y = x[order], y[order]
        once = np.concatenate([[True], np.diff(x) > 0])
        x, y = x[once], y[once]
    elif blocks >= _NEIGHBOURS:
        # A block contains corners only if its minimum is not above the hull of all block minima. This hull is convex
        # and therefore highest at an end of a block.
        kept = np.zeros(len(x), dtype=bool)
        kept[0] = kept[-1] = kept[blocks * _HULL_BLOCK :] = True
        begins = np.arange(blocks) * _HULL_BLOCK
        lowest = begins + y[: len(begins) * _HULL_BLOCK].reshape(blocks, _HULL_BLOCK).argmin(axis=1)
        kept[lowest] = True
        over = np.interp([x[begins], x[begins + _HULL_BLOCK - 1]], *lower_hull(x[kept], y[kept])).max(axis=0)
        kept[: blocks * _HULL_BLOCK].reshape(blocks, _HULL_BLOCK)[y[lowest] <= over] = True
        x, y = x[kept], y[kept]
    while len(x) > 2:
        # A point on or above the line between two others is not a corner, even if either was removed.
        turn = (x[1:-1] - x[:-2]) * (y[2:] - y[:-2]) - (y[1:-1] - y[:-2]) * (x[2:] - x[:-2])
        corner = np.concatenate([[True], turn > 0, [True]])
        if corner.all():
            break
        x, y = x[corner], y[corner]
    return x, y


_LEAP_S = 1.0
"""Smallest jump of a clock. A network or serial connection does not survive a delay of this length, although a busy
computer may cause one.
"""
_WRAPS_S = (2**32 * 1e-3, 2**32 * 1e-6)
"""Ranges of 32-bit counters in ms and in µs."""

_LATEST_S = 1e11
"""Largest valid clock value. A larger timestamp means that the instrument has no clock."""


_BLOCK = 1 << 15
"""Rows per block, to fit the processor's cache."""
_AROUND = 8
"""Number of timestamps before and after a decrease that are searched for the wrong ones."""


@dataclass(frozen=True)
class FittedClock:
    """Host times (n,) ns of an instrument's timestamps. u_s (n,): uncertainty of times derived from arrivals, else 0.

    wrong: number of ignored timestamps. wanders_s: permanent changes in the delay of a steadily sending instrument.
    shared_u_s: common uncertainty caused by these.
    """

    ns: Array
    u_s: Array
    restarts: int = 0
    wrong: int = 0
    wanders_s: float = 0.0
    shared_u_s: float = 0.0


def is_stalled(device_s: Array) -> bool:
    """True if the clock does not advance, within the resolution of host timestamps."""
    return len(device_s) > 1 and bool(device_s.max() <= device_s.min() + TICK_S)


def through_clock(device_s: Array, host_ns: Array) -> FittedClock:
    """Host times of timestamps device_s (n,) s; host_ns (n,): arrivals or other upper bounds, returned if there is no
    clock.
    """
    if len(device_s) < 3 or not -_LATEST_S < device_s.min() <= device_s.max() < _LATEST_S:
        return FittedClock(host_ns, np.zeros(len(host_ns)))
    if (device_s[1:] >= device_s[:-1]).all():
        least, most = np.inf, -np.inf
        for begin in range(0, len(device_s), _BLOCK):
            rows = slice(begin, begin + _BLOCK)
            offset_s = (host_ns[rows] - host_ns[0]) / 1e9 - device_s[rows]
            least, most = min(least, offset_s.min()), max(most, offset_s.max())
        # The usual case: a monotone and continuous clock requires no further checks.
        if most - least < _LEAP_S:
            return _by_arrival(*_fitted(device_s, host_ns), 0, host_ns)
    device_s = unwrapped(device_s, host_ns)
    wrong = out_of_order(device_s)
    in_order_s, came_ns = (device_s[~wrong], host_ns[~wrong]) if wrong.any() else (device_s, host_ns)
    starts = _starts(in_order_s, came_ns)
    pieces = [_fitted(*piece) for piece in zip(np.split(in_order_s, starts), np.split(came_ns, starts), strict=True)]
    ns, low = (of[0] if len(of) == 1 else np.concatenate(of) for of in zip(*pieces, strict=True))
    if wrong.any():
        ns, low = _among(wrong, ns, 0.0), _among(wrong, low, True)
    return _by_arrival(ns, low, len(starts), host_ns)


def _among(wrong: Mask, kept: NDArray[Any], filler: float) -> NDArray[Any]:
    values = np.full(len(wrong), filler, dtype=kept.dtype)
    values[~wrong] = kept
    return values


def _starts(device_s: Array, host_ns: Array) -> Integers:
    """Rows at which the clock restarts: it decreases, or its offset changes permanently."""
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
    """Timestamps (n,) s of a counter, continued after each decrease by its range."""
    ticks, passed = np.diff(device_s), np.diff(host_ns) / 1e9
    leaps = np.flatnonzero(np.abs(ticks - passed) > min(_WRAPS_S) - _LEAP_S)
    if not len(leaps):
        return device_s
    added, ticks, passed = np.zeros(len(device_s)), ticks[leaps], passed[leaps]
    for wrap_s in _WRAPS_S:
        added[leaps[(ticks < 0) & (np.abs(ticks + wrap_s - passed) < _LEAP_S)] + 1] = wrap_s
        # The opposite jump is a late duplicate of an earlier message.
        added[leaps[(ticks > 0) & (np.abs(ticks - wrap_s - passed) < _LEAP_S)] + 1] = -wrap_s
    return np.asarray(device_s + np.cumsum(added))


def out_of_order(device_s: Array) -> Mask:
    """Mask of wrong timestamps (n,): the fewest that must be removed for the others to increase.

    Many decreases are a restart of the clock, and no timestamp is wrong.
    """
    wrong = np.zeros(len(device_s), dtype=bool)
    for fell in (np.flatnonzero(np.diff(device_s) < 0) + 1).tolist():
        around = np.arange(max(0, fell - _AROUND), min(len(device_s), fell + _AROUND))
        odd = np.delete(around, _longest_in_order(device_s[around].tolist()))
        if len(odd) <= _AROUND // 2:
            wrong[odd] = True
    return wrong


def _longest_in_order(values: Sequence[float]) -> list[int]:
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
    if len(device_s) < 3 or is_stalled(device_s):
        return host_ns, np.zeros(len(host_ns), dtype=bool)
    since_s = device_s - device_s[0]
    offset_s = (host_ns - host_ns[0]) / 1e9
    offset_s -= since_s
    ns, low = floor(since_s, offset_s)
    ns += since_s
    ns *= 1e9
    ns += host_ns[0]
    return ns, low


def _by_arrival(ns: Array, wrong: Mask, restarts: int, host_ns: Array) -> FittedClock:
    u_s = np.zeros(len(ns))
    if wrong.any() and not wrong.all():
        delay = (host_ns - ns)[~wrong]
        ns = np.where(wrong, host_ns - np.median(delay), ns)
        u_s[wrong] = delay.std() / 1e9
    return FittedClock(ns, u_s, restarts, int(np.count_nonzero(u_s)))


_AHEAD = 32
"""Number of consecutive messages of which at least one has almost no delay. It covers several beats between the
message period and an adapter's timer.
"""
_ONE_BY_ONE = 4 * _AHEAD
"""Rows that are counted without arrays after a change of the lag, because changes come in groups."""
_EARLY = 0.15
"""Fraction of a period by which the smallest delay may decrease, due to the beat or an inaccurate period."""
_MOSTLY = 0.75
"""Fraction of steps between groups of messages with an almost constant smallest delay that proves a steady rate. The
other steps may be waits. If the rate is not steady, the fraction is about a third.
"""
_DELAY_DIVISOR = 8
"""Divisor of the usual delay. A message rarely precedes the earliest of the previous
`_AHEAD` messages by more than the quotient.
"""
_APART = (_AHEAD, 8 * _AHEAD, 64 * _AHEAD, 64 * _AHEAD)
"""Distances between messages, in messages, used to determine the period; at most a quarter of a short run.

Between close messages, missing ones are rare. When the larger distances are used, they are already known.
"""
_PAIRS = 100_000
"""Number of pairs. The uncertainty of their median is 1/300 of their scatter."""
_STAYS = 0.4
"""Threshold of a wandering delay: changes between groups of messages relative to the scatter of the complete run.

This is von Neumann's ratio, which is 1 for independent values.
"""
_WANDERS = 6.0
"""Alternative threshold of a wandering delay: deviation from the median, as a multiple of the scatter."""
_WANDERS_NS = 0.2e6
"""Smallest deviation of a wandering delay. A busy computer may cause smaller ones for a longer time."""
_HELD_UP_NS = 0.5e9
"""Longest usual stall of a computer. Rarely are all messages late within this time, or within `_AHEAD` messages."""

_COMES_BACK = 8
"""Number of blocks of _HELD_UP_NS, at most a quarter of a short run, after which a delay is permanent. If it
recovers earlier, it was a stall of a few seconds, because an instrument that waited never catches up.
"""


def through_pace(host_ns: Array) -> FittedClock:
    """Host times (n,) ns of messages that arrived at host_ns (n,), assuming a steady rate.

    A crystal keeps its rate, so a temporary delay is one of the transmission, and the lower envelope is the clock. An
    instrument that waits never catches up (a program timed by software), so a permanent delay is its own. If the delay
    wanders, the times follow the lower envelope of the arrivals, and the shared uncertainty covers both
    interpretations.

    The rate is not steady if the smallest delays differ between groups of messages, because a stalling host never
    delays all of many. The result is then the arrival times, with their scatter as uncertainty.
    """
    if len(host_ns) < 2 * _AHEAD:
        return FittedClock(host_ns, _uneven_s(host_ns))
    number, period_ns = np.arange(len(host_ns), dtype=np.int64), 0.0
    for apart in _APART:
        # Pairs of messages at this distance, about `_PAIRS` of them.
        lag, every = min(apart, len(number) // 4), max(1, len(host_ns) // _PAIRS)
        later, earlier = slice(lag, None, every), slice(None, -lag, every)
        former_ns, former = period_ns, number
        period_ns = float(np.median((host_ns[later] - host_ns[earlier]) / (number[later] - number[earlier])))
        if not period_ns > 0:
            return FittedClock(host_ns, _uneven_s(host_ns))  # most messages arrived at once, after a stall
        if period_ns == former_ns:
            break
        number = numbered(host_ns, period_ns)
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
    """Correct the numbers (n,) of the last messages before a missing one.

    Very late ones are counted as the first messages after it, and then seem too early.
    """
    number = number.copy()
    for row in (np.flatnonzero(np.diff(number) > 1) + 1).tolist():
        before, after = slice(max(0, row - _AHEAD), row), slice(row, row + _AHEAD)
        late_ns = host_ns[before] - number[before] * period_ns
        first_ns = late_ns.min() - (np.median(late_ns) - late_ns.min()) / _DELAY_DIVISOR
        early = np.append(host_ns[after] - number[after] * period_ns < first_ns, False)
        few = int(early.argmin())
        if few < _AHEAD:  # otherwise the instrument waited
            number[row : row + few] = number[row - 1] + 1 + np.arange(few)
    return number


def _wandering(fitted: FittedClock, late_ns: Array, block: int) -> FittedClock:
    """A clock that follows slow changes of the delay late_ns (n,), if they exceed the scatter."""
    least_ns = _least_of_blocks(late_ns, block)
    steps_ns = np.diff(least_ns)
    level_ns = np.median(np.lib.stride_tricks.sliding_window_view(np.pad(least_ns, 1, mode="edge"), 3), axis=1)
    few = max(1, min(_COMES_BACK, len(level_ns) // 4))
    # both ends are padded: a recovery cannot be observed there
    stayed_ns = _floor_around(np.pad(level_ns, few, mode="edge"), few)[few:-few]
    off_ns = np.abs(stayed_ns - np.median(stayed_ns)).max()
    # 0.6745: median absolute value of a normal variable
    scatter_ns = np.median(np.abs(steps_ns)) / 0.6745 / math.sqrt(2)
    stays = np.mean(steps_ns**2) < _STAYS * 2 * np.var(least_ns) or off_ns > _WANDERS * scatter_ns
    if not (stays and off_ns > _WANDERS_NS):
        return replace(fitted, shared_u_s=float(stayed_ns.std()) / 1e9)
    wanders_s = float(np.ptp(level_ns)) / 1e9
    # The interpretation is uncertain: the uncertainty is the root mean square error of the chosen one.
    ns = fitted.ns + _floor_around(late_ns, block)
    return replace(fitted, ns=ns, shared_u_s=wanders_s / math.sqrt(2), wanders_s=wanders_s)


def _least_of_blocks(values: Array, block: int) -> Array:
    blocks = len(values) // block
    return np.asarray(values[: blocks * block].reshape(blocks, block).min(axis=1))


def _floor_around(late_ns: Array, width: int) -> Array:
    """Larger of the smallest delays in `width` messages up to each message and from it on: it steps exactly at the
    start of a permanent delay.
    """
    least = _least_of_next(late_ns, width)
    return np.maximum(np.pad(least, (0, width - 1), mode="edge"), np.pad(least, (width - 1, 0), mode="edge"))


def numbered(host_ns: Array, period_ns: float) -> Integers:
    """Sequence number (n,) of each of at least `_AHEAD` arrivals. A missing message delays all later ones by a period.

    A single message may be late for other reasons, but rarely all of the next `_AHEAD`. A missing message near the end
    is not detected.
    """
    least = np.empty(len(host_ns) - _AHEAD + 1)  # smallest of `_AHEAD` delays relative to the period
    for begin in range(0, len(least), _BLOCK):
        rows = slice(begin, begin + _BLOCK + _AHEAD - 1)
        delays_ns = host_ns[rows] - np.arange(begin, begin + len(host_ns[rows])) * period_ns
        least[begin : begin + _BLOCK] = _least_of_next(delays_ns)
    missing = _count_missing_periods(least, period_ns)
    along = np.arange(len(host_ns), dtype=np.int64)
    if not missing.any():
        return along
    missing = np.pad(missing, (0, _AHEAD - 1), mode="edge")
    # A missing message shifts all later messages. A stall longer than the look-ahead does not.
    along += np.minimum.accumulate(missing[::-1])[::-1]
    return along


def _count_missing_periods(least: Array, period_ns: float) -> Integers:
    """Lag of each smallest delay (n,) relative to the corrected delays of the previous `_AHEAD` rows, in
    periods.

    The lag rarely changes. Blocks of growing size are therefore computed with the last lag, up to the first row with
    another one.
    """
    missing = np.empty(len(least), dtype=np.int64)
    before = np.full(_AHEAD, least[0])
    row, count, block = 0, 0, _AHEAD
    while row < len(least):
        late = least[row : row + block]
        corrected = np.concatenate([before, late - count * period_ns])
        counts = np.floor((late - _least_of_next(corrected)[:-1]) / period_ns + _EARLY)
        changed = counts != count
        same = int(changed.argmax()) if changed.any() else len(late)
        missing[row : row + same] = count
        row, before = row + same, corrected[same : same + _AHEAD]
        if same == len(late):
            block = min(2 * block, _BLOCK)
            continue
        recent = deque(before.tolist(), maxlen=_AHEAD)
        lowest, counted = min(recent), list[int]()
        for delay in least[row : row + _ONE_BY_ONE].tolist():
            count = math.floor((delay - lowest) / period_ns + _EARLY)
            leaves, comes = recent[0], delay - count * period_ns
            recent.append(comes)
            if comes <= lowest:
                lowest = comes
            elif leaves == lowest:
                lowest = min(recent)
            counted.append(count)
        missing[row : row + len(counted)] = counted
        row, before, block = row + len(counted), np.array(recent), _AHEAD
    return missing


def _least_of_next(values: Array, width: int = _AHEAD) -> Array:
    covered = 1
    while covered < width:
        step = min(covered, width - covered)
        values = np.minimum(values[:-step], values[step:])
        covered += step
    return values


def _uneven_s(host_ns: Array) -> Array:
    """Standard uncertainty (n,) s of arrivals without a steady rate: the usual scatter and the deviation of each."""
    if len(host_ns) < 2:
        return np.zeros(len(host_ns))
    steps = np.diff(host_ns)
    off = np.abs(steps - np.median(steps))
    usual = off[off <= np.quantile(off, 0.9)].mean()
    return np.asarray(np.hypot(usual, np.concatenate([off[:1], off])) / math.sqrt(3) / 1e9)
