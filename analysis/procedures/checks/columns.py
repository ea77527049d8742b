"""Comparison of the labelled joint columns with every other possible meaning.

Poses: for each meaning of the joints, base and tool are fitted to the nearest four fifths, and the residuals are
compared. A wrong meaning leaves centimetres, an arm with nominal constants millimetres. Circles and targets: the
program put the tool on the path of the rig file, and only the correct meaning does the same.

Alternative meanings are mistakes of a user or a program: axis 3 measured from the horizontal or from axis 2, inverted
axes, two exchanged columns, or a different zero. Makers differ in the signs of several axes at once, so every
combination of signs is tried; of meanings that fit alike, the one with the fewest mistakes comes first.

Positions in a left-handed frame come from an export with an inverted axis, which no rigid frame corrects.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from analysis.procedures.checks.joint_search import JointReading, search_joint_readings
from analysis.procedures.shared.test_kind import (
    Finding,
    JudgedMeaning,
    Meaning,
    Misfit,
    PathDeviation,
    Strength,
    Verdict,
    facts_of,
    kind_of,
    labels_of,
)
from analysis.robot.geometry.circle import frame_of
from analysis.robot.geometry.driven_programs import hemisphere_frame
from analysis.robot.geometry.pose_setup import PoseSetUp, fit_setup, position_error, socket_residuals
from analysis.robot.kinematics.arm import Arm, Array, Integers, arm_of, forward, without_setup
from analysis.runs.noise.readings import evenly, extent_of, rms
from analysis.runs.tables import PoseTable, Table
from rigs.arms import arm_names, load_arm
from rigs.rig import Rig
from rigs.schema.declared_tests import Circle, Hemisphere
from rigs.schema.robot import Robot
from rigs.text import enumerated

_ZEROS_DEG = (90.0, -90.0, 180.0)
"""Other zeros used in practice: a quarter or half a turn away."""
_QUARTER_DEG = 3.0
"""Distance from a quarter of a turn up to which a zero is one. Chosen: zeros of arms in use are wrong by less."""
_ROUNDED_SHARE = 0.5
"""Share of the largest residual of a correct meaning up to which a zero is rounded to a quarter of a turn. Chosen."""
MOST_ZERO_DEG = 5.0
"""Largest zero that a diagnosis determines: the range of `offset_deg` in rigs/effects/joint_offset.py."""


def meanings(axes: int) -> list[Meaning]:
    ways = []
    for sign, word in ((1.0, "+"), (-1.0, "-")):
        matrix = np.eye(axes)
        matrix[2, 1] = sign
        do = f"give the coupling of axes 2 and 3 in the rig file (robot.coupling), or q3_deg {word} q2_deg as q3_deg"
        ways.append(_meaning((2, 3), f"J3 {word} J2 in place of J3", do, matrix))
    every = range(1, axes + 1)
    for backwards in (some for count in every for some in combinations(every, count)):
        signs = np.where(np.isin(every, backwards), -1.0, 1.0)
        words = f"{enumerated([f'J{axis}' for axis in backwards])} counted in the opposite direction"
        columns = enumerated([f"q{axis}_deg" for axis in backwards])
        do = f"change the sign of {columns}, or correct these axes of the rig file"
        ways.append(_meaning(backwards, words, do, np.diag(signs), mistakes=len(backwards)))
    for first, second in combinations(range(1, axes + 1), 2):
        rows = list(range(axes))
        rows[first - 1], rows[second - 1] = second - 1, first - 1
        words, do = f"J{first} and J{second} exchanged", f"exchange the columns q{first}_deg and q{second}_deg"
        ways.append(_meaning((first, second), words, do, np.eye(axes)[rows]))
    for axis, off_deg in product(range(1, axes + 1), _ZEROS_DEG):
        offset = np.radians(off_deg) * np.eye(axes)[axis - 1]
        do = f"add {off_deg:.0f}° to q{axis}_deg, or to offset_deg of axis {axis} in the rig file"
        ways.append(_meaning((axis,), f"{off_deg:+z.0f}° on J{axis}", do, np.eye(axes), offset))
    return ways


def searched_meanings(bare: Arm, q: Array, xyz_mm: Array) -> list[tuple[Meaning, float]]:
    """Signs and zeros of several joints that fit places (n, 3) mm best, with the residual in mm; empty if none fits.

    Of readings that fit alike only the simplest are listed.
    """
    if bare.rail is not None or len(q) < FEWEST:
        return []
    most_mm = right_mm(extent_of(xyz_mm))
    readings = search_joint_readings(bare, q, xyz_mm, most_mm)
    found = []
    for exact in (one for one in readings if one.left_mm <= most_mm and one.changes <= readings[0].changes):
        # A zero near a quarter of a turn is that of a convention, unless the difference shows.
        rounded = _with_quarter_turns(exact)
        mm = left_mm(bare, rounded.of(q), xyz_mm, _STEPS)
        is_quarter = mm <= max(_ROUNDED_SHARE * most_mm, AS_WELL * exact.left_mm)
        found.append((_of_reading(rounded), mm) if is_quarter else (_of_reading(exact), exact.left_mm))
    return found


def _with_quarter_turns(reading: JointReading) -> JointReading:
    quarters = np.round(reading.zeros / (np.pi / 2)) * np.pi / 2
    is_near = np.abs(reading.zeros - quarters) <= np.radians(_QUARTER_DEG)
    return replace(reading, zeros=np.where(is_near & (quarters != 0), quarters, reading.zeros))


def _of_reading(reading: JointReading) -> Meaning:
    zeros_deg = [zero % 360 if abs(zero) > 179.95 else zero for zero in np.degrees(reading.zeros).tolist()]
    angles = {axis: f"{zero:+.1f}°".replace(".0°", "°") for axis, zero in enumerate(zeros_deg, start=1) if zero}
    backwards = (np.flatnonzero(reading.signs < 0) + 1).tolist()
    words, do = [f"{angle} on J{axis}" for axis, angle in angles.items()], []
    if backwards:
        words.insert(0, f"{enumerated([f'J{axis}' for axis in backwards])} counted in the opposite direction")
        do.append(f"change the sign of {enumerated([f'q{axis}_deg' for axis in backwards])}")
    if angles:
        do.append(f"add {enumerated([f'{angle} to q{axis}_deg' for axis, angle in angles.items()])}")
    remedy = f"{' and '.join(do)} if only the table uses this convention"
    if homed := [f"J{axis} by {angle}" for axis, angle in angles.items() if zeros_deg[axis - 1] % 90]:
        remedy += f"{HOMED}re-master {enumerated(homed)} and measure again"
    axes = tuple(sorted({*angles, *backwards}))
    offset = np.radians(zeros_deg)
    return _meaning(axes, enumerated(words), remedy, np.diag(reading.signs), offset, max(reading.changes, 1))


HOMED = "; if the arm was homed with these zeros, "
"""Introduces the remedy for zeros of the arm itself, in the remedy of a meaning."""


def is_small_zeros(meaning: Meaning) -> bool:
    """True if a meaning consists of zeros within the range that a diagnosis determines."""
    is_plain = bool((meaning.matrix == np.eye(len(meaning.offset))).all())
    return is_plain and bool(np.degrees(np.abs(meaning.offset)).max() <= MOST_ZERO_DEG)


def _meaning(
    axes: tuple[int, ...], words: str, remedy: str, matrix: Array, offset: Array | None = None, mistakes: int = 1
) -> Meaning:
    columns = tuple(f"q{axis}_deg" for axis in axes)
    return Meaning(columns, words, remedy, matrix, np.zeros(len(matrix)) if offset is None else offset, mistakes)


JOINTS = "joints"
FEWEST = 12
"""Smallest number of poses for judging a meaning: nine unknowns, and as many redundant readings."""
_SCREENED, _JUDGED = 80, 300
"""Number of poses for a first comparison of all meanings, and for the final comparison of the best ones; more poses
do not change the result.
"""
_STEPS, _BEST = 8, 6
"""Number of fit steps in the first comparison, and number of meanings in the final comparison."""
_KEPT = 0.8
"""Share of the poses, those with the smallest residuals, that is fitted and compared, because of outliers."""
_ROUNDS, _NAMED = 3, 3
_NOTHING_MM = 1e-3
"""Residual below which the labels are correct. Below a micrometre only the rounding of the numbers is compared."""
RIGHT_MM = 10.0
"""Largest residual of a correct meaning over places within a metre: an arm with nominal constants has errors of some
mm.
"""
_RIGHT_PER_MM = 0.01
"""The same for places farther apart, in mm per mm: a zero that is wrong by 0.15° moves the tool of an arm with a reach
of 3.7 m by 10 mm, and that of an arm of one metre by 2.6 mm.
"""
RIGHT_SHARE = 0.02
"""Largest residual of a correct meaning as a share of the spread of the positions. An arm of one metre leaves some
thousandths; poses that hardly move always leave a few mm.
"""


def right_mm(extent_mm: float) -> float:
    """Largest residual that the right arm may leave with nominal constants, for places of this extent."""
    return min(max(RIGHT_MM, _RIGHT_PER_MM * extent_mm), RIGHT_SHARE * extent_mm)


UNRELATED_SHARE = 0.1
"""Smallest residual, as a share of the extent of the positions, of a table that belongs to a different arm. A zero
wrong by 5° moves places by 0.09 of the lever, which is more than any arm in use.
"""
_OTHER_MM = 2.0
"""Smallest residual from which other arms are tried. Source: nominal constants left 0.3 to 1.5 mm of arms in use."""
CLEARLY = 4.0
"""Factor by which an alternative must fit better. Fitting all constants of a real arm (UR10) gave a factor of 2.6,
whereas a meaning has no free parameter.
"""
AS_WELL = 1.5
"""Meanings within this factor of the best are not distinguished."""
_ARM_MM = 100.0
"""Lever arm that converts rotations to lengths."""
_ROWS = 2000
"""Number of circle rows sufficient for the comparison."""


def joint_findings(table: Table, rig: Rig) -> Iterator[Finding]:
    if kind_of(table.test).cannot_tell(table, rig):
        return
    best, as_labelled, as_good = kind_of(table.test).judged_joints(table, rig)
    if best is None:
        is_off = as_labelled > _OTHER_MM
        other = (_another_arm(table, rig) or _classic_arm(table, rig, as_labelled)) if is_off else None
        yield from [other] if other else _far_off(table, rig, as_labelled)
        return
    if as_labelled < _NOTHING_MM:
        return
    rows = labels_of(table.test).joints_fit
    words = " or ".join(judged.meaning.words for judged in (best, *as_good)[:_NAMED])
    fact = (
        f"these {rows} only with {words} (error {_length(best.left_mm)} instead of {_length(as_labelled)}): order, "
        "signs, zeros or coupling of the joints differ from the rig file"
    )
    gain = best.values * float(np.log(as_labelled / max(best.left_mm, 1e-9)))
    misfit = Misfit(as_labelled, best.left_mm, gain)
    remedy = best.meaning.remedy if not as_good else "look up the convention in the controller, and correct the columns"
    strength: Strength = "decisive"
    if not as_good and is_small_zeros(best.meaning):
        strength, remedy = "likely", f"{remedy}. A wrong length may look the same; a diagnosis tells them apart"
    if rig.robot.rail and best.meaning.columns == ("q1_deg",) and not as_good and best.meaning.offset.any():
        remedy += "; or correct robot.rail.direction: a rail with a different direction or sign looks the same"
    yield Finding(JOINTS, strength, best.meaning.columns, words, fact, remedy, misfit)


def _another_arm(table: Table, rig: Rig) -> Finding | None:
    """A finding if an arm of the library fits poses or touches clearly better than the stated arm.

    The stated arm must be one of the library too: a rig file with another length may contain a mistake.
    """
    if not facts_of(table.test).of_places:
        return None
    robots = {name: load_arm(name).robot for name in arm_names()}
    stated = next((name for name, robot in robots.items() if _links(robot) == _links(rig.robot)), None)
    if stated is None:
        return None
    fits = {
        name: _misfit_mm(robot, table, rig) for name, robot in robots.items() if len(robot.axes) == len(rig.robot.axes)
    }
    name = min(fits, key=lambda arm: fits[arm])
    if fits[stated] <= max(_OTHER_MM, CLEARLY * fits[name]):
        return None
    fact = (
        f"the table fits {name} of the arm library with an error of {_length(fits[name])}, and {stated} with "
        f"{_length(fits[stated])}"
    )
    remedy = f"compare with the name plate, and give --arm {name} or a rig file of that arm"
    return Finding(JOINTS, "decisive", (), f"the arm {name}", fact, remedy)


def _misfit_mm(robot: Robot, table: Table, rig: Rig) -> float:
    """Error of poses or touches with another arm that carries the tool of the rig file."""
    arm = arm_of(robot.model_copy(update={"tool": rig.robot.tool}))
    if facts_of(table.test).of_tracker:
        rows = (table.readings != 0).any(axis=1)
        return left_mm(without_setup(arm), table.q[rows], table.readings[rows], _STEPS)
    path = kind_of(table.test).off_path(table, rig, forward(arm, table.q))
    return np.inf if path is None else path.off_mm


def _classic_arm(table: Table, rig: Rig, as_labelled: float) -> Finding | None:
    """A finding if the axes of the rig file fit only as classic constants of Denavit and Hartenberg."""
    if not facts_of(table.test).of_places:
        return None
    fitted_mm = _misfit_mm(rig.robot.read_as_classic, table, rig)
    if as_labelled <= max(_OTHER_MM, CLEARLY * fitted_mm):
        return None
    fact = (
        "the axes of the rig file fit the table if they are read in the classic notation of Denavit and Hartenberg "
        f"(error {_length(fitted_mm)} instead of {_length(as_labelled)}), but rig reads the modified one (Craig)"
    )
    remedy = "move a_mm and alpha_deg of each axis in the rig file to the next axis"
    return Finding(JOINTS, "decisive", (), "classic constants of the arm", fact, remedy)


def _links(robot: Robot) -> list[tuple[float, ...]]:
    return [(axis.a_mm, axis.d_mm, axis.alpha_deg, axis.beta_deg) for axis in robot.axes]


def _far_off(table: Table, rig: Rig, left_mm: float) -> Iterator[Finding]:
    """A finding if tracker positions or touches miss by more than an arm with nominal constants, in every meaning."""
    belongs = "check that the rig file belongs to this arm"
    no_other = "and no other order, sign or zero of the joints fits clearly better"
    if facts_of(table.test).of_tracker:
        places = table.readings[(table.readings != 0).any(axis=1)]
        extent_mm = extent_of(places)
        least_mm, words = right_mm(extent_mm), "a different arm, or a zero or length far off"
        fact = (
            f"these poses do not fit the arm of the rig file: the error is {_length(left_mm)}, over a work area of "
            f"{_length(extent_mm)}. Nominal constants of the right arm are accurate to {_length(least_mm)} there, "
            f"{no_other}"
        )
        remedy = f"{belongs}; otherwise a zero or a length is wrong"
    elif facts_of(table.test).of_places:
        T = forward(arm_of(rig.robot), table.q)
        path = kind_of(table.test).off_path(table, rig, T)
        if path is None or path.on:
            return
        extent_mm = extent_of(T[:, :3, 3])
        least_mm = max(RIGHT_MM, _RIGHT_PER_MM * extent_mm)
        words = "a different arm, or rows of another socket"
        missed = f"these touches miss their sockets by {_length(left_mm)} with the arm of the rig file"
        fact, remedy = f"{missed}, {no_other}", f"{belongs}, and that each row names its socket"
    else:
        return
    if left_mm > least_mm:
        is_unrelated = left_mm > max(RIGHT_MM, UNRELATED_SHARE * extent_mm)
        yield Finding(JOINTS, "decisive" if is_unrelated else "likely", (), words, fact, remedy)


PLACE_UNKNOWN = "the rig file lacks the place of the test"


def judged_by_path(table: Table, rig: Rig) -> Verdict:
    """Meaning of the joints that puts the tool on the path of the rig file, a circle or targets."""
    arm = arm_of(rig.robot)
    part = table.thinned(_ROWS)

    def path_deviation(read: Callable[[Array], Array]) -> tuple[float, bool]:
        path = kind_of(part.test).off_path(part, rig, forward(arm, read(part.q)))
        return (0.0, True) if path is None else (path.off_mm, path.on)

    as_labelled, is_on = path_deviation(lambda q: q)
    if is_on:
        return None, as_labelled, []
    judged = [
        JudgedMeaning(meaning, off_mm, len(part.q))
        for meaning in meanings(arm.axes)
        for off_mm, on in [path_deviation(meaning.of)]
        if on
    ]
    return _decided(judged, as_labelled, np.inf) if judged else (None, as_labelled, [])


def judged_by_places(rig: Rig, q: Array, xyz_mm: Array, rpy: Array | None) -> Verdict:
    """Meaning of the joints that fits the measured positions xyz_mm (n, 3) and rotations rpy (n, 3) rad."""
    bare, measured = without_setup(arm_of(rig.robot)), np.flatnonzero((xyz_mm != 0).any(axis=1))
    few, many = (measured[evenly(len(measured), rows)] for rows in (_SCREENED, _JUDGED))
    values, most_mm = int(3 * _KEPT * len(q)) - 9, right_mm(extent_of(xyz_mm[many]))

    def verdict(turns: Array | None) -> Verdict:
        def misfit(rows: Integers, joints: Array, steps: int) -> float:
            return left_mm(bare, joints, xyz_mm[rows], steps, None if turns is None else turns[rows])

        screened = sorted(meanings(bare.axes), key=lambda meaning: misfit(few, meaning.of(q[few]), _STEPS))
        judged = [
            JudgedMeaning(meaning, misfit(many, meaning.of(q[many]), 100), values) for meaning in screened[:_BEST]
        ]
        return _decided(judged, misfit(many, q[many], 100), most_mm)

    by_places = verdict(None)
    by_places = by_places if by_places[0] or rpy is None else verdict(rpy)
    if by_places[0] or by_places[1] <= most_mm:
        return by_places
    found = searched_meanings(bare, q[many], xyz_mm[many])
    judged = [JudgedMeaning(meaning, left, values) for meaning, left in found]
    return _decided(judged, by_places[1], np.inf) if judged else by_places


def judged_by_sockets(table: Table, rig: Rig) -> Verdict:
    arm = arm_of(rig.robot)

    def off_mm(q: Array) -> float:
        path = kind_of(table.test).off_path(table, rig, forward(arm, q))
        return np.inf if path is None else path.off_mm

    judged = [JudgedMeaning(meaning, off_mm(meaning.of(table.q)), 3 * len(table.q)) for meaning in meanings(arm.axes)]
    return _decided(judged, off_mm(table.q), RIGHT_MM)


def _decided(judged: Sequence[JudgedMeaning], as_labelled: float, right_mm: float) -> Verdict:
    closest = min(judge.left_mm for judge in judged)
    if closest > right_mm or as_labelled < CLEARLY * closest:
        return None, as_labelled, []
    alike = [judge for judge in judged if judge.left_mm <= AS_WELL * closest]
    best, *as_good = sorted(alike, key=lambda judge: (judge.meaning.mistakes, judge.left_mm))
    return best, as_labelled, as_good


def left_mm(bare: Arm, q: Array, xyz_mm: Array, steps: int, rpy: Array | None = None) -> float:
    """Rms residual in mm of positions xyz_mm (n, 3), with fitted base and tool; rotations rpy count as lengths."""
    return fit_nearest(bare, q, xyz_mm, steps, rpy)[0]


def fit_nearest(bare: Arm, q: Array, xyz_mm: Array, steps: int, rpy: Array | None = None) -> tuple[float, PoseSetUp]:
    """Residual of `left_mm`, and the fitted base and tool."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

    T = forward(bare, q)
    kept = np.arange(len(q))
    count = max(int(_KEPT * len(q)), 9)
    for _ in range(_ROUNDS if steps > _STEPS else 1):
        setup = fit_setup(T[kept], xyz_mm[kept], steps)
        distance = np.linalg.norm(position_error(T, xyz_mm, setup), axis=1)
        if rpy is not None:
            # Compare measured rotations with those of the arm, using a tool with the mean rotation of the near poses.
            seen = Rotation.from_matrix(setup.T_world_base[:3, :3]).inv() * Rotation.from_euler("xyz", rpy)
            arm = Rotation.from_matrix(T[:, :3, :3])
            tool = (arm[kept].inv() * seen[kept]).mean()
            distance = np.hypot(distance, _ARM_MM * (seen * (arm * tool).inv()).magnitude())
        kept = np.sort(np.argsort(distance)[:count])
    return rms(distance[kept]), setup


