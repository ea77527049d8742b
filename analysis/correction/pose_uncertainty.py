"""How well the tool's pose is known: what a correction needs of any model's own uncertainty.

A correction asks for two things: the covariance of the tool's place at joint angles, and the joint angles at which the
model was tested. Entries at a controller need a third: how the uncertainty at one posture goes with that at another.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, runtime_checkable

import numpy as np

from analysis.correction.calibrated_uncertainty import CalibratedUncertainty, named_in
from analysis.correction.support import Support
from analysis.correction.taught_frame import TaughtFrame
from analysis.correction.work import tool_poses, used_effects
from analysis.inference.observation import BEYOND_DEG
from analysis.kinematics.arm import Array, Mask, pose_error
from analysis.measures.parameters import parameter_label
from analysis.model.predict import model_of
from rigs.rig import Rig
from rigs.schema.effect import label_of

_TAUGHT = 200
"""Postures at most by which a frame is taught. Chosen: six numbers do not become surer by more of them."""
_ROWS = 128
"""Postures of which the displacements are computed at a time: 1500 terms at each take 10 MB."""


class PoseUncertainty(Protocol):
    """What a model knows of its own uncertainty."""

    def position_covariance_mm2(self, q: Array) -> Array:
        """Return the covariance (n, 3, 3) mm² of the tool's place in the world at joint angles q (n, 6) rad."""

    @property
    def joints_rad(self) -> Array | None:
        """The lowest and highest angle of each joint (6, 2) rad in the runs behind the model, None where unknown."""

    @property
    def unexplained_mm(self) -> float:
        """What the model does not explain of the tool's place where it was judged, root mean square, beside what its
        covariance knows; 0 where nothing judged it."""


@runtime_checkable
class JointPoseUncertainty(PoseUncertainty, Protocol):
    """The same with what postures have in common."""

    def pose_displacements(self, q: Array) -> Array:
        """Return independent displacements (k, n, 6) of the tool, mm and rad, each one standard uncertainty, at joint
        angles q (n, 6) rad: the sum of their squares is the covariance."""


@dataclass(frozen=True)
class EffectsUncertainty:
    """The uncertainty of a rig from that of the effects in its rig file, with their correlations."""

    rig: Rig
    supported: tuple[Support, ...]

    def pose_displacements(self, q: Array) -> Array:
        """Return displacements (k, n, 6) mm and rad at joint angles q (n, 6) rad, made independent."""
        model = model_of(self.rig, used_effects(self.rig, self.supported))
        base = tool_poses(model, q)
        names, moves = [], []
        for k, effect in enumerate(model.effects):
            varied: Any = effect
            if effect.found is None:
                continue
            for field, sd in effect.found.sd.items():
                effects = list(model.effects)
                effects[k] = varied.model_copy(update={field: getattr(effect, field) + sd})
                moves.append(pose_error(base, tool_poses(replace(model, effects=tuple(effects)), q)))
                names.append((parameter_label(effect, field), effect.found.correlation))
        if not moves:
            return np.zeros((0, len(q), 6))
        correlations = np.eye(len(names))
        for j, (_, correlation) in enumerate(names):
            for k, (earlier, _) in enumerate(names[:j]):
                correlations[j, k] = correlations[k, j] = correlation.get(earlier, 0.0)
        values, vectors = np.linalg.eigh(correlations)
        # Rounded correlations may make a combination a little less certain than nothing.
        independent: Array = np.tensordot((vectors * np.sqrt(np.maximum(values, 0.0))).T, np.array(moves), axes=1)
        return independent

    def position_covariance_mm2(self, q: Array) -> Array:
        """Return the covariance (n, 3, 3) mm² of the tool's place at joint angles q (n, 6) rad."""
        places = self.pose_displacements(q)[:, :, :3]
        covariance: Array = np.einsum("kni,knj->nij", places, places)
        return covariance

    @property
    def unexplained_mm(self) -> float:
        """None: nothing judged the effects together."""
        return 0.0

    @property
    def joints_rad(self) -> Array | None:
        """The joint angles (6, 2) rad that the runs of all effects have in common, None where no effect has any."""
        effects = used_effects(self.rig, self.supported)
        ranges_deg = [effect.found.joints_deg for effect in effects if effect.found and effect.found.joints_deg]
        if not ranges_deg:
            return None
        ranges = np.radians(np.array(ranges_deg))
        common: Array = np.stack([ranges[:, :, 0].max(axis=0), ranges[:, :, 1].min(axis=0)], axis=1)
        return common


