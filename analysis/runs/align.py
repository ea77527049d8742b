"""From a recorded run to one table: each gauge reading beside the joint angles at the same instant.

Gauge 1 sets the rows; the other gauge and the robot are interpolated to its instants. A row is left out,
and counted, where either has a gap there: a straight line across missing data is not a measurement.

A stream whose stamps `rigd` cannot have written was changed since, whatever the checksums say: its clock never goes
back, and no time can be made of one that does, so such a run is refused. A value that cannot be a reading is left out
instead, and counted.
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
"""No gauge measures further than 100 m, the bound of lengths in a rig file (`rigs.schema.part.Length`)."""
LARGEST_DEG = 36e3
"""No joint of a robot makes more than 100 turns."""
_LATEST_NS = 2**61
"""A monotonic clock begins with its computer: 73 years."""
_LONGEST_MESSAGE = 65_536
"""Bytes; the longest message of any protocol is a UDP datagram."""


def require_sound(path: Path, instrument: str, columns: Mapping[str, np.ndarray[Any, Any]]) -> None:
    """Raises FileError for columns (n,), stamps in ns and sizes in bytes, that `rigd` cannot have written."""
    requested, first, last = (columns[name] for name in ("requested_ns", "first_byte_ns", "last_byte_ns"))
    rules = {
        "an impossible stamp": (first < 0) | (last > _LATEST_NS),
        "a first byte later than the last": first > last,
        "a request later than its answer": requested > last,
        "a stamp earlier than that of the row before": np.append(False, last[1:] < last[:-1]),
        "an impossible message size": (columns["size"] < 0) | (columns["size"] > _LONGEST_MESSAGE),
    }
    for words, broken in rules.items():
        if broken.any():
            row = int(broken.argmax()) + 1
            raise FileError(str(path), f"row {row} of {instrument} has {words}", "restore the run from a copy")


def is_reading(values: Array, largest: float) -> Mask:
    """Which rows of values (n, k) hold nothing but numbers up to the largest that can be."""
    sound = np.ones(len(values), dtype=bool)
    for column in values.T:  # column by column, in no more memory than the answer takes
        sound &= column <= largest
        sound &= column >= -largest
    return sound


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
_CONTEXT = 8
"""Rows before and after a part by which it is judged whether one at its end is wild (`noise.readings`)."""
_NEVER = ("gauges and robot were never recorded at the same time", "record both through the whole test")
_STALLED = 5.0
"""A row's time is doubtful where its own uncertainty is so many times the usual, …"""
_TOGETHER = {
    True: "arrival together with a later one; have each message sent at once (TCP_NODELAY), or with its own time",
    False: "the same time as that of one before; have the instrument send its time in finer steps",
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
class Track:
    """Values (n, k) of one instrument at increasing times (n,) ns, and the uncertainty of each in s: that which all
    share, and what each row (n,) has beside it. inside (n,): which rows are of the part of a run that was asked for,
    None where all are."""

    ns: Array
    values: Array
    u_s: float
    own_u_s: Array
    inside: Mask | None = None


@dataclass(frozen=True)
class Seen:
    """What a person should know of one instrument in a run, or in a part of it. As in `Instants` restarts, wrong,
    wanders_s, held, arrived and doubts; numbers of rows that are doubtful by the gauge itself, odd (no reading),
    stalled (their time too uncertain) and dropped (of one instant); gaps: rows of gauge 1 in its gaps, of which the
    longest is longest_ns; before, after: those before its first row and after its last, where it has any here."""

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

    def then(self, later: Seen) -> Seen:
        """What was seen in two parts of a run that follow each other."""
        counts = ("restarts", "wrong", "doubtful", "odd", "stalled", "dropped")
        sums = {name: getattr(self, name) + getattr(later, name) for name in counts}
        most = {doubt.form: doubt for doubt in sorted((*self.doubts, *later.doubts), key=lambda doubt: doubt.ms)}
        between = self.after + later.before if self.has_rows and later.has_rows else 0
        return Seen(
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
    """A run, or a part of it, on the rows of gauge 1 at which all was measured: rows_ns (n,), of which those `inside`
    are of the part, and a few come before and after; the tracks of the gauges and of the robot, which span these rows;
    u_lag_s and own_u_s (n,) as in `Aligned`; seen: by the name of each instrument."""

    rows_ns: Array
    inside: slice
    gauges: tuple[Track, ...]
    robot: Track
    u_lag_s: float
    own_u_s: Array
    seen: Mapping[str, Seen]

    @property
    def g_mm(self) -> Array:
        """The readings (n, k) mm of the gauges."""
        return _columns_at(self.rows_ns, self.gauges)

    def q_at(self, rows_ns: Array) -> Array:
        """The joint angles (m, 6) rad at some of the rows (m,) ns."""
        return _columns_at(rows_ns, [self.robot])


class NotTogether(FileError):
    """Gauges and robot were not read at the same time; seen: of each of them, in a part of a run."""

    def __init__(self, where: str, problem: str, remedy: str, seen: Mapping[str, Seen] | None = None) -> None:
        super().__init__(where, problem, remedy)
        self.seen = seen or {}


def align(path: Path, run: Run, rig: Rig) -> Aligned:
    """One table of a run. Raises FileError where a stream is missing or has nothing in common with the rest."""
    return align_streams(path, run.streams, run.manifest.test, rig)


def align_streams(path: Path, streams: Streams, test: TestName, rig: Rig) -> Aligned:
    """One table of the streams of a test; path: names them in errors. Raises FileError as `align` does."""
    joined = join(path, streams, test, rig)
    rows_ns = joined.rows_ns
    doubts = doubts_of(joined.seen, len(joined.gauges[0].ns))
    t_s = (rows_ns - rows_ns[0]) / 1e9
    return Aligned(t_s, joined.q_at(rows_ns), joined.g_mm, joined.u_lag_s, joined.own_u_s, tuple(doubts))


def join(path: Path, streams: Streams, test: TestName, rig: Rig, part: tuple[float, float] | None = None) -> Joined:
    """The streams of a test on the rows of gauge 1, of those alone that came in a part [begin, end) ns of the run where
    one is asked for. Raises FileError as `align` does, NotTogether where that may be due to the part.

    At targets gauge 1 alone measures: whether there is a second, and how it reads, is nothing to them.
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
    own_u_s = np.zeros(len(rows_ns))  # of each row the less certain gauge's and the robot's together
    for track, together in [*((gauge, np.maximum) for gauge in gauges), (robot, np.hypot)]:
        if track.own_u_s.any():
            own_u_s = together(own_u_s, np.interp(rows_ns, track.ns, track.own_u_s))
    return Joined(rows_ns, of_part, gauges, robot, u_lag_s, own_u_s, seen)


def _read(
    path: Path, streams: Streams, test: TestName, rig: Rig, part: tuple[float, float] | None
) -> tuple[dict[str, Track], dict[str, Seen]]:
    """Gauges and robot of a run, or those of them that read in a part. Raises FileError."""
    tracks, seen = {}, {}
    for name in [*gauges_of(test, rig), "robot"]:
        try:
            track, seen[name] = (
                _robot(path, streams, part) if name == "robot" else _gauge(path, streams, test, rig, name, part)
            )
            if len(track.ns) < 2:
                problem = f"holds fewer than two readings of {name} at known times"
                raise NotTogether(str(path), problem, "record again, and check the rates with rig status")
            tracks[name] = track
        except NotTogether:
            if part is None:
                raise
            seen[name] = replace(seen.get(name, Seen()), has_rows=False)
    return tracks, seen


def gauges_of(test: TestName, rig: Rig) -> list[str]:
    """The gauges that a test measures with."""
    return [name for name, _ in rig.gauges] if test in CIRCLES else ["g1"]


def doubts_of(seen: Mapping[str, Seen], rows: int) -> list[str]:
    """What a person should know before trusting a run of so many rows of gauge 1, in words."""
    doubts = [doubt for name, of in seen.items() for doubt in _doubts_of(name, of)]
    gaps = ((name, of.gaps) for name, of in seen.items() if of.gaps and are_many(of.gaps, of.longest_ns, rows))
    return [*doubts, *(f"{_left_out(name, count)} at gaps" for name, count in gaps)]


def _doubts_of(name: str, seen: Seen) -> list[str]:
    doubts = timing_doubts(name, seen)
    if seen.doubtful:
        doubts.append(f"{name}: the gauge itself marks {counted(seen.doubtful, 'reading')} as doubtful")
    if seen.odd:
        doubts.append(f"{_left_out(name, seen.odd)} for want of a valid reading; check it and its connection")
    if seen.stalled:
        doubts.append(
            f"{_left_out(name, seen.stalled)} because the time is too uncertain: "
            "the computer was held up, or a stamp was wrong"
        )
    if seen.dropped:
        doubts.append(f"{_left_out(name, seen.dropped)} because of {_TOGETHER[seen.arrived]}")
    return doubts


def _left_out(name: str, count: int) -> str:
    return f"{name}: {counted(count, 'row is', 'rows are')} left out"


def robot_alone(path: Path, run: Run) -> tuple[Array, Array, tuple[str, ...]]:
    """Times (n,) s since the first and reported angles (n, 6) rad of a recorded run whose gauges need not have read,
    and doubts in words. Raises FileError where the robot was not recorded."""
    track, seen = _robot(path, run.streams, None)
    if len(track.ns) < 2:
        problem = "holds fewer than two readings of robot at known times"
        raise FileError(str(path), problem, "record again, and check the rates with rig status")
    return (track.ns - track.ns[0]) / 1e9, track.values, tuple(_doubts_of("robot", seen))


def _columns_at(rows_ns: Array, tracks: Sequence[Track]) -> Array:
    """Values (n, k) of all tracks side by side, on the chords between their rows, at the times of the rows (n,), which
    increase and which each track spans; in blocks."""
    at_rows = np.empty((len(rows_ns), sum(track.values.shape[1] for track in tracks)))
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
            # Where each row of the track lies among the rows says for all rows between which two they are.
            passed = np.searchsorted(at_ns, ns[1:-1], side="left")
            before = np.repeat(np.arange(len(ns) - 1), np.diff(passed, prepend=0, append=len(at_ns)))
            chords = np.diff(values, axis=0)[before]
            chords *= ((at_ns - ns[before]) / np.diff(ns)[before])[:, None]
            chords += values[before]
            at_rows[rows, columns] = chords
    return at_rows


def are_many(gaps: int, longest_ns: float, rows: int) -> bool:
    """Whether so many of the rows in gaps, the longest of so many ns, are more than what rigd itself makes a gauge
    wait."""
    return longest_ns > MOVES_NS or gaps > _OFTEN * rows


def _gauge(
    path: Path, streams: Streams, test: TestName, rig: Rig, name: str, part: tuple[float, float] | None
) -> tuple[Track, Seen]:
    """Readings (n, 1) mm of one gauge, which grow with the distance from the ball however it counts."""
    gauge, column = dict(rig.gauges)[name], f"{name}_mm"
    stream = _stream(path, streams, [column], f"gauge {name}", LONGEST_MM)
    if gauge.bus and sum(key.endswith("_mm") for key in stream) > 1:
        # On a line where each is asked by itself the rows of the others are not of this gauge.
        rows = np.isfinite(stream[column])
        stream = {key: values[rows] for key, values in stream.items() if not key.endswith("_mm") or key == column}
    instants, inside = gauge_instants(stream, gauge), _inside(stream, part)
    values = gauge.sign * stream[column][:, None]
    sound = is_reading(values, LONGEST_MM)
    if test in CIRCLES and rig.tests.circle:
        # With the ball inside the circle no link is ever longer than twice its radius.
        sound &= is_reading(values - np.median(values[sound]), 2 * rig.tests.circle.radius_mm)
    track, seen = _track(instants, values, sound, inside)
    return track, replace(seen, doubtful=_count(stream["status"] != 0, inside))


def _inside(stream: Columns, part: tuple[float, float] | None) -> Mask | None:
    """Which rows (n,) of a stream came in a part of the run."""
    if part is None:
        return None
    came_ns = stream["last_byte_ns"]
    inside = np.zeros(len(came_ns), dtype=bool)
    inside[slice(*np.searchsorted(came_ns, part, side="left"))] = True
    return inside


def _count(rows: Mask, inside: Mask | None) -> int:
    return int(np.count_nonzero(rows if inside is None else rows & inside))


def _robot(path: Path, streams: Streams, part: tuple[float, float] | None) -> tuple[Track, Seen]:
    """Joint angles (n, 6) rad as reported."""
    columns = [f"q{axis}_deg" for axis in range(1, 7)]
    stream = _stream(path, streams, columns, "the robot", LARGEST_DEG)
    q_deg = np.stack([stream[column] for column in columns], axis=1)
    sound = is_reading(q_deg, LARGEST_DEG)
    return _track(robot_instants(stream), np.radians(q_deg), sound, _inside(stream, part))


def timing_doubts(name: str, instants: Instants | Seen) -> list[str]:
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


def _track(instants: Instants, values: Array, sound: Mask, inside: Mask | None) -> tuple[Track, Seen]:
    """The values in order of time, without rows that hold no reading or whose time is unknown, and one of each instant:
    of messages that arrived together the last, which the others waited for, and of a clock with coarse steps the first.
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
    seen = Seen(
        instants.restarts if inside is None else int(inside[list(instants.restarted)].sum()),
        # Its own uncertainty has a row alone whose stamp is wrong.
        min(instants.wrong, _count(instants.own_u_s > 0, inside)) if instants.wrong else 0,
        instants.wanders_s,
        instants.held,
        instants.arrived,
        instants.doubts,
        odd=counts[0],
        stalled=counts[1],
        dropped=dropped,
    )
    return Track(ns, values, instants.u_s, own_u_s, track_inside), seen


def _stream(path: Path, streams: Streams, columns: Sequence[str], instrument: str, largest: float) -> Columns:
    for stream in streams.values():
        if all(column in stream and is_reading(stream[column][:, None], largest).sum() > 1 for column in columns):
            require_sound(path, instrument, stream)
            return stream
    remedy = "connect it, check it with rig status, and record again"
    raise NotTogether(str(path), f"holds no readings of {instrument}", remedy)


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
