"""When was it measured? Host stamps, wire time and the instrument's own clock made into one time line.

A byte can only arrive late, never early, and a reading that was asked for was taken after the request had gone through
the line and before its answer set out. So of every bound that the stamps give the tightest is the best, and what
stays between the bounds is the uncertainty: one part that all readings share, one that each has for itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from analysis.robot.kinematics.arm import Array
from analysis.runs.own_clock import FittedClock, stands, through_clock, through_pace
from analysis.runs.own_cycle import anywhere_in_a_cycle, changes, repeats, through_cycle
from rigs.schema.gauges import Gauge
from rigs.schema.links import tcp_address
from rigs.schema.probe import Timing

_HIDDEN_S = 1e-3
"""How much an instrument's own time to answer may vary unseen behind an adapter that holds bytes back."""

_HOLDS_NS = 25e6
"""Adapters hold bytes back for up to 16 ms as they come, and some for the way, …"""
_HOLDS = 1.5
"""… or for so many times what nine of ten answers took; what takes longer, a computer held up."""
_HOST_S = 30e-6
"""A host cannot stamp a byte any better."""
_TIMER_NS = 3e6
"""What a quicker timer hides, unevenness covers."""
_MOST = (0.05, 0.95)
_DRIFTING = 0.7
"""The scatter of messages about a pace: what one does from the last, 1.2 to 1.4 where each is late for itself."""
_IN_STEP = 0.9
"""Mean cosine of arrivals that a timer of whole milliseconds releases, as all adapters have it."""
_SAMPLE = 20_000
"""Messages that are enough to see a timer by."""
_STIRRED = 5
_STIRRED_NS = 2e6
"""From so many requests that did not follow the answer before at once, and where they are answered so unevenly, it can
be seen that an adapter holds bytes back (`daq.protocol.polled` says why)."""

_LONGER = 1.2
"""Readings that stay the same for more than so many stated cycles contradict the cycle."""
_SPARSE_NS = 50e6
"""Where a joint turns back, a play is crossed in some ten milliseconds: five times that shows it to one gauge long
before the other."""
_SPARSE = (
    "its readings are {:.0f} ms apart, too far to follow a joint that turns back: a band may be too large by what the "
    "other gauge shows earlier; drive the circle slower"
)
_STANDS = "its own clock does not advance and is not used; check the instrument"
_FOUND = (
    "its readings repeat with a cycle of its own of {:.2f} ms; each takes the time of its tick; "
    "state the cycle as timing.cycle_ms in the rig file"
)
_UNEVEN = (
    "its readings repeat while it moves, in an uneven cycle of some {:.0f} ms; each takes the time of its first copy, "
    "which adds uncertainty; see timing in the rig file and the instrument's manual"
)
_NOT_SEEN = (
    "its readings repeat while it moves, so they may be up to {:.0f} ms old, which is in u; state the cycle as "
    "timing.cycle_ms in the rig file, or read the gauge more often"
)

Columns = Mapping[str, np.ndarray[Any, Any]]


@dataclass(frozen=True)
class TimingDoubt:
    """What a person should know of an instrument's times: the form of a sentence, and the ms that it states."""

    form: str
    ms: float = 0.0

    def __str__(self) -> str:
        return self.form.format(self.ms)


@dataclass(frozen=True)
class Instants:
    """When each sample was taken: ns (n,) on the host's clock.

    u_s: the standard uncertainty that all share; own_u_s (n,): what each has beside it. restarted: the rows from which
    on the instrument's clock is another; wrong: how many of its stamps were left out. held: an adapter holds bytes
    back.
    wanders_s: by how much the lateness of its pace changed for good. arrived: the times are those of arrivals, which
    messages that a network bundles share.
    doubts: what else a person should know of these times.
    """

    ns: Array
    u_s: float
    own_u_s: Array
    restarted: tuple[int, ...] = ()
    wrong: int = 0
    held: bool = False
    wanders_s: float = 0.0
    arrived: bool = False
    doubts: tuple[TimingDoubt, ...] = ()

    @property
    def restarts(self) -> int:
        """How often the instrument's own clock restarted."""
        return len(self.restarted)


def gauge_instants(stream: Columns, gauge: Gauge) -> Instants:
    """When each reading of a gauge was taken, in the middle of what its filter averages."""
    stream, doubts = _without_standing_clock(stream)
    timing, device_s = gauge.timing, stream["device_time_s"]
    character_ns = 0 if tcp_address(gauge.port) else gauge.line.character_ns
    first, last, size = stream["first_byte_ns"], stream["last_byte_ns"], stream["size"]
    set_out = np.minimum(first - character_ns, last - size * character_ns).astype(float)
    if (stream["requested_ns"] < 0).any():
        latched = _streamed(device_s, set_out, character_ns)
    else:
        went_through = stream["requested_ns"] + float(gauge.request_bytes * character_ns)
        latched = _requested(stream, went_through, set_out, timing)
    if not np.isfinite(device_s).all() and timing.latch not in ("on_request", "streamed"):
        values = np.stack([column for name, column in stream.items() if name.endswith("_mm")], axis=1)
        latched = _of_own_cycle(latched, values, timing)
    u_s = math.hypot(latched.u_s, timing.filter_uncertainty_ms / 1e3)
    return replace(latched, ns=latched.ns - timing.filter_ms * 1e6, u_s=u_s, doubts=doubts + latched.doubts)