def pose_uncertainty(rig: Rig, supported: Sequence[Support]) -> PoseUncertainty:
    """Return what is known of the uncertainty of a rig's model: that of its calibration, and of the effects of its file
    that the calibration does not hold."""
    if rig.calibrated is None:
        return EffectsUncertainty(rig, tuple(supported))
    held_labels = {label_of(effect) for effect in named_in(rig.calibrated)}
    others = tuple(support for support in supported if label_of(support.effect) not in held_labels)
    return _Both(CalibratedUncertainty(rig, rig.calibrated), EffectsUncertainty(rig, others))


@dataclass(frozen=True)
class _Both:
    """The uncertainty of a calibrated model and, independent of it, of other effects."""

    calibrated: CalibratedUncertainty
    others: EffectsUncertainty

    def pose_displacements(self, q: Array) -> Array:
        """Return displacements (k, n, 6) mm and rad at joint angles q (n, 6) rad, made independent."""
        return np.concatenate([part.pose_displacements(q) for part in (self.calibrated, self.others)])

    def position_covariance_mm2(self, q: Array) -> Array:
        """Return the covariance (n, 3, 3) mm² of the tool's place at joint angles q (n, 6) rad."""
        covariance: Array = self.calibrated.position_covariance_mm2(q) + self.others.position_covariance_mm2(q)
        return covariance

    @property
    def joints_rad(self) -> Array | None:
        """The joint angles (6, 2) rad of the runs behind the calibration."""
        return self.calibrated.joints_rad

    @property
    def unexplained_mm(self) -> float:
        """What the calibrated model does not explain."""
        return self.calibrated.unexplained_mm


def position_u_mm(uncertainty: PoseUncertainty, q: Array) -> Array:
    """Return the standard uncertainty (n,) mm of the tool's place at joint angles q (n, 6) rad: the root of the trace
    of its covariance, and what the model does not explain."""
    variance = np.trace(uncertainty.position_covariance_mm2(q), axis1=1, axis2=2)
    u_mm: Array = np.sqrt(variance + uncertainty.unexplained_mm**2)
    return u_mm


def frame_u_mm(rig: Rig, uncertainty: PoseUncertainty, q: Array, taught: Array) -> Array:
    """Return the standard uncertainty (n,) mm of the tool's place at joint angles q (n, 6) rad with frame and tool
    taught with the robot at joint angles `taught` (m, 6) rad, with what the model does not explain. A model that
    states no more than the covariance of each place does not say what places have in common, so that nothing of it is
    left out."""
    if not isinstance(uncertainty, JointPoseUncertainty):
        return position_u_mm(uncertainty, q)
    taught = taught[:: -(-len(taught) // _TAUGHT)]
    frame = TaughtFrame(tool_poses(model_of(rig, ()), taught))
    motions = frame.motions(uncertainty.pose_displacements(taught)[:, :, :3])
    squares = np.zeros(len(q))
    for begin in range(0, len(q), _ROWS):
        rows = slice(begin, begin + _ROWS)
        rest_of_moves = frame.rest(
            uncertainty.pose_displacements(q[rows])[:, :, :3], tool_poses(model_of(rig, ()), q[rows]), motions
        )
        squares[rows] = (rest_of_moves**2).sum(axis=(0, 2))
    u_mm: Array = np.sqrt(squares + uncertainty.unexplained_mm**2)
    return u_mm


def displacements(uncertainty: PoseUncertainty, q: Array) -> Array:
    """Return displacements (k, n, 6) mm and rad of one standard uncertainty each at joint angles q (n, 6) rad. A model
    that states no more than the covariance of each place is taken to err alike at all of them, the worst case for what
    is constant, and to know how the tool is turned."""
    if isinstance(uncertainty, JointPoseUncertainty):
        return uncertainty.pose_displacements(q)
    values, vectors = np.linalg.eigh(uncertainty.position_covariance_mm2(q))
    root = np.einsum("nik,nk,njk->inj", vectors, np.sqrt(np.maximum(values, 0.0)), vectors)
    return np.concatenate([root, np.zeros_like(root)], axis=2)


def covered(uncertainty: PoseUncertainty, q: Array) -> Mask | None:
    """Return whether all joints stand where the runs drove them (n,), within a small margin, at joint angles q (n, 6)
    rad; None where the runs' angles are unknown."""
    joints = uncertainty.joints_rad
    if joints is None:
        return None
    margin, known_of = np.radians(BEYOND_DEG), q[:, : len(joints)]
    inside: Mask = ((known_of >= joints[:, 0] - margin) & (known_of <= joints[:, 1] + margin)).all(axis=1)
    return inside