def _length(mm: float) -> str:
    return f"{mm:.2g} mm" if mm < 10 else f"{mm:.0f} mm"


_ON_PATH = 0.03
_ON_TRACK = 0.3
"""Largest deviation from the path, as a share of the path size.

The rig file may lack the target of the tracker, so the positions fit only roughly.
"""
_IN_SOCKET = 0.1
"""Largest residual in sockets, as a share of the tool's travel. Uncalibrated arms leave up to 0.04 (the Pandas of
MUKCa). With joints in a wrong unit it is at least 0.3, because the ball then appears to move.
"""
_UPRIGHT = 0.3
"""Largest acceptable angle in rad between the tool and the orientation of the test; a misread joint exceeds it."""


def off_sockets(T: Array, socket: NDArray[np.str_]) -> PathDeviation | None:
    """Deviation of the ball from the sockets, with fitted positions of sockets and ball."""
    size = float(np.linalg.norm(T[:, :3, 3] - T[:, :3, 3].mean(axis=0), axis=1).mean())
    if size <= 0:
        return None
    off_mm = float(np.median(np.linalg.norm(socket_residuals(T, socket), axis=1)))
    return PathDeviation(off_mm, off_mm / size, off_mm / size < _IN_SOCKET)


def off_places(T: Array, xyz_mm: Array) -> PathDeviation | None:
    """Difference between the mutual distances of tool poses and those of the measured positions."""
    rows = most_distant_rows(xyz_mm)
    size = float(np.median(steps(xyz_mm, rows)))
    if size <= 0:
        return None
    off_mm = float(np.median(np.abs(steps(T[:, :3, 3], rows) - steps(xyz_mm, rows))))
    return PathDeviation(off_mm, off_mm / size, off_mm / size < _ON_TRACK)


