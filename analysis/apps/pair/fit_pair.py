"""Fit two arms to their touches: initial fit without a prior, repeated linearisation at the posterior, and removal
of outliers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from analysis.apps.pair.arm_terms import PairArm, arm_terms, tool_points
from analysis.apps.pair.linear_gap import LinearGaps, Pair, PairState, linearise
from analysis.apps.pair.pair_table import FEWEST, PairTable
from analysis.apps.pair.posterior import PairPosterior, fitted_levels, posterior
from analysis.robot.geometry.pose_setup import frame
from analysis.robot.kinematics.arm import Array
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.declared_tests import Touch

_ROUNDS = 3
"""Number of linearisations. Measured on two simulated cells: the mean after three differs from that after two by at
most 0.001 u.
"""
_LARGEST_GAP_MM = 50.0
"""Rms gap of nominal arms with a fitted set-up above which the table is refused. An error of 0.5° of each joint
gives 20 mm for an arm with a reach of one metre.
"""
_OUTLIER_CHI2 = 35.0
"""Chi-square of the three coordinates of a touch, given all others, above which it is an outlier: probability 1e-7."""
_MOST_OUTLIERS_SHARE = 0.1
"""Largest share of outliers."""


@dataclass(frozen=True)
class FittedPair:
    """Result of a fit.

    pair: the touches without outliers.
    gaps: the last linearisation.
    posterior: the last posterior.
    state: values of the unknowns at the posterior mean.
    odd: excluded rows of the table, each with its distance in mm.
    nominal_rms_mm: rms of a coordinate of the gap with nominal arms.
    """

    pair: Pair
    gaps: LinearGaps
    posterior: PairPosterior
    state: PairState
    odd: tuple[tuple[int, float], ...]
    nominal_rms_mm: float


_NOMINAL_MM = 0.01
"""Residual of nominal arms below which the joints were computed. Chosen: a seated ball scatters by more, and the
rounding of a plan to 0.0001° causes 0.002 mm.
"""


def pair_of(first: Rig, second: Rig, table: PairTable, where: str) -> Pair:
    """Return the pair of two rigs with their touches. Raises FileError for a rail or an existing calibration."""
    for rig in (first, second):
        if rig.robot.rail is not None:
            raise FileError(
                rig.name,
                "is on a rail, which a pair does not support",
                "lock the rail and remove the key",
                code="pair.rail",
            )
        if rig.calibrated is not None:
            problem = "has a calibration already, which a pair would count twice"
            raise FileError(
                rig.name, problem, "give the rig file without the section calibration", code="pair.calibrated"
            )
    distances = [rig.tests.touch.distances for rig in (first, second) if rig.tests.touch]
    arms = PairArm(first, arm_terms(first)), PairArm(second, arm_terms(second))
    return Pair(*arms, table, tuple(distance for of_rig in distances for distance in of_rig), where)


def fit_pair(pair: Pair) -> FittedPair:
    """Fit two arms to their touches.

    Raises FileError for planned joints, if no set-up explains the touches, or if there are too many outliers.
    """
    state, nominal_rms = start(pair)
    if nominal_rms < _NOMINAL_MM:
        problem = f"fits the nominal arms to {nominal_rms:.3f} mm, which no real arms do: these are planned joints"
        raise FileError(
            pair.where,
            problem,
            "make the touches, and write the joints that both controllers show",
            code="pair.planned_joints",
        )
    odd: list[tuple[int, float]] = []
    allowed = int(_MOST_OUTLIERS_SHARE * len(pair.table.q))
    levels = None
    while True:
        for _ in range(_ROUNDS):
            gaps = linearise(pair, state)
            levels = fitted_levels(gaps, None if levels is None else levels.log)
            at_levels = posterior(gaps, levels)
            state = _at_mean(gaps, at_levels)
        worst = int(np.argmax(at_levels.odd))
        if at_levels.odd[worst] < _OUTLIER_CHI2:
            return FittedPair(pair, gaps, at_levels, state, tuple(odd), nominal_rms)
        odd.append((int(pair.table.row[worst]), float(np.linalg.norm(at_levels.left_mm[3 * worst : 3 * worst + 3]))))
        if len(odd) > allowed:
            rows = ", ".join(str(row) for row, _ in odd[:5])
            problem = (
                f"more than {allowed} of {len(pair.table.q) + len(odd) - 1} touches do not fit the others ({rows} …)"
            )
            raise FileError(
                pair.where,
                problem,
                "check that the ball was seated and the joints of both arms were read",
                code="pair.outliers",
            )
        keep = np.arange(len(pair.table.q)) != worst
        pair, levels = pair.rows(keep), None
        _check_enough(pair)


def _check_enough(pair: Pair) -> None:
    if len(pair.table.q) < FEWEST or set(pair.names) > set(pair.table.socket.tolist()):
        raise FileError(
            pair.where,
            "has too few touches after the removal of outliers",
            "touch in more postures",
            code="pair.few_touches",
        )


def _at_mean(gaps: LinearGaps, at_levels: PairPosterior) -> PairState:
    """Return the state at a posterior mean. Its terms are absolute, and the set-up is relative to the linearisation."""
    terms = int((gaps.group >= 0).sum())
    step = at_levels.mean.copy()
    step[:terms] -= np.concatenate(gaps.state.times)
    return gaps.state.moved(step, gaps.centre_mm)


def ball_of(rig: Rig) -> Array:
    """Return the approximate position (3,) mm of the ball or socket in the tool frame of a rig file."""
    default = Touch.model_fields["ball_mm"].default
    return np.array(rig.tests.touch.ball_mm if rig.tests.touch else default, dtype=float)


def start(pair: Pair) -> tuple[PairState, float]:
    """Return the set-up that fits nominal arms best, and the rms gap per coordinate in mm.

    Raises FileError if the gap is too large for rows of these arms.
    """
    zeros = (np.zeros(len(pair.first.terms)), np.zeros(len(pair.second.terms)))
    T_first, T_second = pair.first.poses(pair.table.q, zeros[0]), pair.second.poses(pair.q_second, zeros[1])
    ball, mounted = ball_of(pair.first.rig), pair.table.is_mounted
    places = tool_points(T_first, ball)
    X = np.eye(4)
    if mounted.any():
        X = _aligned(tool_points(T_second, ball_of(pair.second.rig))[mounted], places[mounted])
    sockets = {
        name: ball_of(pair.second.rig) if mounted[rows].all() else places[rows].mean(axis=0)
        for name in pair.names
        for rows in [pair.table.socket == name]
    }
    begun = PairState(zeros, X, ball, sockets)
    terms, centre = sum(map(len, zeros)), places.mean(axis=0)

    def gap(step: Array) -> Array:
        state = begun.moved(np.concatenate([np.zeros(terms), step]), centre)
        at = np.stack([state.sockets_mm[name] for name in pair.names])[pair.socket]
        carried = tool_points(T_second, at) @ state.T_first_second[:3, :3].T + state.T_first_second[:3, 3]
        socket = np.where(mounted[:, None], carried, at)
        return np.asarray((socket - tool_points(T_first, state.ball_mm)).ravel())

    scale = np.full(pair.unknowns - terms, 100.0)
    scale[3:6] = 0.1
    solution = least_squares(gap, np.zeros_like(scale), x_scale=scale, method="trf", loss="soft_l1", f_scale=5.0)
    rms = float(np.sqrt(np.median(gap(solution.x).reshape(-1, 3) ** 2, axis=0).mean() / _MEDIAN_OF_SQUARE))
    if rms > _LARGEST_GAP_MM:
        problem = f"ball and socket are {rms:.0f} mm apart, whatever the place of the second base"
        remedy = "check the order of the two rig files, the units, and that each row has the joints of one touch"
        raise FileError(pair.where, problem, remedy, code="pair.other_touches")
    return begun.moved(np.concatenate([np.zeros(terms), solution.x]), centre), rms


_MEDIAN_OF_SQUARE = 0.455
"""Median of the square of a standard normal variable; it makes the rms insensitive to outliers."""


def _aligned(points: Array, targets: Array) -> Array:
    """Return the motion (4, 4) that brings points (n, 3) nearest to targets (n, 3)."""
    centre, target = points.mean(axis=0), targets.mean(axis=0)
    R = Rotation.align_vectors(targets - target, points - centre)[0].as_matrix()
    return frame(R, target - R @ centre)
