"""Determine measurement times from host timestamps, transmission times and instrument clocks.

A byte can only arrive late. A requested reading was taken after the request was transmitted and before the answer was
sent. The best estimate is the tightest bound of all timestamps; the remaining interval is the uncertainty, in part
common to all readings.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from analysis.robot.kinematics.arm import Array
from analysis.runs.own_clock import FittedClock, is_stalled, through_clock, through_pace
from analysis.runs.own_cycle import anywhere_in_a_cycle, changes, repeats
from rigs.schema.gauges import Gauge
from rigs.schema.links import tcp_address
from rigs.schema.probe import Timing

_HIDDEN_S = 1e-3
"""Variation of an instrument's answer time that a buffering adapter can hide."""

_HOLDS_NS = 25e6
"""Longest delay by a buffering adapter: 16 ms plus transmission, or _HOLDS times the 90 % quantile of answer times."""
_HOLDS = 1.5
"""Factor for the 90 % quantile of the answer times. Delays above both bounds are caused by a stalled computer."""
_HOST_S = 30e-6
"""Resolution of host timestamps."""
_TIMER_NS = 3e6
"""Shortest detectable timer period of an adapter. A shorter one is hidden by the general variation."""
_MOST = (0.05, 0.95)
_DRIFTING = 0.7
"""Ratio of successive differences to the scatter about a steady rate below which the rate drifts. Independent delays
have a ratio of 1.2 to 1.4.
"""
_IN_STEP = 0.9
"""Smallest mean cosine of the phases of arrivals that indicates a timer, with a period of whole milliseconds."""
_SAMPLE = 20_000
"""Number of messages used to detect a timer."""
_STIRRED = 5
_STIRRED_NS = 2e6
"""Variation of answer times that reveals a buffering adapter.

At least _STIRRED requests must start some time after the previous answer (`daq.protocol.polled` gives the reason).
"""

_SPARSE_NS = 50e6
"""Interval of readings above which one gauge may show backlash long before the other.

A reversal crosses backlash in about ten milliseconds; this limit is five times longer.
"""
_SPARSE = (
    "the readings are {:.0f} ms apart, too far to follow the reversal of a joint: one gauge shows it before the "
    "other, which may increase a band; drive the circle more slowly"
)
_NOT_ADVANCING = "the instrument clock does not advance and is not used; check the instrument"
_REPEATED = (
    "the readings repeat while it moves, in a cycle of some {:.0f} ms; each gets the time of the first copy, with "
    "a wider u; see timing in the rig file and the instrument's manual"
)

Columns = Mapping[str, np.ndarray[Any, Any]]


@dataclass(frozen=True)
class Instants:
    """Times of samples on the host's clock, with the common (u_s) and the individual (own_u_s) standard uncertainty.

    wrong: ignored timestamps. held: an adapter buffers bytes. wanders_s: permanent changes in the delay of a steadily
    sending instrument. arrived: the times are arrivals, which bundled network messages share.
    """

    ns: Array
    u_s: float
    own_u_s: Array
    restarts: int = 0
    wrong: int = 0
    held: bool = False
    wanders_s: float = 0.0
    arrived: bool = False
    doubts: tuple[str, ...] = ()


def gauge_instants(stream: Columns, gauge: Gauge) -> Instants:
    """Time at which each gauge reading was true: the middle of the filter's averaging interval."""
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


def _without_standing_clock(stream: Columns) -> tuple[Columns, tuple[str, ...]]:
    if not is_stalled(stream["device_time_s"]):
        return stream, ()
    return {**stream, "device_time_s": np.full(len(stream["device_time_s"]), np.nan)}, (_NOT_ADVANCING,)


def _requested(stream: Columns, went_through: Array, set_out: Array, timing: Timing) -> Instants:
    set_out = set_out - timing.answer_delay_ms * 1e6
    window = np.maximum(set_out - went_through, 0.0)
    if timing.latched_within_ms is not None:
        window = np.minimum(window, timing.latched_within_ms * 1e6)
    # An adapter buffers bytes if answers to out-of-step requests scatter more. The comparison uses quartiles, because a
    # busy host delays some answers of both kinds, while an adapter delays most of the out-of-step ones.
    idle_before = stream["requested_ns"][1:] > stream["last_byte_ns"][:-1]
    in_step, stirred = window[1:][~idle_before], window[1:][idle_before]
    held = min(len(in_step), len(stirred)) >= _STIRRED and _spread(stirred) > 2 * _spread(in_step) + _STIRRED_NS
    device_s = stream["device_time_s"]
    if not np.isfinite(device_s).all():
        return asked_instants(went_through, window, held)
    # The instrument's clock lies between two lines: a reading is taken after its request and before its answer. A gauge
    # that answers with a reading older than the request violates the first bound. In this case only the second is used.
    after = through_clock(device_s, set_out)
    before = through_clock(-device_s[::-1], -went_through[::-1])
    width = float(np.median(after.ns + before.ns[::-1]))
    u_s = math.hypot(_anywhere_in(abs(width)), _HIDDEN_S if held else _HOST_S)
    return Instants(after.ns - max(width, 0.0) / 2, u_s, after.u_s, after.restarts, after.wrong, held)


