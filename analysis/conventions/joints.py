"""The joint columns as labelled against every other way in which they may have been meant.

Poses: base and tool are fitted to the nearest four fifths for each meaning, and what is left is compared. A wrong
meaning leaves centimetres, an arm by its nominal constants millimetres. Circles and targets: the program put the tool
on a path that the rig file states, and only the right meaning does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.conventions.finding import Finding, Misfit
from analysis.conventions.joint_meanings import Meaning, meanings
from analysis.conventions.off_path import off_path
from analysis.geometry.pose_setup import fit_setup, position_error
from analysis.kinematics.arm import Arm, Array, Integers, arm_of, forward, without_setup
from analysis.traces.tables import CircleTable, PoseTable, Table, TouchTable
from rigs.rig import Rig

JOINTS = "joints"
FEWEST = 12
"""Poses from which on a meaning is judged: nine unknowns, and as many readings again that are not fitted."""
_SCREENED, _JUDGED = 80, 300
"""Poses by which meanings are screened, and by which the best few are judged; more would show no more."""
_STEPS, _BEST = 8, 6
"""Steps of a fit while meanings are screened, and how many of them are then fitted to the end."""
_KEPT = 0.8
"""Share of the poses, the nearest, that is fitted and compared: lost points move no base."""
_ROUNDS = 3
_NOTHING_MM = 1e-3
"""Below a micrometre the labels are right: what is left are rounded digits, which any meaning may fit better."""
RIGHT_MM = 10.0
"""An arm by its nominal constants errs by some mm; what leaves more is not right either."""
CLEARLY = 4.0
"""Factor by which a meaning must fit better. The constants of a real arm, all free, gained 2.6 (UR10); a meaning has no
unknown."""
_AS_WELL = 1.5
"""Meanings within this factor of the best are not distinguished."""
_ARM_MM = 100.0
"""Distance at which a turn counts as a length."""
_ROWS = 2000
"""Rows of a circle that show its path."""


@dataclass(frozen=True)
class _Judged:
    """What a meaning leaves, rms in mm of `values` readings that no unknown absorbs."""

    meaning: Meaning
    left_mm: float
    values: int


_Verdict = tuple[_Judged | None, float, list[_Judged]]
"""The meaning that fits where the labelled one does not, None without one; what the labelled one leaves, rms mm; and
those that fit as well as the best."""


def joint_findings(table: Table, rig: Rig) -> Iterator[Finding]:
    """What speaks against the labels of the joint columns of a table: their order, signs, zeros or coupling."""
    best, as_labelled, as_good = _judged(table, rig)
    if best is None or as_labelled < _NOTHING_MM:
        return
    words = " or ".join(judged.meaning.words for judged in (best, *as_good))
    rows = "poses fit" if isinstance(table, PoseTable) else "rows lie on the path of the test"
    what = (
        f"only with {words} do these {rows}: {_length(best.left_mm)} instead of {_length(as_labelled)}; order, signs, "
        "zeros and coupling of the joints are not those of the rig file"
    )
    gain = best.values * float(np.log(as_labelled / max(best.left_mm, 1e-9)))
    misfit = Misfit(as_labelled, best.left_mm, gain)
    remedy = best.meaning.remedy if not as_good else "look up in the controller which it is, and correct the columns"
    if rig.robot.rail and best.meaning.columns == ("q1_deg",) and not as_good and best.meaning.offset.any():
        remedy += (
            "; or correct robot.rail.direction, which a rail that leads or counts another way asks for, and looks alike"
        )
    yield Finding(JOINTS, "decisive", best.meaning.columns, words, what, remedy, misfit)


def cannot_tell(table: Table, rig: Rig) -> str:
    """Why a table cannot show what its joint columns mean; empty where it can."""
    if isinstance(table, TouchTable):
        return "a touch has no place of its own"
    if isinstance(table, PoseTable):
        sound = int((table.xyz_mm != 0).any(axis=1).sum())
        return "" if sound >= FEWEST else f"{sound} poses are too few; {FEWEST} are needed"
    place = rig.tests.circle if isinstance(table, CircleTable) else rig.tests.hemisphere
    return "" if place else "the rig file does not say where the test was driven"


def _judged(table: Table, rig: Rig) -> _Verdict:
    """Which meaning of its joint columns fits a table."""
    if cannot_tell(table, rig):
        return None, 0.0, []
    if not isinstance(table, PoseTable):
        # Of a circle or of targets: which meaning puts the tool on the path that the rig file states.
        arm = arm_of(rig.robot)
        rows = slice(None, None, max(1, len(table.q) // _ROWS))
        part = replace(table, **{name: getattr(table, name)[rows] for name in _row_wise(table)})

        def off(read: Callable[[Array], Array]) -> tuple[float, bool]:
            path = off_path(forward(arm, read(part.q)), part, rig)
            return (0.0, True) if path is None else (path.off_mm, path.on)

        as_labelled, is_on = off(lambda q: q)
        if is_on:
            return None, as_labelled, []
        judged = [
            _Judged(meaning, off_mm, len(part.q))
            for meaning in meanings(arm.axes)
            for off_mm, on in [off(meaning.of)]
            if on
        ]
        return _decided(judged, as_labelled, np.inf) if judged else (None, as_labelled, [])
    bare = without_setup(arm_of(rig.robot))
    verdict = _of_misfits(table, bare, with_turns=False)
    return verdict if verdict[0] or table.rpy is None else _of_misfits(table, bare, with_turns=True)


def _of_misfits(table: PoseTable, bare: Arm, *, with_turns: bool) -> _Verdict:
    few, many = (_some(table, rows) for rows in (_SCREENED, _JUDGED))
    as_labelled = left_mm(many, bare, many.q, 100, with_turns=with_turns)
    screened = sorted(
        meanings(bare.axes), key=lambda meaning: left_mm(few, bare, meaning.of(few.q), _STEPS, with_turns=with_turns)
    )
    values = int(3 * _KEPT * len(table.q)) - 9
    judged = [
        _Judged(meaning, left_mm(many, bare, meaning.of(many.q), 100, with_turns=with_turns), values)
        for meaning in screened[:_BEST]
    ]
    return _decided(judged, as_labelled, RIGHT_MM)


def _decided(judged: Sequence[_Judged], as_labelled: float, right_mm: float) -> _Verdict:
    first, *others = sorted(judged, key=lambda judged_meaning: judged_meaning.left_mm)
    if first.left_mm > right_mm or as_labelled < CLEARLY * first.left_mm:
        return None, as_labelled, []
    return (
        first,
        as_labelled,
        [judged_meaning for judged_meaning in others if judged_meaning.left_mm < _AS_WELL * first.left_mm],
    )


def _some(table: PoseTable, rows: int) -> PoseTable:
    """The table without lost places, and of many poses so many, evenly."""
    measured = np.flatnonzero((table.xyz_mm != 0).any(axis=1))
    chosen = measured[np.unique(np.linspace(0, len(measured) - 1, rows).astype(int))]
    rpy = None if table.rpy is None else table.rpy[chosen]
    return PoseTable(table.q[chosen], table.xyz_mm[chosen], rpy)


def left_mm(table: PoseTable, bare: Arm, q: Array, steps: int, *, with_turns: bool) -> float:
    """What the nearest poses leave, rms mm, with base and tool fitted to them, at joints q (n, axes) rad; with turns,
    each counts as a length beside it."""
    T = forward(bare, q)
    kept = np.arange(len(q))
    count = max(int(_KEPT * len(q)), 9)
    distance = np.zeros(len(q))
    for _ in range(_ROUNDS if steps > _STEPS else 1):
        setup = fit_setup(T[kept], table.xyz_mm[kept], steps)
        distance = np.linalg.norm(position_error(T, table.xyz_mm, setup), axis=1)
        if with_turns and table.rpy is not None:
            distance = np.hypot(distance, _ARM_MM * _turned(T, table.rpy, setup.T_world_base, kept))
        kept = np.sort(np.argsort(distance)[:count])
    return float(np.sqrt(np.mean(distance[kept] ** 2)))


def _turned(T: Array, rpy: Array, base: Array, kept: Integers) -> Array:
    """Angles (n,) rad between turns seen rpy (n, 3) rad and those of the arm, T (n, 4, 4), on a tool whose turn is the
    mean of the kept ones."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

    seen = Rotation.from_matrix(base[:3, :3]).inv() * Rotation.from_euler("xyz", rpy)
    arm = Rotation.from_matrix(T[:, :3, :3])
    tool = (arm[kept].inv() * seen[kept]).mean()
    return np.asarray((seen * (arm * tool).inv()).magnitude())


def _row_wise(table: Table) -> list[str]:
    """The fields of a table that have a value for each row."""
    return [name for name, value in vars(table).items() if isinstance(value, np.ndarray)]


def _length(mm: float) -> str:
    return f"{mm:.2g} mm" if mm < 10 else f"{mm:.0f} mm"
