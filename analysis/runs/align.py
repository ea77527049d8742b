"""Align a recorded run to one table: each gauge reading with the joint angles at the same instant.

Gauge 1 defines the rows; the second gauge and the robot are interpolated to its instants. Rows in a gap of either
stream are dropped and counted, because interpolation across missing data is not a measurement.

A run is refused if a stream contains timestamps that `rigd` cannot have written: such a stream was modified.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from analysis.robot.kinematics.arm import Array, Mask
from analysis.runs.clocks import Columns, Instants, gauge_instants, robot_instants
from daq.store import Run
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.vocabulary import CIRCLES, TestName
from rigs.text import counted

LONGEST_MM = 1e5
"""Largest gauge reading: 100 m, the bound of lengths in a rig file (`rigs.schema.part.Length`)."""
LARGEST_DEG = 36e3
"""Largest joint angle: 100 turns."""
_LATEST_NS = 2**61
"""Largest timestamp of a monotonic clock, which starts with the computer: 73 years."""
_LONGEST_MESSAGE = 65_536
"""Largest message in bytes, the size of a UDP datagram. No protocol sends longer messages."""


def require_sound(path: Path, instrument: str, columns: Mapping[str, np.ndarray[Any, Any]]) -> None:
    """Raise FileError if `rigd` cannot have written these columns (n,): timestamps in ns and sizes in bytes."""
    requested, first, last = (columns[name] for name in ("requested_ns", "first_byte_ns", "last_byte_ns"))
    rules = {
        "an impossible stamp": (first < 0) | (last > _LATEST_NS),
        "a first byte later than the last": first > last,
        "a request later than the answer": requested > last,
        "a timestamp earlier than the timestamp of the previous row": np.append(False, last[1:] < last[:-1]),
        "an impossible message size": (columns["size"] < 0) | (columns["size"] > _LONGEST_MESSAGE),
    }
    for words, broken in rules.items():
        if broken.any():
            row = int(broken.argmax()) + 1
            raise FileError(
                str(path),
                f"row {row} of {instrument} has {words}",
                "restore the run from a copy",
                code="run.damaged",
            )


def is_reading(values: Array, largest: float) -> Mask:
    """Mask of the rows of values (n, k) in which all numbers are finite and at most `largest` in magnitude."""
    sound = np.ones(len(values), dtype=bool)
    for column in values.T:  # column by column, to use no more memory than the result
        sound &= column <= largest
        sound &= column >= -largest
    return sound


_GAP = 4.0
"""Threshold of a gap: this multiple of the usual sampling interval, and at least MOVES_NS or JUMPS_NS."""
MOVES_NS = 25e6
"""Shortest gap of a robot: a quarter period of the fastest arm vibration, about 10 Hz."""
JUMPS_NS = 5e6
"""Shortest gap of a gauge: at a reversal, backlash is crossed in about ten milliseconds."""
_OFTEN = 0.05
"""Minimum share of rows in gaps of a gauge for the gaps to be reported. A smaller share is reported only if a gap is
as long as a gap of the robot, because rigd itself occasionally delays polled gauges (daq.protocol.polled).
"""
_BLOCK = 1 << 14
"""Rows per block, to fit the processor's cache."""
_STALLED = 5.0
"""Threshold of a doubtful row time: this multiple of the usual individual uncertainty, and at least _STALLED_S."""
_TOGETHER = {
    True: "arrival together with a later one; have each message sent immediately (TCP_NODELAY), or with a timestamp",
    False: "the same timestamp as the previous message; use timestamps with a finer resolution",
}
"""Reasons for rows with equal times, with remedies; the key states whether the times are arrivals."""
_STALLED_S = 1e-3
"""Smallest doubtful uncertainty. Smaller ones are included in the uncertainty of the figures."""

Streams = Mapping[str, Columns]
"""Columns of each stream by name."""
WANDERS_S = 1e-3
"""Largest deviation from a steady rate that is not reported. It is included in the uncertainty of the figures."""


@dataclass(frozen=True)
class Aligned:
    """A run as one table: times t_s (n,) since the first row, reported angles q (n, 6) rad, readings g_mm (n, k).

    u_lag_s: standard uncertainty of the gauges' time relative to the robot's, common to all rows. u_t_s (n,):
    individual part.
    """

    t_s: Array
    q: Array
    g_mm: Array
    u_lag_s: float
    u_t_s: Array
    doubts: tuple[str, ...]


@dataclass(frozen=True)
class InstrumentTrack:
    """Values (n, k) of an instrument at increasing times (n,) ns, with common and individual (n,) uncertainty in s."""

    name: str
    ns: Array
    values: Array
    u_s: float
    own_u_s: Array
    doubts: tuple[str, ...]


