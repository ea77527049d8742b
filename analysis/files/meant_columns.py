"""Columns of a table read in another way than their names or their order say: the hypotheses that the conventions have
of a run (`analysis.conventions.joint_meanings`), and a frame that is left-handed.

What a map can state (another order of the columns, an axis that counts the other way, a mirror) becomes a question;
zeros and couplings are of the rig file, and are named.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from analysis.conventions.joint_meanings import Meaning, meanings
from analysis.conventions.joints import left_mm
from analysis.files.cells import TableFileError
from analysis.files.mapped import poses_of
from analysis.files.raw_table import RawTable
from analysis.files.table_map import TableMap
from analysis.kinematics.arm import Arm, Array, forward
from analysis.traces.tables import PoseTable

_STEPS, _ALL_STEPS, _BEST = 8, 60, 3
"""Steps of a fit while meanings are screened, of the best few of them, and how many those are."""
_ALIKE = 4.0
"""Places spread as far as the flange does, but for what the tool adds: units in which they do not are left out."""
_MIRROR = "y"
"""Any axis will do: the frame is fitted."""


@dataclass(frozen=True)
class Meant:
    """A map by which poses fit the arm, what it leaves, rms in mm and as a share of how far the places lie apart, and
    what it reads otherwise, in words. remedy: what to do where a map cannot state it, else empty."""

    table_map: TableMap
    left_mm: float
    share: float
    words: str
    remedy: str


def meant(raw: RawTable, bare: Arm, base: TableMap) -> list[Meant]:
    """Return the ways to read the joints and places of a map otherwise, the best first; none where its units do not
    suit the arm."""
    try:
        poses = poses_of(raw, base)
    except TableFileError:
        return []
    sound = (poses.xyz_mm != 0).any(axis=1)
    q, xyz_mm = poses.q[sound], poses.xyz_mm[sound]
    apart, reach = _spread(xyz_mm), _spread(forward(bare, q)[:, :3, 3])
    if not 1 / _ALIKE < apart / max(reach, 1e-9) < _ALIKE:
        return []

    def judged(way: tuple[TableMap, Meaning | None, str, str], steps: int) -> Meant:
        table_map, meaning, words, remedy = way
        seen = xyz_mm if meaning else xyz_mm @ np.diag([-1.0 if letter == _MIRROR else 1.0 for letter in "xyz"])
        rms_mm = left_mm(PoseTable(q, seen, None), bare, meaning.of(q) if meaning else q, steps, with_turns=False)
        return Meant(table_map, rms_mm, rms_mm / apart, words, remedy)

    ways = list(_ways(base, bare.axes))
    order = np.argsort([judged(way, _STEPS).left_mm for way in ways])[:_BEST]
    return sorted((judged(ways[k], _ALL_STEPS) for k in order.tolist()), key=lambda otherwise: otherwise.left_mm)


def _ways(base: TableMap, axes: int) -> Iterator[tuple[TableMap, Meaning | None, str, str]]:
    """Every other way to read a map: the map, the meaning, None for a mirror, in words, and what to do where a map
    cannot state it."""
    if base.joints is None or base.place is None:
        return
    mirrored = base.place.model_copy(update={"mirror": _MIRROR})
    yield base.model_copy(update={"place": mirrored}), None, f"{_MIRROR} mirrored: the frame is left-handed", ""
    columns = np.array(base.joints.columns, dtype=object)
    for meaning in meanings(axes):
        is_order = not meaning.offset.any() and bool((np.abs(meaning.matrix).sum(axis=1) == 1).all())
        if not is_order:
            yield base, meaning, meaning.words, meaning.remedy
            continue
        backwards = tuple((np.flatnonzero(meaning.matrix.sum(axis=1) < 0) + 1).tolist())
        order = tuple(columns[np.abs(meaning.matrix).argmax(axis=1)].tolist())
        joints = base.joints.model_copy(update={"columns": order, "reversed": backwards})
        yield base.model_copy(update={"joints": joints}), meaning, meaning.words, ""


def _spread(places: Array) -> float:
    return float(np.sqrt(((places - places.mean(axis=0)) ** 2).sum(axis=1).mean()))
