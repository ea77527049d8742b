"""Fit two arms to their touches: without a prior, then linearised at the posterior, without outliers."""

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
"""Linearisations: the mean after three differs from that after two by at most 0.001 u."""
_LARGEST_GAP_MM = 50.0
"""Above this rms gap of nominal arms the table is refused: 0.5° of each joint give 20 mm at a metre."""
_OUTLIER_CHI2 = 35.0
"""Chi-square of the three coordinates of a touch: probability 1e-7."""
_MOST_OUTLIERS_SHARE = 0.1


@dataclass(frozen=True)
class FittedPair:
    """Result of a fit."""

    pair: Pair
    gaps: LinearGaps
    posterior: PairPosterior
    state: PairState
    odd: tuple[tuple[int, float], ...]
    """Excluded rows with their distances in mm."""
    nominal_rms_mm: float
    """Rms of a coordinate of the gap with nominal arms."""


_NOMINAL_MM = 0.01
"""Residual of nominal arms below which the joints were computed: a seated ball scatters by more."""


def pair_of(first: Rig, second: Rig, table: PairTable, where: str) -> Pair:
    """Refuses a rail and an existing calibration."""
    for rig in (first, second):
        if rig.robot.rail is not None:
            raise FileError(
                rig.name,
                "is on a rail, which a pair does not support",
                "lock the rail and remove the key",
                code="arm.invalid",
            )
        if rig.calibrated is not None:
            problem = "has a calibration already, which a pair would count twice"
            raise FileError(rig.name, problem, "give the rig file without the section calibration", code="pair.invalid")
    distances = [rig.tests.touch.distances for rig in (first, second) if rig.tests.touch]
    arms = PairArm(first, arm_terms(first)), PairArm(second, arm_terms(second))
    return Pair(*arms, table, tuple(distance for of_rig in distances for distance in of_rig), where)


def fit_pair(pair: Pair) -> FittedPair:
    """Refuses planned joints, touches that no set-up explains, and too many outliers."""
    state, nominal_rms = start(pair)
    if nominal_rms < _NOMINAL_MM:
        problem = f"fits the nominal arms to {nominal_rms:.3f} mm, which no real arms do: these are planned joints"
        raise FileError(
            pair.where,
            problem,
            "make the touches, and write the joints that both controllers show",
            code="pair.invalid",
        )
    odd: list[tuple[int, float]] = []
    allowed = int(_MOST_OUTLIERS_SHARE * len(pair.table.q))
    levels = None
    while True:
        for _ in range(_ROUNDS):
            gaps = linearise(pair, state)
            levels = fitted_levels(gaps, None if levels is None else levels.logs)
            at_levels = posterior(gaps, levels)
            step = at_levels.mean.copy()  # its terms are absolute, and the set-up is relative to the linearisation
            step[gaps.group >= 0] -= np.concatenate(gaps.state.times)
            state = gaps.state.moved(step, gaps.centre_mm)
        worst = int(np.argmax(at_levels.odd))
        if at_levels.odd[worst] < _OUTLIER_CHI2:
            return FittedPair(pair, gaps, at_levels, state, tuple(odd), nominal_rms)
        odd.append((int(pair.table.row[worst]), float(np.linalg.norm(at_levels.left_mm[3 * worst : 3 * worst + 3]))))
        if len(odd) > allowed:
            rows = ", ".join(str(row) for row, _ in odd[:5])
            problem = (
                f"more than {allowed} of {len(pair.table.q) + len(odd) - 1} touches do not fit the others ({rows} …)"
            )
            remedy = "check that the ball was seated and the joints of both arms were read"
            raise FileError(pair.where, problem, remedy, code="pair.invalid")
        pair, levels = pair.rows(np.arange(len(pair.table.q)) != worst), None
        if len(pair.table.q) < FEWEST or set(pair.names) > set(pair.table.socket.tolist()):
            problem = "has too few touches after the removal of outliers"
            raise FileError(pair.where, problem, "touch in more postures", code="readings.too_few")


def ball_of(rig: Rig) -> Array:
    """Approximate position (3,) of the ball or socket in the tool frame of a rig file."""
    default = Touch.model_fields["ball_mm"].default
    return np.array(rig.tests.touch.ball_mm if rig.tests.touch else default, dtype=float)


def start(pair: Pair) -> tuple[PairState, float]:
    """Set-up that fits nominal arms best, and the rms gap per coordinate in mm."""
    zeros = (np.zeros(len(pair.first.terms)), np.zeros(len(pair.second.terms)))
    T_first, T_second = pair.poses(zeros)
    ball, mounted = ball_of(pair.first.rig), pair.table.is_mounted
    places = tool_points(T_first, ball)
    X = np.eye(4)
    if mounted.any():
        points, targets = tool_points(T_second, ball_of(pair.second.rig))[mounted], places[mounted]
        centre, target = points.mean(axis=0), targets.mean(axis=0)
        R = Rotation.align_vectors(targets - target, points - centre)[0].as_matrix()
        X = frame(R, target - R @ centre)
    sockets = {
        name: ball_of(pair.second.rig) if mounted[rows].all() else places[rows].mean(axis=0)
        for name in pair.names
        for rows in [pair.table.socket == name]
    }
    begun = PairState(zeros, X, ball, sockets)
    terms, centre = sum(map(len, zeros)), places.mean(axis=0)

    def gap(step: Array) -> Array:
        return pair.between(T_first, T_second, begun.moved(np.concatenate([np.zeros(terms), step]), centre)).ravel()

    scale = np.full(pair.unknowns - terms, 100.0)
    scale[3:6] = 0.1
    solution = least_squares(gap, np.zeros_like(scale), x_scale=scale, method="trf", loss="soft_l1", f_scale=5.0)
    rms = float(np.sqrt(np.median(gap(solution.x).reshape(-1, 3) ** 2, axis=0).mean() / _MEDIAN_OF_SQUARE))
    if rms > _LARGEST_GAP_MM:
        problem = f"ball and socket are {rms:.0f} mm apart, whatever the place of the second base"
        remedy = "check the order of the two rig files, the units, and that each row has the joints of one touch"
        raise FileError(pair.where, problem, remedy, code="pair.invalid")
    return begun.moved(np.concatenate([np.zeros(terms), solution.x]), centre), rms


_MEDIAN_OF_SQUARE = 0.455
"""Median of the square of a standard normal variable."""
