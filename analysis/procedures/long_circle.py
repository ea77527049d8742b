"""Evaluate a circle with more rows than fit in memory, part by part.

part of a run  →  joined on the rows of gauge 1  →  φ at the robot's rate, interpolated linearly →  sums of the rows
between nodes, by time stretches  →  laps  →  readings at 720 circle angles

A part contains the rows of all streams in a time interval, in the memory of a few chunks, and is evaluated like a
separate run. Events visible only in context, such as a waiting instrument or a computer stalled for a second, also
affect rows near its ends, so a part has a margin of some seconds on either side, owned by its neighbours.

Laps are found in a thinned table, which is also used to display the run; each stretch of rows is assigned to a lap by
its time.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path

import numpy as np

from analysis.procedures.shared.reduction import (
    HatSums,
    LapRows,
    Reduced,
    base_of,
    of_rows,
    outliers_of,
    place_of,
    slopes_of,
)
from analysis.robot.geometry.circle import SENSE, frame_of
from analysis.robot.geometry.driven_programs import circle_of
from analysis.robot.kinematics.arm import Array, Integers, arm_of
from analysis.runs.align import InstrumentObservations, Joined, NotTogether, doubts_of, gauges_of, join
from analysis.runs.clocks import Columns
from analysis.runs.controller_poses import controller_poses
from analysis.runs.laps import Laps, laps_of, leaps_of, places_along
from analysis.runs.loading import Measured, known_doubts, measured_as, rig_of
from analysis.runs.noise.certificate import beyond_certificates, corrected_gauges
from analysis.runs.noise.readings import Mask, noise_beneath, step_of
from analysis.runs.noise.spectrum import NODES
from analysis.runs.tables import CircleTable
from daq.store import Manifest, Run, chunks_of, closed_manifest
from rigs.errors import FileError
from rigs.load import calibrated_beside
from rigs.rig import Rig
from rigs.schema.condition import MOTORS, POSE, PROGRAM, SAFETY, SPEED
from rigs.schema.vocabulary import CIRCLES

_ROWS = 300_000
"""Rows of gauge 1 in a part: 75 s at 4 kHz, over which a clock is linear (`lower_hull.WINDOW_S`)."""
_MARGIN_NS = 6e9
"""Margin of a part. `own_clock` needs four seconds to see whether a delay persists."""


@dataclass(frozen=True)
class StreamInterval:
    """Rows of streams received in [begin_ns, end_ns), with a margin of a few seconds."""

    streams: dict[str, Columns]
    begin_ns: float
    end_ns: float


def rows_of_gauge(manifest: Manifest) -> int:
    """Number of rows of gauge 1 in a recorded run; 0 if there are none."""
    first = _stream_of(manifest, "g1_mm")
    return sum(chunk.rows for chunk in manifest.chunks_of(first)) if first else 0


def parts_of(path: Path, manifest: Manifest) -> Iterator[StreamInterval]:
    """Streams of gauges and robot part by part, in order of time.

    Raises FileError for a missing or damaged chunk, and for decreasing stamps: such a run is refused as a whole.
    """
    read = {
        name: _Window(path, chunks_of(path, manifest, name))
        for name, columns in manifest.streams.items()
        if {"g1_mm", "g2_mm", "q1_deg"} & set(columns)
    }
    first, begin_ns = read[_stream_of(manifest, "g1_mm")], -math.inf
    while begin_ns < math.inf:
        end_ns = first.time_after(begin_ns, _ROWS)
        streams = {
            name: window.rows_between(begin_ns - _MARGIN_NS, end_ns + _MARGIN_NS) for name, window in read.items()
        }
        yield StreamInterval(streams, begin_ns, end_ns)
        begin_ns = end_ns


def _stream_of(manifest: Manifest, column: str) -> str:
    return next((name for name, columns in manifest.streams.items() if column in columns), "")


class _Window:
    """Rows of a stream in a moving time window."""

    def __init__(self, path: Path, chunks: Iterator[Columns]) -> None:
        self._path = path
        self._chunks = chunks
        self._kept: list[Columns] = []

    def rows_between(self, begin_ns: float, end_ns: float) -> Columns:
        """Rows received in [begin_ns, end_ns); intervals must not move backwards."""
        while self._last_ns() < end_ns and self._reads_on():
            pass
        self._kept = [chunk for chunk in self._kept[:-1] if chunk["last_byte_ns"][-1] >= begin_ns] + self._kept[-1:]
        pieces = []
        for chunk in self._kept:
            rows = slice(*np.searchsorted(chunk["last_byte_ns"], (begin_ns, end_ns), side="left"))
            if rows.start < rows.stop:
                pieces.append({name: column[rows] for name, column in chunk.items()})
        joined = {}
        for name in pieces[0] if pieces else ():
            columns = [piece[name] for piece in pieces]
            first = columns[0]
            # A view of identical values, as read by `daq.store`.
            if all(column.strides == (0,) and column[:1].tobytes() == first[:1].tobytes() for column in columns):
                joined[name] = np.broadcast_to(first[0], (sum(map(len, columns)),))
            else:
                joined[name] = np.concatenate(columns)
        return joined

    def time_after(self, begin_ns: float, rows: int) -> float:
        """Time of the row that follows the first row from begin_ns on by `rows` rows.

        The result is infinite if at most one and a half times as many rows remain.
        """
        most = rows + rows // 2
        while True:
            came_ns = [chunk["last_byte_ns"] for chunk in self._kept]
            first = [int(np.searchsorted(stamps, begin_ns, side="left")) for stamps in came_ns]
            if sum(len(stamps) for stamps in came_ns) - sum(first) > most:
                return float(np.concatenate([stamps[k:] for stamps, k in zip(came_ns, first, strict=True)])[rows])
            if not self._reads_on():
                return math.inf

    def _last_ns(self) -> float:
        return float(self._kept[-1]["last_byte_ns"][-1]) if self._kept else -math.inf

    def _reads_on(self) -> bool:
        """Read the next chunk, if any."""
        chunk = next(self._chunks, None)
        if chunk is None:
            return False
        stamps = chunk["last_byte_ns"]
        if len(stamps):
            if stamps[0] < self._last_ns() or not (stamps[1:] >= stamps[:-1]).all():
                raise FileError(
                    str(self._path),
                    "has timestamps that decrease",
                    "restore the run from a copy",
                    code="run.times_decrease",
                )
            self._kept.append(chunk)
        return True


_SHOWN = 100_000
"""Rows of the thinned table: 140 per node of a single lap."""
_ROBOT_SHOWN = 100_000
"""Robot rows for judging its condition, three minutes at 500 Hz; longer runs are thinned, keeping each state change."""
_STRETCHES, _SHORTEST = 100_000, 64
"""Maximum number of time stretches, 10 MB, and minimum rows per stretch."""
_BLOCK = 1 << 13
"""Rows per block, to fit the processor's cache."""
_ROUNDS = 60
"""Solver rounds for the curve used to find outliers: twice those needed if every node has rows."""
_NEAR = 8
"""Rows of the thinned table around the start and end of a lap."""
_SAMPLE = 20_000
"""Consecutive rows for estimating the step of a gauge and the noise below it (`noise.readings`)."""
_HATS = ("before", "between", "beyond", "cubes", "fourths", "near1", "near2", "far1", "far2")
_SUMS = (*_HATS, "count", "wild1", "wild2", "new1", "new2")
"""Sums over the rows of a stretch: without outliers, products of hat functions, third and fourth powers of the second,
and readings by both; over all, rows, outliers, and changed readings."""