def _without_standing_clock(stream: Columns) -> tuple[Columns, tuple[TimingDoubt, ...]]:
    """A stream without its instrument's clock where that does not advance, and a doubt that says so."""
    if not stands(stream["device_time_s"]):
        return stream, ()
    return {**stream, "device_time_s": np.full(len(stream["device_time_s"]), np.nan)}, (TimingDoubt(_STANDS),)


def _requested(stream: Columns, went_through: Array, set_out: Array, timing: Timing) -> Instants:
    """When answers were given that set out at set_out (n,) ns, to requests that went through the line before."""
    set_out = set_out - timing.answer_delay_ms * 1e6
    window = np.maximum(set_out - went_through, 0.0)
    if timing.latched_within_ms is not None:
        window = np.minimum(window, timing.latched_within_ms * 1e6)
    # An adapter holds bytes back where answers to requests that came out of step took less even times. By the quarters
    # in the middle: a busy host holds up some of either kind, an adapter most of those out of step.
    idle_before = stream["requested_ns"][1:] > stream["last_byte_ns"][:-1]
    in_step, stirred = window[1:][~idle_before], window[1:][idle_before]
    held = min(len(in_step), len(stirred)) >= _STIRRED and _spread(stirred) > 2 * _spread(in_step) + _STIRRED_NS
    device_s = stream["device_time_s"]
    if not np.isfinite(device_s).all():
        return asked_instants(went_through, window, held)
    # The instrument's clock runs between two lines: no reading was taken before its request or after its answer. A
    # gauge that answers with a reading from before the request breaks the first; then the second alone holds.
    after = through_clock(device_s, set_out)
    before = through_clock(-device_s[::-1], -went_through[::-1])
    width = float(np.median(after.ns + before.ns[::-1]))
    u_s = math.hypot(_anywhere_in(abs(width)), _HIDDEN_S if held else _HOST_S)
    return Instants(after.ns - max(width, 0.0) / 2, u_s, after.u_s, after.restarted, after.wrong, held)


def _of_own_cycle(asked: Instants, values: Array, timing: Timing) -> Instants:
    """The instants of answers to requests, with readings (n, k) mm of a cycle that runs by itself."""
    cycle_ns = None if timing.cycle_ms is None else timing.cycle_ms * 1e6
    if cycle_ns is None and not repeats(values):
        return asked
    doubts: tuple[TimingDoubt, ...] = ()
    if ticks := through_cycle(asked.ns, values, cycle_ns):
        if cycle_ns is None or not ticks.steady:
            doubts = (TimingDoubt(_FOUND if ticks.steady else _UNEVEN, ticks.period_ns / 1e6),)
        if ticks.period_ns > _SPARSE_NS:
            doubts = (*doubts, TimingDoubt(_SPARSE, ticks.period_ns / 1e6))
        u_s = math.hypot(asked.u_s, ticks.u_s)
        return replace(asked, ns=ticks.ns, u_s=u_s, own_u_s=ticks.own_u_s, doubts=doubts)
    seen = changes(asked.ns, values)
    if seen.repeating and (cycle_ns is None or seen.usual_ns > _LONGER * cycle_ns):
        cycle_ns, doubts = seen.usual_ns, (TimingDoubt(_NOT_SEEN, seen.usual_ns / 1e6),)
    if cycle_ns is None:
        return asked
    own_u_s, shared_u_s = anywhere_in_a_cycle(asked.ns, cycle_ns)
    return replace(
        asked,
        ns=asked.ns - cycle_ns / 2,
        u_s=math.hypot(asked.u_s, shared_u_s),
        own_u_s=np.hypot(asked.own_u_s, own_u_s),
        doubts=doubts,
    )


def _spread(window: Array) -> float:
    low, high = np.quantile(window, (0.25, 0.75))
    return float(high - low)


