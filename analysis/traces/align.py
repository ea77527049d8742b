"""From a recorded run to one table: each gauge reading beside the joint angles at the same instant.

Gauge 1 sets the rows; the other gauge and the robot are interpolated to its instants. A row is left out,
and counted, where either has a gap there: a straight line across missing data is not a measurement.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.kinematics.arm import Array
from analysis.traces.clocks import Columns, Instants, gauge_instants, robot_instants
from analysis.traces.lower_hull import Mask
from analysis.traces.stream_checks import LARGEST_DEG, LONGEST_MM, is_reading, require_sound
from daq.store import Run
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.vocabulary import CIRCLES, TestName

_GAP = 4.0
"""A gap is this many times the usual distance between samples, …"""
MOVES_NS = 25e6
"""… and of a robot's longer than this: a quarter of a cycle of the quickest vibration an arm shows, some 10 Hz; …"""
JUMPS_NS = 5e6
"""… of a gauge's longer than this: where a joint turns back, a play is crossed in some ten milliseconds."""
_OFTEN = 0.05
"""Rows left out for gaps of a gauge are reported where they are a larger share than this, or a gap is as long as a
robot's: rigd itself makes each polled gauge wait now and then (daq.protocol.polled), for less."""
_BLOCK = 1 << 14
"""Rows at a time, so that what is computed of them stays in the processor's cache."""
_STALLED = 5.0
"""A row's time is doubtful where its own uncertainty is so many times the usual, …"""
_TOGETHER = {
    True: "they arrived together with a later one; have each message sent at once (TCP_NODELAY), or with its own time",
    False: "they have the same time as one before; have the instrument send its time in finer steps",
}
"""Why rows share an instant, by whether their times are arrivals, and what to do."""
_STALLED_S = 1e-3
"""… and more than this: a shorter doubt is borne by the figures' uncertainty."""

Streams = Mapping[str, Columns]
"""The columns of each stream by its name."""
WANDERS_S = 1e-3
"""Deviations from the pace up to this size are not reported: the uncertainty of the figures includes them."""


@dataclass(frozen=True)
class Aligned:
    """A run as one table.

    t_s (n,) since its first row; q (n, 6) rad as reported; g_mm (n, k) of g1 and, on a circle, g2. Of the gauges' time
    against the robot's the standard uncertainty u_lag_s is common to all rows, and u_t_s (n,) each row's own beside
    it. doubts: what a person should know before trusting it, in words.
    """

    t_s: Array
    q: Array
    g_mm: Array
    u_lag_s: float
    u_t_s: Array
    doubts: tuple[str, ...]


@dataclass(frozen=True)
class _Track:
    """Values (n, k) of one instrument at increasing times (n,) ns, and the uncertainty of each in s: that which all
    share, and what each row (n,) has beside it."""

    ns: Array
    values: Array
    u_s: float
    own_u_s: Array


def align(path: Path, run: Run, rig: Rig) -> Aligned:
    """One table of a run. Raises FileError where a stream is missing or has nothing in common with the rest."""
    return align_streams(path, run.streams, run.manifest.test, rig)


def align_streams(path: Path, streams: Streams, test: TestName, rig: Rig) -> Aligned:
    """One table of the streams of a test; path: names them in errors. Raises FileError as `align` does.

    At targets gauge 1 alone measures: whether there is a second, and how it reads, is nothing to them.
    """
    doubts: list[str] = []
    names = [name for name, _ in rig.gauges] if test in CIRCLES else ["g1"]
    gauges = [_gauge(path, streams, test, rig, name, doubts) for name in names]
    robot = _robot(path, streams, doubts)
    for name, track in zip([*names, "robot"], [*gauges, robot], strict=True):
        if len(track.ns) < 2:
            raise FileError(
                str(path),
                f"holds fewer than two readings of {name} at known times",
                "record again, and check the rates with rig status",
            )
    rows_ns = gauges[0].ns
    keep = np.ones(len(rows_ns), dtype=bool)
    for name, track in zip([*names[1:], "robot"], [*gauges[1:], robot], strict=True):
        begin, end = np.searchsorted(rows_ns, track.ns[0]), np.searchsorted(rows_ns, track.ns[-1], side="right")
        keep[:begin], keep[end:] = False, False
        gaps = gaps_ns(rows_ns, track.ns, MOVES_NS if track is robot else JUMPS_NS)
        keep &= gaps == 0
        gaps = gaps[begin:end][gaps[begin:end] > 0]
        if are_many(gaps, len(rows_ns)):
            doubts.append(f"{name}: {len(gaps)} rows are left out at gaps")
    if keep.sum() < 2:
        raise FileError(
            str(path), "gauges and robot were never recorded at the same time", "record both through the whole test"
        )
    rows_ns = rows_ns if keep.all() else rows_ns[keep]
    u_lag_s = float(np.hypot(max(gauge.u_s for gauge in gauges), robot.u_s))
    own_u_s = _own_u_s(rows_ns, gauges, robot)
    g_mm = _columns_at(rows_ns, gauges)
    return Aligned((rows_ns - rows_ns[0]) / 1e9, _columns_at(rows_ns, [robot]), g_mm, u_lag_s, own_u_s, tuple(doubts))


