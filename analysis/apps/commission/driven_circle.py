"""Circle that a robot drove, or around which it was jogged or guided by hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.apps.commission.circle_motion import NEAR, CircleFit, bin_motions, fit_rows, on_circle
from analysis.apps.commission.circle_search import BENT, DRIVEN, GUIDED, FoundCircle, Tolerance, even_path, find_circle
from analysis.apps.commission.circle_stops import fit_stops, is_jogged
from analysis.apps.commission.touched_ball import GAUGE_MM, distinct_places
from analysis.robot.geometry.circle import (
    CircleFrame,
    circle_frame,
    deviations,
)
from analysis.robot.kinematics.arm import Array, Integers, arm_of
from analysis.runs.loading import RobotMotion
from analysis.runs.stands import STILL_RUN_RAD
from rigs.edit import Values
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.declared_tests import Circle
from rigs.schema.vocabulary import Direction

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
_SAME_TOOL_DEG = 2.0
"""Largest deviation of the tool from its orientation in a circle test."""


def find_start(
    fit: CircleFit, direction: Direction | None, declared: Circle | None
) -> tuple[CircleFrame, Array, Array, float, bool, list[str]]:
    """Circle with sign and zero direction, the unit vector (3,) to the start, the joint angles (6,) there in rad, the
    driven angle, whether the zero direction of the rig file stays, and doubts."""
    circle, T = fit.circle, fit.T
    phi = circle.angle(T[:, :3, 3])
    doubts: list[str] = []
    if _normal_sign(circle, T, phi, direction, declared, doubts) < 0:
        circle, phi = circle_frame(circle.centre, -circle.n, circle.u, circle.radius), -phi
    arc = float(np.ptp(phi))
    laps = int(arc / (2 * np.pi) + _MISSING_SHARE)
    lead = max(0.0, (arc - 2 * np.pi * laps) / 2) if laps else 0.0
    begins = float(phi.min()) + lead
    begun = np.radians(declared.start_deg) if declared else 0.0
    zero, keeps_zero = circle.radial(np.array([begins - begun]))[0], False
    if declared is not None and abs(np.dot(_unit(declared.zero), circle.n)) < _ALONG_NORMAL:
        declared_frame = circle_frame(circle.centre, circle.n, _unit(declared.zero), circle.radius)
        keeps_zero = bool(declared_frame.u @ zero > np.cos(_SAME_START_RAD))
        zero = declared_frame.u if keeps_zero else zero
    circle = circle_frame(circle.centre, circle.n, zero, circle.radius)
    posture = fit.q[int(np.abs(phi - begins).argmin())]
    at = circle.radial(np.array([begun]))[0]
    return circle, at, posture, arc, keeps_zero, [*doubts, *_tool_doubts(circle, T)]


def _normal_sign(
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
    off_deg, spread_deg = np.degrees(mean.magnitude()), float(np.degrees((mean.inv() * turn).magnitude().max()))
    if max(off_deg, spread_deg) < _SAME_TOOL_DEG:
        return []
    uneven = f", and not evenly (by up to {spread_deg:.0f}°)" if spread_deg >= _SAME_TOOL_DEG else ""
    place = f"{off_deg:.0f}° from the orientation of the test (z to the centre, x along the normal){uneven}"
    return [f"the tool was {place}: the program turns the tool by this angle unless robot.tool.rpy_deg is corrected"]


def _unit(vector: tuple[float, float, float]) -> Array:
    return np.asarray(np.array(vector) / np.linalg.norm(vector))


# The circle as the block `tests.circle` of a rig file.
#
# The places follow from the reported joint angles and the nominal arm. If the robot followed a circle, all rows on it
# are used; if it stood at three or more points with straight motion in between, only these points. The uncertainty u
# covers the scatter about the circle, but no errors common to the run, such as a wrong zero of a joint.

_SECOND = 1 / 3
"""Minimum angle of a second circle, driven on purpose, relative to the first."""
_FURTHER = 1.3
"""Ratio of angles for preferring a bent circle: the path of a healthy arm follows both."""
_FEWEST_OFF = 10
"""Minimum number of points of a second circle, of some hundred."""
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

    def values(self) -> Values:
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
            raise FileError(motion.where, problem, "remove such rows", code="readings.unsuitable")
        if len(motion.t_s) < 2 or np.ptp(motion.q, axis=0).max() < STILL_RUN_RAD:
            remedy = "move the tool about the ball during the recording"
            raise FileError(motion.where, "the robot stood still", remedy, code="readings.unsuitable")
    where = ", ".join(motion.where for motion in motions)
    bins = bin_motions(motions, arm)
    path = bins.moving
    path[bins.stand_rows] = True  # a stop is a single point of the path
    points, run = even_path(bins.places[path], bins.run[path])
    # Use a bent circle only if the path follows it much further than a round circle.
    true, bent = find_circle(points, run, DRIVEN), find_circle(points, run, BENT)
    found, tolerance = true, DRIVEN
    if bent and bent.turned_rad > _FURTHER * (true.turned_rad if true else 0.0):
        found, tolerance = bent, BENT
    if is_jogged(bins, found):
        return _with_start(fit_stops(arm, bins, where), motions, rig, where)
    if found is None:
        found, tolerance = find_circle(points, run, GUIDED), GUIDED
    if found is None:
        length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
        problem = (
            f"the motion of {length:.0f} mm contains no arc of a circle that is long enough, and the robot stopped at "
            f"{len(distinct_places(bins.places[bins.stand_rows]))} points; three are needed"
        )
        raise FileError(where, problem, _LONGER, code="readings.unsuitable")
    _check_one_circle(found, tolerance, points, run, where)
    on, circle = on_circle(bins, found.circle, tolerance, where)
    return _with_start(fit_rows(motions, arm, bins, on, circle), motions, rig, where)


def _with_start(fit: CircleFit, motions: Sequence[RobotMotion], rig: Rig, where: str) -> DrivenCircle:
    direction = motions[fit.motion].direction
    circle, at, posture, arc, keeps_zero, of_start = find_start(fit, direction, rig.tests.circle)
    plane, normal = np.stack([fit.circle.u, fit.circle.v], axis=1), fit.circle.n
    centre_cov = plane @ fit.radial[1:, 1:] @ plane.T + fit.axial[0, 0] * np.outer(normal, normal)
    normal_cov = plane @ fit.axial[1:, 1:] @ plane.T / fit.circle.radius**2
    tangent = np.cross(circle.n, at)
    u_zero = float(np.sqrt(tangent @ centre_cov @ tangent)) / circle.radius
    u_radius_mm = float(np.sqrt(fit.radial[0, 0]))
    used = f"{fit.used} over {np.degrees(arc):.0f}° of arc"
    if 2 * (largest := max(float(np.sqrt(np.diag(centre_cov)).max()), u_radius_mm)) > GAUGE_MM:
        problem = f"{used} leave centre and radius of the circle uncertain by {largest:.3g} mm (u)"
        raise FileError(where, problem, _LONGER, code="readings.unsuitable")
    named = len(motions) > 1
    doubts = [f"{motion.where}: {doubt}" if named else doubt for motion in motions for doubt in motion.doubts]
    doubts += [*fit.doubts, *of_start]
    return DrivenCircle(
        circle, centre_cov, normal_cov, u_radius_mm, u_zero, posture, arc, keeps_zero, used, tuple(doubts)
    )


def _check_one_circle(path_circle: FoundCircle, tolerance: Tolerance, points: Array, run: Integers, where: str) -> None:
    first = path_circle.circle
    off_first = deviations(first, points).largest > NEAR * tolerance.at(first.radius)
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
    raise FileError(where, problem, remedy, code="readings.unsuitable")
