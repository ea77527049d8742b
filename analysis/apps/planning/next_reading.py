"""The next reading of a tracker: the posture at which a reading reduces the uncertainty of a figure most.

A reading is linear in the unknowns of the calibrated model, and its influence on the posterior is that of a Kalman
update. A figure of targets, such as a distance, is linearised at draws of their errors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.apps.planning.pose_pool import drawn_poses
from analysis.correction.pose_uncertainty import PoseUncertainty, few_taught, pose_uncertainty
from analysis.correction.support import supports
from analysis.correction.work import TaughtFrame
from analysis.robot.kinematics.arm import Array, arm_of, forward
from rigs.rig import Rig

_CANDIDATES, _SEED = 150, 0
_LINEARISED, _STEP_MM = 30, 1e-3
"""Number of draws at which a figure is linearised, and step of the slopes."""
_WORTHWHILE = 0.02
"""Smallest relative reduction of u by a reading that is proposed. Chosen: a tenth needs about five readings."""


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
