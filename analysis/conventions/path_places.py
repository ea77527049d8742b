"""Places of a path that an instrument did not measure: spikes, and a beam that stood still while the tool went on.

A tool goes smoothly: where it is follows from three places before, and from three behind. A spike lies off what both
say, and they agree; at a corner, where a move begins and at a step at least one of them is right. Taken at distances of
one to some places, spikes of as many places are seen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from analysis.kinematics.arm import Array, Mask
from analysis.traces.tables import PathTable
from rigs.text import listed

_STRIDES, _SMOOTH_S = (1, 2, 3, 5, 8), 0.016
"""Distances of the places that a place is held against: spikes of up to eight are seen, as long as the path is smooth
over that time. On a circle of 20 mm at 250 mm/s it turns by a fifth of a radian."""
_SPREADS, _AGREE = 10.0, 2.0
"""A spike is so many robust standard deviations from where both sides have it, and so many times as far as these lie
apart."""
_LEAST_MM = 0.1
"""No tracker resolves so badly, and no spike below this changes a figure."""
_ALIKE = 5
"""So many equal places in a row are no motion, …"""
_CAUGHT_UP, _BEFORE, _AHEAD = 0.75, 20, 0.5
"""… where the tool has gone on by this share of what its speed before would make; it moved where so many steps before
lead ahead by that share of their length, and do not tremble about a place."""


@dataclass(frozen=True)
class Places:
    """Which places (n,) of a path are wild, by how much, mm (n,), and which repeat the one before."""

    wild: Mask
    away_mm: Array
    repeated: Mask

    @property
    def words(self) -> dict[str, str]:
        """What a person should know, by `wild` and `repeated`; nothing where there are none."""
        words = {}
        if count := int(self.wild.sum()):
            named = listed((np.flatnonzero(self.wild) + 1).tolist())
            is_at = f"is wild: row {named} is" if count == 1 else f"are wild: rows {named} are up to"
            far_mm = float(self.away_mm[self.wild].max())
            words["wild"] = f"{count} of {len(self.wild)} places {is_at} {far_mm:.2g} mm from the path beside"
        if count := int(self.repeated.sum()):
            rows = np.flatnonzero(self.repeated) + 1
            words["repeated"] = (
                f"{count} of {len(self.wild)} places repeat the one before to the last digit while the tool went on, "
                f"from row {rows[0]} on: the instrument sent its last place again"
            )
        return words


def places_of(table: PathTable) -> Places:
    """Return which places of a path were not measured."""
    repeated, wild = np.zeros(len(table.t_s), dtype=bool), np.zeros(len(table.t_s), dtype=bool)
    step = np.linalg.norm(np.diff(table.xyz_mm, axis=0), axis=1)
    # Rows of equal places behind which the tool is further on.
    edges = np.diff(np.concatenate([[False], step == 0, [False]]).astype(np.int64))
    for begin, end in zip(np.flatnonzero(edges > 0).tolist(), np.flatnonzero(edges < 0).tolist(), strict=True):
        first = max(0, begin - _BEFORE)
        if end - begin + 1 < _ALIKE or begin < 2 or end > len(step) - 1:
            continue
        way = float(step[first:begin].sum())
        moved = np.linalg.norm(table.xyz_mm[begin] - table.xyz_mm[first]) > _AHEAD * way
        if moved and step[end] > _CAUGHT_UP * way / (begin - first) * (end - begin + 1) > 0:
            repeated[begin + 1 : end + 1] = True
    kept, away_mm = np.flatnonzero(~repeated), np.zeros(len(table.t_s))
    wild[kept], away_mm[kept] = _wild(table.t_s[kept], table.xyz_mm[kept])
    return Places(wild, away_mm, repeated)


def measured_places(table: PathTable) -> tuple[PathTable, list[str]]:
    """Return a path without the places that were not measured, and what was left out, in words."""
    places = places_of(table)
    kept = ~(places.wild | places.repeated)
    notes = [f"{words}; left out" for words in places.words.values()]
    return replace(table, t_s=table.t_s[kept], xyz_mm=table.xyz_mm[kept]), notes


def _wild(t_s: Array, xyz_mm: Array) -> tuple[Mask, Array]:
    """Which places (n,) lie off the path beside them, and by how much, mm (n,)."""
    count = len(t_s)
    wild, away = np.zeros(count, dtype=bool), np.zeros(count)
    step_s = float(np.median(np.diff(t_s))) if count > 1 else 0.0
    for stride in _STRIDES:
        reach = 3 * stride
        if count < 3 * reach or (stride > 1 and stride * step_s > _SMOOTH_S):
            break
        middle = slice(reach, count - reach)
        sides = []
        for way in (-stride, stride):
            near, further, farthest = (xyz_mm[reach + k * way : count - reach + k * way or None] for k in (1, 2, 3))
            sides.append(3 * near - 3 * further + farthest)
        off = np.min([np.linalg.norm(xyz_mm[middle] - side, axis=1) for side in sides], axis=0)
        apart = np.linalg.norm(sides[1] - sides[0], axis=1)
        span = t_s[2 * reach :] - t_s[: count - 2 * reach]
        limit = max(_SPREADS * 1.4826 * float(np.median(off)), _LEAST_MM)
        seen = (off > limit) & (off > _AGREE * apart) & (span < 2 * float(np.median(span)))
        away[middle] = np.where(seen, np.maximum(away[middle], off), away[middle])
        wild[middle] |= seen
    return wild, away
