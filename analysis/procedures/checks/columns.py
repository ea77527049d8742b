"""Comparison of the labelled columns with every other possible meaning: joints, and units.

Poses: for each meaning of the joints, base and tool are fitted to the nearest four fifths, and the residuals are
compared. A wrong meaning leaves centimetres, an arm with nominal constants millimetres. Circles and targets: the
program put the tool on the path of the rig file, and only the correct meaning does the same.

Alternative meanings are mistakes of a user or a program: axis 3 measured from the horizontal or from axis 2, inverted
axes, two exchanged columns, or a different zero. Makers differ in the signs of several axes at once, so every
combination of signs is tried; of meanings that fit alike, the one with the fewest mistakes comes first.

A wrong unit is claimed only for data that are impossible as labelled and correct with the alternative unit. An unlikely
label causes only a doubt. The two gauges on a circle reveal each other's unit: at circle angle phi their mean is R -
e_u cos(phi) - e_v sin(phi) for an eccentricity e, and each gauge shows the same e in yaw and roll. Positions and angles
of a tracker and a rail are compared with the motion of the robot in any frame. Positions in a left-handed frame come
from an export with an inverted axis, which no rigid frame corrects.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

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
from analysis.robot.kinematics.arm import Arm, Array, Integers, arm_of, forward, rail_mm, without_setup
from analysis.robot.kinematics.joint_limits import impossible_rad
from analysis.runs.noise.readings import evenly, rms
from analysis.runs.tables import CircleTable, PoseTable, Table, format_of
from rigs.arms import arm_names, load_arm
from rigs.rig import Rig
from rigs.schema.declared_tests import Circle, Hemisphere
from rigs.schema.modbus import ValueRegister
from rigs.schema.robot import Robot
from rigs.signedness import unsigned_readings
from rigs.text import enumerated

_ZEROS_DEG = (90.0, -90.0, 180.0)
"""Other zeros used in practice: a quarter or half a turn away."""


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
"""Largest residual of a correct meaning: an arm with nominal constants has errors of some mm."""
RIGHT_SHARE = 0.02
"""Largest residual of a correct meaning as a share of the spread of the positions. An arm of one metre leaves some
thousandths; poses that hardly move always leave a few mm.
"""
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
        other = _another_arm(table, rig) if as_labelled > _OTHER_MM else None
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
    if rig.robot.rail and best.meaning.columns == ("q1_deg",) and not as_good and best.meaning.offset.any():
        remedy += "; or correct robot.rail.direction: a rail with a different direction or sign looks the same"
    yield Finding(JOINTS, "decisive", best.meaning.columns, words, fact, remedy, misfit)


def _another_arm(table: Table, rig: Rig) -> Finding | None:
    """A finding if an arm of the library fits poses or touches clearly better than the stated arm.

    The stated arm must be one of the library too: a rig file with another length may contain a mistake.
    """
    if not facts_of(table.test).of_places:
        return None

    def misfit_mm(robot: Robot) -> float:
        arm = arm_of(robot.model_copy(update={"tool": rig.robot.tool}))
        if facts_of(table.test).of_tracker:
            rows = (table.readings != 0).any(axis=1)
            return left_mm(without_setup(arm), table.q[rows], table.readings[rows], _STEPS)
        path = kind_of(table.test).off_path(table, rig, forward(arm, table.q))
        return np.inf if path is None else path.off_mm

    robots = {name: load_arm(name).robot for name in arm_names()}
    stated = next((name for name, robot in robots.items() if _links(robot) == _links(rig.robot)), None)
    if stated is None:
        return None
    fits = {name: misfit_mm(robot) for name, robot in robots.items() if len(robot.axes) == len(rig.robot.axes)}
    name = min(fits, key=lambda arm: fits[arm])
    if fits[stated] <= max(_OTHER_MM, CLEARLY * fits[name]):
        return None
    fact = (
        f"the table fits {name} of the arm library with an error of {_length(fits[name])}, and {stated} with "
        f"{_length(fits[stated])}"
    )
    remedy = f"compare with the name plate, and give --arm {name} or a rig file of that arm"
    return Finding(JOINTS, "decisive", (), f"the arm {name}", fact, remedy)


def _links(robot: Robot) -> list[tuple[float, ...]]:
    return [(axis.a_mm, axis.d_mm, axis.alpha_deg, axis.beta_deg) for axis in robot.axes]


def _far_off(table: Table, rig: Rig, left_mm: float) -> Iterator[Finding]:
    """A finding if tracker positions or touches miss by more than an arm with nominal constants, in every meaning."""
    if facts_of(table.test).of_places and not facts_of(table.test).of_tracker:
        yield from _far_from_sockets(table, rig, left_mm)
    if not facts_of(table.test).of_tracker:
        return
    places = table.readings
    places = places[(places != 0).any(axis=1)]
    apart_mm = float(np.sqrt(3)) * rms(places - places.mean(axis=0))  # of positions, not of coordinates
    if left_mm <= min(RIGHT_MM, RIGHT_SHARE * apart_mm):
        return
    fact = (
        f"these poses do not fit the arm of the rig file: the error is {_length(left_mm)}, over a work area of "
        f"{_length(apart_mm)}. Nominal constants of the right arm are accurate to {RIGHT_MM:g} mm and "
        f"{100 * RIGHT_SHARE:g} %, and no other order, sign or zero of the joints fits clearly better"
    )
    remedy = "check that the rig file belongs to this arm; otherwise a zero or a length is wrong"
    strength = _strength(left_mm, apart_mm)
    yield Finding(JOINTS, strength, (), "a different arm, or a zero or length far off", fact, remedy)


def _strength(left_mm: float, extent_mm: float) -> Strength:
    return "decisive" if left_mm > max(RIGHT_MM, UNRELATED_SHARE * extent_mm) else "likely"


def _far_from_sockets(table: Table, rig: Rig, left_mm: float) -> Iterator[Finding]:
    T = forward(arm_of(rig.robot), table.q)
    path = kind_of(table.test).off_path(table, rig, T)
    if left_mm <= RIGHT_MM or path is None or path.on:
        return
    fact = (
        f"these touches miss their sockets by {_length(left_mm)} with the arm of the rig file, and no other order, "
        "sign or zero of the joints fits clearly better"
    )
    remedy = "check that the rig file belongs to this arm, and that each row names its socket"
    strength = _strength(left_mm, float(np.sqrt(3)) * rms(T[:, :3, 3]))
    yield Finding(JOINTS, strength, (), "a different arm, or rows of another socket", fact, remedy)


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

    def verdict(turns: Array | None) -> Verdict:
        def misfit(rows: Integers, joints: Array, steps: int) -> float:
            return left_mm(bare, joints, xyz_mm[rows], steps, None if turns is None else turns[rows])

        screened = sorted(meanings(bare.axes), key=lambda meaning: misfit(few, meaning.of(q[few]), _STEPS))
        values = int(3 * _KEPT * len(q)) - 9
        judged = [
            JudgedMeaning(meaning, misfit(many, meaning.of(q[many]), 100), values) for meaning in screened[:_BEST]
        ]
        return _decided(judged, misfit(many, q[many], 100), RIGHT_MM)

    by_places = verdict(None)
    return by_places if by_places[0] or rpy is None else verdict(rpy)


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


_ECCENTRIC_MM = 0.2
"""Smallest examined eccentricity. A smaller one may differ between the gauges because of robot errors."""
_LIKE_STATED = 0.3
"""Largest relative difference from the stated eccentricity. Robot errors of 0.1 mm cause less, a wrong unit causes
25 times more.
"""
_TRAVEL_RATIO = 2.0
"""Largest ratio of the travel of two gauges in the same unit; in different units it is 25."""
FACTORS = {"inches": 1 / 25.4, "µm": 1000.0}
"""Factor from a length in mm to another unit."""


def circle_gauges(table: CircleTable, rig: Rig, T: Array) -> Iterator[tuple[str, str]]:
    """Faults of the gauges of a circle, each with a remedy."""
    circle = rig.tests.circle
    if circle is None:
        return
    for name, reading in zip(("g1_mm", "g2_mm"), table.g_mm.T, strict=False):
        yield from impossible_travel(name, reading, circle.radius_mm)
    off = off_circle(T, circle)
    if table.g_mm.shape[1] < 2 or rig.gauges.g2 is None or off is None or not off.on:
        return
    frame = frame_of(circle)
    phi = frame.angle(T[:, :3, 3])
    if np.ptp(phi) < 2 * np.pi * 0.9 or len(phi) < 12:
        return
    # Eccentricity along phi = 0° and 90° from each gauge, rotated in a yaw test by w/R to either side.
    design = np.stack([np.ones_like(phi), np.cos(phi), np.sin(phi)], axis=1)
    waves: Array = -np.linalg.lstsq(design, table.g_mm, rcond=None)[0][1:].T
    # Both gauges follow the same ball. They therefore see waves of the same size and direction, and have equal travel.
    # Errors of a robot may cancel the wave of a gauge, but not the rest of the reading.
    # an outlier caused by a chip under the probe does not count
    low, high = np.quantile(table.g_mm, [0.05, 0.95], axis=0)
    travel, size = high - low, np.linalg.norm(waves, axis=1)
    seen = size.min() > 0 and size.max() >= _ECCENTRIC_MM and waves[0] @ waves[1] >= 0
    for (unit, factor), k in product(FACTORS.items(), (0, 1)) if seen else ():
        ratio = size[k] / size[1 - k]
        as_far = 1 / _TRAVEL_RATIO < travel[k] / factor / max(travel[1 - k], 1e-9) < _TRAVEL_RATIO
        if abs(ratio / factor - 1) < 0.1 and as_far:
            fact = f"g{k + 1}_mm is in {unit}: its wave over the circle is {ratio:.3g} times that of the other gauge"
            yield fact, "convert it to mm"
    # If the rig file states the eccentricity, compare it with the data in other units.
    stated_mm = np.array([np.dot(circle.eccentricity_mm, frame.u), np.dot(circle.eccentricity_mm, frame.v)])
    size_mm = float(np.linalg.norm(stated_mm))
    for unit, factor in FACTORS.items() if size_mm >= _ECCENTRIC_MM else ():
        if np.linalg.norm(waves.mean(axis=0) / factor - stated_mm) < _LIKE_STATED * size_mm:
            fact = f"g1_mm and g2_mm are in {unit}: their wave is {factor:.3g} times the eccentricity of the rig file"
            yield fact, "convert them to mm"


def impossible_travel(name: str, reading: Array, radius_mm: float) -> Iterator[tuple[str, str]]:
    """Fault and remedy if a reading travels further than the radius, which is impossible with a link."""
    travel = float(np.ptp(reading))
    if travel > radius_mm:
        fact = f"{name} travels {travel:.4g} mm on a radius of {radius_mm:g} mm, which is impossible for a link"
        if wrapped := unsigned_readings(reading):
            unsigned, remedy = wrapped
            yield f"{fact}: {unsigned}", remedy
            return
        yield fact, "convert it to mm: the values are probably µm" if travel > 3 * radius_mm else "check the unit"


_OF_TRACKERS = {"m": 1e-3, "cm": 0.1}
"""Units of trackers in addition to those of gauges: factor from a length in mm."""
_MISREAD_UNITS = {"inches": 25.4, "cm": 10.0}
"""Factor for a length in mm misinterpreted in another unit, for example by an import map; m looks like µm."""
_ABOUT = 0.3
"""Largest relative difference between equal distances.

