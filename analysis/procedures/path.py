"""Path test: tool positions along the paths of the cube seen by a tracker, by ISO 9283:1998, clause 8, and ISO 230-4.

8.2 path accuracy AT: largest distance, over the stations, between the mean of all cycles and the command, across the
path.
8.3 path repeatability RT: largest mean + 3 S of the distances of the cycles from their mean, S with n - 1. 8.5 corners
of
the rectangle: cornering round-off CR, the smallest distance of the path from the corner; corner overshoot CO, the
travel
beyond the corner in the old direction, across the new one; each the largest of the first three cycles, at the worst of
P3,
P4, P5. The standard is not public; clauses and formulas follow public quotations (docs/figures.md).

The large circle is driven in both directions, and a tracker measures its radius: F, the radial deviation from the
nominal radius about the least-squares centre, and D, the mean of both least-squares radii less the nominal (ISO
230-4:2005, clause 3).

u is the deviation of a figure from its expectation in repeated tests with the same scatter. The errors of the
instrument are not included.

From the recording to the deviations: positions are averaged over short spans, so that tracker noise, estimated from
second differences, is not taken for motion. A standstill is longer than half a second: at corners some controllers
almost stop, but for less. Data before the first and after the last standstill is dropped, because its completeness is
unknown. A move is identified by length and chord; the first of the two directions around the large circle is
anticlockwise, as in the program. An unknown tracker frame is fitted to all paths: first by the relative position along
each path, then from each position to the closest path point. Deviations are taken across the path and averaged between
stations, which are closer than any feature of robot motion.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from analysis.procedures.checks.places import (
    DUPLICATES,
    WILDNESS,
    measured_places,
    outlying_places,
    repeated_places,
)
from analysis.procedures.shared.quantity import Quantity
from analysis.procedures.shared.result_curves import PathCurve
from analysis.procedures.shared.scatter_figures import FEWEST_CYCLES, half_width, rp
from analysis.procedures.shared.test_kind import Finders, Instruments, Labels, Simulation, TestKind
from analysis.procedures.simulate import simulated_path
from analysis.robot.geometry.iso_cube import CommandPath, Cube, PathName, Polygon, Ring, cube_of, iso9283_of, paths_of
from analysis.robot.geometry.pose_setup import best_rigid, in_frame
from analysis.robot.kinematics.arm import Array, transform
from analysis.runs.noise.readings import robust_sd
from analysis.runs.tables import PathTable
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.declared_tests import TrackerPose
from rigs.schema.vocabulary import Direction

_SPAN_S, _SAMPLES = 0.05, 4
"""Averaging time, and minimum number of positions averaged."""
_STANDSTILL_S = 0.6
_SLOW = 0.02
"""Share of the 90 % quantile of the speeds below which the tool is at rest …"""
_NOISES = 6.0
"""… or multiple of the standard deviation caused by noise alone."""
_GAP_S = 0.3
"""Longest gap in the tracker data of a complete move; after a longer gap the target was lost."""


@dataclass(frozen=True)
class PathMove:
    """A move of a path recording: rows from `first` to before `last`, length length_mm by spans, and chord chord_mm.

    whole: True if the tracker data are complete.
    """

    first: int
    last: int
    length_mm: float
    chord_mm: float
    whole: bool


def moves_of(t_s: Array, xyz_mm: Array) -> list[PathMove]:
    if len(t_s) < 10 * _SAMPLES:
        return []
    step_s = float(np.median(np.diff(t_s)))
    span_s = max(_SPAN_S, _SAMPLES * step_s)
    number = ((t_s - t_s[0]) / span_s).astype(np.int64)
    first = np.flatnonzero(np.diff(number, prepend=-1))
    count = np.diff(first, append=len(t_s))
    at = np.add.reduceat(xyz_mm, first, axis=0) / count[:, None]
    when = np.add.reduceat(t_s, first) / count
    way = np.linalg.norm(np.diff(at, axis=0), axis=1)
    speed = way / np.diff(when)
    bends = np.abs(xyz_mm[2:] - 2 * xyz_mm[1:-1] + xyz_mm[:-2])
    noise_mm = robust_sd(bends) / float(np.sqrt(6))  # standard deviation of a coordinate
    noise = noise_mm * np.sqrt(6 / max(float(np.median(count)), 1.0)) / span_s
    rests = speed < max(_SLOW * float(np.quantile(speed, 0.9)), _NOISES * noise)
    # First and last span (k,) of each standstill.
    edges = np.diff(np.concatenate([[False], rests, [False]]).astype(np.int64))
    begins, ends = np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)
    long = when[ends] - when[begins] > _STANDSTILL_S
    begins, ends = begins[long], ends[long]
    gaps = np.concatenate([[0], np.cumsum(np.diff(t_s) > max(_GAP_S, 3 * span_s))])
    moves = []
    for out, back in zip(ends[:-1].tolist(), begins[1:].tolist(), strict=True):
        rows = int(first[out]), int(first[back])
        chord = float(np.linalg.norm(at[back] - at[out]))
        moves.append(PathMove(*rows, float(way[out:back].sum()), chord, bool(gaps[rows[1]] == gaps[rows[0]])))
    return moves


_LENGTH, _CHORD = 0.08, 0.05
"""Permitted relative differences of length and chord: a cut corner is shorter."""
_FITTED = 400
"""Positions per move used to fit the frame."""
_ROUNDS = 12
_MOST_DEVIATION = 0.05
"""Limit of the deviation, relative to the cube's side, for paths of this program."""
_STATIONS, _FEWEST = 200, 12
"""Usual number of stations along a path, and smallest number for an evaluation. Few tracker positions give fewer
stations.
"""
_ENDS = 0.02
"""Share of a path at each end left out: acceleration and stop, and ambiguous closest points of a closed path."""


