"""From a recorded run to one table: each gauge reading beside the joint angles at the same instant.

Gauge 1 sets the rows; the other gauge and the robot are interpolated to its instants. A row is left out,
and counted, where either has a gap there: a straight line across missing data is no measurement.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.kinematics.arm import Array
from analysis.reading.clocks import Columns, Instants, gauge_instants, robot_instants
from daq.store import Run
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.vocabulary import CIRCLES

_GAP = 4.0
"""A gap is this many times the usual distance between samples, …"""
_MOVES_NS = 25e6
"""… and of a robot's longer than this: a quarter of a cycle of the quickest vibration an arm shows, some 10 Hz; …"""
_JUMPS_NS = 5e6
"""… of a gauge's longer than this: where a joint turns back, a play is crossed in some ten milliseconds."""
_OFTEN = 0.05
"""Rows left out for gaps of a gauge are told where they are a larger share than this, or a gap is as long as a robot's:
rigd itself makes each polled gauge wait now and then (daq.protocol.polled), for less."""
_STALLED = 5.0
"""A row's time is doubtful where its own uncertainty is so many times the usual, …"""
_STALLED_S = 1e-3
"""… and more than this: a shorter doubt is borne by the figures' uncertainty."""


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
    """One table of a run. Raises FileError where a stream is missing or has nothing in common with the rest.

    At targets gauge 1 alone measures: whether there is a second, and how it reads, is nothing to them.
    """
    doubts: list[str] = []
    names = [name for name, _ in rig.gauges] if run.manifest.test in CIRCLES else ["g1"]
    gauges = [_gauge(path, run, rig, name, doubts) for name in names]
    robot = _robot(path, run, doubts)
    rows_ns = gauges[0].ns
    keep = np.ones(len(rows_ns), dtype=bool)
    at_rows = [gauges[0].values]
    for name, track in zip([*names, "robot"], [*gauges, robot], strict=True):
        if len(track.ns) < 2:
            raise FileError(
                str(path), f"holds no two readings of {name} at known times", "record again: rig status tells"
            )
    for name, track in zip([*names[1:], "robot"], [*gauges[1:], robot], strict=True):
        spanned = (rows_ns >= track.ns[0]) & (rows_ns <= track.ns[-1])
        gaps_ns = _gaps_ns(rows_ns, track.ns, _MOVES_NS if track is robot else _JUMPS_NS)
        keep &= spanned & (gaps_ns == 0)
        gaps_ns = gaps_ns[spanned & (gaps_ns > 0)]
        if _are_many(gaps_ns, len(rows_ns)):
            doubts.append(f"{name}: rows left out for gaps: {len(gaps_ns)}")
        at_rows.append(np.stack([np.interp(rows_ns, track.ns, column) for column in track.values.T], axis=1))
    if keep.sum() < 2:
        raise FileError(str(path), "gauges and robot share no stretch of time", "record both through the whole test")
    t_s = (rows_ns - rows_ns[keep][0])[keep] / 1e9
    g_mm = np.concatenate(at_rows[:-1], axis=1)[keep]
    u_lag_s = float(np.hypot(max(gauge.u_s for gauge in gauges), robot.u_s))
    return Aligned(t_s, at_rows[-1][keep], g_mm, u_lag_s, _own_u_s(gauges, robot)[keep], tuple(doubts))


def _are_many(gaps_ns: Array, rows: int) -> bool:
    """Whether gaps (n,) of the rows left out are more than what rigd itself makes a gauge wait."""
    return len(gaps_ns) > 0 and bool(gaps_ns.max() > _MOVES_NS or len(gaps_ns) > _OFTEN * rows)


def _own_u_s(gauges: Sequence[_Track], robot: _Track) -> Array:
    """Of each row (n,) of the first gauge: the less certain gauge's and the robot's together."""
    at = [np.interp(gauges[0].ns, track.ns, track.own_u_s) for track in (*gauges, robot)]
    together: Array = np.hypot(np.max(at[:-1], axis=0), at[-1])
    return together


def _gauge(path: Path, run: Run, rig: Rig, name: str, doubts: list[str]) -> _Track:
    """Readings (n, 1) mm of one gauge."""
    stream = _stream(path, run, [f"{name}_mm"], f"gauge {name}")
    instants = gauge_instants(stream, dict(rig.gauges)[name])
    _tell(name, instants, doubts)
    if doubtful := int(np.count_nonzero(stream["status"])):
        doubts.append(f"{name}: {doubtful} readings that the gauge itself calls doubtful")
    return _track(name, instants, stream[f"{name}_mm"][:, None], doubts)


def _robot(path: Path, run: Run, doubts: list[str]) -> _Track:
    """Joint angles (n, 6) rad as reported."""
    columns = [f"q{axis}_deg" for axis in range(1, 7)]
    stream = _stream(path, run, columns, "the robot")
    instants = robot_instants(stream)
    _tell("robot", instants, doubts)
    return _track("robot", instants, np.radians(np.stack([stream[column] for column in columns], axis=1)), doubts)


def _tell(name: str, instants: Instants, doubts: list[str]) -> None:
    if instants.restarts:
        doubts.append(f"{name}: its clock began anew {instants.restarts} times; fitted in pieces")
    if instants.wrong:
        doubts.append(f"{name}: {instants.wrong} stamps of its clock make no sense; those rows go by their arrival")
    if instants.held:
        doubts.append(f"{name}: its adapter holds bytes back, which costs certainty; set its latency_timer to 1 ms")
    doubts.extend(f"{name}: {words}" for words in instants.doubts)


def _track(name: str, instants: Instants, values: Array, doubts: list[str]) -> _Track:
    """In order of time, without what is no number, what nobody knows the time of, and a second value for an instant."""
    number = np.isfinite(values).all(axis=1)
    usual_s = float(np.median(instants.own_u_s[number])) if number.any() else 0.0
    there = number & (instants.own_u_s <= max(_STALLED * usual_s, _STALLED_S))
    if stalled := int((number & ~there).sum()):
        doubts.append(
            f"{name}: rows left out whose time is known far worse than the others': {stalled}; "
            "a computer was held up, or a stamp was wrong"
        )
    increasing, first = np.unique(instants.ns[there], return_index=True)
    return _Track(increasing, values[there][first], instants.u_s, instants.own_u_s[there][first])


def _stream(path: Path, run: Run, columns: Sequence[str], what: str) -> Columns:
    for stream in run.streams.values():
        if all(column in stream and np.isfinite(stream[column]).sum() > 1 for column in columns):
            return stream
    raise FileError(str(path), f"holds no readings of {what}", "record again with it connected: rig status tells")


def _gaps_ns(rows: Array, times: Array, short_ns: float) -> Array:
    """How far apart the two of `times` (m,) are that rows (n,) lie between: 0 where no further than usual, or hardly,
    and where a row is of one of those times."""
    after = np.clip(np.searchsorted(times, rows, side="left"), 1, len(times) - 1)
    gaps: Array = times[after] - times[after - 1]
    short = (gaps <= max(short_ns, _GAP * np.median(np.diff(times)))) | (times[after] == rows)
    return np.where(short, 0.0, gaps)
