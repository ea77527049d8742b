"""Paths of the cube in a tracker recording: identify the moves, determine the frame, and compute the deviations.

recording  →  moves, between two standstills  →  paths, by length and chord  →  frame  →  deviations

Positions are averaged over short spans, so that tracker noise, estimated from second differences, is not taken for
motion. A standstill is longer than half a second: at corners some controllers almost stop, but for less. Data before
the first and after the last standstill is dropped, because its completeness is unknown.

A move is identified by length and chord; the first of the two directions around the large circle is anticlockwise, as
in the program. An unknown tracker frame is fitted to all paths: first by the relative position along each path, then
from each position to the closest path point. Deviations are taken across the path, as in ISO 9283, and averaged between
stations, which are closer than any feature of robot motion.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from analysis.procedures.checks.lost_poses import measured_places
from analysis.robot.geometry.iso_cube import CommandPath, Cube, PathName, paths_of
from analysis.robot.geometry.pose_setup import best_rigid, in_frame
from analysis.robot.kinematics.arm import Array
from analysis.runs.tables import PathTable
from rigs.errors import FileError

_SPAN_S, _SAMPLES = 0.05, 4
"""Averaging time, and minimum number of positions averaged."""
_STANDSTILL_S = 0.6
_SLOW = 0.02
"""Share of the 90 % quantile of the speeds below which the tool is at rest …"""
_NOISES = 6.0
"""… or multiple of the standard deviation caused by noise alone."""
_GAP_S = 0.3
"""Longest gap in the tracker data of a complete move; after a longer gap the target was lost."""
_NORMAL = 1.4826
"""Ratio of the standard deviation of a normal distribution to its median absolute deviation."""


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
    """Moves between standstills, in order, for positions xyz_mm (n, 3) at increasing times t_s (n,)."""
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
    noise_mm = float(_NORMAL * np.median(bends) / np.sqrt(6))  # standard deviation of a coordinate
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

    places: positions of each cycle, (k, 3) mm in the world. s_mm (m,): stations along the path. off_mm (cycles, m, 3):
    mean deviation at each station, across the path, in the world. speed_mm_s (cycles,): mean speed along the middle
    half.
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
    """Paths of a cube in a recording.

    T_world_instrument (4, 4): tracker frame in mm, None to fit it. Raises FileError if the recording contains no paths,
    or not those of this cube.
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
            where, problem, "check the unit, the cube of the rig file, and the recording", code="path.missing"
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
        raise FileError(where, problem, "record more positions per second", code="path.sparse")
    far_mm = max(float(np.median(np.linalg.norm(driven.off_mm, axis=2))) for driven in paths.values())
    if far_mm > _MOST_DEVIATION * cube.side_mm:
        problem = f"the paths lie {far_mm:.3g} mm from those of the cube in the rig file"
        or_else = "" if T_world_instrument is None else ", tests.iso9283.instrument and the tool"
        raise FileError(
            where, problem, f"give the rig file of the program, and check the cube{or_else}", code="path.other_cube"
        )
    torn = sum(not move.whole for cycles in every.values() for move in cycles)
    notes = [f"{torn} paths are ignored because of gaps in the readings of the tracker"] if torn else []
    if coarse:
        notes.append(f"too few places were written to judge: {', '.join(coarse)}; record more positions per second")
    return DrivenPaths(paths, T, (*left_out, *notes))


def _sorted(
    table: PathTable, commands: Mapping[PathName, CommandPath], moves: list[PathMove]
) -> dict[PathName, list[PathMove]]:
    """Moves of each path, in order of time."""
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
    """Frame (4, 4) that fits all positions to their paths."""
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
