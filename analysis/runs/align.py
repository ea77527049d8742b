"""Align a recorded run to one table: each gauge reading with the joint angles at the same instant.

Gauge 1 defines the rows. The second gauge and the robot are interpolated to its instants. Rows in a gap of either
stream are dropped and counted, because interpolation across missing data is not a measurement.

A run is refused if a stream contains timestamps that `rigd` cannot have written, even if the checksums are valid. Host
timestamps never decrease, so such a stream was modified. Impossible values are dropped and counted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from analysis.robot.kinematics.arm import Array
from analysis.runs.clocks import Columns, Instants, TimingDoubt, gauge_instants, robot_instants
from analysis.runs.lower_hull import Mask
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
                code="run.impossible_row",
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
_CONTEXT = 8
"""Number of rows before and after a part, needed to detect outliers at both ends (`noise.readings`)."""
_NEVER = ("gauges and robot were never recorded at the same time", "record both through the whole test")
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
    """A run as one table.

    t_s (n,): time since the first row.
    q (n, 6): reported joint angles in rad.
    g_mm (n, k): readings of g1, and of g2 on a circle.
    u_lag_s: standard uncertainty of the gauges' time relative to the robot's, common to all rows.
    u_t_s (n,): individual part of the time uncertainty.
    doubts: as text.
    """

    t_s: Array
    q: Array
    g_mm: Array
    u_lag_s: float
    u_t_s: Array
    doubts: tuple[str, ...]


@dataclass(frozen=True)
class InstrumentTrack:
    """Values (n, k) of an instrument at increasing times (n,) ns, with common and individual (n,) uncertainty in s.

    inside (n,): mask of the rows in the requested part of a run, None for all rows.
    """

    ns: Array
    values: Array
    u_s: float
    own_u_s: Array
    inside: Mask | None = None


@dataclass(frozen=True)
class InstrumentObservations:
    """Observations about an instrument in a run, or in a part of a run.

    restarts, wrong, wanders_s, held, arrived, doubts: as in `Instants`.
    doubtful, odd, stalled, dropped: number of rows marked by the gauge, rows lacking a reading, rows with an uncertain
    time, and rows with a repeated time.
    gaps, longest_ns: number of rows of gauge 1 in gaps of the instrument, and the longest gap.
    before, after: number of rows of gauge 1 before the first and after the last row of the instrument.
    has_rows: whether the instrument has rows in this part.
    """

    restarts: int = 0
    wrong: int = 0
    wanders_s: float = 0.0
    held: bool = False
    arrived: bool = False
    doubts: tuple[TimingDoubt, ...] = ()
    doubtful: int = 0
    odd: int = 0
    stalled: int = 0
    dropped: int = 0
    gaps: int = 0
    longest_ns: float = 0.0
    before: int = 0
    after: int = 0
    has_rows: bool = True

    def then(self, later: InstrumentObservations) -> InstrumentObservations:
        """Combine the observations of two successive parts of a run."""
        counts = ("restarts", "wrong", "doubtful", "odd", "stalled", "dropped")
        sums = {name: getattr(self, name) + getattr(later, name) for name in counts}
        most = {doubt.form: doubt for doubt in sorted((*self.doubts, *later.doubts), key=lambda doubt: doubt.ms)}
        between = self.after + later.before if self.has_rows and later.has_rows else 0
        return InstrumentObservations(
            **sums,
            wanders_s=max(self.wanders_s, later.wanders_s),
            held=self.held or later.held,
            arrived=self.arrived or later.arrived,
            doubts=tuple(most.values()),
            gaps=self.gaps + later.gaps + between,
            longest_ns=math.inf if between else max(self.longest_ns, later.longest_ns),
            before=self.before if self.has_rows else self.before + later.before,
            after=later.after if later.has_rows else self.after + later.before,
            has_rows=self.has_rows or later.has_rows,
        )


@dataclass(frozen=True)
class Joined:
    """A run, or a part of one, with all values given at the times of the readings of gauge 1, without incomplete rows.

    rows_ns (n,): times of the rows, including a few before and after the part; `inside` selects the part. The tracks of
    gauges and robot span all rows. u_lag_s, own_u_s (n,): as u_lag_s and u_t_s in `Aligned`. seen: observations by
    instrument.
    """

    rows_ns: Array
    inside: slice
    gauges: tuple[InstrumentTrack, ...]
    robot: InstrumentTrack
    u_lag_s: float
    own_u_s: Array
    seen: Mapping[str, InstrumentObservations]

    @property
    def g_mm(self) -> Array:
        """Readings (n, k) mm of the gauges."""
        return _columns_at(self.rows_ns, self.gauges)

    def q_at(self, rows_ns: Array) -> Array:
        """Joint angles (m, 6) rad at times rows_ns (m,)."""
        return _columns_at(rows_ns, [self.robot])


class NotTogether(FileError):
    """Gauges and robot have no common time. seen: observations of each instrument, in a part of a run."""

    code = "run.not_together"

    def __init__(
        self, where: str, problem: str, remedy: str, seen: Mapping[str, InstrumentObservations] | None = None
    ) -> None:
        super().__init__(where, problem, remedy)
        self.seen = seen or {}


def align(path: Path, run: Run, rig: Rig) -> Aligned:
    """Align a run to a table. Raises FileError if a stream is missing or has no common time with the others."""
    return align_streams(path, run.streams, run.manifest.test, rig)


def align_streams(path: Path, streams: Streams, test: TestName, rig: Rig) -> Aligned:
    """Align the streams of a test to a table. Error messages contain the path. Raises FileError like `align`."""
    joined = join(path, streams, test, rig)
    rows_ns = joined.rows_ns
    doubts = doubts_of(joined.seen, len(joined.gauges[0].ns))
    t_s = (rows_ns - rows_ns[0]) / 1e9
    return Aligned(t_s, joined.q_at(rows_ns), joined.g_mm, joined.u_lag_s, joined.own_u_s, tuple(doubts))


def join(path: Path, streams: Streams, test: TestName, rig: Rig, part: tuple[float, float] | None = None) -> Joined:
    """Join the streams of a test on the rows of gauge 1, optionally in a part [begin, end) ns of the run.

    Tests at targets use gauge 1 only. Raises FileError like `align`. Raises NotTogether, a subclass, if a longer part
    could avoid the error.
    """
    tracks, seen = _read(path, streams, test, rig, part)
    if "g1" not in tracks:
        raise NotTogether(str(path), *_NEVER, seen)
    rows_ns, inside = tracks["g1"].ns, tracks["g1"].inside
    inside = np.ones(len(rows_ns), dtype=bool) if inside is None else inside
    keep = inside.copy()
    for place in np.flatnonzero(np.diff(inside)).tolist():
        keep[max(0, place + 1 - _CONTEXT) : place + 1 + _CONTEXT] = True
    for name in list(seen)[1:]:
        track = tracks.get(name)
        if track is None:
            keep[:], seen[name] = False, replace(seen[name], before=int(inside.sum()))
            continue
        begin, end = np.searchsorted(rows_ns, track.ns[0]), np.searchsorted(rows_ns, track.ns[-1], side="right")
        keep[:begin], keep[end:] = False, False
        gaps = gaps_ns(rows_ns, track.ns, MOVES_NS if name == "robot" else JUMPS_NS)
        keep &= gaps == 0
        gaps = gaps[begin:end][(gaps[begin:end] > 0) & inside[begin:end]]
        before, after = int(inside[:begin].sum()), int(inside[end:].sum())
        longest_ns = float(gaps.max(initial=0.0))
        seen[name] = replace(seen[name], gaps=len(gaps), longest_ns=longest_ns, before=before, after=after)
    kept = np.flatnonzero(inside[keep])
    if len(kept) < 2:
        raise NotTogether(str(path), *_NEVER, seen)
    rows_ns = rows_ns if keep.all() else rows_ns[keep]
    robot, of_part = tracks.pop("robot"), slice(int(kept[0]), int(kept[-1]) + 1)
    gauges = tuple(tracks.values())
    u_lag_s = float(np.hypot(max(track.u_s for track in gauges), robot.u_s))
    own_u_s = np.zeros(len(rows_ns))  # per row: uncertainty of the less certain gauge, combined with that of the robot
    for track, together in [*((gauge, np.maximum) for gauge in gauges), (robot, np.hypot)]:
        if track.own_u_s.any():
            own_u_s = together(own_u_s, np.interp(rows_ns, track.ns, track.own_u_s))
    return Joined(rows_ns, of_part, gauges, robot, u_lag_s, own_u_s, seen)


def _read(
    path: Path, streams: Streams, test: TestName, rig: Rig, part: tuple[float, float] | None
) -> tuple[dict[str, InstrumentTrack], dict[str, InstrumentObservations]]:
    """Read gauges and robot of a run, or those with readings in a part. Raises FileError."""
    tracks, seen = {}, {}
    for name in [*gauges_of(test, rig), "robot"]:
        try:
            track, seen[name] = (
                _robot(path, streams, part) if name == "robot" else _gauge(path, streams, test, rig, name, part)
            )
            if len(track.ns) < 2:
                problem = f"contains fewer than two readings of {name} at known times"
                raise NotTogether(str(path), problem, "repeat the recording, and check the rates with rig status")
            tracks[name] = track
        except NotTogether:
            if part is None:
                raise
            seen[name] = replace(seen.get(name, InstrumentObservations()), has_rows=False)
    return tracks, seen


def gauges_of(test: TestName, rig: Rig) -> list[str]:
    """Gauges used by a test."""
    return [name for name, _ in rig.gauges] if test in CIRCLES else ["g1"]


def doubts_of(seen: Mapping[str, InstrumentObservations], rows: int) -> list[str]:
    """Doubts about a run as text. rows: number of rows of gauge 1."""
    doubts = [doubt for name, of in seen.items() for doubt in _doubts_of(name, of)]
    gaps = ((name, of.gaps) for name, of in seen.items() if of.gaps and are_many(of.gaps, of.longest_ns, rows))
    return [*doubts, *(f"{_left_out(name, count)} at gaps" for name, count in gaps)]


def _doubts_of(name: str, seen: InstrumentObservations) -> list[str]:
    doubts = timing_doubts(name, seen)
    if seen.doubtful:
        doubts.append(f"{name}: the gauge marked {counted(seen.doubtful, 'reading')} as doubtful")
    if seen.odd:
        doubts.append(f"{_left_out(name, seen.odd)} for want of a valid reading; check it and the connection")
    if seen.stalled:
        doubts.append(
            f"{_left_out(name, seen.stalled)} because the time is too uncertain: the computer was too "
            "busy, or a timestamp was wrong"
        )
    if seen.dropped:
        doubts.append(f"{_left_out(name, seen.dropped)} because of {_TOGETHER[seen.arrived]}")
    return doubts


def _left_out(name: str, count: int) -> str:
    return f"{name}: {counted(count, 'row is', 'rows are')} ignored"


def robot_only(path: Path, run: Run) -> tuple[Array, Array, tuple[str, ...]]:
    """Times (n,) s since the first row, reported angles (n, 6) rad, and doubts of a recorded run.

    Gauges are ignored. Raises FileError if the robot was not recorded.
    """
    track, seen = _robot(path, run.streams, None)
    if len(track.ns) < 2:
        problem = "contains fewer than two readings of robot at known times"
        raise FileError(
            str(path), problem, "repeat the recording, and check the rates with rig status", code="run.few_readings"
        )
    return (track.ns - track.ns[0]) / 1e9, track.values, tuple(_doubts_of("robot", seen))


def _columns_at(rows_ns: Array, tracks: Sequence[InstrumentTrack]) -> Array:
    """Interpolate all tracks linearly at increasing times (n,) ns and return the values (n, k).

    Each track must span the times. The computation is done in blocks.
    """
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
            chords = np.diff(values, axis=0)[before]
            chords *= ((at_ns - ns[before]) / np.diff(ns)[before])[:, None]
            chords += values[before]
            at_rows[rows, columns] = chords
    return at_rows


def are_many(gaps: int, longest_ns: float, rows: int) -> bool:
    """True if the gaps exceed the delays caused by rigd itself.

    gaps: number of rows in gaps. longest_ns: length of the longest gap.
    """
    return longest_ns > MOVES_NS or gaps > _OFTEN * rows


def _gauge(
    path: Path, streams: Streams, test: TestName, rig: Rig, name: str, part: tuple[float, float] | None
) -> tuple[InstrumentTrack, InstrumentObservations]:
    """Readings (n, 1) mm of one gauge, increasing with the distance from the ball."""
    gauge, column = dict(rig.gauges)[name], f"{name}_mm"
    stream = _stream(path, streams, [column], f"gauge {name}", LONGEST_MM)
    if gauge.bus and sum(key.endswith("_mm") for key in stream) > 1:
        # Several polled instruments may share a line; select the rows of this gauge.
        rows = np.isfinite(stream[column])
        stream = {key: values[rows] for key, values in stream.items() if not key.endswith("_mm") or key == column}
    instants, inside = gauge_instants(stream, gauge), _inside(stream, part)
    values = gauge.sign * stream[column][:, None]
    sound = is_reading(values, LONGEST_MM)
    if test in CIRCLES and rig.tests.circle:
        # The ball is inside the circle, so the distance to it is never more than twice the radius.
        most = 2 * rig.tests.circle.radius_mm
        if not np.ptp(values) <= most:  # otherwise no reading is further from the median than that
            sound &= is_reading(values - np.median(values[sound]), most)
    track, seen = _track(instants, values, sound, inside)
    return track, replace(seen, doubtful=_count(stream["status"] != 0, inside))


def _inside(stream: Columns, part: tuple[float, float] | None) -> Mask | None:
    """Mask (n,) of the rows of a stream in a part of the run, None for the complete run."""
    if part is None:
        return None
    came_ns = stream["last_byte_ns"]
    inside = np.zeros(len(came_ns), dtype=bool)
    inside[slice(*np.searchsorted(came_ns, part, side="left"))] = True
    return inside


def _count(rows: Mask, inside: Mask | None) -> int:
    return int(np.count_nonzero(rows if inside is None else rows & inside))


def _robot(
    path: Path, streams: Streams, part: tuple[float, float] | None
) -> tuple[InstrumentTrack, InstrumentObservations]:
    """Read the joint angles (n, 6) rad as reported."""
    columns = [f"q{axis}_deg" for axis in range(1, 7)]
    stream = _stream(path, streams, columns, "the robot", LARGEST_DEG)
    q_deg = np.stack([stream[column] for column in columns], axis=1)
    sound = is_reading(q_deg, LARGEST_DEG)
    return _track(robot_instants(stream), np.radians(q_deg), sound, _inside(stream, part))


def timing_doubts(name: str, instants: Instants | InstrumentObservations) -> list[str]:
    """Doubts about the times of an instrument, as text."""
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


def _track(
    instants: Instants, values: Array, sound: Mask, inside: Mask | None
) -> tuple[InstrumentTrack, InstrumentObservations]:
    """Values in order of time with a single row per instant. Rows lacking a valid reading or time are
    dropped.

    If several messages arrived together, the last one is kept, because the others waited for it. If a coarse clock
    repeats a time, the first row is kept.
    """
    usual_s = float(np.median(instants.own_u_s[sound])) if sound.any() else 0.0
    timely = sound & (instants.own_u_s <= max(_STALLED * usual_s, _STALLED_S))
    dropped, counts = 0, (_count(~sound, inside), _count(sound & ~timely, inside))
    ns, own_u_s, track_inside = instants.ns, instants.own_u_s, inside
    if not timely.all():
        ns, values, own_u_s = ns[timely], values[timely], own_u_s[timely]
        track_inside = None if inside is None else inside[timely]
    if not (ns[1:] > ns[:-1]).all():
        order = np.argsort(ns, kind="stable")
        differs = np.diff(ns[order]) > 0
        is_kept = np.append(differs, True) if instants.arrived else np.insert(differs, 0, True)
        kept, instant = order[is_kept], np.cumsum(np.insert(differs, 0, False))
        off = (values[order] != values[kept][instant]).any(axis=1)
        dropped = _count(off, None if track_inside is None else track_inside[order])
        ns, values, own_u_s = ns[kept], values[kept], own_u_s[kept]
        track_inside = None if track_inside is None else track_inside[kept]
    seen = InstrumentObservations(
        instants.restarts if inside is None else int(inside[list(instants.restarted)].sum()),
        # Only rows with a wrong timestamp have an individual uncertainty.
        min(instants.wrong, _count(instants.own_u_s > 0, inside)) if instants.wrong else 0,
        instants.wanders_s,
        instants.held,
        instants.arrived,
        instants.doubts,
        odd=counts[0],
        stalled=counts[1],
        dropped=dropped,
    )
    return InstrumentTrack(ns, values, instants.u_s, own_u_s, track_inside), seen


def _stream(path: Path, streams: Streams, columns: Sequence[str], instrument: str, largest: float) -> Columns:
    for stream in streams.values():
        if all(column in stream and is_reading(stream[column][:, None], largest).sum() > 1 for column in columns):
            require_sound(path, instrument, stream)
            return stream
    remedy = "connect it, check it with rig status, and repeat the recording"
    raise NotTogether(str(path), f"contains no readings of {instrument}", remedy)


def gaps_ns(rows: Array, times: Array, short_ns: float) -> Array:
    """For each of the rows (n,) ns the length in ns of the gap containing it, 0 outside gaps.

    times (m,) ns: instants of the other instrument; both arrays increase. A row equal to one of the times is outside.
    """
    apart = np.diff(times)
    wide = np.flatnonzero(apart > max(short_ns, _GAP * np.median(apart)))
    begins, ends = np.searchsorted(rows, times[wide], side="right"), np.searchsorted(rows, times[wide + 1], side="left")
    gaps = np.zeros(len(rows))
    for begin, end, gap in zip(begins.tolist(), ends.tolist(), apart[wide].tolist(), strict=True):
        gaps[begin:end] = gap
    return gaps