def align(path: Path, streams: Streams, test: TestName, rig: Rig) -> Aligned:
    """Align the streams of a test; tests at targets use gauge 1 only.

    Raises FileError if a stream is missing or has no common time with the others.
    """
    names = [name for name, _ in rig.gauges] if test in CIRCLES else ["g1"]
    gauges = [_gauge(path, streams, test, rig, name) for name in names]
    robot = _robot(path, streams)
    rows_ns = gauges[0].ns
    keep = np.ones(len(rows_ns), dtype=bool)
    doubts = [doubt for track in (*gauges, robot) for doubt in track.doubts]
    for track in (*gauges[1:], robot):
        begin, end = np.searchsorted(rows_ns, track.ns[0]), np.searchsorted(rows_ns, track.ns[-1], side="right")
        keep[:begin], keep[end:] = False, False
        gaps = gaps_ns(rows_ns, track.ns, MOVES_NS if track is robot else JUMPS_NS)
        keep &= gaps == 0
        gaps = gaps[begin:end][gaps[begin:end] > 0]
        if len(gaps) and are_many(len(gaps), float(gaps.max()), len(rows_ns)):
            doubts.append(f"{_left_out(track.name, len(gaps))} at gaps")
    if np.count_nonzero(keep) < 2:
        problem = "gauges and robot were never recorded at the same time"
        raise FileError(str(path), problem, "record both through the whole test", code="readings.unsuitable")
    rows_ns = rows_ns if keep.all() else rows_ns[keep]
    u_lag_s = float(np.hypot(max(track.u_s for track in gauges), robot.u_s))
    own_u_s = np.zeros(len(rows_ns))  # per row: uncertainty of the less certain gauge, combined with that of the robot
    for track, together in [*((gauge, np.maximum) for gauge in gauges), (robot, np.hypot)]:
        if track.own_u_s.any():
            own_u_s = together(own_u_s, np.interp(rows_ns, track.ns, track.own_u_s))
    t_s, q, g_mm = (rows_ns - rows_ns[0]) / 1e9, _columns_at(rows_ns, [robot]), _columns_at(rows_ns, gauges)
    return Aligned(t_s, q, g_mm, u_lag_s, own_u_s, tuple(doubts))


def _left_out(name: str, count: int) -> str:
    return f"{name}: {counted(count, 'row is', 'rows are')} ignored"


def robot_only(path: Path, run: Run) -> tuple[Array, Array, tuple[str, ...]]:
    """Times (n,) s since the first row, reported angles (n, 6) rad, and doubts. Raises FileError without a robot."""
    track = _robot(path, run.streams)
    return (track.ns - track.ns[0]) / 1e9, track.values, track.doubts


def _columns_at(rows_ns: Array, tracks: Sequence[InstrumentTrack]) -> Array:
    """Values (n, k) of all tracks at increasing times (n,) ns, which each track must span, in blocks."""
    at_rows = np.empty((len(rows_ns), sum(track.values.shape[1] for track in tracks)), order="F")
    first = 0
    for track in tracks:
        columns = slice(first, first := first + track.values.shape[1])
        if track.values.shape[1] == 1:
            at_rows[:, first - 1] = (
                track.values[:, 0] if track.ns is rows_ns else np.interp(rows_ns, track.ns, track.values[:, 0])
            )
            continue
        for first_row in range(0, len(rows_ns), _BLOCK):
            rows = slice(first_row, first_row + _BLOCK)
            at_ns = rows_ns[rows]
            begin = max(int(np.searchsorted(track.ns, at_ns[0], side="right")) - 1, 0)
            end = int(np.searchsorted(track.ns, at_ns[-1], side="left")) + 1
            ns, values = track.ns[begin:end], track.values[begin:end]
            if len(ns) < 2:
                at_rows[rows, columns] = values[:1]
                continue
            # The positions of the track's rows among the requested times give the interval of each time.
            passed = np.searchsorted(at_ns, ns[1:-1], side="left")
            before = np.repeat(np.arange(len(ns) - 1), np.diff(passed, prepend=0, append=len(at_ns)))
            share = (at_ns - ns[before]) / np.diff(ns)[before]
            for at_column, column in zip(at_rows[rows, columns].T, values.T, strict=True):
                np.multiply(np.diff(column)[before], share, out=at_column)
                np.add(at_column, column[before], out=at_column)
    return at_rows


def are_many(gaps: int, longest_ns: float, rows: int) -> bool:
    """True if the gaps exceed the delays caused by rigd itself."""
    return longest_ns > MOVES_NS or gaps > _OFTEN * rows


def _gauge(path: Path, streams: Streams, test: TestName, rig: Rig, name: str) -> InstrumentTrack:
    """Readings (n, 1) mm of one gauge, increasing with the distance from the ball."""
    gauge, column = dict(rig.gauges)[name], f"{name}_mm"
    stream = _stream(path, streams, [column], f"gauge {name}", LONGEST_MM)
    if gauge.bus and sum(key.endswith("_mm") for key in stream) > 1:
        # Several polled instruments may share a line; select the rows of this gauge.
        rows = np.isfinite(stream[column])
        stream = {key: values[rows] for key, values in stream.items() if not key.endswith("_mm") or key == column}
    values = gauge.sign * stream[column][:, None]
    sound = is_reading(values, LONGEST_MM)
    if test in CIRCLES and rig.tests.circle:
        # The ball is inside the circle, so the distance to it is never more than twice the radius.
        most = 2 * rig.tests.circle.radius_mm
        if not np.ptp(values) <= most:  # otherwise no reading is further from the median than that
            sound &= is_reading(values - np.median(values[sound]), most)
    return _track(path, name, gauge_instants(stream, gauge), values, sound, int(np.count_nonzero(stream["status"])))