The rig file may lack the target of the tracker, so the distances agree only roughly.
"""
_SAME_TURN_RAD = 0.01
"""Largest median difference between the rotation angles of tracker and robot between poses, …"""
_FARTHER = 8.0
"""An angle convention is wrong if its difference exceeds this limit, and that of another convention by this factor."""


def tracker(table: PoseTable, T: Array) -> Iterator[tuple[str, str]]:
    rows = most_distant_rows(table.xyz_mm)
    robot_step, seen = (float(np.median(steps(places, rows))) for places in (T[:, :3, 3], table.xyz_mm))
    for units, are_in, remedy in (
        ({**FACTORS, **_OF_TRACKERS}, "are in", "convert the places to mm"),
        (_MISREAD_UNITS, "were not in", "read them as mm"),
    ):
        for unit, factor in units.items():
            if robot_step > 1.0 and abs(seen / robot_step / factor - 1) < _ABOUT:
                far = f"they move {seen / robot_step:.3g} times as far as the robot"
                yield f"x_mm, y_mm, z_mm {are_in} {unit}: {far}", remedy
    if table.rpy is None:
        return
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

    # Difference between the robot's rotations and the angles as read, and with other units and orders.
    turned, rpy = _turns(T[:, :3, :3], rows), table.rpy
    turns = (
        _turns(Rotation.from_euler(order, angles).as_matrix(), rows)
        for order, angles in (("xyz", rpy), ("xyz", np.degrees(rpy)), ("XYZ", rpy))
    )
    as_read, in_radians, about_moving = (float(np.median(np.abs(turn - turned))) for turn in turns)
    right = 0.0 if as_read < _SAME_TURN_RAD else min(_SAME_TURN_RAD, as_read / _FARTHER)
    if in_radians < right:
        yield (
            "rx_deg, ry_deg, rz_deg are in radians: only then do they fit the motion of the robot",
            "convert them to degrees",
        )
    if about_moving < right:
        fact = "rx_deg, ry_deg, rz_deg are rotations about moving axes: only then do they fit the motion of the robot"
        yield fact, "convert them to roll-pitch-yaw about fixed axes, R = Rz Ry Rx"


def off_in_its_unit(T: Array, xyz_mm: Array) -> PathDeviation | None:
    units = (1.0, *FACTORS.values(), *_OF_TRACKERS.values(), *_MISREAD_UNITS.values())
    every = [off for factor in units if (off := off_places(T, xyz_mm / factor))]
    return min(every, key=lambda off: off.off, default=None)


def _turns(R: Array, rows: int) -> Array:
    """Angle (n,) rad between each rotation and the one `rows` rows before, which is equal in every frame."""
    trace = np.einsum("nij,nij->n", R, np.roll(R, rows, axis=0))
    return np.asarray(np.arccos(np.clip((trace - 1) / 2, -1.0, 1.0)))


_MM = {"m": 1000.0, "inches": 25.4, "cm": 10.0}
"""Millimetres per unit in which a controller may write the position of a rail."""
_POSES, _RAIL_STEPS = 200, 30
"""Number of poses that reveal a unit, and number of fit steps."""


def rail_findings(table: PoseTable, rig: Rig) -> Iterator[Finding]:
    """A finding if the rail positions of poses fit in a different unit, or exceed the rail."""
    arm = without_setup(arm_of(rig.robot))
    if rig.robot.rail is None or table.q.shape[1] == arm.axes:
        return
    if len(table.q) >= FEWEST:
        kept = evenly(len(table.q), _POSES)

        def misfit_mm(factor: float) -> float:
            q: Array = table.q[kept] * np.append(np.ones(arm.axes), factor)
            return left_mm(arm, q, table.xyz_mm[kept], _RAIL_STEPS)

        as_read = misfit_mm(1.0)
        for unit, factor in _MM.items() if as_read > CLEARLY * RIGHT_MM else ():
            if (meant := misfit_mm(factor)) < RIGHT_MM:
                fact = (
                    f"e1_mm is in {unit}: only then do these poses fit (error {meant:.2g} instead of {as_read:.0f} mm)"
                )
                yield Finding("units", "impossible", ("e1_mm",), unit, fact, "convert it to mm")
                return
    stands, (low, high) = rail_mm(arm, table.q), rig.robot.rail.limits_mm
    if stands.min() < low or stands.max() > high:
        reach = f"{stands.min():.6g} to {stands.max():.6g} mm"
        fact = f"e1_mm ranges from {reach}, but robot.rail.limits_mm from {low:g} to {high:g} mm"
        yield Finding("units", "likely", ("e1_mm",), "another unit", fact, "check the unit, or correct limits_mm")


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


UNITS = "units"
_TURN_RAD = 2 * np.pi + 0.1
_MUCH_MORE = 2.0
"""Factor by which the deviation from the path must exceed that of another joint convention, in any unit of the
tracker. Radians read as degrees move the arm so little that metres look like inches.
"""
_UNLIKELY = 0.1
"""Gauge travel at targets, as a share of the radius, that is too large for errors of an arm."""
_UNIT_ROWS = 20_000
"""Number of rows sufficient to reveal a unit; a run may have millions."""


def unit_findings(table: Table, rig: Rig) -> Iterator[Finding]:
    if most := impossible_rad(table.q):
        columns = tuple(f"q{axis}_deg" for axis in range(1, table.q.shape[1] + 1))
        fact = f"a joint would be at {np.degrees(most):.0f}°: degrees were read as radians"
        yield Finding(UNITS, "impossible", columns, "degrees", fact, "read them as degrees")
        return
    table = table.thinned(_UNIT_ROWS)
    arm = arm_of(rig.robot)
    places = forward(arm, table.q)
    # True if the robot performs the test only if q is in rad instead of degrees.
    degrees = np.degrees(table.q)
    ways: tuple[Array, ...] = (places, forward(arm, degrees)) if np.abs(degrees).max() <= _TURN_RAD else ()
    wrong, right = [kind_of(table.test).off_path(table, rig, T) for T in ways] or (None, None)
    if wrong and right and right.on and wrong.off > _MUCH_MORE * right.off:
        columns = tuple(f"q{axis}_deg" for axis in range(1, arm.axes + 1))
        fact = f"q1_deg … {columns[-1]} are in radians: only then does the robot of the rig file follow the program"
        yield Finding(UNITS, "impossible", columns, "radians", fact, "convert them to degrees")
        yield from kind_of(table.test).unit_findings(table, rig, forward(arm, degrees))
        return
    yield from kind_of(table.test).unit_findings(table, rig, places)


def unsigned_findings(table: Table, rig: Rig) -> Iterator[Finding]:
    readings, gauges = table.readings, format_of(table.test).gauges
    for name, column in zip(gauges, readings.T, strict=False):
        value = getattr(dict(rig.gauges).get(name), "value", None)
        shown = unsigned_readings(column, [value.scale] if isinstance(value, ValueRegister) else [])
        if shown is not None:
            fact, remedy = shown
            fact, remedy = f"{name}_mm: {fact} mm", f"{remedy}, and read {name} again"
            yield Finding(UNITS, "decisive", (f"{name}_mm",), "signed values", fact, remedy)


def impossible(mistakes: Iterable[tuple[str, str]]) -> Iterator[Finding]:
    for fact, remedy in mistakes:
        columns = tuple(name.strip(",:") for name in fact.split() if "_" in name)
        yield Finding(UNITS, "impossible", columns, "another unit", fact, remedy)


def target_units(g_mm: Array, radius_mm: float) -> Iterator[Finding]:
    yield from impossible(impossible_travel("g1_mm", g_mm, radius_mm))
    travel = float(np.ptp(g_mm))
    if _UNLIKELY * radius_mm <= travel <= radius_mm:
        fact = f"g1_mm travels {travel:.4g} mm on a radius of {radius_mm:g} mm, more than any robot error"
        yield Finding(UNITS, "likely", ("g1_mm",), "another unit", fact, "check the unit")