def off_circle(T: Array, circle: Circle) -> PathDeviation:
    """Deviation of tool poses T (n, 4, 4) from a circle.

    The x axis of the tool points along the normal; in a different orientation the deviation is an arc length.
    """
    frame = frame_of(circle)
    from_centre = T[:, :3, 3] - frame.centre
    radial = np.abs(np.linalg.norm(from_centre, axis=1) - circle.radius_mm)
    off = float(np.median(np.maximum(radial, np.abs(from_centre @ frame.n))))
    R_nominal = frame.poses(np.arctan2(from_centre @ frame.v, from_centre @ frame.u))[:, :3, :3]
    trace = np.einsum("nij,nij->n", R_nominal, T[:, :3, :3])
    turned = float(np.median(np.arccos(np.clip((trace - 1) / 2, -1.0, 1.0))))
    off_mm = max(off, circle.radius_mm * turned * (turned > _UPRIGHT))
    return PathDeviation(off_mm, off_mm / circle.radius_mm, off_mm < _ON_PATH * circle.radius_mm)


def off_targets(T: Array, targets: Array | None, hemisphere: Hemisphere) -> PathDeviation:
    """Deviation of tool poses from their targets (n, 3) mm, or from the sphere if the targets are unknown."""
    frame, places = hemisphere_frame(hemisphere), T[:, :3, 3]
    away = np.abs(np.linalg.norm(places - frame.centre, axis=1) - frame.radius)
    off_mm = float(np.median(away if targets is None else np.linalg.norm(places - targets, axis=1)))
    return PathDeviation(off_mm, off_mm / frame.radius, off_mm < _ON_PATH * frame.radius)