def _robot(path: Path, streams: Streams) -> InstrumentTrack:
    columns = [f"q{axis}_deg" for axis in range(1, 7)]
    stream = _stream(path, streams, columns, "the robot", LARGEST_DEG)
    q_deg = np.stack([stream[column] for column in columns], axis=1)
    return _track(path, "robot", robot_instants(stream), np.radians(q_deg), is_reading(q_deg, LARGEST_DEG))


def timing_doubts(name: str, instants: Instants) -> list[str]:
    doubts = []
    if instants.restarts:
        doubts.append(f"{name}: the clock restarted {instants.restarts} times and is fitted in pieces")
    if instants.wrong:
        doubts.append(
            f"{name}: {instants.wrong} stamps of the clock are impossible; these rows take the time of their arrival"
        )
    if instants.wanders_s > WANDERS_S:
        doubts.append(
            f"{name}: the messages deviate from their steady pace by {1e3 * instants.wanders_s:.1f} ms: it waited, or "
            "they came later for good; the uncertainty covers both; repeat the recording on a computer that is less "
            "busy"
        )
    if instants.held:
        doubts.append(
            f"{name}: the adapter delays bytes, which adds uncertainty; set the latency_timer of the adapter to 1 ms"
        )
    return [*doubts, *(f"{name}: {words}" for words in instants.doubts)]


def _track(path: Path, name: str, instants: Instants, values: Array, sound: Mask, doubtful: int = 0) -> InstrumentTrack:
    """Values in order of time with a single row per instant.

    If several messages arrived together, the last one is kept, because the others waited for it. If a coarse clock
    repeats a time, the first row is kept.
    """
    usual_s = float(np.median(instants.own_u_s[sound])) if sound.any() else 0.0
    timely = sound & (instants.own_u_s <= max(_STALLED * usual_s, _STALLED_S))
    dropped, odd, stalled = 0, int(np.count_nonzero(~sound)), int(np.count_nonzero(sound & ~timely))
    ns, own_u_s = instants.ns, instants.own_u_s
    if not timely.all():
        ns, values, own_u_s = ns[timely], values[timely], own_u_s[timely]
    if not (ns[1:] > ns[:-1]).all():
        order = np.argsort(ns, kind="stable")
        differs = np.diff(ns[order]) > 0
        is_kept = np.append(differs, True) if instants.arrived else np.insert(differs, 0, True)
        kept, instant = order[is_kept], np.cumsum(np.insert(differs, 0, False))
        dropped = int(np.count_nonzero((values[order] != values[kept][instant]).any(axis=1)))
        ns, values, own_u_s = ns[kept], values[kept], own_u_s[kept]
    if len(ns) < 2:
        problem = f"contains fewer than two readings of {name} at known times"
        remedy = "repeat the recording, and check the rates with rig status"
        raise FileError(str(path), problem, remedy, code="readings.too_few")
    doubts = timing_doubts(name, instants)
    if doubtful:
        doubts.append(f"{name}: the gauge marked {counted(doubtful, 'reading')} as doubtful")
    if odd:
        doubts.append(f"{_left_out(name, odd)} for want of a valid reading; check it and the connection")
    if stalled:
        why = "the time is too uncertain: the computer was too busy, or a timestamp was wrong"
        doubts.append(f"{_left_out(name, stalled)} because {why}")
    if dropped:
        doubts.append(f"{_left_out(name, dropped)} because of {_TOGETHER[instants.arrived]}")
    return InstrumentTrack(name, ns, values, instants.u_s, own_u_s, tuple(doubts))


def _stream(path: Path, streams: Streams, columns: Sequence[str], instrument: str, largest: float) -> Columns:
    for stream in streams.values():
        if all(column in stream and is_reading(stream[column][:, None], largest).sum() > 1 for column in columns):
            require_sound(path, instrument, stream)
            return stream
    remedy = "connect it, check it with rig status, and repeat the recording"
    raise FileError(str(path), f"contains no readings of {instrument}", remedy, code="readings.unsuitable")


def gaps_ns(rows: Array, times: Array, short_ns: float) -> Array:
    """Length (n,) ns of the gap containing each row, 0 outside gaps.

    times (m,) ns: instants of the other instrument; both arrays increase. A row equal to one of the times is outside.
    """
    apart = np.diff(times)
    wide = np.flatnonzero(apart > max(short_ns, _GAP * np.median(apart)))
    begins, ends = np.searchsorted(rows, times[wide], side="right"), np.searchsorted(rows, times[wide + 1], side="left")
    gaps = np.zeros(len(rows))
    for begin, end, gap in zip(begins.tolist(), ends.tolist(), apart[wide].tolist(), strict=True):
        gaps[begin:end] = gap
    return gaps