@dataclass(frozen=True)
class _Rows:
    """Reduced rows of a part of a run.

    at_ns, cell (m,): start of each stretch of rows, and the node that it belongs to; NODES is added beyond the angle at
    which laps begin. sums (m, len(_SUMS)): sums over each stretch. shown: thinned table, with t_s in ns. step_mm,
    noise_mm (k,): resolution and noise in the middle of the part, at middle_ns. beyond: number of rows outside the
    range of a certificate.
    """

    at_ns: Array
    cell: Integers
    sums: Array
    shown: CircleTable
    u_lag_s: float
    count: int
    step_mm: tuple[float, ...]
    noise_mm: tuple[float, ...]
    middle_ns: float
    beyond: dict[str, int]


@dataclass(frozen=True)
class _Piece:
    """Result of a part of a run.

    robot: columns of the thinned rows. rows: None if gauges and robot have no common time.
    """

    robot: dict[str, Array]
    seen: dict[str, InstrumentObservations]
    rows: _Rows | None = None


def long_circle(directory: Path, path: Path) -> tuple[Measured, Reduced] | None:
    """A run with thinned rows, and all readings reduced to circle angles; path: original location of its files.

    None if it is not a long recorded circle, or contains features visible only in the whole run, which must then be
    read.
    """
    manifest = closed_manifest(directory)
    if (
        manifest.table is not None
        or manifest.test not in CIRCLES
        or not manifest.direction
        or rows_of_gauge(manifest) <= _ROWS
    ):
        return None
    run = Run(path, manifest, {}, [])
    rig = calibrated_beside(rig_of(run), directory)
    poses_show_controller = rig.controller == "unknown" and POSE[0] in manifest.streams.get("robot", {})
    if rig.gauges.g2 is None or poses_show_controller:
        return None
    beforehand = known_doubts(run, rig)
    try:
        pieces = list(_pieces(directory, run, rig))
    except (FileError, _AsAWhole):
        return None  # the whole run reports the problem and its row
    parts = [piece.rows for piece in pieces if piece.rows is not None]
    if not parts:
        return None
    first_ns, rows = parts[0].shown.t_s[0], [part.count for part in parts]
    tables = [part.shown for part in parts]
    t_s = (np.concatenate([table.t_s for table in tables]) - first_ns) / 1e9
    q, g_mm = (np.concatenate([getattr(table, name) for table in tables]) for name in ("q", "g_mm"))
    u_t_s = np.concatenate([table.u_t_s for table in tables if table.u_t_s is not None])
    table = CircleTable(tables[0].test, tables[0].direction, t_s, q, g_mm, u_t_s)
    laps = laps_of(table, rig, str(path))
    seen = {
        name: reduce(InstrumentObservations.then, (piece.seen[name] for piece in pieces)) for name in pieces[0].seen
    }
    beyond = {name: sum(part.beyond[name] for part in parts) for name in parts[0].beyond}
    doubts = doubts_of(seen, rows_of_gauge(manifest)) + beyond_certificates(rig, beyond, sum(rows))
    u_lag_s = float(np.sqrt(np.average([part.u_lag_s**2 for part in parts], weights=rows)))
    shown = [piece.robot for piece in pieces if piece.robot]
    robot = {name: np.concatenate([columns[name] for columns in shown]) for name in (shown[0] if shown else ())}
    measured = measured_as(run, rig, table, u_lag_s, [*beforehand, *doubts], robot, controller_poses(robot))
    return measured, of_rows(laps, _rows_in(laps, parts, first_ns, np.radians(circle_of(rig).start_deg)))


