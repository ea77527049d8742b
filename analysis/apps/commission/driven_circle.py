"""Circle that a robot drove, or around which it was jogged or guided by hand, with its start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.apps.commission.circle_motion import (
    BENT,
    DRIVEN,
    GUIDED,
    Binned,
    Fit,
    FoundCircle,
    Tolerance,
    binned,
    even_path,
    find_circle,
    fit_rows,
    on_circle,
)
from analysis.apps.commission.touched_ball import circle_through_stands, distinct, is_jogged
from analysis.robot.geometry.circle import CircleFrame, circle_frame, deviations
from analysis.robot.kinematics.arm import Array, Integers, Mask, arm_of
from analysis.runs.loading import RobotMotion
from analysis.runs.stands import STILL_RUN_RAD
from rigs.edit import Values
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.declared_tests import Circle
from rigs.schema.vocabulary import Direction

# ----------------------------------------------------------------------------------------------------------------------
# Start and anticlockwise direction of a driven circle: normal, zero direction and posture.
#
# By docs/conventions.md the x axis of the tool points along the normal. A tool held in this way determines the sign of
# the normal; otherwise the label of the run does. The acw circle starts at the smallest angle, after the lead-in. A cw
# program drives the same joint angles in reverse.

_ALONG_NORMAL = float(np.cos(np.radians(30.0)))
"""Minimum cosine between the x axis of the tool and the normal for the tool to determine the sign."""
_CLEAR_RAD = np.radians(20.0)
"""Smallest net angle of a motion with a clear direction. Below it, the robot moved in both directions."""
_MISSING_SHARE = 0.01
"""Largest missing share of a turn for a lap to count as complete."""
_SAME_START_RAD = np.radians(5.0)
"""Largest distance from the start in the rig file: the ends of a program are found to about a degree."""
_SAME_TOOL_RAD = np.radians(2.0)
"""Largest deviation of the tool from its orientation in a circle test."""


@dataclass(frozen=True)
class CircleStart:
    """Circle with sign and zero direction."""

    circle: CircleFrame
    at: Array
    """Unit vector (3,) to the start of the acw circle."""
    posture: Array
    """Joint angles (6,) at the start, in rad."""
    arc_rad: float
    """Driven angle."""
    keeps_zero: bool
    """True if the zero direction of the rig file remains valid."""
    doubts: tuple[str, ...]


def start_of(
    circle: CircleFrame, T: Array, q: Array, direction: Direction | None, declared: Circle | None
) -> CircleStart:
    """Start of a circle from a stretch of tool poses T (n, 4, 4) and angles q (n, 6) on it.

    direction: label of the run. declared: circle of the rig file.
    """
    phi = circle.angle(T[:, :3, 3])
    doubts: list[str] = []
    if _sense(circle, T, phi, direction, declared, doubts) < 0:
        circle, phi = circle_frame(circle.centre, -circle.n, circle.u, circle.radius), -phi
    arc = float(np.ptp(phi))
    laps = int(arc / (2 * np.pi) + _MISSING_SHARE)
    lead = max(0.0, (arc - 2 * np.pi * laps) / 2) if laps else 0.0
    begins = float(phi.min()) + lead
    row = int(np.abs(phi - begins).argmin())
    begun = np.radians(declared.start_deg) if declared else 0.0
    zero = circle.radial(np.array([begins - begun]))[0]
    keeps_zero = False
    if declared is not None and abs(np.dot(_unit(declared.zero), circle.n)) < _ALONG_NORMAL:
        declared_frame = circle_frame(circle.centre, circle.n, _unit(declared.zero), circle.radius)
        keeps_zero = bool(declared_frame.u @ zero > np.cos(_SAME_START_RAD))
        zero = declared_frame.u if keeps_zero else zero
    circle = circle_frame(circle.centre, circle.n, zero, circle.radius)
    at = circle.radial(np.array([begun]))[0]
    return CircleStart(circle, at, q[row], arc, keeps_zero, (*doubts, *_tool_doubts(circle, T)))


def _sense(
    circle: CircleFrame, T: Array, phi: Array, direction: Direction | None, declared: Circle | None, doubts: list[str]
) -> float:
    """Sign of the normal: -1 if it must be reversed."""
    along = float(T[:, :3, 0].mean(axis=0) @ circle.n)
    net = float(phi[-1] - phi[0])
    went = 0.0 if abs(net) < _CLEAR_RAD else float(np.sign(net))
    labelled = -1.0 if direction == "cw" else 1.0
    if abs(along) > _ALONG_NORMAL:
        sign = float(np.sign(along))
        if direction and went and sign * went != labelled:
            driven = "acw" if direction == "cw" else "cw"
            doubts.append(
                f"about the tool's x axis, which is the normal, the robot moved {driven}, and the run is labelled "
                f"{direction}: to correct: rig relabel RUN --direction {driven}, or turn robot.tool by 180° about z"
            )
        return sign
    if went:
        return labelled * went
    doubts.append("the robot moved equally in both directions, so the sign of the normal is a guess: check the sign")
    return float(np.sign(circle.n @ (_unit(declared.normal) if declared else [0.0, 0.0, 1.0])) or 1.0)


def _tool_doubts(circle: CircleFrame, T: Array) -> list[str]:
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

    nominal = circle.poses(circle.angle(T[:, :3, 3]))[:, :3, :3]
    turn = Rotation.from_matrix(np.swapaxes(T[:, :3, :3], 1, 2) @ nominal)
    mean = turn.mean()
    off, spread = mean.magnitude(), float(np.degrees((mean.inv() * turn).magnitude().max()))
    if off < _SAME_TOOL_RAD and spread < np.degrees(_SAME_TOOL_RAD):
        return []
    fact = f"the tool was {np.degrees(off):.0f}° from the orientation of the test (z to the centre, x along the normal)"
    if spread < np.degrees(_SAME_TOOL_RAD):
        return [f"{fact}: the program turns the tool by this angle unless robot.tool.rpy_deg is corrected"]
    return [f"{fact}, and not evenly (by up to {spread:.0f}°): the program turns the tool by this angle"]


def _unit(vector: tuple[float, float, float]) -> Array:
    return np.asarray(np.array(vector) / np.linalg.norm(vector))


# ----------------------------------------------------------------------------------------------------------------------
# Circle that a robot drove, or around which it was jogged or guided by hand, as the block `tests.circle` of a rig file.
#
# The places follow from the reported joint angles and the nominal arm. If the robot followed a circle, all rows on it
# are used. If it stood at three or more points with straight motion in between, only these points are used. The
# uncertainty u covers the scatter about the circle and the ambiguity of the arc. It does not cover errors common to the
# entire run, such as a wrong zero of a joint.

_SECOND = 1 / 3
"""Minimum angle of a second circle relative to the first. Such a circle was driven on purpose."""
_FURTHER = 1.3
"""Ratio of angles for preferring a bent circle. The path of a healthy arm follows both."""
_ROUND_MM = 0.3
"""Largest deviation from a circle caused by a healthy arm, whose constants are wrong by some tenths of a mm."""
_NEAR = 4.0
"""Tolerances from the first circle within which a path is no part of a second."""
_FEWEST_OFF = 10
"""Minimum number of points of a second circle, of some hundred."""
_GAUGE_MM = 5.0
"""Largest 2 u: the ball is mounted at the centre of the circle, and a gauge reads about 5 mm in both directions."""
_LONGER = "drive a longer arc, preferably a full lap, or rest for a second at three or more points of the circle"


@dataclass(frozen=True)
class DrivenCircle:
    """A circle with uncertainties; the covariances (3, 3) are in world coordinates."""

    circle: CircleFrame
    centre_cov: Array
    normal_cov: Array
    u_radius_mm: float
    u_zero: float
    """Uncertainty of the zero direction in the plane, in rad."""
    posture: Array
    arc: float
    keeps_zero: bool
    used: str
    """Description of the data."""
    doubts: tuple[str, ...]

    @property
    def u_centre_mm(self) -> Array:
        """Standard uncertainty (3,) of the centre in mm."""
        return np.sqrt(np.diag(self.centre_cov))

    @property
    def u_normal(self) -> float:
        """Standard uncertainty of the normal in rad, in the least certain direction."""
        return float(np.sqrt(np.linalg.eigvalsh(self.normal_cov)[-1]))

    def values(self) -> Values:
        """Keys of tests.circle, rounded to a micrometre and a hundredth of a degree."""
        values: dict[str, float | list[float]] = {
            "centre_mm": self.circle.centre.round(3).tolist(),
            "normal": self.circle.n.round(6).tolist(),
            "zero": self.circle.u.round(6).tolist(),
            "radius_mm": round(self.circle.radius, 3),
            "posture_deg": np.degrees(self.posture).round(2).tolist(),
        }
        return {key: value for key, value in values.items() if key != "zero" or not self.keeps_zero}


def driven_circle(motions: Sequence[RobotMotion], rig: Rig) -> DrivenCircle:
    """The only circle in motions of the robot. Raises FileError for none, a second, or too short an arc."""
    arm = arm_of(rig.robot)
    for motion in motions:
        if not np.isfinite(motion.q).all():
            row = int(np.argmin(np.isfinite(motion.q).all(axis=1))) + 1
            problem = f"row {row} has a joint angle that is not a number"
            raise FileError(motion.where, problem, "remove such rows", code="circle.not_finite")
        if len(motion.t_s) < 2 or np.ptp(motion.q, axis=0).max() < STILL_RUN_RAD:
            remedy = "move the tool about the ball during the recording"
            raise FileError(motion.where, "the robot stood still", remedy, code="circle.stood_still")
    bins = binned(motions, arm)
    where = _where(motions)
    path = bins.moving
    path[bins.stand_rows] = True  # a stop is a single point of the path
    points, run = even_path(bins.places[path], bins.run[path])
    # Use a bent circle only if the path follows it much further than a round circle.
    true, bent = find_circle(points, run, DRIVEN), find_circle(points, run, BENT)
    path_circle, tolerance = true, DRIVEN
    if bent and bent.turned_rad > _FURTHER * (true.turned_rad if true else 0.0):
        path_circle, tolerance = bent, BENT
    if is_jogged(bins, path_circle):
        stops = circle_through_stands(arm, bins, where)
        start = start_of(stops.circle, stops.T, stops.q, motions[0].direction, rig.tests.circle)
        used = f"{len(stops.T)} stops of the robot, over {np.degrees(start.arc_rad):.0f}° of arc"
        doubts = (*_doubts(motions), *stops.doubts)
        return _result(stops.circle, stops.covariance, stops.covariance, start, used, doubts, where)
    stood = len(distinct(bins.places[bins.stand_rows]))
    if path_circle is None:
        path_circle, tolerance = find_circle(points, run, GUIDED), GUIDED
    if path_circle is None:
        length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
        problem = (
            f"the motion of {length:.0f} mm contains no arc of a circle that is long enough, and the robot stopped at "
            f"{stood} points; three are needed"
        )
        raise FileError(where, problem, _LONGER, code="circle.none")
    _check_one_circle(path_circle, tolerance, points, run, where)
    on, circle = on_circle(bins, path_circle.circle, tolerance, where)
    return _of_rows(fit_rows(motions, arm, bins, on, circle), bins, on, motions, rig)


def _of_rows(fit: Fit, bins: Binned, on: Mask, motions: Sequence[RobotMotion], rig: Rig) -> DrivenCircle:
    # Choose the stretch with the largest angle. A pause at the turning point of a program does not end a stretch.
    rows = np.flatnonzero(on)
    off_path = deviations(fit.circle, bins.places).largest > DRIVEN.at(fit.circle.radius) * _NEAR
    number = np.cumsum(off_path | (np.diff(bins.run, prepend=0) != 0))[rows]
    pieces = [rows[number == piece] for piece in np.unique(number)]
    longest = max(pieces, key=lambda piece: float(np.ptp(fit.circle.angle(bins.places[piece]))))
    start = start_of(
        fit.circle, bins.T[longest], bins.q[longest], motions[bins.run[longest][0]].direction, rig.tests.circle
    )
    doubts = _doubts(motions)
    if fit.outliers:
        doubts.append(f"{fit.outliers} rows are outliers of the circle and are not used")
    off_mm = float(np.quantile(deviations(fit.circle, bins.places[on]).largest, 0.95))
    if off_mm > _ROUND_MM:
        hand = f"the path is off the circle by {off_mm:.1f} mm: the robot was guided by hand, the feedback jumped, or"
        doubts.append(f"{hand} the link constants of the controller differ from the rig file")
    used = f"{fit.rows} rows over {np.degrees(start.arc_rad):.0f}° of arc"
    return _result(fit.circle, fit.radial, fit.axial, start, used, tuple(doubts), _where(motions))


def _result(
    fitted: CircleFrame, radial: Array, axial: Array, start: CircleStart, used: str, doubts: tuple[str, ...], where: str
) -> DrivenCircle:
    """Rotate the covariances (3, 3) in mm² of radial and axial deviations into world coordinates."""
    plane = np.stack([fitted.u, fitted.v], axis=1)
    centre_cov = plane @ radial[1:, 1:] @ plane.T + axial[0, 0] * np.outer(fitted.n, fitted.n)
    normal_cov = plane @ axial[1:, 1:] @ plane.T / fitted.radius**2
    tangent = np.cross(start.circle.n, start.at)
    u_zero = float(np.sqrt(tangent @ centre_cov @ tangent)) / fitted.radius
    driven = DrivenCircle(
        start.circle,
        centre_cov,
        normal_cov,
        float(np.sqrt(radial[0, 0])),
        u_zero,
        start.posture,
        start.arc_rad,
        start.keeps_zero,
        used,
        (*doubts, *start.doubts),
    )
    largest = max(float(driven.u_centre_mm.max()), driven.u_radius_mm)
    if 2 * largest > _GAUGE_MM:
        problem = f"{used} leave centre and radius of the circle uncertain by {largest:.3g} mm (u)"
        raise FileError(where, problem, _LONGER, code="circle.uncertain")
    return driven


def _where(motions: Sequence[RobotMotion]) -> str:
    return ", ".join(motion.where for motion in motions)


def _doubts(motions: Sequence[RobotMotion]) -> list[str]:
    named = len(motions) > 1
    return [f"{motion.where}: {doubt}" if named else doubt for motion in motions for doubt in motion.doubts]


def _check_one_circle(path_circle: FoundCircle, tolerance: Tolerance, points: Array, run: Integers, where: str) -> None:
    """Refuse a path (k, 3) in mm with a second circle."""
    first = path_circle.circle
    off_first = deviations(first, points).largest > _NEAR * tolerance.at(first.radius)
    if off_first.sum() < _FEWEST_OFF:
        return
    # Keep the path after the first circle separate from the path before it.
    pieces = np.cumsum(np.diff(off_first, prepend=False) | (np.diff(run, prepend=0) != 0))
    second = find_circle(points[off_first], pieces[off_first], DRIVEN)
    if second is None or second.turned_rad < _SECOND * path_circle.turned_rad:
        return
    found = [
        f"radius {circle.radius:.1f} mm about {[round(float(x), 1) for x in circle.centre]}"
        for circle in (first, second.circle)
    ]
    problem = f"contains two circles ({found[0]}, and {found[1]})"
    remedy = "give separate runs of the same circle; if there is only one, check the feedback for jumps"
    raise FileError(where, problem, remedy, code="circle.two")