@dataclass(frozen=True)
class DrivenPath:
    """A path in all cycles.

    places: positions of each cycle, (k, 3) mm in the world. off_mm (cycles, m, 3): mean deviation at each station s_mm
    (m,), across the path. speed_mm_s (cycles,): along the middle half.
    """

    command: CommandPath
    places: tuple[Array, ...]
    s_mm: Array
    off_mm: Array
    speed_mm_s: Array


@dataclass(frozen=True)
class DrivenPaths:
    """Paths by name, the tracker frame in the world (4, 4), and notes about omitted paths."""

    paths: Mapping[PathName, DrivenPath]
    T_world_instrument: Array
    notes: tuple[str, ...]


def driven_paths(table: PathTable, cube: Cube, T_world_instrument: Array | None, where: str) -> DrivenPaths:
    """Paths of a cube in a recording. T_world_instrument (4, 4): None to fit the tracker frame.

    Raises FileError if the recording contains no paths, or not those of this cube.
    """
    table, left_out = measured_places(table)
    commands, moves = paths_of(cube), moves_of(table.t_s, table.xyz_mm)
    every = _sorted(table, commands, moves)
    whole = {name: [move for move in cycles if move.whole] for name, cycles in every.items()}
    whole = {name: cycles for name, cycles in whole.items() if cycles}
    if not set(whole) - {"back"}:
        problem = "it has no moves between standstills"
        if moves:
            problem = (
                f"none of its {len(moves)} moves between standstills is as long as a path of the cube: the longest is "
                f"{max(move.length_mm for move in moves):.4g} mm, and a line has "
                f"{commands['line'].length_mm:.4g} mm"
            )
        raise FileError(
            where, problem, "check the unit, the cube of the rig file, and the recording", code="rig_file.invalid"
        )
    places = {name: [table.xyz_mm[move.first : move.last] for move in cycles] for name, cycles in whole.items()}
    T = _fitted(places, commands) if T_world_instrument is None else T_world_instrument
    paths: dict[PathName, DrivenPath] = {}
    coarse = []
    for name, cycles in whole.items():
        times = [table.t_s[move.first : move.last] for move in cycles]
        driven = _driven(commands[name], [in_frame(T, cycle) for cycle in places[name]], times)
        if driven is None:
            coarse.append(name.replace("_", " "))
        elif name != "back":
            paths[name] = driven
    if not paths:
        problem = "the tracker recorded too few positions along each path"
        raise FileError(where, problem, "record more positions per second", code="readings.too_few")
    far_mm = max(float(np.median(np.linalg.norm(driven.off_mm, axis=2))) for driven in paths.values())
    if far_mm > _MOST_DEVIATION * cube.side_mm:
        problem = f"the paths lie {far_mm:.3g} mm from those of the cube in the rig file"
        or_else = "" if T_world_instrument is None else ", tests.iso9283.instrument and the tool"
        raise FileError(
            where, problem, f"give the rig file of the program, and check the cube{or_else}", code="rig_file.invalid"
        )
    torn = sum(not move.whole for cycles in every.values() for move in cycles)
    notes = [f"{torn} paths are ignored because of gaps in the readings of the tracker"] if torn else []
    if coarse:
        notes.append(f"too few places were written to judge: {', '.join(coarse)}; record more positions per second")
    return DrivenPaths(paths, T, (*left_out, *notes))