class _AsAWhole(Exception):
    """Raised if a row can only be interpreted together with the complete run."""


def _pieces(directory: Path, run: Run, rig: Rig) -> Iterator[_Piece]:
    """Results of the parts. Raises FileError for an invalid part, _AsAWhole."""
    taken, manifest = 0, run.manifest
    for part in parts_of(directory, manifest):
        shown = _shown_of_robot(part, manifest)
        try:
            joined = join(run.path, part.streams, manifest.test, rig, (part.begin_ns, part.end_ns))
        except NotTogether as apart:
            yield _Piece(shown, dict(apart.seen))
            continue
        if leaps_of(joined.robot.ns / 1e9, joined.robot.values, rig):
            raise _AsAWhole
        rows = _rows_of(joined, manifest, rig, taken)
        yield _Piece(shown, dict(joined.seen), rows)
        taken += rows.count


def _rows_of(joined: Joined, manifest: Manifest, rig: Rig, taken: int) -> _Rows:
    """Result of a part's rows. taken: rows of the previous parts."""
    circle, total, inside = circle_of(rig), rows_of_gauge(manifest), joined.inside
    q, g_mm = joined.robot.values, joined.g_mm
    of_robot = frame_of(circle).angle(places_along(arm_of(rig.robot), q, np.arange(len(q))))
    phi = np.interp(joined.rows_ns, joined.robot.ns, of_robot)  # linear interpolation of the robot's angles
    lap = np.floor((phi - phi.min()) / (2 * np.pi)).astype(np.int64)
    wild = outliers_of(phi, g_mm - g_mm.mean(axis=0), lap, _ROUNDS)[:, inside]
    is_new = (np.diff(g_mm, axis=0, prepend=np.nan) != 0)[inside]
    phi, rows_ns = phi[inside], joined.rows_ns[inside]
    g_mm, beyond = corrected_gauges(rig, gauges_of(manifest.test, rig), g_mm[inside])
    step = -(-total // _SHOWN)
    shown = np.arange(-taken % step, len(rows_ns), step)  # copies: a view would keep all rows in memory
    q, own_u_s = joined.q_at(rows_ns[shown]), joined.own_u_s[inside][shown]
    assert manifest.direction is not None and manifest.test in CIRCLES  # noqa: S101 - a circle has one
    table = CircleTable(manifest.test, manifest.direction, rows_ns[shown], q, g_mm[shown], own_u_s)
    middle = max(0, (len(rows_ns) - _SAMPLE) // 2)
    steps = tuple(step_of(column[middle:]) for column in g_mm.T)
    noise = tuple(noise_beneath(column[middle:], step_mm) for column, step_mm in zip(g_mm.T, steps, strict=True))
    slot = np.arange(taken, taken + len(phi)) // max(_SHORTEST, total // _STRETCHES)
    at, cell, sums = _stretches(phi, g_mm, np.concatenate([wild, is_new.T]), slot, float(np.radians(circle.start_deg)))
    return _Rows(
        rows_ns[at], cell, sums, table, joined.u_lag_s, len(rows_ns), steps, noise, float(rows_ns[middle]), beyond
    )


def _stretches(phi: Array, g_mm: Array, marks: Mask, slot: Integers, start: float) -> tuple[Integers, Integers, Array]:
    """First rows (m,) of stretches, with their nodes (m,) and sums (m, len(_SUMS)).

    A stretch is the sequence of rows between two nodes within a time slot. marks (4, n): masks of outliers and of
    changed readings. If the robot trembles about a node, the rows on each side form one stretch.
    """
    (of_start,), (behind,) = place_of(np.array([start]))
    firsts, keys, sums = [], [], []
    for begin in range(0, len(phi), _BLOCK):
        rows = slice(begin, begin + _BLOCK)
        cell, share = place_of(phi[rows])
        key = cell + NODES * ((cell == of_start) & (share >= behind)) + 2 * NODES * slot[rows]
        changes = np.append(0, np.flatnonzero(np.diff(key)) + 1)
        firsts.append(begin + changes)
        keys.append(key[changes])
        summed, back, square = np.empty((len(_SUMS), len(share))), 1 - share, share**2
        summed[:5] = back**2, share * back, square, square * share, square**2
        summed[5:7], summed[7:9] = back * g_mm[rows].T, share * g_mm[rows].T
        if marks[:2, rows].any():
            summed[: len(_HATS)] *= ~marks[:2, rows].any(axis=0)
        summed[9], summed[10:] = 1.0, marks[:, rows]
        sums.append(np.add.reduceat(summed, changes, axis=1))
    key, first, stretch = np.unique(np.concatenate(keys), return_index=True, return_inverse=True)
    columns = np.concatenate(sums, axis=1)
    together = np.stack([np.bincount(stretch, column).astype(np.float64) for column in columns], axis=1)
    return np.concatenate(firsts)[first], key % (2 * NODES), together


def _shown_of_robot(part: StreamInterval, manifest: Manifest) -> dict[str, Array]:
    """Thinned robot rows of a part, and those with a state change."""
    stream = part.streams.get("robot")
    if not stream:
        return {}
    step = -(-sum(chunk.rows for chunk in manifest.chunks_of("robot")) // _ROBOT_SHOWN)
    inside = slice(*np.searchsorted(stream["last_byte_ns"], (part.begin_ns, part.end_ns), side="left"))
    columns = {name: column[inside] for name, column in stream.items()}
    shown = np.zeros(len(columns["last_byte_ns"]), dtype=bool)
    shown[::step] = shown[-1:] = True
    for state in (SAFETY, PROGRAM, MOTORS, SPEED):
        if step > 1 and state in columns:
            shown[1:] |= np.diff(columns[state]) != 0
    return {name: column[shown] for name, column in columns.items()}


def _rows_in(laps: Laps, parts: Sequence[_Rows], first_ns: float, start: float) -> LapRows:
    """Combine the rows of all laps, which begin at circle angle start, rad."""
    at_s = (np.concatenate([part.at_ns for part in parts]) - first_ns) / 1e9
    cell = np.concatenate([part.cell for part in parts])
    lap = _lap_of(laps, at_s, cell, start)
    inside, shape = lap >= 0, (laps.count, NODES)
    place = lap[inside] * NODES + cell[inside] % NODES
    columns = np.concatenate([part.sums for part in parts])[inside].T
    sums = {
        name: np.bincount(place, column, laps.count * NODES).astype(np.float64).reshape(shape)
        for name, column in zip(_SUMS, columns, strict=True)
    }
    base = base_of(laps)
    pulls = [np.stack([sums[f"{side}{gauge}"] for gauge in (1, 2)]) for side in ("near", "far")]
    near, far = (pull - taken for pull, taken in zip(pulls, _pulls_of(base, sums), strict=True))
    count, *counts = (int(sums[name].sum()) for name in ("count", "wild1", "wild2", "new1", "new2"))
    middles = (np.array([part.middle_ns for part in parts]) - first_ns) / 1e9
    of_laps = parts[int(np.argmax((middles >= laps.t_s[0]) & (middles <= laps.t_s[-1])))]
    return LapRows(
        HatSums(sums["before"], sums["between"], sums["beyond"], near, far),
        base,
        count,
        (counts[0], counts[1]),
        (counts[2], counts[3]),
        tuple(float(np.ptp(column)) for column in laps.g_mm.T),
        of_laps.step_mm,
        of_laps.noise_mm,
    )


def _pulls_of(base: Array, sums: Mapping[str, Array]) -> tuple[Array, Array]:
    """Sums (2, L, NODES) of readings times hat functions, for readings equal to waves (5, 2).

    A wave is represented by its Taylor polynomial of third order after each node; the error is 4e-9.
    """
    beyond, third, fourth = sums["beyond"], sums["cubes"], sums["fourths"]
    first = sums["between"] + beyond
    powers = [sums["before"] + 2 * sums["between"] + beyond, first, beyond, third, fourth]
    near, far = np.zeros((2, 2, *beyond.shape))
    for order, slope in enumerate(slopes_of(base)):
        by_node = slope.T[:, None, :]
        near += by_node * (powers[order] - powers[order + 1])
        far += by_node * powers[order + 1]
    return near, far


def _lap_of(laps: Laps, at_s: Array, cell: Integers, start: float) -> Integers:
    """Lap number (m,) of each stretch, or -1 outside the laps.

    The lap times are known to a few rows of the thinned table. Within these rows the circle angle decides.
    """
    (of_start,), (behind,) = place_of(np.array([start]))
    middle = cell % NODES + 0.5
    middle[cell == of_start] = of_start + behind / 2
    middle[cell == of_start + NODES] = of_start + (1 + behind) / 2
    is_early = SENSE[laps.direction] * (middle - of_start - behind) % NODES < NODES / 2
    shown = np.minimum((np.abs(laps.phi - start) + 1e-9) // (2 * np.pi), laps.count - 1)
    near_s = _NEAR * float(np.median(np.diff(laps.t_s)))
    lap = np.full(len(at_s), -1)
    for number in range(laps.count):
        t_s = laps.t_s[shown == number]
        begun = (at_s > t_s[0] - near_s) & (is_early | (at_s > t_s[0] + near_s))
        goes_on = (at_s < t_s[-1] + near_s) & (~is_early | (at_s < t_s[-1] - near_s))
        lap[begun & goes_on] = number
    return lap
