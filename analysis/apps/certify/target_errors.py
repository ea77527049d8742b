"""Joint distribution of the errors of all targets of a program, by cause.

The covariance of the calibrated model is common to all targets: errors of neighbouring targets are nearly equal, and
cancel in a distance. Scatter and unexplained error differ from target to target.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from analysis.apps.planning.pose_plan import pose_columns
from analysis.correction.pose_uncertainty import few_taught, pose_uncertainty
from analysis.correction.support import supports, why_nothing
from analysis.correction.work import (
    FEWEST_TAUGHT,
    TaughtFrame,
    left_out_mm,
    rest_effects,
    rest_moves_mm,
    spread_angles,
    tool_places,
    used_effects,
)
from analysis.diagnosis.fit.candidates import Level
from analysis.robot.kinematics.arm import (
    Array,
    Integers,
    Mask,
    arm_of,
    controller_arm,
    drive_angles,
    forward,
    forward_and_jacobian,
    reported_angles,
)
from analysis.robot.predict import driven, model_of, stops
from rigs.effects import VOCABULARY, Effect
from rigs.rig import Rig
from rigs.schema.effect import healthy, label_of, scaled, size_fields
from rigs.schema.limits import USUAL_RP_MM

Knowledge = Literal["calibrated", "effects", "typical"]
"""Origin of the errors: a calibrated model, only effects of the rig file, or the typical size of every effect."""
Nature = Literal["correctable", "load", "approach", "model", "scatter"]

_RP_SIGMAS = 3.616
"""Pose repeatability RP (ISO 9283: mean plus three standard deviations of the distance) over the standard deviation of
a coordinate, of an equal normal scatter in three coordinates: 1.596 + 3 · 0.673."""
_SWING_RAD = np.radians(5.0)
"""Distance over which a joint approaches from the given side. Chosen: wider than the backlash of any arm."""
_LEVEL = 1.0
"""Size of typical errors relative to a healthy arm. For 1 the model of a UR10 has 1.0 mm rms over its work space;
measured nominal errors of a UR10 are 0.8 to 1.1 mm (docs/evidence/real-arms.md)."""
_SAMPLE = 40
"""Number of postures at which time-dependent effects are evaluated; they hardly depend on the posture."""


@dataclass(frozen=True)
class Cause:
    """A part of the error of n targets in mm; displacements are of one standard deviation."""

    name: str
    nature: Nature
    mean: Array
    common: Array
    """Independent displacements common to all targets (k, n, 3)."""
    own: Array
    """Independent displacements of each target (n, m, 3)."""

    def draw(self, rows: Integers, count: int, rng: np.random.Generator) -> Array:
        """Draw the error (count, m, 3) mm at the targets `rows` (m,)."""
        drawn = np.tile(self.mean[rows], (count, 1, 1))
        if len(self.common):
            values, vectors = np.linalg.eigh(covariance_of(self.common[:, rows]))
            root = vectors * np.sqrt(np.maximum(values, 0.0))
            drawn += (rng.standard_normal((count, len(root))) @ root.T).reshape(count, -1, 3)
        if self.own.shape[1]:
            own = self.own[rows]
            drawn += np.einsum("cnk,nki->cni", rng.standard_normal((count, *own.shape[:2])), own)
        return drawn


def covariance_of(moves: Array) -> Array:
    """Covariance (3 n, 3 n) of independent displacements (k, n, 3)."""
    flat = moves.reshape(len(moves), -1)
    return np.asarray(flat.T @ flat)


@dataclass(frozen=True)
class Work:
    q: Array
    wanted: Array
    came_from: Array
    """Postures from which the program reaches them, NaN if unknown."""
    load_kg: Array
    """Payload (n,), NaN for that of the rig file."""


def knowledge_of(rig: Rig) -> Knowledge:
    if why_nothing(rig):
        return "typical"
    if rig.calibrated is not None:
        return "calibrated"
    return "effects" if any(effect.found for effect in rig.effects) else "typical"


def taught_at(rig: Rig, work: Work, inside: Mask) -> tuple[Array, Array]:
    """Postures and poses at which frame and tool are taught: the measured targets, or the measured region for few."""
    if inside.sum() >= FEWEST_TAUGHT:
        return work.q[inside], work.wanted[inside]
    q = spread_angles(rig, pose_uncertainty(rig, supports(rig)).joints_rad)[:, : work.q.shape[1]]
    return q, forward(controller_arm(rig.robot), q)


def causes_of(rig: Rig, work: Work, taught: tuple[Array, Array], rp_mm: float | None) -> list[Cause]:
    """Causes of the errors of targets.

    taught: postures and poses of frame and tool. rp_mm: pose repeatability, None for the usual one.
    """
    knowledge, supported = knowledge_of(rig), supports(rig)
    if knowledge == "typical":
        rig, supported = rig.nominal, []
    count = len(work.q)
    nothing = np.zeros((count, 3))

    def cause(
        name: str, nature: Nature, mean: Array = nothing, common: Array | None = None, own: Array | None = None
    ) -> Cause:
        return Cause(
            name, nature, mean, np.zeros((0, count, 3)) if common is None else common,
            np.zeros((count, 0, 3)) if own is None else own,
        )  # fmt: skip

    def isotropic(sd_mm: Array | float) -> Array:
        return np.asarray(np.broadcast_to(np.asarray(sd_mm), count)[:, None, None] * np.eye(3))

    causes = [cause(name, "correctable", mean) for name, mean in _correctable(rig, work, taught)]
    causes += [cause("payload", "load", moved)] if (moved := _by_load(rig, work)).any() else []
    uncertainty = pose_uncertainty(rig, supported)
    few = few_taught(len(taught[0]))
    q, frame = np.concatenate([taught[0][few], work.q]), TaughtFrame(taught[1][few])
    moves = [] if knowledge == "typical" else [uncertainty.pose_displacements(q)[:, :, :3]]
    moves += [] if knowledge == "calibrated" else [_typical_displacements(rig, q)]
    moved = np.concatenate(moves)
    common = frame.remove_motions(moved[:, len(few) :], work.wanted, frame.motions(moved[:, : len(few)]))
    of_model = "unknown part of the arm" if knowledge == "typical" else "uncertainty of the calibration"
    causes.append(cause(of_model, "model", common=common))
    causes += [
        cause(name, "approach", mean, own=own)
        for name, mean, own in _approaches(rig, work, typical=knowledge != "calibrated")
    ]
    scatters = {
        "unexplained error": uncertainty.unexplained_mm / np.sqrt(3.0),
        "effects of time": np.sqrt(_time_variance(rig, work.q) / 3),
        "repeatability": (rp_mm or rig.limits.data_sheet_rp_mm or USUAL_RP_MM) / _RP_SIGMAS,
    }
    return causes + [cause(name, "scatter", own=isotropic(sd)) for name, sd in scatters.items() if np.any(sd)]


def _correctable(rig: Rig, work: Work, taught: tuple[Array, Array]) -> list[tuple[str, Array]]:
    """Mean errors (n, 3) mm that corrected targets remove: of each effect in the rig file, and of all others."""
    used = used_effects(rig, supports(rig))

    def errors(without: int | None) -> Array:
        effects = [effect for effect in used if id(effect) != without]
        return rest_moves_mm(
            tool_places(rig, effects, work.q), work.wanted, (tool_places(rig, effects, taught[0]), taught[1])
        )

    whole, in_file = errors(None), {id(effect) for effect in rig.effects}
    named = [(label_of(effect), whole - errors(id(effect))) for effect in used if id(effect) in in_file]
    others = whole - sum((mean for _, mean in named), np.zeros_like(whole))
    return [*named, ("errors of usual size", others)] if used or others.any() else named


def _by_load(rig: Rig, work: Work) -> Array:
    """Displacement (n, 3) mm by payloads other than that of the rig file."""
    moved, used = np.zeros((len(work.q), 3)), used_effects(rig, supports(rig))
    for kg in np.unique(work.load_kg[np.isfinite(work.load_kg)]).tolist():
        rows = work.load_kg == kg
        loaded = rig.model_copy(update={"robot": rig.robot.model_copy(update={"payload_kg": kg})}).calibrated_as(rig)
        moved[rows] = tool_places(loaded, used, work.q[rows]) - tool_places(rig, used, work.q[rows])
    return moved


def _approaches(rig: Rig, work: Work, *, typical: bool) -> Sequence[tuple[str, Array, Array]]:
    """Mean (n, 3) and unknown part (n, 1, 3) mm of the error by the side from which each drive arrives, by drive."""
    rising, falling = _play_moves(rig, work.q, typical=typical)
    half, axes = (rising - falling) / 2, rising.shape[1]
    side = np.sign(np.nan_to_num(np.where(np.abs(away := (work.q - work.came_from)[:, :axes]) > 1e-9, away, 0.0)))
    mean = (rising + falling) / 2 + side[..., None] * half
    own = np.where(side[..., None] == 0, half, 0.0)
    return [
        (f"approach of {rig.robot.axis_words(axis + 1)}", mean[:, axis], own[:, axis, None])
        for axis in range(axes)
        if half[:, axis].any() or mean[:, axis].any()
    ]


def _typical_displacements(rig: Rig, q: Array) -> Array:
    """Tool displacements (k, n, 3) mm by one standard deviation of each typical effect, except backlash."""
    columns, sd_mm = pose_columns(rig.nominal, q)
    variance = columns.variance(Level(_LEVEL))
    variance[columns.fixed > 0] = 0.0  # set-ups and scatter
    moves = columns.X * np.sqrt(variance) * sd_mm.reshape(-1, 1)
    return np.ascontiguousarray(moves.reshape(len(q), 3, -1).transpose(2, 0, 1))


def _play_moves(rig: Rig, q: Array, *, typical: bool) -> tuple[Array, Array]:
    """Displacements (m, axes, 3) mm by the backlash of each drive approaching with a rising and a falling angle.

    Includes other joint effects that targets cannot correct. typical: assume backlash of joints without a known one.
    """
    effects = [effect for effect in rest_effects(rig, supports(rig)) if effect.STAGE == "joint"]
    arm = arm_of(rig.robot)
    motions = forward_and_jacobian(arm.by_drives, drive_angles(arm, q))[1][:, :3].transpose(0, 2, 1)
    rising, falling = (_lag_rad(rig, effects, q, side) for side in (-1.0, 1.0))
    if typical:
        kinds = [cls for cls in VOCABULARY.values() if cls.STAGE == "joint" and cls.STRAIGHT == 0]
        plays = [
            healthy(cls.model_validate({"axis": axis, size_fields(cls)[0]: 1.0}))
            for cls in kinds
            for axis in range(1, len(rig.robot.axes) + 1)
        ]
        plays = [scaled(play, play.usual_times(rig.reference)) for play in plays]
        unknown = (rising == 0).all(axis=0) & (falling == 0).all(axis=0)
        rising = np.where(unknown, _lag_rad(rig, plays, q, -1.0), rising)
        falling = np.where(unknown, _lag_rad(rig, plays, q, 1.0), falling)
    return rising[..., None] * motions, falling[..., None] * motions


def _lag_rad(rig: Rig, effects: Sequence[Effect], q: Array, side: float) -> Array:
    """Lag (m, axes) rad of the links after each drive arrived from a side, -1 below and 1 above."""
    model = model_of(rig, effects)
    axes = model.arm.axes
    if not effects or not len(q):
        return np.zeros((len(q), axes))
    came_from = q.copy()
    came_from[:, :axes] += reported_angles(model.arm, np.full(axes, side * _SWING_RAD))
    path = stops(q, came_from=came_from)
    scene = driven(model, path)
    return np.asarray((scene.link_q - scene.q)[path.rows][:, :axes])


def _time_variance(rig: Rig, q: Array) -> Array:
    """Variance (m,) mm² by effects outside the joints that targets cannot correct, such as thermal growth."""
    effects = [effect for effect in rest_effects(rig, supports(rig)) if effect.STAGE != "joint"]
    if not effects or not len(q):
        return np.zeros(len(q))
    left_out = left_out_mm(rig, effects, q[:: -(-len(q) // _SAMPLE)])
    return np.full(len(q), float((left_out**2).sum(axis=1).mean()))
