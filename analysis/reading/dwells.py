"""From a recorded series to readings at targets: where the robot stood still, at which target, and how it came there.

A radial or repeatability program stops at each target. While all joints stand, the gauge is averaged; the target is the
nearest of the rig file's; the side of approach is where the tool was, along the radius, since it last stood there.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from analysis.kinematics.arm import Array, arm_of, forward
from analysis.model.programs import (
    TargetProgram,
    hemisphere_of,
    radial_program,
    repeatability_of,
    repeatability_program,
)
from analysis.model.targets import hemisphere_frame
from analysis.reading.align import Aligned
from analysis.reading.tables import Integers, RadialTable, RepeatabilityTable
from rigs.errors import FileError
from rigs.rig import Rig

_STANDS_RAD = np.radians(0.01)
"""Joints that move by less within the window stand; an encoder's noise is a tenth of it."""
_WINDOW_S = 0.3
_SETTLED = 0.5
"""Share of a stand, at its end, that is averaged: the arm has stopped swinging by then."""
_NEAR_MM = 20.0
_TURNED_RAD = np.radians(8.0)
"""Further from a target than this, a stand is at none of them."""


@dataclass(frozen=True)
class _Stand:
    """Rows [begin, end) in which all joints stood; mean angles (6,) rad and mean readings (k,) of the settled part."""

    begin: int
    end: int
    t_s: float
    q: Array
    g_mm: Array


def radial_table(data: Aligned, rig: Rig, where: str) -> tuple[RadialTable, list[str]]:
    """Readings at every stand, and what a person should know. Raises FileError where no stand is at a target."""
    stands, program = _stands(data), radial_program(rig)
    found = _matched(stands, program, rig, _TURNED_RAD)
    kept = [(stand, row) for stand, row in zip(stands, found, strict=True) if row >= 0]
    rows = _rows(kept, where)
    doubts = _elsewhere(len(stands) - len(kept)) + _missing(program, rows)
    table = RadialTable(
        program.target[rows],
        program.polar[rows],
        program.azimuth[rows],
        program.orientation[rows],
        np.array([stand.t_s for stand, _ in kept]),
        np.array([stand.q for stand, _ in kept]),
        np.array([stand.g_mm[0] for stand, _ in kept]),
    )
    return table, doubts


def repeatability_table(data: Aligned, rig: Rig, where: str) -> tuple[RepeatabilityTable, list[str]]:
    """Readings at every stand with the side it was approached from, and what a person should know. Raises FileError
    as above."""
    stands, program = _stands(data), repeatability_program(rig)
    frame, arm = hemisphere_frame(hemisphere_of(rig)), arm_of(rig.robot)
    limit = repeatability_of(rig).approach_mm / 2
    outwards = np.linalg.norm(forward(arm, data.q)[:, :3, 3] - frame.centre, axis=1) - frame.radius
    kept = [
        (stand, row)
        for stand, row in zip(stands, _matched(stands, program, rig, np.pi), strict=True)
        if row >= 0 and abs(outwards[stand.begin : stand.end].mean()) < limit
    ]
    rows = _rows(kept, where)
    approach, rounds = _sides([stand for stand, _ in kept], rows, outwards, limit)
    table = RepeatabilityTable(
        program.target[rows],
        np.array(approach),
        np.array(rounds, dtype=np.int64),
        np.array([stand.t_s for stand, _ in kept]),
        np.array([stand.q for stand, _ in kept]),
        np.array([stand.g_mm[0] for stand, _ in kept]),
    )
    return table, _missing(program, rows)


def _sides(stands: list[_Stand], rows: Integers, outwards: Array, limit: float) -> tuple[list[str], list[int]]:
    """Side of approach of each stand, and the round it belongs to: the count of that side at that target."""
    approach, seen = ["none"], {(int(rows[0]), "none"): 1}
    rounds = [1]
    for (before, now), (last, row) in zip(pairwise(stands), pairwise(rows.tolist()), strict=True):
        way = outwards[before.end : now.begin]
        furthest = way[np.argmax(np.abs(way))] if len(way) else 0.0
        side = "none" if last != row or abs(furthest) < limit else "out" if furthest > 0 else "in"
        seen[row, side] = seen.get((row, side), 0) + 1
        approach.append(side)
        rounds.append(seen[row, side])
    return approach, rounds


def _rows(kept: list[tuple[_Stand, int]], where: str) -> Integers:
    if not kept:
        raise FileError(
            where, "the robot stood at none of the targets", "correct tests.hemisphere, or record its program"
        )
    return np.array([row for _, row in kept], dtype=np.int64)


def _elsewhere(count: int) -> list[str]:
    return [f"stands left out that are at no target: {count}"] if count else []


def _missing(program: TargetProgram, rows: Integers) -> list[str]:
    missing = sorted(set(program.target.tolist()) - set(program.target[rows].tolist()))
    if not missing:
        return []
    return [f"no stand at target {', '.join(map(str, missing[:8]))}{' …' if len(missing) > 8 else ''}"]


def _stands(data: Aligned) -> list[_Stand]:
    ahead = np.searchsorted(data.t_s, data.t_s + _WINDOW_S).clip(max=len(data.t_s) - 1)
    still = (np.abs(data.q[ahead] - data.q).max(axis=1) < _STANDS_RAD) & (data.t_s[ahead] - data.t_s >= 0.9 * _WINDOW_S)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
    stands = []
    for begin, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        end = int(ahead[last - 1]) + 1
        settled = slice(begin + int((end - begin) * (1 - _SETTLED)), end)
        stands.append(
            _Stand(
                begin,
                end,
                float(data.t_s[settled].mean()),
                data.q[settled].mean(axis=0),
                data.g_mm[settled].mean(axis=0),
            )
        )
    return stands


def _matched(stands: list[_Stand], program: TargetProgram, rig: Rig, turned: float) -> list[int]:
    """For each stand the row of the program nearest to it; -1 where none is near."""
    if not stands:
        return []
    arm = arm_of(rig.robot)
    wanted, reached = forward(arm, program.q), forward(arm, np.array([stand.q for stand in stands]))
    away = np.linalg.norm(reached[:, None, :3, 3] - wanted[None, :, :3, 3], axis=2)
    cosine = (np.einsum("aij,bij->ab", reached[:, :3, :3], wanted[:, :3, :3]) - 1) / 2
    angle = np.arccos(np.clip(cosine, -1, 1))
    badness = away / _NEAR_MM + angle / _TURNED_RAD
    best = badness.argmin(axis=1)
    near = (away[np.arange(len(best)), best] < _NEAR_MM) & (angle[np.arange(len(best)), best] < turned)
    return [int(row) if good else -1 for row, good in zip(best, near, strict=True)]