def robot_instants(stream: Columns) -> Instants:
    """When each position was reported.

    A controller reports what it latched at some time in the cycle before: one cycle is what stays unknown. One that is
    asked over a network (registers) read its position between request and answer.
    """
    if (stream["requested_ns"] >= 0).all():
        asked_ns = stream["requested_ns"].astype(float)
        return asked_instants(asked_ns, np.maximum(stream["first_byte_ns"] - asked_ns, 0.0), held=False)
    stream, doubts = _without_standing_clock(stream)
    fitted = _by_any_clock(stream["device_time_s"], stream["first_byte_ns"].astype(float))
    arrived = not np.isfinite(stream["device_time_s"]).all()
    # The usual time from one message to the next; those that a network bundles share the time since the bundle before.
    at, count = np.unique(fitted.ns, return_counts=True)
    cycle_ns = float(np.median(np.repeat(np.diff(at) / count[1:], count[1:]))) if len(at) > 1 else 0.0
    return replace(_listened(fitted, cycle_ns), arrived=arrived, doubts=doubts)


def _streamed(device_s: Array, set_out: Array, character_ns: int) -> Instants:
    """A reading sent without a request was latched as its answer set out, or up to a character before."""
    fitted = _by_any_clock(device_s, set_out)
    # The timer of an adapter that holds back bytes which come unasked and unevenly: all arrive multiples of it apart.
    late, timer_ns, steps = set_out - fitted.ns, 0.0, np.diff(set_out[:_SAMPLE])
    if len(steps) >= 2 * _STIRRED:
        timers = np.arange(_HOLDS_NS, _TIMER_NS, -1e6)
        uneven = timers[np.ptp(np.quantile(steps, _MOST)) > timers / 2]
        in_step = np.abs(np.exp(2j * np.pi * steps / uneven[:, None]).mean(axis=1)) > _IN_STEP
        timer_ns = float(uneven[in_step].max(initial=0.0))
    if np.isfinite(device_s).all() or _keeps_pace(late, timer_ns):
        return _listened(fitted, character_ns)
    # It is unknown when in the timer's run it came, and how much of the unevenness is the way's.
    open_ns = timer_ns or float(np.ptp(np.quantile(np.diff(set_out), _MOST)))
    own_u_s = np.full(len(set_out), _anywhere_in(open_ns))
    u_s = math.hypot(character_ns / math.sqrt(3) / 1e9, _HOST_S)
    return Instants(set_out - timer_ns / 2, u_s, own_u_s, held=timer_ns > 0)


def _listened(fitted: FittedClock, before_ns: float) -> Instants:
    """What is latched at some time in so many ns before the times fitted."""
    u_s = math.hypot(before_ns / math.sqrt(3) / 1e9, fitted.shared_u_s)
    return Instants(fitted.ns, u_s, fitted.u_s, fitted.restarted, fitted.wrong, wanders_s=fitted.wanders_s)


def _keeps_pace(late: Array, timer_ns: float) -> bool:
    """Whether messages late (n,) ns against a pace are late by the way: each for itself, or by a timer.

    Those of an uneven pace drift away from any line through them, by little from one to the next; and where no pace
    was found they are not late at all.
    """
    if len(late) < 2 or not late.any():
        return len(late) < 2
    spread = float(np.ptp(np.quantile(late, _MOST)))
    if timer_ns:
        return spread < timer_ns
    if spread < _TIMER_NS:
        return True
    from_one_to_next = float(np.median(np.abs(np.diff(late))))
    about = float(np.median(np.abs(late - np.median(late))))
    return from_one_to_next > _DRIFTING * about


def _by_any_clock(device_s: Array, host_ns: Array) -> FittedClock:
    return through_clock(device_s, host_ns) if np.isfinite(device_s).all() else through_pace(host_ns)


def asked_instants(went_through: Array, window: Array, held: bool) -> Instants:
    """Between the request and the answer, as the clocks of two computers are compared (NTP): in the middle of windows
    (n,) ns after the request went through (n,) ns.

    Behind an adapter that holds bytes back only the quickest answer of the run shows how long the instrument takes: the
    time that another takes beyond that is the adapter's.
    """
    shortest = float(np.partition(window, 1)[:2].max())  # the very shortest may be a stamp that is wrong
    if held:
        # The computer was held up, before or after the reading.
        holds_ns = max(_HOLDS_NS, _HOLDS * (float(np.quantile(window, 0.9)) - shortest))
        own_u_s = _anywhere_in(np.maximum(window - shortest - holds_ns, 0.0))
        window = np.minimum(window, shortest)
        return Instants(went_through + window / 2, math.hypot(_anywhere_in(shortest), _HIDDEN_S), own_u_s, held=held)
    own_u_s = _anywhere_in(np.sqrt(np.maximum(window**2 - shortest**2, 0.0)))
    return Instants(went_through + window / 2, math.hypot(_anywhere_in(shortest), _HOST_S), own_u_s)


def _anywhere_in(window_ns: Any) -> Any:
    """Standard uncertainty, in s, of the middle of a window when the truth may be anywhere in it."""
    return window_ns / math.sqrt(12) / 1e9
