"""From a recorded series to readings at targets: where the robot stood still, at which target, and how it came there.

A radial or repeatability program stops at each target. While all joints stand, the gauge is averaged; the target is the
nearest of the rig file's; the side of approach is where the tool was, along the radius, since it last stood there.
Stands that do not belong to the program's order are not visits: where the robot stood before it began or after its end,
or waited at a target for something else. They are counted, not used.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Sequence
from itertools import pairwise

import numpy as np

from analysis.geometry.hemisphere import hemisphere_frame
from analysis.geometry.programs import (
    TargetProgram,
    hemisphere_of,
    radial_program,
    repeatability_of,
    repeatability_program,
)
from analysis.kinematics.arm import Array, Integers, arm_of, forward
from analysis.traces.align import Aligned
from analysis.traces.stands import Stand, stands_of
from analysis.traces.tables import RadialTable, RepeatabilityTable
from rigs.errors import FileError
from rigs.rig import Rig

_NEAR_MM = 20.0
_TURNED_RAD = np.radians(8.0)
"""A stand further from every target than this is not at a target."""
_FOLLOWED = 0.5
"""A run follows the program's order where at least this share of its stands at targets fits it."""


def radial_table(data: Aligned, rig: Rig, where: str) -> tuple[RadialTable, list[str]]:
    """Readings at every stand, and what a person should know. Raises FileError where no stand is at a target."""
    stands, program = stands_of(data.t_s, data.q, data.g_mm), radial_program(rig)
    near = _matched(stands, program, rig, _TURNED_RAD)
    at = [(stand, row) for stand, row in zip(stands, near, strict=True) if row >= 0]
    places = list(zip(program.target.tolist(), program.orientation.tolist(), strict=True))
    fits, doubts = _in_order([places[row] for _, row in at], places, len(places) // hemisphere_of(rig).visits)
    kept = [at[k] for k in fits]
    rows = _rows(kept, where)
    doubts = _elsewhere(len(stands) - len(at)) + doubts + _missing(program, rows) + _outliers(kept)
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
    stands, program = stands_of(data.t_s, data.q, data.g_mm), repeatability_program(rig)
    frame, arm = hemisphere_frame(hemisphere_of(rig)), arm_of(rig.robot)
    limit = repeatability_of(rig).approach_mm / 2
    outwards = np.linalg.norm(forward(arm, data.q)[:, :3, 3] - frame.centre, axis=1) - frame.radius
    at = [
        (stand, row)
        for stand, row in zip(stands, _matched(stands, program, rig, np.pi), strict=True)
        if row >= 0 and abs(outwards[stand.begin : stand.end].mean()) < limit
    ]
    sides = _sides([stand for stand, _ in at], [row for _, row in at], outwards, limit)
    order = ["none", *["out", "in"] * repeatability_of(rig).rounds]
    wanted = [(row, side) for row in range(len(program.target)) for side in order]
    found = [(row, side) for (_, row), side in zip(at, sides, strict=True)]
    fits, doubts = _in_order(found, wanted, len(wanted))
    kept = [at[k] for k in fits]
    rows = _rows(kept, where)
    table = RepeatabilityTable(
        program.target[rows],
        np.array([sides[k] for k in fits]),
        _rounds([found[k] for k in fits]),
        np.array([stand.t_s for stand, _ in kept]),
        np.array([stand.q for stand, _ in kept]),
        np.array([stand.g_mm[0] for stand, _ in kept]),
    )
    return table, doubts + _missing(program, rows) + _outliers(kept)


def _sides(stands: list[Stand], rows: list[int], outwards: Array, limit: float) -> list[str]:
    """Side of approach of each stand."""
    sides = ["none"]
    for (before, now), (last, row) in zip(pairwise(stands), pairwise(rows), strict=True):
        way = outwards[before.end : now.begin]
        furthest = way[np.argmax(np.abs(way))] if len(way) else 0.0
        sides.append("none" if last != row or abs(furthest) < limit else "out" if furthest > 0 else "in")
    return sides[: len(stands)]


def _rounds(approaches: list[tuple[int, str]]) -> Integers:
    """Round (n,) of each approach (target, side): the count of that side at that target."""
    seen: Counter[tuple[int, str]] = Counter()
    rounds = []
    for one in approaches:
        seen[one] += 1
        rounds.append(seen[one])
    return np.array(rounds, dtype=np.int64)


def _in_order(found: Sequence[Hashable], wanted: Sequence[Hashable], once: int) -> tuple[list[int], list[str]]:
    """Which of the places found, by number, follow the order wanted, and what is to be said of the others.

    once: places of one pass of the program. A pass that ends with its first place is not counted: the robot went back.
    """
    pairs = _longest_common(found, wanted)
    if len(pairs) > 1 and pairs[-1][1] > 0 and pairs[-1][1] % once == 0:
        pairs.pop()
    others = len(found) - len(pairs)
    if len(pairs) < _FOLLOWED * len(found):
        return list(range(len(found))), [
            "targets were visited in another order than in the rig file: all stands are used"
        ]
    said = f"{others} stands outside the order of the program (before it, after it, or once too often) are not used"
    return [k for k, _ in pairs], [said] if others else []


def _longest_common(found: Sequence[Hashable], wanted: Sequence[Hashable]) -> list[tuple[int, int]]:
    """Numbers in both of the longest common subsequence; of equal ones, the one whose places were found last."""
    codes = {place: code for code, place in enumerate(dict.fromkeys([*found, *wanted]))}
    targets = np.array([codes[place] for place in wanted], dtype=np.int64)
    length = np.zeros((len(found) + 1, len(wanted) + 1), dtype=np.int32)
    for k, place in enumerate(found):
        longer = np.where(targets == codes[place], length[k, :-1] + 1, 0)
        length[k + 1, 1:] = np.maximum.accumulate(np.maximum(length[k, 1:], longer))
    pairs, k, j = [], len(found), len(wanted)
    while length[k, j]:
        if length[k, j - 1] == length[k, j]:
            j -= 1
        elif found[k - 1] == wanted[j - 1]:
            k, j = k - 1, j - 1
            pairs.append((k, j))
        else:
            k -= 1
    return pairs[::-1]


def _rows(kept: list[tuple[Stand, int]], where: str) -> Integers:
    if not kept:
        raise FileError(
            where, "the robot did not stand at any target", "correct tests.hemisphere, or record its program"
        )
    return np.array([row for _, row in kept], dtype=np.int64)


def _outliers(kept: list[tuple[Stand, int]]) -> list[str]:
    count = sum(stand.outliers for stand, _ in kept)
    return [f"{count} readings lie far from the others of their stand and are not used"] if count else []


def _elsewhere(count: int) -> list[str]:
    return [f"{count} stands are left out because they are not at a target"] if count else []


def _missing(program: TargetProgram, rows: Integers) -> list[str]:
    missing = sorted(set(program.target.tolist()) - set(program.target[rows].tolist()))
    if not missing:
        return []
    return [f"the run has no stand at target {', '.join(map(str, missing[:8]))}{' …' if len(missing) > 8 else ''}"]


def _matched(stands: list[Stand], program: TargetProgram, rig: Rig, turned: float) -> list[int]:
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
