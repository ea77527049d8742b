"""The uncertainty of the tool's pose from that of a calibrated model.

A term turns a joint, changes a constant or moves the tool, and the pose changes by its derivative times what is not
known of the term. Derivatives by joints are taken once, because most of a thousand terms turn one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from analysis.correction.work import tool_poses
from analysis.kinematics.arm import RAIL_MM, Array, pose_error
from analysis.model.hysteresis import Motion
from analysis.model.predict import Model, Path, driven, model_of
from analysis.model.scene import apply
from rigs.calibration import TIMES, CalibratedModel
from rigs.effects import Effect, turned
from rigs.rig import Rig
from rigs.schema.effect import healthy_size, size_field

_STEP_DEG = 1e-3
"""Step of the derivatives by a joint angle: the tool of an arm of one metre moves by 17 µm, over which it is straight.
"""
_SMALL = 1e-3
"""Share of a healthy size, or part of a shape, by which a parameter is varied."""
_ROWS = 128
"""Postures of which the displacements are computed at a time: 1500 terms at each take 10 MB."""


@dataclass(frozen=True)
class CalibratedUncertainty:
    """The uncertainty of a rig from the covariance of its calibrated model."""

    rig: Rig
    calibrated: CalibratedModel

    @cached_property
    def _kept(self) -> list[int]:
        """The parameters of terms that move the tool by the posture alone."""
        terms = self.calibrated.terms
        return [
            k
            for k, parameter in enumerate(self.calibrated.parameters)
            if terms[parameter.term].effect.compensation().use != "none"
        ]

    @cached_property
    def _root(self) -> Array:
        """A root (p, r) of the covariance of the kept parameters."""
        rows = self.calibrated.root[self._kept]
        values, vectors = np.linalg.eigh(rows @ rows.T)
        root: Array = vectors * np.sqrt(np.maximum(values, 0.0))
        return root

    def pose_displacements(self, q: Array) -> Array:
        """Return independent displacements (k, n, 6) of the tool, mm and rad, each one standard uncertainty, at joint
        angles q (n, 6) rad."""
        moves: Array = np.tensordot(self._root.T, self._derivatives(q), axes=1)
        return moves

    def position_covariance_mm2(self, q: Array) -> Array:
        """Return the covariance (n, 3, 3) mm² of the tool's place in the world at joint angles q (n, 6) rad."""
        parts = []
        for begin in range(0, len(q), _ROWS):
            places = self.pose_displacements(q[begin : begin + _ROWS])[:, :, :3]
            parts.append(np.einsum("kni,knj->nij", places, places))
        covariance: Array = np.concatenate(parts)
        return covariance

    @property
    def unexplained_mm(self) -> float:
        """What the model does not explain of the tool's place where a diagnosis judged it, root mean square: as much in
        each of three coordinates. It differs from place to place, so that no frame that is taught takes it away."""
        judged = self.calibrated.judged
        return 0.0 if judged is None else np.sqrt(3.0) * judged.unexplained_um / 1e3

    @property
    def joints_rad(self) -> Array:
        """The lowest and highest angle of each joint (6, 2) rad in the runs behind the model, then of a rail in m."""
        joints, rail = np.radians(np.array(self.calibrated.joints_deg)), self.calibrated.rail_mm
        return joints if rail is None else np.vstack([joints, np.array(rail) / RAIL_MM])

    def _derivatives(self, q: Array) -> Array:
        """Return the change (p, n, 6) of the tool, mm and rad, for each kept parameter in its own unit."""
        model = model_of(self.rig)
        base = tool_poses(model, q)
        by_joint = np.stack([
            pose_error(base, tool_poses(_with(model, turned(axis, _STEP_DEG)), q)) / np.radians(_STEP_DEG)
            for axis in range(1, model.arm.axes + 1)
        ])  # fmt: skip
        path = Path(Motion(np.arange(len(q), dtype=float), q), np.arange(len(q)))
        scene = driven(replace(model, effects=()), path)

        def change(effect: Effect) -> Array:
            """Return what an effect does to the tool (n, 6)."""
            if effect.STAGE == "joint":
                turns = apply([effect], "joint", scene).link_q - scene.link_q
                moved: Array = np.einsum("na,ani->ni", turns[:, : len(by_joint)], by_joint)
                return moved
            return pose_error(base, tool_poses(_with(model, effect), q))

        changes: dict[Effect, Array] = {}

        def of(effect: Effect) -> Array:
            if effect not in changes:
                changes[effect] = change(effect)
            return changes[effect]

        derivatives = np.zeros((len(self._kept), len(q), 6))
        for row, k in enumerate(self._kept):
            parameter = self.calibrated.parameters[k]
            effect: Any = self.calibrated.terms[parameter.term].effect
            if parameter.field == TIMES:
                derivatives[row] = of(effect)
                continue
            step = _SMALL * healthy_size(effect) if parameter.field == size_field(effect) else _SMALL
            stepped = effect.model_copy(update={parameter.field: getattr(effect, parameter.field) + step})
            derivatives[row] = (of(stepped) - of(effect)) / step
        return derivatives


def _with(model: Model, effect: Effect) -> Model:
    return replace(model, effects=(*model.effects, effect))


def named_in(calibrated: CalibratedModel) -> Sequence[Effect]:
    """Return the effects of a rig file of which the calibration has the covariance."""
    return [term.effect for term in calibrated.terms if term.named]