def most_distant_rows(places: Array) -> int:
    """Row distance at which positions (n, 3) differ most, among a few.

    Rows half a table apart are equal if all poses are driven twice, adjacent ones if each pose is measured several
    times.
    """
    n = len(places)
    return max((n // 2, n // 3, n // 5, 1), key=lambda rows: float(np.median(steps(places, rows))))


def steps(places: Array, rows: int) -> Array:
    """Distances (n,) mm of positions (n, 3) from those `rows` rows before; they are equal in every frame."""
    return np.asarray(np.linalg.norm(places - np.roll(places, rows, axis=0), axis=1))


_MIRROR_POSES, _MIRROR_STEPS = 80, 100
_MIRROR = np.array([1.0, -1.0, 1.0])
"""Mirror at one axis. Any axis is suitable, because the frame is fitted."""


def mirror_findings(table: PoseTable, rig: Rig, convention: str) -> Iterator[Finding]:
    measured = np.flatnonzero(~table.lost)
    if len(measured) < FEWEST:
        return
    chosen = measured[evenly(len(measured), _MIRROR_POSES)]
    bare, q, xyz_mm = without_setup(arm_of(rig.robot)), table.q[chosen], table.xyz_mm[chosen]
    as_labelled = left_mm(bare, q, xyz_mm, _MIRROR_STEPS)
    if as_labelled < RIGHT_MM:
        return
    mirrored = left_mm(bare, q, xyz_mm * _MIRROR, _MIRROR_STEPS)
    if mirrored > RIGHT_MM or as_labelled < CLEARLY * mirrored:
        return
    fact = (
        f"these poses fit only with the sign of y_mm changed (error {mirrored:.2g} instead of {as_labelled:.0f} mm): "
        "the frame of the instrument is left-handed"
    )
    remedy = "change the sign of one of x_mm, y_mm, z_mm, or import the file as it was written, by a map with mirror: y"
    joints = judged_by_places(rig, q, xyz_mm, None)[0]
    if joints and joints.left_mm < AS_WELL * mirrored:
        fact += f". They fit as well with {joints.meaning.words}"
        remedy = f"look up which is true. For the frame, {remedy}; for the joints, {joints.meaning.remedy}"
    misfit = Misfit(as_labelled, mirrored, len(chosen) * float(np.log(as_labelled / max(mirrored, 1e-9))))
    yield Finding(convention, "impossible", ("x_mm", "y_mm", "z_mm"), "y mirrored", fact, remedy, misfit)
