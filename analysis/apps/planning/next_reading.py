"""The next reading of a tracker: the posture at which a reading reduces the uncertainty of a figure most.

A reading is linear in the unknowns of the calibrated model, and its influence on the posterior is that of a Kalman
update. A figure of targets, such as a distance, is linearised at draws of their errors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from analysis.apps.planning.pose_plan import Pool, pool_of
from analysis.apps.planning.pose_pool import Sight, drawn_poses
from analysis.correction.corrected_targets import corrected
from analysis.correction.pose_uncertainty import PoseUncertainty, few_taught, pose_uncertainty
from analysis.correction.support import supports, why_nothing
from analysis.correction.work import TaughtFrame, work_or_spread
from analysis.robot.kinematics.arm import Array, arm_of, forward
from rigs.errors import FileError, RigPlace
from rigs.rig import Rig

_CANDIDATES, _SEED = 150, 0
_LINEARISED, _STEP_MM = 30, 1e-3
"""Number of draws at which a figure is linearised, and step of the slopes."""
MANY, _GAIN_OF_MANY = 20, 0.1
"""Number of further readings that are weighed, and the gain that is worth their time, relative to the error without a
correction. Chosen: a reading takes a minute or two, so half an hour must remove a tenth of that error."""
_WORTHWHILE = 0.02
"""Smallest relative reduction of u by a reading that is proposed. Chosen: a tenth needs about five readings."""

_MOST_TARGETS = 60
"""Number of targets that are weighed. Chosen: their mean hardly changes with more."""


@dataclass(frozen=True)
class NextReading:
    """A posture (axes,) rad to measure, and the standard uncertainty in mm of the figure before and after; None outside
    the measured region."""

    q: Array
    u_mm: float | None = None
    after_mm: float | None = None

    def to_dict(self) -> dict[str, Any]:
        return {"q_deg": np.degrees(self.q).round(3).tolist(), "u_mm": self.u_mm, "u_after_mm": self.after_mm}


@dataclass(frozen=True)
class Reading:
    """Candidate postures q (c, axes) rad with independent displacements of the tool (k, c, 3) mm in a taught frame, and
    the standard deviation of a coordinate of a reading in mm."""

    uncertainty: PoseUncertainty
    frame: TaughtFrame
    motions: Array
    q: Array
    moves: Array
    sd_mm: float

    @classmethod
    def of(cls, rig: Rig, taught: tuple[Array, Array]) -> Reading:
        """Draw candidates of a calibrated rig. taught: postures and poses at which frame and tool are taught."""
        uncertainty, arm = pose_uncertainty(rig, supports(rig)), arm_of(rig.robot)
        few = few_taught(len(taught[0]))
        frame = TaughtFrame(taught[1][few])
        motions = frame.motions(uncertainty.pose_displacements(taught[0][few])[:, :, :3])
        q = np.zeros((0, taught[0].shape[1]))
        if rig.robot.rail is None:
            q = drawn_poses(arm, _CANDIDATES, None, np.random.default_rng(_SEED))
        judged = rig.calibrated.judged if rig.calibrated else None
        sd_mm = float(np.hypot(judged.noise_um, judged.unexplained_um)) / 1e3 if judged else 0.0
        moves = _moves(uncertainty, frame, motions, q, forward(arm, q))
        return cls(uncertainty, frame, motions, q, moves, max(sd_mm, 1e-3))

    def moves_at(self, q: Array, poses: Array) -> Array:
        """Independent displacements (k, n, 3) mm at other postures q (n, axes) rad, in the same frame."""
        return _moves(self.uncertainty, self.frame, self.motions, q, poses)


def _moves(uncertainty: PoseUncertainty, frame: TaughtFrame, motions: Array, q: Array, poses: Array) -> Array:
    return frame.remove_motions(uncertainty.pose_displacements(q)[:, :, :3], poses, motions)


def next_reading(
    reading: Reading, q: Array, poses: Array, figure: Callable[[Array], Array], errors: Array
) -> NextReading | None:
    """Return the reading that reduces the variance of a figure most, None if none is worthwhile.

    q (m, axes) rad, poses (m, 4, 4): targets of the figure. figure: value (k,) mm for displaced positions (k, m, 3) mm.
    errors (k, m, 3): draws of the target errors.
    """
    slopes = _slopes(figure, poses[:, :3, 3], errors[:_LINEARISED])
    moves = reading.moves_at(q, poses)
    postures, candidates = np.vstack([q, reading.q]), np.concatenate([moves, reading.moves], axis=1)
    of_figure = slopes @ moves.reshape(len(moves), -1).T  # (draws, k)
    across = np.einsum("dk,kci->cdi", of_figure, candidates)
    seen = np.einsum("kci,kcj->cij", candidates, candidates) + reading.sd_mm**2 * np.eye(3)
    gains = np.einsum("cdi,cid->c", across, np.linalg.solve(seen, across.transpose(0, 2, 1))) / len(slopes)
    best, flat = int(np.argmax(gains)), (errors - errors.mean(axis=0)).reshape(len(errors), -1)
    remaining = 1 - gains[best] / float(((flat @ slopes.T) ** 2).mean())
    u_mm, after_mm = (
        float(figure(poses[:, :3, 3] + errors).std() * np.sqrt(share)) for share in (1.0, max(remaining, 0.0))
    )
    return NextReading(postures[best], u_mm, after_mm) if after_mm < (1 - _WORTHWHILE) * u_mm else None


def _slopes(figure: Callable[[Array], Array], places: Array, errors: Array) -> Array:
    """Derivatives (d, 3 m) of a figure by the displaced positions, at draws (d, m, 3) mm of the errors."""
    steps = _STEP_MM * np.eye(errors[0].size).reshape(-1, *errors.shape[1:])
    return np.array(
        [(figure(places + error + steps) - figure(places + error - steps)) / (2 * _STEP_MM) for error in errors]
    )


@dataclass(frozen=True)
class NextStep:
    """Decision at targets, errors in mm rms.

    act: `measure` if the next readings are worth their time, otherwise `correct`, `repair` if most of the error then
    stays (backlash and other errors that no target corrects), or `nothing`. q (axes,): next posture in rad.
    now_mm, corrected_mm: error now (None if not measured) and after a correction. next_mm, many_mm: the latter after
    one and MANY further readings. of_family: share of the mean square error that the readings leave
    unknown, for which the correction rests on the typical sizes of the family.
    """

    act: Literal["measure", "correct", "repair", "nothing"]
    q: Array
    now_mm: float | None
    corrected_mm: float
    next_mm: float
    many_mm: float
    of_family: float

    def to_dict(self) -> dict[str, Any]:
        names = ("act", "now_mm", "corrected_mm", "next_mm", "many_mm", "of_family")
        return {"q_deg": np.degrees(self.q).round(3).tolist()} | {name: getattr(self, name) for name in names}


def next_step(rig: Rig, targets: tuple[Array, Array] | None, sight: Sight | None = None) -> NextStep:
    """Decide between measuring, correcting, repairing and doing nothing, with the next reading of a tracker.

    targets: postures (n, axes) rad and poses (n, 4, 4), by default the work area.

    Raises FileError for an arm on a rail, and for a calibration by touches, whose next reading must be at a socket.
    """
    if rig.robot.rail or (rig.calibrated is not None and rig.calibrated.reach_mm is not None):
        problem = "has a rail" if rig.robot.rail else "was calibrated by touches"
        remedy = "measure poses with a tracker at a fixed base, or touch sockets in other postures: rig record touch"
        problem += ", but readings are proposed for a tracker"
        raise FileError(RigPlace.of(rig.name), problem, remedy, code="plan.next")
    arm, supported = arm_of(rig.robot), supports(rig)
    is_known = rig.calibrated is not None and not why_nothing(rig)
    joints = pose_uncertainty(rig, supported).joints_rad if is_known else None
    q = work_or_spread(rig, joints) if targets is None else targets[0]
    few = few_taught(len(q))[:_MOST_TARGETS]
    q, wanted = q[few], None if targets is None else targets[1][few]
    candidates = drawn_poses(arm, _CANDIDATES, sight, np.random.default_rng(_SEED))
    possible, of_targets = np.arange(len(candidates)), len(candidates) + np.arange(len(q))
    both = np.vstack([candidates, q])
    stays_mm, now_mm = 0.0, None
    if not is_known:
        pool = pool_of(rig.model_copy(update={"effects": ()}).with_calibration(None, None), both)
    else:
        taught = work_or_spread(rig, joints)
        reading = Reading.of(rig, (taught, forward(arm, taught)))
        flat = reading.moves_at(both, forward(arm, both)).reshape(-1, 3 * len(both)) / reading.sd_mm
        pool = Pool(both, flat.T @ flat, np.full(3 * len(both), reading.sd_mm))
        error = corrected(rig, supported, q, (), wanted).error
        if error is not None:
            now_mm = error.before_um / 1e3
            stays_mm = float(np.sqrt(max(error.after_um**2 - error.u_um**2, 0.0))) / 1e3
    chosen = pool.choose(MANY, of_targets, possible)
    u_mm, next_mm, many_mm = (
        float(np.hypot(stays_mm, pool.u_mm(chosen[:count], of_targets))) for count in (0, 1, MANY)
    )
    act: Literal["measure", "correct", "repair", "nothing"] = "correct"
    if now_mm is None or u_mm - many_mm > _GAIN_OF_MANY * now_mm:
        act = "measure"
    elif u_mm > (1 - _GAIN_OF_MANY) * now_mm:
        act = "repair" if stays_mm > u_mm / 2 else "nothing"
    of_family = 1.0 if now_mm is None else min(1.0, (pool.u_mm(chosen[:0], of_targets) / now_mm) ** 2)
    return NextStep(act, candidates[chosen[0]], now_mm, u_mm, next_mm, many_mm, of_family)
