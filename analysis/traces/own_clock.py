"""An instrument's stamps by its own clock, read on the host's time line.

(host - instrument) is the clock's offset plus a delay, and a delay can only be too long: the floor of it is the clock.
Before that the stamps are put in order: a counter that has wrapped goes on, a stamp that is wrong by itself is left
out, a clock that restarted is fitted in pieces.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.kinematics.arm import Array, Integers
from analysis.traces.lower_hull import TICK_S, Mask, floor

_LEAP_S = 1.0
"""No network or serial line holds a message back for so long without losing its link; a busy computer may."""
_WRAPS_S = (2**32 * 1e-3, 2**32 * 1e-6)
"""Counters of 32 bits, in ms and in µs."""

_LATEST_S = 1e11
"""No clock shows so much, since whatever year: what has a stamp beyond has no clock."""


_BLOCK = 1 << 15
"""Rows at a time, so that what is computed of them stays in the processor's cache."""
_AROUND = 8
"""Stamps before and after one that fell, among which the wrong ones are sought."""


@dataclass(frozen=True)
class FittedClock:
    """Host times (n,) ns of an instrument's stamps; u_s (n,): of those alone that its clock does not give.

    restarted: the rows from which on the clock is another; wrong: how many stamps were left out. wanders_s: by how much
    the lateness of an instrument's pace changed for good, and shared_u_s, what that makes uncertain in all of them.
    """

    ns: Array
    u_s: Array
    restarted: tuple[int, ...] = ()
    wrong: int = 0
    wanders_s: float = 0.0
    shared_u_s: float = 0.0

    @property
    def restarts(self) -> int:
        """How often the clock restarted."""
        return len(self.restarted)


def stands(device_s: Array) -> bool:
    """Whether a clock that shows device_s (n,) does not advance, as far as stamps of the host can resolve it."""
    return len(device_s) > 1 and bool(device_s.max() <= device_s.min() + TICK_S)


def through_clock(device_s: Array, host_ns: Array) -> FittedClock:
    """When the host's clock showed what the instrument's showed, device_s (n,); host_ns (n,), the arrivals or any other
    bound that is never too early. The host's own where the instrument has no clock."""
    if len(device_s) < 3 or not -_LATEST_S < device_s.min() <= device_s.max() < _LATEST_S:
        return FittedClock(host_ns, np.zeros(len(host_ns)))
    if _runs_through(device_s, host_ns):
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


def _runs_through(device_s: Array, host_ns: Array) -> bool:
    """Whether a clock never fell, nor leapt against the host's: most do not, and nothing else is to be looked for."""
    if not (device_s[1:] >= device_s[:-1]).all():
        return False
    least, most = np.inf, -np.inf
    for begin in range(0, len(device_s), _BLOCK):
        rows = slice(begin, begin + _BLOCK)
        offset_s = (host_ns[rows] - host_ns[0]) / 1e9 - device_s[rows]
        least, most = min(least, offset_s.min()), max(most, offset_s.max())
    return bool(most - least < _LEAP_S)


def _among(wrong: Mask, kept: NDArray[Any], filler: float) -> NDArray[Any]:
    """Values for all rows (n,): those kept, and a filler where the stamp is wrong."""
    values = np.full(len(wrong), filler, dtype=kept.dtype)
    values[~wrong] = kept
    return values


def _starts(device_s: Array, host_ns: Array) -> Integers:
    """Rows at which the clock restarted: it fell, or its offset from the host's clock is another from then on.

    A host that was held up reads at once what came meanwhile: offsets leap and come back, so the least of them stays.
    """
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
    """Stamps (n,) s of a counter, going on where it wrapped: where it fell by just what it can count to."""
    ticks, passed = np.diff(device_s), np.diff(host_ns) / 1e9
    leaps = np.flatnonzero(np.abs(ticks - passed) > min(_WRAPS_S) - _LEAP_S)
    if not len(leaps):
        return device_s
    added, ticks, passed = np.zeros(len(device_s)), ticks[leaps], passed[leaps]
    for wrap_s in _WRAPS_S:
        added[leaps[(ticks < 0) & (np.abs(ticks + wrap_s - passed) < _LEAP_S)] + 1] = wrap_s
        # One message of before, come late.
        added[leaps[(ticks > 0) & (np.abs(ticks - wrap_s - passed) < _LEAP_S)] + 1] = -wrap_s
    return np.asarray(device_s + np.cumsum(added))


def out_of_order(device_s: Array) -> Mask:
    """Which stamps (n,) are wrong by themselves: the fewest without which those around them are in order.

    Where that would be many, the clock restarted, and none is wrong.
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
    """Where the stamp is wrong, the arrival less the usual delay takes its place."""
    u_s = np.zeros(len(ns))
    if wrong.any() and not wrong.all():
        delay = (host_ns - ns)[~wrong]
        ns = np.where(wrong, host_ns - np.median(delay), ns)
        u_s[wrong] = delay.std() / 1e9
    return FittedClock(ns, u_s, restarted, int(wrong.sum()))