def _sorted(
    table: PathTable, commands: Mapping[PathName, CommandPath], moves: list[PathMove]
) -> dict[PathName, list[PathMove]]:
    cycles: dict[PathName, list[PathMove]] = {}
    around: Array | None = None
    lengths = {name: command.length_mm for name, command in commands.items()}
    ends = {name: command.at(np.array([0.0, command.length_mm])) for name, command in commands.items()}
    chords = {name: float(np.linalg.norm(end - start)) for name, (start, end) in ends.items()}
    for move in moves:
        fits = (
            name
            for name, length in lengths.items()
            if abs(move.length_mm - length) < _LENGTH * length and abs(move.chord_mm - chords[name]) < _CHORD * length
        )
        name = next(fits, None)
        if name == "circle":
            away = table.xyz_mm[move.first : move.last]
            away = away - away.mean(axis=0)
            area: Array = np.cross(away[:-1], away[1:]).sum(axis=0)  # anticlockwise about it
            around = area if around is None else around
            name = "circle" if area @ around > 0 else "circle_cw"
        if name is not None:
            cycles.setdefault(name, []).append(move)
    return cycles


def _fitted(places: Mapping[PathName, list[Array]], commands: Mapping[PathName, CommandPath]) -> Array:
    cycles = [
        (commands[name], cycle[:: max(1, len(cycle) // _FITTED)]) for name, driven in places.items() for cycle in driven
    ]
    seen, goals = np.concatenate([cycle for _, cycle in cycles]), []
    for command, cycle in cycles:
        way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(cycle, axis=0), axis=1))])
        goals.append(command.at(way / way[-1] * command.length_mm))
    T = best_rigid(seen, np.concatenate(goals))
    for _ in range(_ROUNDS):
        goals = [command.at(command.nearest(in_frame(T, cycle))) for command, cycle in cycles]
        T = best_rigid(seen, np.concatenate(goals))
    return T