def robot_alone(path: Path, run: Run) -> tuple[Array, Array, tuple[str, ...]]:
    """Times (n,) s since the first and reported angles (n, 6) rad of a recorded run whose gauges need not have read,
    and doubts in words. Raises FileError where the robot was not recorded."""
    doubts: list[str] = []
    track = _robot(path, run.streams, doubts)
    if len(track.ns) < 2:
        what = "holds fewer than two readings of robot at known times"
        raise FileError(str(path), what, "record again, and check the rates with rig status")
    return (track.ns - track.ns[0]) / 1e9, track.values, tuple(doubts)


def _columns_at(rows_ns: Array, tracks: Sequence[_Track]) -> Array:
    """Values (n, k) of all tracks side by side at the times of the rows (n,), which each track spans, in blocks."""
    at_rows = np.empty((len(rows_ns), sum(track.values.shape[1] for track in tracks)))
    first = 0
    for track in tracks:
        columns = slice(first, first := first + track.values.shape[1])
        if track.values.shape[1] == 1:
            at_rows[:, first - 1] = (
                track.values[:, 0] if track.ns is rows_ns else np.interp(rows_ns, track.ns, track.values[:, 0])
            )
            continue
        for begin in range(0, len(rows_ns), _BLOCK):
            rows = slice(begin, begin + _BLOCK)
            at_rows[rows, columns] = _values_at(rows_ns[rows], track)
    return at_rows


def _values_at(rows_ns: Array, track: _Track) -> Array:
    """Values (n, k) of a track on the chords between its rows, at times (n,) that increase and that it spans."""
    begin = max(int(np.searchsorted(track.ns, rows_ns[0], side="right")) - 1, 0)
    end = int(np.searchsorted(track.ns, rows_ns[-1], side="left")) + 1
    ns, values = track.ns[begin:end], track.values[begin:end]
    if len(ns) < 2:
        return np.broadcast_to(values[:1], (len(rows_ns), values.shape[1]))
    # Where each row of the track lies among the rows says for all rows between which two they are.
    passed = np.searchsorted(rows_ns, ns[1:-1], side="left")
    before = np.repeat(np.arange(len(ns) - 1), np.diff(passed, prepend=0, append=len(rows_ns)))
    share = (rows_ns - ns[before]) / np.diff(ns)[before]
    chords = np.diff(values, axis=0)[before]
    chords *= share[:, None]
    chords += values[before]
    return chords


def are_many(gaps: Array, rows: int) -> bool:
    """Whether gaps (n,) ns of the rows left out are more than what rigd itself makes a gauge wait."""
    return len(gaps) > 0 and bool(gaps.max() > MOVES_NS or len(gaps) > _OFTEN * rows)


def _own_u_s(rows_ns: Array, gauges: Sequence[_Track], robot: _Track) -> Array:
    """The uncertainty (n,) s of each row: the less certain gauge's and the robot's together."""
    own_u_s = np.zeros(len(rows_ns))
    for track, together in [*((gauge, np.maximum) for gauge in gauges), (robot, np.hypot)]:
        if track.own_u_s.any():
            own_u_s = together(own_u_s, np.interp(rows_ns, track.ns, track.own_u_s))
    return own_u_s


def _gauge(path: Path, streams: Streams, test: TestName, rig: Rig, name: str, doubts: list[str]) -> _Track:
    """Readings (n, 1) mm of one gauge, which grow with the distance from the ball however it counts."""
    stream = _own_rows(_stream(path, streams, [f"{name}_mm"], f"gauge {name}", LONGEST_MM), rig, name)
    instants = gauge_instants(stream, dict(rig.gauges)[name])
    doubts.extend(timing_doubts(name, instants))
    if doubtful := int(np.count_nonzero(stream["status"])):
        doubts.append(f"{name}: {doubtful} readings are marked doubtful by the gauge itself")
    values = dict(rig.gauges)[name].sign * stream[f"{name}_mm"][:, None]
    sound = is_reading(values, LONGEST_MM)
    if test in CIRCLES and rig.tests.circle:
        # With the ball inside the circle no link is ever longer than twice its radius.
        sound &= is_reading(values - np.median(values[sound]), 2 * rig.tests.circle.radius_mm)
    return _track(name, instants, values, sound, doubts)


