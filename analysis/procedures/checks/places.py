"""Checks of position, speed and instrument of a table against the rig file, and of positions that no robot explains.

- With the nominal arm, and independently of the gauges, the robot must be on the path of the test. The arm has errors
  of some mm, and a cell is rarely within 20 mm of the place in the rig file.
- Positions computed by the controller from the joints contain no information about the arm. Two facts reveal them. No
  reflector is in the middle of the flange face while the frame of the instrument is the base of the arm. And neither
  instruments nor robots repeat to the last digit, so positions that fitted constants explain more closely were
  computed.
- Target or instrument may have moved during the run. With all constants fitted, the residual is noise and a small
  error. A far smaller residual with a separate placement for the rows after a certain row, or for every other row,
  reveals the movement.
- Instruments write a position of exactly 0, 0, 0 if there is no target. Other outliers are found by
  `analysis.runs.noise.readings` in three steps: by position and by rotation relative to an arm with base and tool
  fitted to the near poses, and by position relative to an arm with all constants fitted to these. The last step is
  necessary because the error of an arm with nominal constants, half a millimetre, hides an error of 2 mm that would
  change every constant.
- Along a path the tool moves smoothly. Each position can be extrapolated from the three before and from the three
  after. An outlier is far from both extrapolations, which agree with each other; at a corner, a start or a step at most
  one of them is correct. Extrapolations over larger distances reveal several successive outliers.
- An instrument may repeat the last position, and a file may be concatenated with itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from analysis.procedures.checks.columns import FEWEST, RIGHT_MM
from analysis.procedures.shared.test_kind import (
    MOST_LISTED_ROWS,
    Finding,
    Misfit,
    Outliers,
    kind_of,
    labels_of,
    length_in_words,
)
from analysis.robot.geometry.circle import frame_of
from analysis.robot.geometry.pose_setup import (
    DETERMINED,
    FittedArm,
    fit_arm,
    fit_setup,
    position_error,
    socket_design,
)
from analysis.robot.kinematics.arm import Arm, Array, Integers, Mask, arm_of, forward, without_setup
from analysis.runs.loading import Measured
from analysis.runs.noise.cell_noise import TARGET_MM
from analysis.runs.noise.readings import (
    FITTED_SPREADS,
    NEAR,
    SPREADS,
    STEPS,
    by_accident,
    evenly,
    far_from_fit,
    robust_sd,
    spreads_of,
)
from analysis.runs.stands import rows_per_standstill
from analysis.runs.tables import CircleTable, PathTable, PoseTable, Table, TouchTable, table_from
from rigs.rig import Rig
from rigs.text import counted, listed

_FEWEST_ROWS, _SPLITS = 4, 24
"""Minimum number of rows of a part (the nine unknowns of a placement leave three readings), and number of possible
splits that are tried first.
"""
SPARE, FITTED = 30, 300
"""Minimum number of redundant readings for a fit of all constants, and number of poses that is sufficient."""
_SHARE, _SHARE_OF_FEW = 0.6, 0.3
"""Largest ratio of the residuals with and without a second placement, and the ratio for few rows or few redundant
readings (_MANY_ROWS, _MANY_SPARE). For a UR10 and a UR5 measured over hours, the best of all splits leaves at
least 0.86 for 30 to 1495 poses in order, and at least 0.51 for 272 sets of 20 to 40 poses.
"""
_MANY_ROWS, _MANY_SPARE = 8, 120
_LEAST_MM = 0.05
"""Residual below which no movement is assumed: less than the noise of trackers."""


def two_placings(table: PoseTable, bare: Arm) -> str:
    """Words about rows measured after target or instrument had moved; empty if there are none, or too few poses."""
    count = len(table.q)
    chosen = evenly(count, FITTED)
    if count < 2 * _FEWEST_ROWS:
        return ""
    q, xyz_mm, rows = table.q[chosen], table.xyz_mm[chosen], table.rows[chosen]
    fitted = fit_arm(bare, q, xyz_mm)
    if fitted.spare < SPARE or fitted.rms_mm < _LEAST_MM:
        return ""
    T = forward(fitted.arm, q)
    best, words, many = np.inf, "", _MANY_ROWS if fitted.spare >= _MANY_SPARE else count
    for part, called in _parts(rows, lambda part: _left_mm(fitted, T, part)):
        after, few = _left_mm(fitted, T, part), min(part.sum(), (~part).sum())
        if after < min(best, (_SHARE if few >= many else _SHARE_OF_FEW) * fitted.rms_mm):
            best, words = after, called
    if not words:
        return ""
    return (
        f"{words} were measured with target or instrument at a different place than the others: with a separate "
        f"placement the error is {best:.2g} instead of {fitted.rms_mm:.2g} mm"
    )


def _parts(rows: Integers, left_mm: Callable[[Mask], float]) -> Iterator[tuple[Mask, str]]:
    """Possible sets of moved rows in words: those after the split with the smallest residual, and every other row."""
    place, last = np.arange(len(rows)), len(rows) - _FEWEST_ROWS
    tried = np.unique(np.linspace(_FEWEST_ROWS, last, _SPLITS).astype(int)).tolist()
    near, step = min(tried, key=lambda first: left_mm(place >= first)), last // _SPLITS
    first = min(range(max(_FEWEST_ROWS, near - step), min(last, near + step) + 1), key=lambda k: left_mm(place >= k))
    yield place >= first, f"rows from about {rows[first]} on"
    second = rows % 2 == 0
    if min(second.sum(), (~second).sum()) >= _FEWEST_ROWS:
        yield second, "every other row"


def _left_mm(fitted: FittedArm, T: Array, part: Mask) -> float:
    """Rms residual in mm, corrected for the number of unknowns, if the rows `part` have a separate shift, rotation and
    target offset.
    """
    p = (T[:, :3, 3] - T[:, :3, 3].mean(axis=0)) / 1000.0
    (x, y, z), zero = p.T, np.zeros(len(p))
    turned = np.stack([zero, z, -y, -z, zero, x, y, -x, zero], axis=1).reshape(-1, 3, 3)
    shifted = np.tile(np.eye(3), (len(p), 1, 1))
    placing = (np.concatenate([shifted, turned, T[:, :3, :3]], axis=2) * part[:, None, None]).reshape(-1, 9)
    design = np.concatenate([fitted.design, placing], axis=1)
    left_mm = fitted.left_mm - design @ np.linalg.lstsq(design, fitted.left_mm, rcond=DETERMINED)[0]
    return replace(fitted, left_mm=left_mm, spare=fitted.spare - 9).rms_mm


STAMPS, PLACE = "stamps", "place"
_NEAR_MM = 20.0
_ROWS = 5000
"""Number of rows sufficient to estimate the speed along a circle."""
_UNITS_S = {"ms": 1e-3, "µs": 1e-6, "ns": 1e-9}
_OFF = 3.2
"""Factor by which a speed must differ to prove a wrong unit; no circle is driven at such a speed."""


def stamp_findings(table: CircleTable, rig: Rig) -> Iterator[Finding]:
    circle = rig.tests.circle
    if circle is None:
        return
    rows = slice(None, None, max(1, len(table.q) // _ROWS))
    phi = frame_of(circle).angle(forward(arm_of(rig.robot), table.q[rows])[:, :3, 3])
    seconds = float(np.ptp(table.t_s))
    if seconds == 0:
        return
    driven_rad = float(np.abs(np.diff(np.unwrap(phi))).sum())  # laps and the return paths between them
    share = driven_rad * circle.radius_mm / seconds / circle.speed_mm_s
    fact = f"the circle was driven at {share:.2g} times the speed_mm_s of the rig file"
    for unit, unit_s in _UNITS_S.items():
        if 1 / _OFF < share / unit_s < _OFF:
            yield Finding(STAMPS, "likely", ("t_s",), unit, fact, f"t_s may be in {unit}: check it")
        elif 1 / _OFF < share * unit_s < _OFF:
            yield Finding(STAMPS, "likely", ("t_s",), "another unit", fact, "check the units of t_s and speed_mm_s")


def place_findings(table: Table, rig: Rig) -> Iterator[Finding]:
    places = kind_of(table.test).targets(table, rig)
    if places is None:
        return
    away = np.linalg.norm(forward(arm_of(rig.robot), table.q)[:, :3, 3] - places, axis=1)
    far = away > _NEAR_MM
    if far.any():
        row = int(np.argmax(far))
        target = table.numbers[row]
        fact = (
            f"according to the nominal arm, the tool was {away[row]:.0f} mm from target {target} in row {row + 1}, and "
            f"further away than {_NEAR_MM:g} mm in {far.sum()} of {len(far)} rows"
        )
        yield Finding(
            PLACE, "likely", ("target",), "another target", fact, "check the target numbers, the angles and the joints"
        )


STANDS = "stands"


def stand_findings(run: Measured) -> Iterator[Finding]:
    manifest, table = run.run.manifest, run.run.table
    if table is None or run.table.swept:
        return
    counts = rows_per_standstill(table_from(table, manifest.test, manifest.direction, str(run.path)))
    several = counts[counts > 1]
    if not len(several):
        return
    stands = counted(len(several), "stand")
    fact = (
        f"{several.sum()} rows are repeated readings, up to {several.max()} each, of {stands} of the robot: the mean "
        "of each stand is used"
    )
    remedy = "if the robot moved in between, write the rows in the order in which they were measured"
    yield Finding(STANDS, "likely", (), "readings of one standstill", fact, remedy)


SOURCE = "source"
OF_CONTROLLER = "rig arms NAME --poses TABLE -o arm.yaml reads the calibration of the controller from them"
"""Recommended use of positions computed by a controller."""
NO_INSTRUMENT_MM = 0.008
"""Smallest residual of measured positions. Rounding to 0.01 mm leaves 0.005 mm, the best trackers state at least
0.010 mm (Leica AT960: 15 µm + 6 µm/m), and arms repeat to 0.01 mm.
"""
_BASE_MM, _BASE_RAD, _FLANGE_MM = 3.0, float(np.radians(0.3)), 2.0
"""Uncertainty of frame and target with the nominal constants of an arm, as found in calibrations of sound arms. The
smallest reflectors are balls of 12.7 mm on a nest.
"""
_POSES = 150


@dataclass(frozen=True)
class PlaceSource:
    """Evidence on places that fit an arm: were they measured, or computed from the joints by the controller?

    left_mm, fitted: rms residual with nominal constants, and the arm with fitted ones. in_base: True if the places are
    given in the base of the arm. proof: why they were computed, empty if they may be measured.
    """

    left_mm: float
    fitted: FittedArm
    in_base: bool
    proof: str


def source_of(bare: Arm, q: Array, xyz_mm: Array) -> PlaceSource | None:
    """Compare places xyz_mm (n, 3) with an arm without base and tool at joints q; None if they do not fit it."""
    T = forward(bare, q)
    setup = fit_setup(T, xyz_mm)
    left_mm = float(np.sqrt((position_error(T, xyz_mm, setup) ** 2).sum(axis=1).mean()))
    if left_mm > RIGHT_MM:
        return None
    target_mm = float(np.linalg.norm(setup.T_flange_tool[:3, 3]))
    fitted = fit_arm(bare, q, xyz_mm)
    # The base of the arm, or the base rotated by half a turn about z, as base_link of ROS drivers.
    base = setup.T_world_base
    traces = [np.trace(base[:3, :3] @ np.diag([sign, sign, 1.0])) for sign in (1.0, -1.0)]
    turned_rad = float(np.arccos(np.clip((max(traces) - 1) / 2, -1.0, 1.0)))
    in_base = turned_rad < _BASE_RAD and float(np.linalg.norm(base[:3, 3])) < _BASE_MM
    proof = ""
    if fitted.spare >= SPARE and fitted.rms_mm < NO_INSTRUMENT_MM:
        proof = (
            f"the arm's constants explain them to {1e3 * fitted.rms_mm:.2g} µm, closer than any instrument can measure"
        )
    elif in_base and target_mm < _FLANGE_MM:
        proof = f"they are given in the base of the arm, for a point {target_mm:.1f} mm from the centre of the flange"
    return PlaceSource(left_mm, fitted, in_base, proof)


def source_findings(table: PoseTable, rig: Rig) -> Iterator[Finding]:
    if table.rail:
        return
    measured = np.flatnonzero(~table.lost)
    if len(measured) < FEWEST:
        return
    chosen = measured[evenly(len(measured), _POSES)]
    source = source_of(without_setup(arm_of(rig.robot)), table.q[chosen], table.xyz_mm[chosen])
    if source is None or not source.proof:
        return
    left_mm, fitted = source.left_mm, source.fitted
    fact = f"these places were not measured but computed from the joints by the controller: {source.proof}"
    remedy = f"give places measured by an instrument; {OF_CONTROLLER}"
    misfit = Misfit(left_mm, fitted.rms_mm, float(fitted.left_mm.size * np.log(left_mm / max(fitted.rms_mm, 1e-9))))
    columns = ("x_mm", "y_mm", "z_mm")
    yield Finding(SOURCE, "impossible", columns, "the controller's own places", fact, remedy, misfit)


_STRIDES, _SMOOTH_S = (1, 2, 3, 5, 8), 0.016
"""Distances between the compared positions, and the time over which the path must be smooth. Up to eight successive
outliers are found. On a circle of 20 mm at 250 mm/s the path turns by a fifth of a radian in this time.
"""
_SPREADS, _AGREE = 10.0, 2.0
"""Minimum distance of an outlier from both extrapolations, in robust standard deviations and relative to the
difference between the extrapolations.
"""
_LEAST_OUTLIER_MM = 0.1
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
        limit = max(_SPREADS * robust_sd(off), _LEAST_OUTLIER_MM)
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
    """Poses with a position far from that of an arm, without rows of 0, 0, 0.

    fit: function for positions and rotations; positions only if absent.
    """
    lost = table.lost
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
    """Distances (n,) mm from an arm with all constants fitted to the near poses, and the mask of far poses.

    With too few poses for the fit, the arguments are returned.
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
    return by_place[evenly(len(rows), FITTED)]


