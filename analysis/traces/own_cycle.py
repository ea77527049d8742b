"""When a gauge with a cycle of its own read what it answers: its ticks, found from the readings themselves.

Such a gauge answers with the last reading of its cycle, however old. Its value can change only at a tick, so two
answers that differ have a tick between them. Each such change bounds one tick; a steady cycle, numbered and fitted
through all of them, gives each far better than its own bounds (`cycle_line`). In an uneven cycle the bounds alone
hold. Where answers come hardly oftener than ticks nothing is seen of them, and the age of a reading is anything up to
a cycle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from analysis.kinematics.arm import Array, Mask
from analysis.traces.cycle_line import CycleLine, fitted, numbered, period_of
from analysis.traces.value_changes import FEW, Bounds, changes

_WIDE = 0.7
"""Changes that are not seen to this share of a cycle do not bound a tick, …"""
_STATED = 0.02
"""… a stated cycle is true to this share (a crystal to far less, a maker's round figure to this), …"""
_SOUGHT = 0.3
"""… and one that is not stated lies so near to the usual distance of changes."""
_AGREE = 0.8
"""Share of the changes that must agree with a cycle before it is believed."""
_STEADY = 0.15
"""Ticks that scatter by more than this share of a cycle cannot serve as a clock."""
_SAMPLE = 2000
"""Requests that show whether they keep step with the cycle: more of them show the same."""


@dataclass(frozen=True)
class Ticks:
    """When each of n answers was read. ns (n,); own_u_s (n,); u_s: shared by all; period_ns; steady: whether the cycle
    keeps it."""

    ns: Array
    own_u_s: Array
    u_s: float
    period_ns: float
    steady: bool


def through_cycle(asked_ns: Array, values: Array, cycle_ns: float | None) -> Ticks | None:
    """Ticks of the answers given at asked_ns (n,) with values (n, k); None where they are not to be seen.

    cycle_ns: as stated. Where nothing is stated a cycle is believed only of a gauge that was seen to repeat itself
    while it moved by more than its resolution.
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
    # On the move every answer was read where its value first showed; else within a usual cycle.
    run = np.searchsorted(bounds.row, np.arange(len(asked_ns)), side="right") - 1
    seen = (run >= 0) & bounds.jumps[np.maximum(run, 0)]
    ns = np.where(seen, bounds.middle_ns[run], asked_ns - bounds.usual_ns / 2)
    own_ns = np.where(seen, bounds.width_ns[run], bounds.usual_ns) / math.sqrt(12)
    return Ticks(start_ns + ns, own_ns / 1e9, 0.0, bounds.usual_ns, steady=False)


def _at_ticks(asked_ns: Array, bounds: Bounds, close: Mask, line: CycleLine) -> Ticks:
    """The tick of every answer at asked_ns (n,): of the change before it, or a later one at which nothing changed."""
    # What does not agree with any tick is not one: a garbled reading, and the next one, which is right again.
    true = ~close
    true[close] = line.agreeing
    bounds, close = bounds.of(true), close[true]
    number = np.empty(len(bounds.row), dtype=np.int64)
    number[close] = line.number[line.agreeing]
    exact = line.number_at(bounds.high_ns[~close])
    number[~close] = np.floor(exact)
    tick_ns, u_ns = line.tick_ns(number.astype(float)), np.full(len(number), line.scatter_ns)
    tick_ns[close], u_ns[close] = line.ns[line.agreeing], line.u_ns[line.agreeing]
    # A change across a gap that ends close to a tick may show that tick or the one before.
    unclear = np.abs(exact - np.round(exact)) * line.period_ns < 2 * line.scatter_ns
    u_ns[~close] = np.where(unclear, line.period_ns / math.sqrt(12), u_ns[~close])

    run = np.searchsorted(bounds.row, np.arange(len(asked_ns)), side="right")
    first = np.concatenate([[np.iinfo(np.int64).min // 2], number])[run]
    last = np.concatenate([number, [np.iinfo(np.int64).max // 2]])[run] - 1
    seen = np.minimum(np.floor(line.number_at(asked_ns)).astype(np.int64), last)
    # On the move nothing reads the same twice: the gauge left a tick out, and its answer is as old as it looks.
    stale = np.concatenate([[False], bounds.jumps])[run] & (run < len(bounds.row))
    later = (seen > first) & ~stale
    of_run = np.maximum(run - 1, 0)
    ns = np.where(later, line.tick_ns(seen.astype(float)), tick_ns[of_run])
    own_ns = np.where(later, line.scatter_ns, u_ns[of_run])
    return Ticks(ns, own_ns / 1e9, line.u_phase_ns / 1e9, line.period_ns, steady=True)


def anywhere_in_a_cycle(asked_ns: Array, cycle_ns: float) -> tuple[Array, float]:
    """Own (n,) and shared standard uncertainty in s of readings taken half a cycle before asked_ns (n,).

    Where requests keep step with the cycle all readings are equally old: the share of it that they have in common is
    the length of their mean phase, at the cycle near the stated one that makes the most of it.
    """
    each = asked_ns[np.linspace(0, len(asked_ns) - 1, min(len(asked_ns), _SAMPLE)).astype(int)] - asked_ns[0]
    off = np.linspace(-1e-3, 1e-3, 41)
    in_step = float(np.abs(np.exp(2j * np.pi * (1 + off[:, None]) * each / cycle_ns).mean(axis=1)).max())
    u_s = cycle_ns / math.sqrt(12) / 1e9
    return np.full(len(asked_ns), u_s * math.sqrt(1 - min(in_step, 1.0) ** 2)), u_s * in_step
