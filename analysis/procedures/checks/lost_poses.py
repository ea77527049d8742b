"""Poses, touches and path positions that no robot explains: the tracker lost the target, or the robot was elsewhere.
They are excluded and counted, and doubtful readings are reported.

Instruments write a position of exactly 0, 0, 0 if there is no target. Other outliers are found by
`analysis.runs.noise.readings` in three steps: by position and by rotation relative to an arm with base and tool fitted
to the near poses, and by position relative to an arm with all constants fitted to these. The last step is necessary
because the error of an arm with nominal constants, half a millimetre, hides an error of 2 mm that would change every
constant.

Along a path the tool moves smoothly. Each position can be extrapolated from the three positions before and from the
three after. An outlier is far from both extrapolations, which agree with each other; at a corner, a start or a step at
most one of them is correct. Extrapolations over larger distances reveal outliers of several successive positions. A
beam that was interrupted while the tool moved is also found.

Positions and rows written more than once are also found: an instrument that repeats the last position, or a file
concatenated with itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from analysis.procedures.checks.place import FITTED, SPARE, two_placings
from analysis.procedures.facts import labels_of
from analysis.procedures.shared.finding import MOST_LISTED_ROWS, Finding, Outliers, length_in_words
from analysis.robot.geometry.pose_setup import fit_arm, fit_setup, position_error, socket_design
from analysis.robot.kinematics.arm import Arm, Array, Integers, Mask, arm_of, forward, without_setup
from analysis.runs.noise.cell_noise import TARGET_MM
from analysis.runs.noise.readings import FITTED_SPREADS, NEAR, SPREADS, STEPS, by_accident, far_from_fit, spreads_of
from analysis.runs.tables import PathTable, PoseTable, Table, TouchTable
from rigs.rig import Rig
from rigs.text import listed

_STRIDES, _SMOOTH_S = (1, 2, 3, 5, 8), 0.016
"""Distances between the compared positions, and the time over which the path must be smooth. Up to eight successive
outliers are found. On a circle of 20 mm at 250 mm/s the path turns by a fifth of a radian in this time.
"""
_SPREADS, _AGREE = 10.0, 2.0
"""Minimum distance of an outlier from both extrapolations, in robust standard deviations and relative to the
difference between the extrapolations.
"""
_LEAST_MM = 0.1
"""Smallest outlier. No tracker has a coarser resolution, and a smaller outlier changes no figure."""
_ALIKE = 5
"""Number of equal successive positions, above which the instrument has stopped measuring …"""
_CAUGHT_UP, _BEFORE, _AHEAD = 0.75, 20, 0.5
"""… if the tool moved on afterwards: by this share of the distance expected from its previous speed. The tool was
moving if the net distance over this number of previous steps is at least that share of their total length.
"""


@dataclass(frozen=True)
class Places:
    """Outliers (n,) of a path, their distances (n,) in mm, and the rows that repeat the previous position."""

    wild: Mask
    away_mm: Array
    repeated: Mask

    @property
    def words(self) -> dict[str, str]:
        words = {}
        if count := int(self.wild.sum()):
            named = listed((np.flatnonzero(self.wild) + 1).tolist())
            is_at = f"is an outlier: row {named} is" if count == 1 else f"are outliers: rows {named} are up to"
            far_mm = float(self.away_mm[self.wild].max())
            words["wild"] = f"{count} of {len(self.wild)} places {is_at} {far_mm:.2g} mm from the neighbouring path"
        if count := int(self.repeated.sum()):
            rows = np.flatnonzero(self.repeated) + 1
            words["repeated"] = (
                f"{count} of {len(self.wild)} places repeat the preceding one to the last digit although the tool "
                f"moved, from row {rows[0]} on: the instrument repeated the last place"
            )
        return words


def places_of(table: PathTable) -> Places:
    repeated, wild = np.zeros(len(table.t_s), dtype=bool), np.zeros(len(table.t_s), dtype=bool)
    step = np.linalg.norm(np.diff(table.xyz_mm, axis=0), axis=1)
    # Rows of equal positions after which the tool has moved on.
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
    wild[kept], away_mm[kept] = _outliers(table.t_s[kept], table.xyz_mm[kept])
    return Places(wild, away_mm, repeated)


def measured_places(table: PathTable) -> tuple[PathTable, list[str]]:
    """A path without outliers and repeated positions, and messages about the removed rows."""
    places = places_of(table)
    kept = ~(places.wild | places.repeated)
    notes = [f"{words}; ignored" for words in places.words.values()]
    return replace(table, t_s=table.t_s[kept], xyz_mm=table.xyz_mm[kept]), notes


def _outliers(t_s: Array, xyz_mm: Array) -> tuple[Mask, Array]:
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


_LEAST_RAD = 0.001
"""Lower limit of the standard deviation of a rotation: ten times the resolution of trackers."""
_KEPT = 6
"""Minimum number of poses for fitting base and tool; any fewer poses would fit."""
Fit = Callable[[PoseTable, PoseTable], tuple[Array, Array | None]]
"""Function that fits base and tool to the first table and returns the errors of position (n, 3) mm and of rotation
(n, 3) rad of the poses in the second table.
"""


def far_poses(table: PoseTable, bare: Arm, fit: Fit | None = None) -> Outliers:
    """Poses with a position far from that of an arm. Rows of 0, 0, 0 are no positions and not included.

    fit: function for positions and rotations; positions only if absent.
    """
    lost = (table.xyz_mm == 0).all(axis=1)
    count = len(lost) - int(lost.sum())
    far, far_mm = np.zeros(len(lost), dtype=bool), np.zeros(len(lost))
    if count <= _KEPT:
        return Outliers(far, far_mm, True)
    seen = _of(table, ~lost)

    def of_places(of_fit: PoseTable, poses: PoseTable) -> tuple[Array, None]:
        setup = fit_setup(forward(bare, of_fit.q), of_fit.xyz_mm)
        return position_error(forward(bare, poses.q), poses.xyz_mm, setup), None

    errors_of: Fit = fit or of_places

    def distances(kind: int) -> Callable[[Mask], Array]:
        def of_those(near: Mask) -> Array:
            errors = errors_of(_of(seen, near if near.sum() > _KEPT else np.ones_like(near)), seen)[kind]
            return np.zeros(len(near)) if errors is None else np.linalg.norm(errors, axis=1)

        return of_those

    mm, spreads = far_from_fit(distances(0), count, TARGET_MM.high)
    off = spreads > SPREADS
    if by_accident(off, seen.q):
        mm, off = _beside_fitted(seen, bare, mm, off)
    if seen.rpy is not None:
        off |= far_from_fit(distances(1), count, _LEAST_RAD)[1] > SPREADS
    far[~lost], far_mm[~lost] = off, mm
    return Outliers(far, far_mm, by_accident(off, seen.q))


def _beside_fitted(seen: PoseTable, bare: Arm, mm: Array, far: Mask) -> tuple[Array, Mask]:
    """Distances (n,) mm from an arm with all constants fitted to the near poses, and the mask (n,) of far poses.

    If there are too few poses for the fit, the arguments are returned unchanged.
    """
    near = ~far
    for _ in range(STEPS):
        those = _sample(np.flatnonzero(near), seen.xyz_mm)
        fitted = fit_arm(bare, seen.q[those], seen.xyz_mm[those])
        if fitted.spare < SPARE:
            break
        mm = np.linalg.norm(seen.xyz_mm - forward(fitted.arm, seen.q)[:, :3, 3], axis=1)
        spreads = spreads_of(mm, TARGET_MM.high)
        far, before, near = spreads > FITTED_SPREADS, near, spreads <= NEAR
        if (near == before).all():
            break
    return mm, far


def _sample(rows: Integers, xyz_mm: Array) -> Integers:
    """At most FITTED of the rows (m,), at places xyz_mm (n, 3); the same ones for any order of the rows."""
    by_place = rows[np.lexsort(xyz_mm[rows].T)]
    chosen: Integers = by_place[np.unique(np.linspace(0, len(rows) - 1, min(FITTED, len(rows))).astype(int))]
    return chosen


def without_lost(table: PoseTable, bare: Arm, fit: Fit) -> tuple[PoseTable, Integers, list[str]]:
    """Leave out outliers by position and rotation relative to an arm; also returns the kept rows (m,) and notes."""
    far = far_poses(table, bare, fit)
    out = (table.xyz_mm == 0).all(axis=1) | far.wild
    if out.all():
        return table, np.arange(len(out)), []
    notes = [words] if (words := far.words(table)) else []
    if out.any():
        away = np.linalg.norm(fit(_of(table, ~out), table)[0], axis=1)
        notes.insert(0, left_out(table, out, np.where(far.wild, far.far_mm, away)))
    return _of(table, ~out), np.flatnonzero(~out), notes


def _of(table: PoseTable, mask: Mask) -> PoseTable:
    rpy = None if table.rpy is None else table.rpy[mask]
    row = None if table.row is None else table.row[mask]
    came = None if table.came_from is None else table.came_from[mask]
    return replace(table, q=table.q[mask], xyz_mm=table.xyz_mm[mask], rpy=rpy, row=row, came_from=came)


def far_touches(table: TouchTable, T: Array) -> Outliers:
    """Touches far from all other touches of the same socket. T (n, 4, 4): tool poses of the arm, in mm."""
    names, socket = np.unique(table.socket, return_inverse=True)
    design, seen = socket_design(T, socket.ravel(), len(names)), -T[:, :3, 3].ravel()

    def distances(near: Mask) -> Array:
        those = np.repeat(near, 3)
        terms = np.linalg.lstsq(design[those], seen[those], rcond=None)[0]
        return np.asarray(np.linalg.norm((design @ terms - seen).reshape(-1, 3), axis=1))

    if len(seen) < 3 * _KEPT + design.shape[1]:
        return Outliers(np.zeros(len(T), dtype=bool), np.zeros(len(T)), True)
    far_mm, spreads = far_from_fit(distances, len(T), TARGET_MM.high)
    far = spreads > SPREADS
    return Outliers(far, far_mm, by_accident(far, table.q))


def left_out(table: Table, out: Mask, far_mm: Array) -> str:
    rows = np.sort(table.rows[out]).tolist()
    shown = listed(rows, MOST_LISTED_ROWS)
    far = length_in_words(far_mm[out].max())
    labels = labels_of(table.test)
    which = f"row {shown} is" if len(rows) == 1 else f"rows {shown} are up to"
    where = f"{which} {far} {labels.distance_from}"
    return f"{len(rows)} of {len(out)} {labels.rows} ignored: {where}; {labels.outlier_check}"


WILDNESS = "wildness"


def outlying_touches(table: TouchTable, rig: Rig) -> Iterator[Finding]:
    far = far_touches(table, forward(arm_of(rig.robot), table.q))
    if far.wild.any():
        fact, remedy = left_out(table, far.wild, far.far_mm).rsplit("; ", 1)
        yield Finding(WILDNESS, "likely", ("socket",), "no touch", fact, remedy)


def outlier_findings(table: PoseTable, rig: Rig) -> Iterator[Finding]:
    lost = (table.xyz_mm == 0).all(axis=1)
    if lost.any():
        rows = listed(table.rows[lost].tolist())
        have = "row {} has the place" if lost.sum() == 1 else "rows {} have the place"
        fact = f"{have.format(rows)} 0, 0, 0, which a tracker writes if it has lost its target"
        remedy = "the analysis ignores it" if lost.sum() == 1 else "the analysis ignores them"
        yield Finding(WILDNESS, "likely", ("x_mm", "y_mm", "z_mm"), "no measurement", fact, remedy)
    bare = without_setup(arm_of(rig.robot))
    far = far_poses(table, bare)
    if words := two_placings(_of(table, ~(lost | far.wild)), bare):
        remedy = "give each placement as a separate file and run"
        yield Finding(WILDNESS, "likely", ("x_mm", "y_mm", "z_mm"), "two placings", words, remedy)
    if far.far.any() and (far.by_accident or not words):  # too many for accidents: something has moved
        fact = left_out(table, far.wild, far.far_mm) if far.by_accident else far.words(table)
        fact, remedy = fact.rsplit("; ", 1)
        yield Finding(WILDNESS, "likely", ("x_mm", "y_mm", "z_mm"), "no measurement", fact, remedy)


def outlying_places(table: PathTable, rig: Rig) -> Iterator[Finding]:
    del rig
    if "wild" in (words := places_of(table).words):
        remedy = "check that the beam is not interrupted; the analysis ignores these rows"
        yield Finding(WILDNESS, "likely", ("x_mm", "y_mm", "z_mm"), "no measurement", words["wild"], remedy)


DUPLICATES = "duplicates"
_ELSEWHERE_MM = 1.0
"""Flange motion that also moves the target, unless the target is on the axis of rotation."""
_FINE_MM = 2e-3
"""Resolution of positions that always differ between visits, because robots repeat to 0.01 mm."""
_SEVERAL = 3
"""Number of rows with six equal angles and exactly the same position that cannot be a coincidence."""


def duplicate_findings(table: PoseTable, rig: Rig) -> Iterator[Finding]:
    if not len(table.q):
        return
    lost = (table.xyz_mm == 0).all(axis=1)
    places = forward(arm_of(rig.robot), table.q)[:, :3, 3]
    group_of_row = np.unique(table.xyz_mm, axis=0, return_inverse=True)[1].reshape(-1)
    copied = 0
    for group in np.flatnonzero(np.bincount(group_of_row) > 1).tolist():
        alike = (group_of_row == group) & ~lost
        if not alike.any():
            continue
        if np.linalg.norm(places[alike] - places[alike][0], axis=1).max() > _ELSEWHERE_MM:
            fact = (
                f"rows {listed(table.rows[alike].tolist())} have exactly the same place, although the robot "
                "was elsewhere: the instrument may have repeated the last place"
            )
            remedy = "remove the rows that were not measured"
            yield Finding(DUPLICATES, "likely", ("x_mm", "y_mm", "z_mm"), "a place sent again", fact, remedy)
        elif (table.q[alike] == table.q[alike][0]).all():
            copied += int(alike.sum()) - 1
    steps_mm = np.diff(np.unique(table.xyz_mm[:, 0]))  # resolution of the written positions
    if copied >= _SEVERAL and steps_mm.min(initial=1.0) < _FINE_MM:
        fact = f"{copied} rows repeat angles and place of an earlier row to the last digit; a new visit never does"
        yield Finding(DUPLICATES, "likely", (), "rows written twice", fact, "remove the copies")


def repeated_places(table: PathTable, rig: Rig) -> Iterator[Finding]:
    """Findings about path positions that repeat the previous one although the tool moved."""
    del rig
    if "repeated" in (words := places_of(table).words):
        remedy = "the analysis ignores these rows; set the instrument to pause output while the target is lost"
        yield Finding(DUPLICATES, "likely", ("x_mm", "y_mm", "z_mm"), "a place sent again", words["repeated"], remedy)