def without_lost(table: PoseTable, bare: Arm, fit: Fit) -> tuple[PoseTable, Integers, list[str]]:
    """Leave out outliers relative to an arm; also returns the kept rows (m,) and notes."""
    far = far_poses(table, bare, fit)
    out = table.lost | far.wild
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
    """Touches far from all other touches of the same socket."""
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
TWO_PLACINGS = "two placings"


def outlying_touches(table: TouchTable, rig: Rig) -> Iterator[Finding]:
    far = far_touches(table, forward(arm_of(rig.robot), table.q))
    if far.wild.any():
        fact, remedy = left_out(table, far.wild, far.far_mm).rsplit("; ", 1)
        yield Finding(WILDNESS, "likely", ("socket",), "no touch", fact, remedy)


def outlier_findings(table: PoseTable, rig: Rig) -> Iterator[Finding]:
    lost = table.lost
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
        yield Finding(WILDNESS, "likely", ("x_mm", "y_mm", "z_mm"), TWO_PLACINGS, words, remedy)
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
    lost = table.lost
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
    del rig
    if "repeated" in (words := places_of(table).words):
        remedy = "the analysis ignores these rows; set the instrument to pause output while the target is lost"
        yield Finding(DUPLICATES, "likely", ("x_mm", "y_mm", "z_mm"), "a place sent again", words["repeated"], remedy)
