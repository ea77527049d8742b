"""Poses that a tracker did not measure: it lost its target, or the robot was elsewhere. They are left out and counted.

A place of exactly 0, 0, 0 is what instruments write without a target. Others are wild by `analysis.noise.wild`, by
their place or their turn beside an arm whose base and tool are fitted to the poses that are near.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from analysis.kinematics.arm import Array, Integers, Mask
from analysis.noise.cell import TARGET_MM
from analysis.noise.wild import SPREADS, by_accident, far_from_fit
from analysis.traces.tables import PoseTable
from rigs.text import listed

_LEAST_RAD = 0.001
"""The least that a turn counts as a standard deviation: ten times what trackers resolve."""
_KEPT = 6
"""Poses that fit base and tool; the nearest of fewer would fit anything."""
Fit = Callable[[PoseTable, PoseTable], tuple[Array, Array | None]]
"""Errors of place (n, 3) mm and of turn (n, 3) rad of the second table's poses, beside base and tool fitted to those of
the first."""


@dataclass(frozen=True)
class Kept:
    """A table without lost poses; rows (m,): the places of those kept in the table given. notes: in words."""

    table: PoseTable
    rows: Integers
    notes: tuple[str, ...]


def without_lost(table: PoseTable, fit: Fit) -> Kept:
    """Return a table without the poses that were not measured."""
    lost = (table.xyz_mm == 0).all(axis=1)
    if len(lost) - lost.sum() <= _KEPT:
        return Kept(table, np.arange(len(lost)), ())
    seen = _of(table, ~lost)

    def distances(kind: int) -> Callable[[Mask], Array]:
        def of_those(near: Mask) -> Array:
            errors = fit(_of(seen, near if near.sum() > _KEPT else np.ones_like(near)), seen)[kind]
            return np.zeros(len(near)) if errors is None else np.linalg.norm(errors, axis=1)

        return of_those

    far_mm, spreads = far_from_fit(distances(0), len(seen.q), TARGET_MM.high)
    far = spreads > SPREADS
    if seen.rpy is not None:
        far |= far_from_fit(distances(1), len(seen.q), _LEAST_RAD)[1] > SPREADS
    notes: list[str] = []
    if far.any() and not by_accident(far, seen.q):
        what = f"{far.sum()} of {len(far)} poses lie far from where the arm was, up to {_length(far_mm[far].max())}"
        notes.append(
            f"{what}, and are not left out: so many, or all in one range of a joint, are no lost points; check the "
            "signs, order and zeros of the joints, and whether instrument or base moved"
        )
        far[:] = False
    out = lost.copy()
    out[~lost] = far
    if out.any():
        kept = fit(_of(table, ~out), table)[0]
        notes.insert(0, _message(table, out, np.linalg.norm(kept, axis=1)))
    return Kept(_of(table, ~out), np.flatnonzero(~out), tuple(notes))


def _of(table: PoseTable, mask: Mask) -> PoseTable:
    rpy = None if table.rpy is None else table.rpy[mask]
    row = None if table.row is None else table.row[mask]
    return replace(table, q=table.q[mask], xyz_mm=table.xyz_mm[mask], rpy=rpy, row=row)


def _message(table: PoseTable, out: Mask, far_mm: Array) -> str:
    """Return which poses (n,) were left out, and how far (n,) mm they are from the arm."""
    rows = table.rows[out].tolist()
    shown = listed(rows)
    far, check = _length(far_mm[out].max()), "check that the tracker had its target and that the robot stood"
    if len(rows) == 1:
        return f"1 of {len(out)} poses left out: row {shown} is {far} from where the arm was; {check}"
    return f"{len(rows)} of {len(out)} poses left out: rows {shown} are up to {far} from where the arm was; {check}"


def _length(mm: float) -> str:
    return f"{mm / 1000:.2g} m" if mm >= 1000 else f"{mm:.3g} mm"
