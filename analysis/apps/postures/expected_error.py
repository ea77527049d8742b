"""Expected position error of postures with its uncertainty, and the backlash of each joint by side of approach.

The controller uses the nominal arm. Frame and tool are taught over the work, so a rigid motion of the arm and a shift
of the tool are no errors (`analysis.correction.work`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import product
from typing import Literal

import numpy as np

from analysis.apps.planning.pose_plan import pose_columns
from analysis.correction.pose_uncertainty import PoseUncertainty, covered, few_taught, pose_uncertainty
from analysis.correction.support import supports, why_nothing
from analysis.correction.work import (
    TaughtFrame,
    left_out_mm,
    rest_effects,
    rest_moves_mm,
    tool_places,
    used_effects,
    work_or_spread,
)
from analysis.diagnosis.fit.candidates import Level
from analysis.robot.kinematics.arm import (
    Array,
    Integers,
    Mask,
    arm_of,
    blocks,
    drive_angles,
    forward,
    forward_and_jacobian,
    reported_angles,
)
from analysis.robot.predict import driven, model_of, stops
from rigs.effects import VOCABULARY, Effect
from rigs.rig import Rig
from rigs.schema.effect import healthy, scaled, size_fields

Knowledge = Literal["calibrated", "effects", "typical"]
"""Origin of the errors: a calibrated model, only effects of the rig file, or the typical size of every effect."""

_SWING_RAD = np.radians(5.0)
"""Distance over which a joint approaches from the given side. Chosen: wider than the backlash of any arm."""
_MOST_GROWTH = 4.0
"""Growth of u outside the measured joint range: errors of real arms were 2 to 4 u there (docs/evidence/world.md)."""
_GROWN_RAD = np.radians(30.0)
"""Distance outside the range at which the growth is complete. Chosen: a usual range of taught postures."""
_ROWS = 1024
"""Postures per block: 1500 terms at each need 75 MB. Smaller blocks are slower."""
_LEVEL = 1.0
"""Size of typical errors relative to a healthy arm. For 1 the model of a UR10 has 1.0 mm rms over its work space;
measured nominal errors of a UR10 are 0.8 to 1.1 mm (docs/trials.md)."""
_SAMPLE = 40
"""Number of postures at which time-dependent effects are evaluated; they hardly depend on the posture."""


@dataclass(frozen=True)
class PostureErrors:
    """Errors of m postures in mm."""

    error_mm: Array
    u_mm: Array
    """Standard uncertainty (m,) of the displacement."""
    rising_mm: Array
    """Displacement (m, axes, 3) by the backlash of each joint for an approach with rising angle; also `falling_mm`."""
    falling_mm: Array
    covered: Mask | None
    """True (m,) if the posture is within the range of the runs; None if that range is unknown."""

    @cached_property
    def size_mm(self) -> Array:
        return np.asarray(np.linalg.norm(self.error_mm + self._middle_mm, axis=1))

    @cached_property
    def play_mm(self) -> Array:
        """Rms displacement (m,) mm by backlash for unknown sides of approach."""
        return np.asarray(np.sqrt((self._half_mm**2).sum(axis=(1, 2))))

    @cached_property
    def expected_mm(self) -> Array:
        """Expected rms error (m,) mm including uncertainty and backlash from unknown sides, used for the ranking."""
        return self.from_sides(np.zeros(self.rising_mm.shape[:2]))

    @property
    def _middle_mm(self) -> Array:
        return np.asarray(((self.rising_mm + self.falling_mm) / 2).sum(axis=1))

    @property
    def _half_mm(self) -> Array:
        return (self.rising_mm - self.falling_mm) / 2

    def of(self, rows: Mask | Integers | slice) -> PostureErrors:
        inside = None if self.covered is None else self.covered[rows]
        return PostureErrors(
            self.error_mm[rows], self.u_mm[rows], self.rising_mm[rows], self.falling_mm[rows], inside
        )  # fmt: skip

    def best_approach(self) -> tuple[Mask, Array]:
        """Joints (m, axes) that should approach with a rising angle, and the resulting expected rms error (m,) mm."""
        axes = self.rising_mm.shape[1]
        playing = np.flatnonzero(np.abs(self.rising_mm - self.falling_mm).max(axis=(0, 2), initial=0.0) > 0)
        sides = np.ones((len(self.u_mm), axes))
        best = self.from_sides(sides)
        for of_playing in product((1.0, -1.0), repeat=len(playing)):
            tried = np.ones(axes)
            tried[playing] = of_playing
            expected = self.from_sides(np.broadcast_to(tried, sides.shape))
            better = expected < best - 1e-12
            sides[better], best[better] = tried, expected[better]
        return sides > 0, best

    def from_sides(self, side: Array) -> Array:
        """Expected rms error (m,) mm for sides of approach (m, axes): 1 rising, -1 falling, 0 unknown."""
        half = self._half_mm
        displaced = self.error_mm + self._middle_mm + (side[..., None] * half).sum(axis=1)
        unknown = ((side == 0)[..., None] * half**2).sum(axis=(1, 2))
        return np.asarray(np.sqrt((displaced**2).sum(axis=1) + unknown + self.u_mm**2))


def knowledge_of(rig: Rig) -> Knowledge:
    if why_nothing(rig):
        return "typical"
    if rig.calibrated is not None:
        return "calibrated"
    return "effects" if any(effect.found for effect in rig.effects) else "typical"


def expected_errors(
    rig: Rig, q: Array, taught: Array | None = None, *, solution: Integers | None = None
) -> PostureErrors:
    """Errors of postures q (m, axes) rad, followed by a rail position in m.

    taught (k, axes): postures at which frame and tool are taught, by default the work area. solution (m,): postures
    with the same number differ by full turns only.
    """
    knowledge = knowledge_of(rig)
    if knowledge == "typical":
        rig = rig.nominal
    supported = supports(rig)
    uncertainty = pose_uncertainty(rig, supported)
    if taught is None:
        taught = work_or_spread(rig, uncertainty.joints_rad)
    arm, used = arm_of(rig.robot), used_effects(rig, supported)
    at_taught, at_postures = forward(arm, taught), forward(arm, q)
    places = tool_places(rig, used, q)
    error = rest_moves_mm(places, at_postures, (tool_places(rig, used, taught), at_taught))
    few = few_taught(len(taught))
    taught, frame = taught[few], TaughtFrame(at_taught[few])
    numbers = np.arange(len(q)) if solution is None else solution
    _, first, of_all = np.unique(numbers, return_index=True, return_inverse=True)
    square = np.zeros(len(q))
    if knowledge != "typical":
        square += _model_square(uncertainty, frame, taught, q[first], at_postures[first])[of_all]
        square *= _growth_outside(uncertainty, q) ** 2
    if knowledge != "calibrated":
        moves = typical_displacements(rig, np.concatenate([taught, q[first]]))
        remaining = frame.remove_motions(
            moves[:, len(taught) :], at_postures[first], frame.motions(moves[:, : len(taught)])
        )
        square += np.einsum("kni,kni->n", remaining, remaining)[of_all]
    rising, falling = play_moves(rig, q, typical=knowledge != "calibrated")
    square += time_variance(rig, q)
    inside = covered(uncertainty, q) if knowledge != "typical" else np.zeros(len(q), dtype=bool)
    return PostureErrors(error, np.sqrt(square), rising, falling, inside)


def _model_square(uncertainty: PoseUncertainty, frame: TaughtFrame, taught: Array, q: Array, poses: Array) -> Array:
    """Variance (m,) mm² of positions in a taught frame by the model, including its unexplained error."""
    terms: list[tuple[Callable[[Array], Array], Array | None]] = [(uncertainty.pose_displacements, None)]
    if uncertainty.calibrated is not None:
        # Effects are small, and evaluating them takes most time: the derivatives are those of the nominal arm.
        derivatives = partial(uncertainty.pose_derivatives, model_of(uncertainty.rig, ()))
        terms = [(uncertainty.displacements_by_effects, None), (derivatives, uncertainty.factor.T)]
    squares = (_rest_square(moves_at, factor, frame, taught, (q, poses)) for moves_at, factor in terms)
    return sum(squares, np.full(len(q), uncertainty.unexplained_mm**2))


def _rest_square(
    moves_at: Callable[[Array], Array], factor: Array | None, frame: TaughtFrame, taught: Array, at: tuple[Array, Array]
) -> Array:
    """Sum (m,) mm² of squared displacements at postures, without the part absorbed by the taught frame.

    moves_at: displacements (k, n, 6) at joint angles. factor (r, k): combines them; None if they are independent.
    """
    q, poses = at
    single = None if factor is None else factor.astype(np.float32)  # half the time; u needs only three digits
    motions, square = frame.motions(np.ascontiguousarray(moves_at(taught)[:, :, :3])), np.zeros(len(q))
    for rows in blocks(len(q), _ROWS):
        moves = frame.remove_motions(moves_at(q[rows])[:, :, :3], poses[rows], motions)
        if single is not None and len(moves):
            flat = moves.reshape(len(moves), -1).astype(np.float32)
            moves = (single @ flat).reshape(len(single), -1, 3).astype(float)
        square[rows] = np.einsum("kni,kni->n", moves, moves)
    return square


def _growth_outside(uncertainty: PoseUncertainty, q: Array) -> Array:
    """Factor (m,) by which u grows outside the measured joint range, 1 inside or if that is unknown."""
    joints = uncertainty.joints_rad
    if joints is None:
        return np.ones(len(q))
    at = q[:, : len(joints)]
    beyond = np.maximum(joints[:, 0] - at, at - joints[:, 1]).max(axis=1)
    share = np.clip(beyond / _GROWN_RAD, 0.0, 1.0)
    share[~uncertainty.is_within_reach(q)] = 1.0
    return np.asarray(1 + (_MOST_GROWTH - 1) * share)


def typical_displacements(rig: Rig, q: Array) -> Array:
    """Tool displacements (k, n, 3) mm by one standard deviation of each typical effect, except backlash."""
    columns, sd_mm = pose_columns(rig.nominal, q)
    variance = columns.variance(Level(_LEVEL))
    variance[columns.fixed > 0] = 0.0  # set-ups and scatter
    moves = columns.X * np.sqrt(variance) * sd_mm.reshape(-1, 1)
    return np.ascontiguousarray(moves.reshape(len(q), 3, -1).transpose(2, 0, 1))


def play_moves(rig: Rig, q: Array, *, typical: bool) -> tuple[Array, Array]:
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


def time_variance(rig: Rig, q: Array) -> Array:
    """Variance (m,) mm² by effects outside the joints that targets cannot correct, such as thermal growth."""
    effects = [effect for effect in rest_effects(rig, supports(rig)) if effect.STAGE != "joint"]
    if not effects or not len(q):
        return np.zeros(len(q))
    left_out = left_out_mm(rig, effects, q[:: -(-len(q) // _SAMPLE)])
    return np.full(len(q), float((left_out**2).sum(axis=1).mean()))