def _own_rows(stream: Columns, rig: Rig, name: str) -> Columns:
    """The rows of a stream that are of one gauge: on a line where each is asked by itself the others are not."""
    gauge, column = dict(rig.gauges)[name], f"{name}_mm"
    if not gauge.bus or sum(key.endswith("_mm") for key in stream) < 2:
        return stream
    own = np.isfinite(stream[column])
    return {key: values[own] for key, values in stream.items() if not key.endswith("_mm") or key == column}


def _robot(path: Path, streams: Streams, doubts: list[str]) -> _Track:
    """Joint angles (n, 6) rad as reported."""
    columns = [f"q{axis}_deg" for axis in range(1, 7)]
    stream = _stream(path, streams, columns, "the robot", LARGEST_DEG)
    instants = robot_instants(stream)
    doubts.extend(timing_doubts("robot", instants))
    q_deg = np.stack([stream[column] for column in columns], axis=1)
    return _track("robot", instants, np.radians(q_deg), is_reading(q_deg, LARGEST_DEG), doubts)


def timing_doubts(name: str, instants: Instants) -> list[str]:
    """What a person should know before trusting the times of an instrument, in words."""
    doubts = []
    if instants.restarts:
        doubts.append(f"{name}: its clock restarted {instants.restarts} times and is fitted in pieces")
    if instants.wrong:
        doubts.append(
            f"{name}: {instants.wrong} stamps of its clock are impossible; these rows take the time of their arrival"
        )
    if instants.wanders_s > WANDERS_S:
        doubts.append(
            f"{name}: its messages deviate from their steady pace by {1e3 * instants.wanders_s:.1f} ms: it waited, or "
            "they came later for good; the uncertainty covers both; record again on a computer that is less busy"
        )
    if instants.held:
        doubts.append(f"{name}: its adapter holds bytes back, which adds uncertainty; set its latency_timer to 1 ms")
    return [*doubts, *(f"{name}: {words}" for words in instants.doubts)]


def _track(name: str, instants: Instants, values: Array, sound: Mask, doubts: list[str]) -> _Track:
    """The values in order of time, without rows that hold no reading or whose time is unknown, and one of each instant:
    of messages that arrived together the last, which the others waited for, and of a clock with coarse steps the first.
    """
    if odd := int((~sound).sum()):
        doubts.append(f"{name}: {odd} rows that hold no valid reading are left out; check it and its connection")
    usual_s = float(np.median(instants.own_u_s[sound])) if sound.any() else 0.0
    there = sound & (instants.own_u_s <= max(_STALLED * usual_s, _STALLED_S))
    if stalled := int((sound & ~there).sum()):
        doubts.append(
            f"{name}: {stalled} rows are left out because their time is too uncertain: "
            "the computer was held up, or a stamp was wrong"
        )
    ns, own_u_s = instants.ns, instants.own_u_s
    if not there.all():
        ns, values, own_u_s = ns[there], values[there], own_u_s[there]
    if not (ns[1:] > ns[:-1]).all():
        order = np.argsort(ns, kind="stable")
        differs = np.diff(ns[order]) > 0
        is_kept = np.append(differs, True) if instants.arrived else np.insert(differs, 0, True)
        kept, instant = order[is_kept], np.cumsum(np.insert(differs, 0, False))
        if dropped := int((values[order] != values[kept][instant]).any(axis=1).sum()):
            doubts.append(f"{name}: {dropped} rows are left out because {_TOGETHER[instants.arrived]}")
        ns, values, own_u_s = ns[kept], values[kept], own_u_s[kept]
    return _Track(ns, values, instants.u_s, own_u_s)


def _stream(path: Path, streams: Streams, columns: Sequence[str], what: str, largest: float) -> Columns:
    for stream in streams.values():
        if all(column in stream and is_reading(stream[column][:, None], largest).sum() > 1 for column in columns):
            require_sound(path, what, stream)
            return stream
    raise FileError(str(path), f"holds no readings of {what}", "connect it, check it with rig status, and record again")


def gaps_ns(rows: Array, times: Array, short_ns: float) -> Array:
    """How far apart (n,) ns the two of `times` (m,) ns are that rows (n,) ns lie between: 0 where no further than
    usual, or hardly, and where a row is of one of those times. Both increase."""
    apart = np.diff(times)
    wide = np.flatnonzero(apart > max(short_ns, _GAP * np.median(apart)))
    begins, ends = np.searchsorted(rows, times[wide], side="right"), np.searchsorted(rows, times[wide + 1], side="left")
    gaps = np.zeros(len(rows))
    for begin, end, gap in zip(begins.tolist(), ends.tolist(), apart[wide].tolist(), strict=True):
        gaps[begin:end] = gap
    return gaps