def _of_own_cycle(asked: Instants, values: Array, timing: Timing) -> Instants:
    cycle_ns = None if timing.cycle_ms is None else timing.cycle_ms * 1e6
    if cycle_ns is None and not repeats(values):
        return asked
    found = changes(asked.ns, values)
    if found.repeating:
        doubts = [] if cycle_ns else [_REPEATED.format(found.usual_ns / 1e6)]
        doubts += [_SPARSE.format(found.usual_ns / 1e6)] if found.usual_ns > _SPARSE_NS else []
        ns, own_u_s = found.of_first_copies(asked.ns)
        return replace(asked, ns=ns, own_u_s=own_u_s, doubts=tuple(doubts))
    if cycle_ns is None:
        return asked
    own_u_s, shared_u_s = anywhere_in_a_cycle(asked.ns, cycle_ns)
    return replace(
        asked,
        ns=asked.ns - cycle_ns / 2,
        u_s=math.hypot(asked.u_s, shared_u_s),
        own_u_s=np.hypot(asked.own_u_s, own_u_s),
    )


def _spread(window: Array) -> float:
    low, high = np.quantile(window, (0.25, 0.75))
    return float(high - low)


def robot_instants(stream: Columns) -> Instants:
    """Times of reported positions.

    A controller reports a value latched during the previous cycle, so the uncertainty is one cycle. A controller polled
    over a network (registers) was read between request and answer.
    """
    if (stream["requested_ns"] >= 0).all():
        asked_ns = stream["requested_ns"].astype(float)
        return asked_instants(asked_ns, np.maximum(stream["first_byte_ns"] - asked_ns, 0.0), held=False)
    stream, doubts = _without_standing_clock(stream)
    fitted = _by_any_clock(stream["device_time_s"], stream["first_byte_ns"].astype(float))
    arrived = not np.isfinite(stream["device_time_s"]).all()
    # Usual interval of messages. Bundled messages share the interval since the previous bundle.
    at, count = np.unique(fitted.ns, return_counts=True)
    cycle_ns = float(np.median(np.repeat(np.diff(at) / count[1:], count[1:]))) if len(at) > 1 else 0.0
    return replace(_listened(fitted, cycle_ns), arrived=arrived, doubts=doubts)


def _streamed(device_s: Array, set_out: Array, character_ns: int) -> Instants:
    fitted = _by_any_clock(device_s, set_out)
    # An adapter that buffers uneven unprompted bytes releases them by a timer, at multiples of its period.
    late, timer_ns, steps = set_out - fitted.ns, 0.0, np.diff(set_out[:_SAMPLE])
    if len(steps) >= 2 * _STIRRED:
        timers = np.arange(_HOLDS_NS, _TIMER_NS, -1e6)
        uneven = timers[np.ptp(np.quantile(steps, _MOST)) > timers / 2]
        in_step = np.abs(np.exp(2j * np.pi * steps / uneven[:, None]).mean(axis=1)) > _IN_STEP
        timer_ns = float(uneven[in_step].max(initial=0.0))
    if np.isfinite(device_s).all() or _keeps_pace(late, timer_ns):
        return _listened(fitted, character_ns)
    # Two quantities are unknown: the arrival within the timer period, and the part of the variation due to
    # transmission.
    open_ns = timer_ns or float(np.ptp(np.quantile(np.diff(set_out), _MOST)))
    own_u_s = np.full(len(set_out), _anywhere_in(open_ns))
    u_s = math.hypot(character_ns / math.sqrt(3) / 1e9, _HOST_S)
    return Instants(set_out - timer_ns / 2, u_s, own_u_s, held=timer_ns > 0)


def _listened(fitted: FittedClock, before_ns: float) -> Instants:
    """Times of readings latched at most before_ns before the fitted times."""
    u_s = math.hypot(before_ns / math.sqrt(3) / 1e9, fitted.shared_u_s)
    return Instants(fitted.ns, u_s, fitted.u_s, fitted.restarts, fitted.wrong, wanders_s=fitted.wanders_s)


def _keeps_pace(late: Array, timer_ns: float) -> bool:
    """True if delays late (n,) ns relative to a steady rate are caused by transmission.

    Such delays are independent, or multiples of a timer period. If the rate is not steady, they drift in small steps.
    """
    if len(late) < 2 or not late.any():
        return len(late) < 2
    most_ns = timer_ns or _TIMER_NS
    if np.ptp(late) < most_ns or np.ptp(np.quantile(late, _MOST)) < most_ns:  # the quantiles only if necessary
        return True
    if timer_ns:
        return False
    from_one_to_next = float(np.median(np.abs(np.diff(late))))
    about = float(np.median(np.abs(late - np.median(late))))
    return from_one_to_next > _DRIFTING * about


def _by_any_clock(device_s: Array, host_ns: Array) -> FittedClock:
    return through_clock(device_s, host_ns) if np.isfinite(device_s).all() else through_pace(host_ns)


def asked_instants(went_through: Array, window: Array, held: bool) -> Instants:
    """Middle of the windows (n,) ns between request and answer, as in NTP.

    Behind a buffering adapter only the fastest answer shows the instrument's answer time.
    """
    shortest = float(np.partition(window, 1)[:2].max())  # the second shortest: the shortest may have a wrong timestamp
    if held:
        # Delays beyond this bound are stalls of the computer before or after the reading.
        holds_ns = max(_HOLDS_NS, _HOLDS * (float(np.quantile(window, 0.9)) - shortest))
        own_u_s = _anywhere_in(np.maximum(window - shortest - holds_ns, 0.0))
        window = np.minimum(window, shortest)
        return Instants(went_through + window / 2, math.hypot(_anywhere_in(shortest), _HIDDEN_S), own_u_s, held=held)
    own_u_s = _anywhere_in(np.sqrt(np.maximum(window**2 - shortest**2, 0.0)))
    return Instants(went_through + window / 2, math.hypot(_anywhere_in(shortest), _HOST_S), own_u_s)


def _anywhere_in(window_ns: Any) -> Any:
    """Standard uncertainty in s of the middle of a window in ns: a uniform distribution."""
    return window_ns / math.sqrt(12) / 1e9