def _driven(command: CommandPath, places: list[Array], times: list[Array]) -> DrivenPath | None:
    fewest = min(map(len, places))
    stations = min(_STATIONS, fewest // 3)
    if stations < _FEWEST:
        return None
    edges = np.linspace(_ENDS, 1 - _ENDS, stations + 1) * command.length_mm
    off, speeds = [], []
    at = (edges[1:] + edges[:-1]) / 2
    for cycle, t_s in zip(places, times, strict=True):
        s = command.nearest(cycle)
        # Mean deviations between the edges, interpolated across missing data.
        number = np.searchsorted(edges, s, side="right") - 1
        inside = (number >= 0) & (number < stations)
        count = np.bincount(number[inside], minlength=stations)
        sums = [np.bincount(number[inside], column, minlength=stations) for column in (cycle - command.at(s))[inside].T]
        written = count > 0
        means = [np.interp(at, at[written], total[written] / count[written]) for total in sums]
        off.append(np.stack(means, axis=1))
        middle = np.flatnonzero((s > 0.25 * command.length_mm) & (s < 0.75 * command.length_mm))
        speeds.append((s[middle[-1]] - s[middle[0]]) / (t_s[middle[-1]] - t_s[middle[0]]))
    return DrivenPath(command, tuple(places), at, np.array(off), np.array(speeds))


CYCLES_ASKED, _CORNER_CYCLES = 10, 3
"""Cycles required by ISO 9283, and those used for corner figures."""
_ASKED: tuple[PathName, ...] = ("line", "rectangle", "circle", "circle_cw", "small_circle")
_SLOWEST, _FASTEST = 0.05, 1.5
"""Limits of the speed relative to the rig file; the programs use 0.1 to 1 of it."""
_JUDGED: tuple[PathName, ...] = ("line", "circle", "small_circle")
_NEAR = 0.3
"""Range after a corner for detecting an overshoot, relative to a side."""
_SPANS = 60
_SEED, _DRAWS = 1, 400


@dataclass(frozen=True)
class PathResult:
    """Result of a path test; samples: number of positions."""

    driven: DrivenPaths
    cube: Cube
    figures: dict[str, Quantity]
    samples: int
    notes: tuple[str, ...]

    @property
    def as_curve(self) -> PathCurve:
        cube, parts = self.cube, list[tuple[Array, ...]]()
        axes = np.stack([cube.level, cube.rising, np.cross(cube.level, cube.rising)])
        names: list[str] = []
        for name, path in self.driven.paths.items():
            mean, many = path.off_mm.mean(axis=0), len(path.places) >= FEWEST_CYCLES
            repeat = rp(np.swapaxes(path.off_mm, 0, 1)) if many else np.full(len(mean), np.nan)
            place = (path.command.at(path.s_mm) - cube.centre_mm) @ axes.T
            share = path.s_mm / path.command.length_mm
            parts.append((path.s_mm, share, place, mean @ axes.T, np.linalg.norm(mean, axis=1), repeat))
            names += [name] * len(mean)
        return PathCurve(np.array(names), *(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def evaluate(
    table: PathTable, cube: Cube, instrument: TrackerPose | None, where: str, speed_mm_s: float | None = None
) -> PathResult:
    """Figures of a path recording.

    NAME_at_mm and NAME_rt_mm of line, circle and small_circle; corner_round_mm, corner_overshoot_mm; f_max_mm,
    f_min_mm, d_mm of the large circle in both directions; speed_mm_s along the line, or the largest path found, doubted
    by a note unless it is a program speed for speed_mm_s. Raises FileError if the recording contains no path of the
    cube.
    """
    driven = driven_paths(table, cube, None if instrument is None else transform(instrument), where)
    paths, figures, u_mm = driven.paths, dict[str, Quantity](), 0.0 if instrument is None else instrument.u_mm
    for name in _JUDGED:
        if name in paths and len(paths[name].places) >= FEWEST_CYCLES:
            figures |= _redone(paths[name].off_mm, lambda off, name=name: at_and_rt(off, name))  # type: ignore[misc]
            accuracy = figures[f"{name}_at_mm"]
            figures[f"{name}_at_mm"] = replace(accuracy, u=float(np.hypot(accuracy.u, u_mm)))
    if "rectangle" in paths:
        figures |= _corners(paths["rectangle"])
    if "circle" in paths and "circle_cw" in paths:
        figures |= _radial(paths["circle"], paths["circle_cw"])
    speeds = next(iter(paths.values())).speed_mm_s
    speed, n = float(speeds.mean()), len(speeds)
    u = float(speeds.std(ddof=1) / np.sqrt(n)) if n > 1 else np.nan
    figures["speed_mm_s"] = Quantity(speed, u, "mm/s", n)
    counts = {name: len(paths[name].places) if name in paths else 0 for name in _ASKED}
    notes = list(driven.notes)
    if min(counts.values()) < CYCLES_ASKED:
        few = ", ".join(f"{name.replace('_', ' ')} {count} times" for name, count in counts.items())
        notes.append(f"ISO 9283 requires {CYCLES_ASKED} cycles, but there are only: {few}")
    if speed_mm_s is not None and not _SLOWEST * speed_mm_s <= speed <= _FASTEST * speed_mm_s:
        ways = f"the programs drive {0.1 * speed_mm_s:g} to {speed_mm_s:g} mm/s"
        remedy = "check that t_s is in s, and path_speed_mm_s of the rig file"
        notes.append(f"the tool went at {speed:.3g} mm/s, and {ways}: {remedy}")
    if instrument is None:
        notes.append(
            "AT and corners are the residuals of a best fit of the tracker's frame to these paths, which is less than "
            "required by ISO 9283; give tests.iso9283.instrument, a frame that was measured separately"
        )
    return PathResult(driven, cube, figures, len(table.t_s), tuple(notes))


def at_and_rt(off_mm: Array, name: str = "path") -> dict[str, Array]:
    accuracy = np.linalg.norm(off_mm.mean(axis=-3), axis=-1).max(axis=-1)
    repeat = rp(np.swapaxes(off_mm, -3, -2)).max(axis=-1)
    return {f"{name}_at_mm": accuracy, f"{name}_rt_mm": repeat}


def _redone(values: Array, plain: Callable[[Array], dict[str, Array]]) -> dict[str, Quantity]:
    """Figures of values (cycles, …), and their deviations from the expectation in repeated tests.

    Each repeated cycle is the mean plus a mixture of the differences between cycles, preserving their correlation along
    the path; the uncertainty of their scatter adds a chi-square draw.
    """
    rng, n = np.random.default_rng(_SEED), len(values)
    mean = values.mean(axis=0)
    away = (values - mean).reshape(n, -1) / np.sqrt(n - 1)
    level = np.sqrt((n - 1) / rng.chisquare(n - 1, _DRAWS))
    mixed = (level[:, None, None] * rng.standard_normal((_DRAWS, n, n))) @ away
    tests = plain(mean + mixed.reshape(_DRAWS, *values.shape))
    figures = {}
    for name, value in plain(values).items():
        drawn = tests[name]
        figures[name] = Quantity(float(value), half_width(drawn - drawn.mean()), "mm", n)
    return figures


def _corners(rectangle: DrivenPath) -> dict[str, Quantity]:
    """CR and CO from the first three cycles of the standard; u from all cycles.

    Between two positions the chord cuts a right corner by up to half its length: this is the minimum of 2 u.
    """
    assert isinstance(rectangle.command, Polygon)  # noqa: S101 - what the rectangle is
    each = np.array([[corner_of(place, rectangle.command, k) for k in (1, 2, 3)] for place in rectangle.places])
    hidden = float(each[:, :, 2].max()) / 4
    rng, few = np.random.default_rng(_SEED), min(_CORNER_CYCLES, len(each))
    figures = {}
    for column, name in enumerate(("corner_round_mm", "corner_overshoot_mm")):
        of_corners = each[:, :, column]
        drawn = of_corners[rng.integers(len(of_corners), size=(_DRAWS, few))].max(axis=(1, 2))
        u = half_width(drawn - drawn.mean()) if len(of_corners) > few else np.nan
        u = float(np.hypot(u, hidden)) if name == "corner_round_mm" else u
        figures[name] = Quantity(float(of_corners[:few].max()), u, "mm", few)
    return figures


def corner_of(places: Array, command: Polygon, knot: int) -> tuple[float, float, float]:
    """CR and CO in mm of one pass, positions (n, 3) mm, at a corner of a polygon, and the spacing there."""
    corner, before, after = command.knots[knot], command.knots[knot - 1], command.knots[knot + 1]
    old, new = (corner - before) / np.linalg.norm(corner - before), (after - corner) / np.linalg.norm(after - corner)
    reach = _NEAR * float(np.linalg.norm(after - corner))
    away = places - corner
    near = np.flatnonzero(np.linalg.norm(away, axis=1) < reach)
    if len(near) < 2:
        return np.nan, np.nan, np.nan
    first, last = int(near[0]), int(near[-1]) + 1
    begin, step = away[first : last - 1], np.diff(away[first:last], axis=0)
    share = np.clip(-(begin * step).sum(axis=1) / np.maximum((step**2).sum(axis=1), 1e-12), 0.0, 1.0)
    off = np.linalg.norm(begin + share[:, None] * step, axis=1)
    cut, apart = float(off.min()), float(np.linalg.norm(step[off.argmin()]))
    along, beyond = away[first:last] @ new, away[first:last] @ old
    aside = away[first:last] @ np.cross(old, new)
    passed = (along >= 0) & (along < reach)
    if not passed.any():
        return cut, 0.0, apart
    span = np.minimum((along[passed] / reach * _SPANS).astype(np.int64), _SPANS - 1)
    count = np.maximum(np.bincount(span, minlength=_SPANS), 1)
    y, x = (np.bincount(span, away[passed], minlength=_SPANS) / count for away in (beyond, aside))
    return cut, float(np.where(y > 0, np.hypot(x, y), 0.0).max()), apart


def _radial(acw: DrivenPath, cw: DrivenPath) -> dict[str, Quantity]:
    ring, n = acw.command, min(len(acw.places), len(cw.places))
    stations = min(len(acw.s_mm), len(cw.s_mm))
    if not isinstance(ring, Ring) or n < FEWEST_CYCLES or len(acw.s_mm) != len(cw.s_mm):
        return {}
    parts = []
    for way in (acw, cw):
        outwards = (way.command.at(way.s_mm) - ring.centre) / ring.radius_mm
        radial = (way.off_mm[:n] * outwards).sum(axis=2)
        angle = np.arctan2(outwards @ ring.v, outwards @ ring.u)
        parts.append((radial, np.stack([np.cos(angle), np.sin(angle)], axis=1)))
    waves = np.concatenate([parts[0][1], parts[1][1]])
    # One constant per direction and a common centre, as for a bidirectional least-squares circle.
    level = np.repeat(np.eye(2), stations, axis=0)
    back = np.linalg.pinv(np.hstack([level, waves]))

    def plain(both: Array) -> dict[str, Array]:
        mean = both.mean(axis=-2)
        fit = mean @ back.T
        centred = mean - fit[..., 2:] @ waves.T
        return {"f_max_mm": centred.max(axis=-1), "f_min_mm": centred.min(axis=-1), "d_mm": fit[..., :2].mean(axis=-1)}

    return _redone(np.hstack([parts[0][0], parts[1][0]]), plain)


class Path(TestKind[PathTable]):
    """Tool positions along the paths of the cube, seen by a tracker."""

    test = "path"
    table = PathTable
    fields = ("t_s", "xyz_mm")
    labels = Labels(
        example=("line_at_mm", 0.5, 1.0),
        unsupported_reason="is a path without joint angles, which cannot show single joints",
    )
    finders: ClassVar[Finders] = {WILDNESS: outlying_places, DUPLICATES: repeated_places}

    def evaluate(self, table: PathTable, rig: Rig, where: str, instruments: Instruments) -> PathResult:
        declared = iso9283_of(rig)
        return evaluate(table, cube_of(rig), declared.instrument, where, declared.path_speed_mm_s)

    def require_evaluable(self, table: PathTable, rig: Rig, where: str) -> None:
        driven_paths(table, cube_of(rig), None, where)

    def simulated(self, rig: Rig, direction: Direction | None, run: Simulation) -> PathTable:
        return PathTable(*simulated_path(rig, run.seed, run.effects))
