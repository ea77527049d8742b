"""Uncertainty of the tool pose for corrections from any model, known only in the range covered by its runs.

A term of a model turns a joint, changes a constant or moves the tool. Derivatives with respect to joint angles are
computed only once, because most of a thousand terms turn a joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import numpy as np

from analysis.correction.support import Support
from analysis.correction.work import TaughtFrame, at_rest, tool_poses, used_effects
from analysis.diagnosis.evidence.observation import BEYOND_DEG
from analysis.procedures.shared.quantity import parameter_label
from analysis.robot.kinematics.arm import RAIL_MM, Array, Integers, Mask, pose_error
from analysis.robot.kinematics.joint_limits import turned_into
from analysis.robot.predict import Model, apply, driven, model_of, moved, posed
from rigs.calibration import TIMES, CalibratedModel, CovarianceParameter, verdict_of
from rigs.effects import Effect, turned
from rigs.rig import Rig
from rigs.schema.effect import healthy_size, label_of, size_field

_MARGIN_RAD = float(np.radians(BEYOND_DEG))
_STEP_DEG = 1e-3
"""Step of the derivatives by a joint angle: the tool of a one-metre arm moves by 17 µm."""
_SMALL = 1e-3
"""Variation of a parameter: share of a healthy size, or of a shape."""
_ROWS = 128
"""Number of postures per block: 1500 terms need 10 MB at this size."""


@dataclass(frozen=True)
class PoseUncertainty:
    """Uncertainty of the tool pose of a rig: from the covariance of its calibration, if any, and independently from
    other effects of the rig file.
    """

    rig: Rig
    calibrated: CalibratedModel | None = None
    supported: tuple[Support, ...] = ()
    """Effects of the rig file outside the calibration."""

    @cached_property
    def _parameters(self) -> list[tuple[int, CovarianceParameter, Effect]]:
        """Row, parameter and effect of the posture-dependent terms of the calibration, which move the tool."""
        if self.calibrated is None:
            return []
        terms = self.calibrated.terms
        rows = [(k, parameter, terms[parameter.term].effect) for k, parameter in enumerate(self.calibrated.parameters)]
        return [row for row in rows if row[2].compensation().use != "none"]

    @property
    def factor(self) -> Array:
        """Square root (p, P) of the parameter covariance, for the columns that `pose_derivatives` gives."""
        if self.calibrated is None:
            return np.empty((0, 0))
        return self.calibrated.root[[row for row, _, _ in self._parameters]]

    @cached_property
    def _root(self) -> Array:
        values, vectors = np.linalg.eigh(self.factor @ self.factor.T)
        root: Array = vectors * np.sqrt(np.maximum(values, 0.0))
        return root

    def pose_displacements(self, q: Array) -> Array:
        """Independent tool displacements (k, n, 6), mm and rad, of one standard uncertainty each, at joint angles q (n,
        6) rad: their sum of squares is the covariance.
        """
        others = self.displacements_by_effects(q)
        if self.calibrated is None:
            return others
        moves: Array = np.tensordot(self._root.T, self.pose_derivatives(model_of(self.rig), q), axes=1)
        return np.concatenate([moves, others])

    def pose_derivatives(self, model: Model, q: Array) -> Array:
        """Derivatives (p, n, 6) of the tool pose, mm and rad, by the parameters of posture-dependent terms about a
        model.
        """
        path = at_rest(q)
        joints = driven(model, path)
        base = posed(model, path, joints).T
        by_joint = np.stack([
            pose_error(base, posed(model, path, apply([turned(axis, _STEP_DEG)], "joint", joints)).T)
            for axis in range(1, model.arm.axes + 1)
        ]) / np.radians(_STEP_DEG)  # fmt: skip
        scene = driven(replace(model, effects=()), path)

        @cache
        def change(effect: Effect) -> Array:
            """Influence of an effect on the tool (n, 6), mm and rad."""
            if effect.STAGE == "joint":
                turns = apply([effect], "joint", scene).link_q - scene.link_q
                by_turns: Array = np.einsum("na,ani->ni", turns[:, : len(by_joint)], by_joint)
                return by_turns
            changed = _with(model, effect)
            at_joints = joints if effect.STAGE == "tool" else driven(changed, path)
            return pose_error(base, posed(changed, path, at_joints).T)

        derivatives = np.zeros((len(self._parameters), len(q), 6))
        for derivative, (_, parameter, effect) in zip(derivatives, self._parameters, strict=True):
            if parameter.field == TIMES:
                derivative[:] = change(effect)
                continue
            step = _SMALL * healthy_size(effect) if parameter.field == size_field(effect) else _SMALL
            stepped = effect.model_copy(update={parameter.field: getattr(effect, parameter.field) + step})
            derivative[:] = (change(stepped) - change(effect)) / step
        return derivatives

    def displacements_by_effects(self, q: Array) -> Array:
        """The part of `pose_displacements` by effects of the rig file, with their correlations."""
        model = model_of(self.rig, used_effects(self.rig, self.supported))
        path = at_rest(q)
        base = moved(model, path).T
        names, moves, supported = [], [], {id(support.effect) for support in self.supported}
        for k, effect in enumerate(model.effects):
            varied: Any = effect
            if effect.found is None or id(effect) not in supported:
                continue
            for field, sd in effect.found.sd.items():
                effects = list(model.effects)
                effects[k] = varied.model_copy(update={field: getattr(effect, field) + sd})
                moves.append(pose_error(base, moved(replace(model, effects=tuple(effects)), path).T))
                names.append((parameter_label(effect, field), effect.found.correlation))
        if not moves:
            return np.zeros((0, len(q), 6))
        correlations = np.eye(len(names))
        for j, (_, correlation) in enumerate(names):
            for k, (earlier, _) in enumerate(names[:j]):
                correlations[j, k] = correlations[k, j] = correlation.get(earlier, 0.0)
        values, vectors = np.linalg.eigh(correlations)
        # Rounded correlations may give a slightly negative variance.
        return np.tensordot((vectors * np.sqrt(np.maximum(values, 0.0))).T, np.array(moves), axes=1)

    @property
    def unexplained_mm(self) -> float:
        """RMS position error beyond the covariance, from the validation in a diagnosis. It varies between places, so a
        taught frame cannot remove it.
        """
        judged = self.calibrated and self.calibrated.judged
        return np.sqrt(3.0) * judged.unexplained_um / 1e3 if judged else 0.0

    @property
    def joints_rad(self) -> Array | None:
        """Range of each joint (6, 2) rad in the runs of the calibration, followed by that of a rail in m; without a
        calibration, the range common to the runs of all effects. None if unknown.
        """
        if self.calibrated is not None:
            joints, rail = np.radians(np.array(self.calibrated.joints_deg)), self.calibrated.rail_mm
            return joints if rail is None else np.vstack([joints, np.array(rail) / RAIL_MM])
        effects = used_effects(self.rig, self.supported)
        ranges_deg = [effect.found.joints_deg for effect in effects if effect.found and effect.found.joints_deg]
        if not ranges_deg:
            return None
        ranges = np.radians(np.array(ranges_deg))
        return np.stack([ranges[:, :, 0].max(axis=0), ranges[:, :, 1].min(axis=0)], axis=1)

    def turned_into_runs(self, q: Array, slack_rad: float = _MARGIN_RAD) -> Array:
        """Joint angles q (n, axes) rad in the turns of the runs, followed by the rail position in m."""
        ranges, axes = self.joints_rad, len(self.rig.robot.axes)
        if ranges is None:
            return q
        return np.hstack([turned_into(q[:, :axes], ranges[:axes], slack_rad), q[:, axes:]])

    def is_within_reach(self, q: Array) -> Mask:
        """Mask (n,) of postures with the ball no further from touched sockets than validated.

        True for runs measured with an instrument, false for a model that must not be used for correction.
        """
        if self.calibrated is None:
            return np.ones(len(q), dtype=bool)
        reach_mm, judged = self.calibrated.reach_mm, verdict_of(self.calibrated) == "correct"
        if reach_mm is None or not judged:
            return np.full(len(q), judged)
        placed = list(self.calibrated.setups.values())
        sockets = -np.array([setup.T_instrument_world for setup in placed])[:, :3, 3]
        balls = (tool_poses(model_of(self.rig, ()), q) @ np.array(placed[0].T_tool_target))[:, :3, 3]
        return np.asarray(np.linalg.norm(balls[:, None] - sockets, axis=2).min(axis=1) <= reach_mm)


def _with(model: Model, effect: Effect) -> Model:
    return replace(model, effects=(*model.effects, effect))


_TAUGHT = 200
"""Limit of postures for teaching a frame. Chosen."""


def pose_uncertainty(rig: Rig, supported: Sequence[Support]) -> PoseUncertainty:
    terms = rig.calibrated.terms if rig.calibrated else ()
    held_labels = {label_of(term.effect) for term in terms if term.named}
    others = tuple(support for support in supported if label_of(support.effect) not in held_labels)
    return PoseUncertainty(rig, rig.calibrated, others)


def few_taught(count: int) -> Integers:
    """Indices (k,) of the postures that teach a frame, drawn randomly: at even steps, those of a grid could all have
    the same orientation.
    """
    return np.random.default_rng(0).permutation(count)[:_TAUGHT]


def places_u_mm(rig: Rig, uncertainty: PoseUncertainty, q: Array, taught: Array) -> tuple[Array, Array]:
    """Standard uncertainty (n,) mm of the tool position at joint angles q (n, 6) rad, in the robot's base and in a
    frame taught at angles `taught` (m, 6) rad. Both include the unexplained error.
    """
    taught = taught[few_taught(len(taught))]
    frame = TaughtFrame(tool_poses(model_of(rig, ()), taught))
    moves = uncertainty.pose_displacements(np.concatenate([taught, q[:_ROWS]]))[:, :, :3]
    motions, moves = frame.motions(moves[:, : len(taught)]), moves[:, len(taught) :]
    squares = np.zeros((2, len(q)))
    for begin in range(0, len(q), _ROWS):
        rows = slice(begin, begin + _ROWS)
        if begin:
            moves = uncertainty.pose_displacements(q[rows])[:, :, :3]
        stays = frame.remove_motions(moves, tool_poses(model_of(rig, ()), q[rows]), motions)
        squares[:, rows] = (moves**2).sum(axis=(0, 2)), (stays**2).sum(axis=(0, 2))
    in_base, in_frame = np.sqrt(squares + uncertainty.unexplained_mm**2)
    return in_base, in_frame


def frame_u_mm(rig: Rig, uncertainty: PoseUncertainty, q: Array, taught: Array) -> Array:
    return places_u_mm(rig, uncertainty, q, taught)[1]


def covered(uncertainty: PoseUncertainty, q: Array) -> Mask | None:
    """Mask (n,) of known uncertainties at joint angles q (n, 6) rad; None if the runs' angles are unknown.

    All joints must be within the range of the runs, with a small margin, and the tool within the validated distance.
    """
    joints = uncertainty.joints_rad
    if joints is None:
        return None
    known_of = uncertainty.turned_into_runs(q)[:, : len(joints)]
    low, high = joints[:, 0] - _MARGIN_RAD, joints[:, 1] + _MARGIN_RAD
    inside: Mask = np.asarray(((known_of >= low) & (known_of <= high)).all(axis=1))
    return inside & uncertainty.is_within_reach(q)


def why_unknown(rig: Rig, uncertainty: PoseUncertainty, q: Array) -> list[str]:
    """Reasons for unknown uncertainties at joint angles q (n, axes) rad; empty if known."""
    inside, joints = covered(uncertainty, q), uncertainty.joints_rad
    if inside is None or joints is None:
        return [""] * len(q)
    low, high = np.degrees(joints[: len(rig.robot.axes)]).T
    reasons = []
    turned = uncertainty.turned_into_runs(q)[:, : len(low)]
    for at_deg, is_inside in zip(np.degrees(turned), inside, strict=True):
        beyond = [
            f"{rig.robot.axis_words(k + 1)} at {at_deg[k]:z.1f}°, in the runs {low[k]:z.1f}° to {high[k]:z.1f}°"
            for k in np.flatnonzero((at_deg < low - BEYOND_DEG) | (at_deg > high + BEYOND_DEG)).tolist()
        ]
        reasons.append("" if is_inside else ", ".join(beyond) or "the model was not validated there")
    return reasons


def where_known(uncertainty: PoseUncertainty, q: Array, u_mm: Array) -> Array:
    """Standard uncertainties (n,) mm, NaN outside the range of the runs, where errors of real arms were two to four u
    (docs/evidence/world.md).
    """
    inside = covered(uncertainty, q)
    return u_mm if inside is None else np.where(inside, u_mm, np.nan)
