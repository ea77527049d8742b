"""Work area of a rig: the postures of its tests, at which the benefit of a correction is computed.

The residual error is computed at each target, approached from both sides, and early and late in a shift, because the
approach in a program is unknown. The rms of an effect over these approaches contributes to the position uncertainty.

Frame and tool are taught with the robot itself, so a rigid motion of the whole arm and a shift of the tool on the
flange do not matter. Errors over the work area are therefore stated after a least-squares removal of these nine terms.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from analysis.correction.support import Support
from analysis.robot.geometry.circle import frame_of
from analysis.robot.geometry.driven_programs import drive, radial_program
from analysis.robot.geometry.pose_setup import best_rigid, fit_setup, in_frame
from analysis.robot.kinematics.arm import RAIL_MM, Array, arm_of, controller_arm, forward
from analysis.robot.predict import Model, Motion, Path, model_of, moved
from rigs.effects import Effect
from rigs.errors import FileError
from rigs.rig import Rig

FEWEST_TAUGHT, _SPREAD = 12, 60
"""Smallest number of postures for teaching frame and tool and for judging a correction, and the number used otherwise.
Chosen: nine constants then use a quarter of the 36 coordinates.
"""
_AROUND_RAD = np.radians(30.0)
"""Range around the work area if the runs' joint angles are unknown. Chosen: a usual range."""
_STEP_RAD = np.radians(15.0)
"""Spacing of postures on the circle. Chosen: zeros and link constants cause orders below 4 on a circle."""


def work_angles(rig: Rig) -> Array:
    """Joint angles (n, 6) rad of the rig's circle and hemisphere, as far as reachable; else the middle of the
    limits.
    """
    angles = []
    arm, circle, hemisphere = arm_of(rig.robot), rig.tests.circle, rig.tests.hemisphere
    if circle:
        phi = np.arange(0.0, 2 * np.pi, _STEP_RAD)
        with suppress(FileError):  # reported by `rig check`
            angles.append(drive(arm, frame_of(circle), phi, np.radians(circle.posture_deg), rig.name))
    if hemisphere:
        with suppress(FileError):
            q = radial_program(rig).q
            angles.append(q[: len(q) // hemisphere.visits])
    return np.concatenate(angles) if angles else posture_limits(rig).mean(axis=1)[None]


def posture_limits(rig: Rig) -> Array:
    """Limits (6, 2) rad of the joints, followed by those of the rail in m."""
    limits, rail = arm_of(rig.robot).limits, rig.robot.rail
    return limits if rail is None else np.vstack([limits, np.array(rail.limits_mm) / RAIL_MM])


def spread_angles(rig: Rig, joints_rad: Array | None) -> Array:
    """Postures (n, 6) rad spread over the joint angles (6, 2) rad of the runs, or around the work area."""
    limits = posture_limits(rig)
    if joints_rad is None:
        work = work_angles(rig)
        around = 0.0 if len(work) >= FEWEST_TAUGHT else _AROUND_RAD
        joints_rad = np.stack([work.min(axis=0) - around, work.max(axis=0) + around], axis=1)
    box = np.vstack([joints_rad, limits[len(joints_rad) :]])  # with the whole rail
    low, high = np.maximum(box[:, 0], limits[:, 0]), np.minimum(box[:, 1], limits[:, 1])
    return np.random.default_rng(0).uniform(low, np.maximum(low, high), (_SPREAD, len(low)))


def taught_angles(rig: Rig, joints_rad: Array | None) -> Array:
    """Postures (n, axes) rad that teach frame and tool if there are too few targets: those that were measured, or else
    spread over the joint angles (6, 2) rad of the runs. The arm may never have been there, so that the model is
    uncertain, and a frame taught there wrong."""
    measured = rig.calibrated.postures_deg if rig.calibrated else ()
    return np.radians(measured) if len(measured) >= FEWEST_TAUGHT else spread_angles(rig, joints_rad)


def work_or_spread(rig: Rig, joints_rad: Array | None) -> Array:
    """Postures (n, 6) rad of the work area; if there are too few, spread over those of the runs."""
    work = work_angles(rig)
    return work if len(work) >= FEWEST_TAUGHT else spread_angles(rig, joints_rad)


def tool_poses(model: Model, q: Array) -> Array:
    """Tool poses (n, 4, 4) of the real arm at commanded angles q (n, 6) rad, for effects independent of history."""
    return moved(model, at_rest(q)).T


def at_rest(q: Array) -> Path:
    """The arm at each of the joint angles q (n, 6) rad, as a visit of its own: plays are in their middle."""
    return Path(Motion(np.arange(len(q), dtype=float), q, samples_per_visit=1), np.arange(len(q)), stands=True)


def tool_places(rig: Rig, effects: Sequence[Effect], q: Array) -> Array:
    return tool_poses(real_model(rig, effects), q)[:, :3, 3]


def largest_move_mm(rig: Rig, effects: Sequence[Effect]) -> float:
    """Largest displacement of the tool over the work area by effects: the error of points that were taught before the
    controller was changed by them."""
    q = work_or_spread(rig, None)
    moved_mm = tool_poses(model_of(rig, effects), q)[:, :3, 3] - tool_poses(model_of(rig, ()), q)[:, :3, 3]
    return float(np.linalg.norm(moved_mm, axis=1).max())


_ANCHORS = 200
"""Number of postures that determine base and tool of a model. Chosen."""


def real_model(rig: Rig, effects: Sequence[Effect]) -> Model:
    """Model of the real arm with effects of the rig file and its calibration.

    The runs of a calibration cannot show a motion of the whole arm on its base or a shift of the tool on the flange, so
    these are taken from the constants of the controller, if stated.
    """
    model = model_of(rig, effects)
    if rig.calibrated is None or not rig.robot.controller_axes:
        return model
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (_ANCHORS, model.arm.axes))
    setup = fit_setup(tool_poses(model, q), forward(controller_arm(rig.robot), q)[:, :3, 3])
    base, tool = setup.T_world_base @ model.arm.T_world_base, model.arm.T_flange_tool @ setup.T_flange_tool
    return replace(model, arm=replace(model.arm, T_world_base=base, T_flange_tool=tool))


def used_effects(rig: Rig, supported: Sequence[Support]) -> tuple[Effect, ...]:
    """Effects removed by a correction: all that depend on posture, except uncertain ones of the rig file."""
    unsure = _unsure(supported)
    return tuple(effect for effect in model_of(rig).effects if not _stays(effect, unsure))


def rest_effects(rig: Rig, supported: Sequence[Support]) -> tuple[Effect, ...]:
    """Effects that a correction leaves on a stationary robot. Clocks and servo lag matter only in motion."""
    unsure, stays = _unsure(supported), list[Effect]()
    for effect in filter(lambda effect: _stays(effect, unsure), model_of(rig).effects):
        portions = tuple(portion for portion in getattr(effect, "portions", ()) if portion.of.part != "clocks")
        if portions:
            stays.append(effect.model_copy(update={"portions": portions}))
        elif effect.part != "clocks" and not hasattr(effect, "portions"):
            stays.append(effect)
    return tuple(stays)


def _unsure(supported: Sequence[Support]) -> set[int]:
    """Identities of uncorrected effects in the rig file; equal effects may occur twice."""
    return {id(support.effect) for support in supported if support.use == "none"}


def _stays(effect: Effect, unsure: set[int]) -> bool:
    return id(effect) in unsure or effect.compensation().use == "none"


def rms_um(distance_mm: Array) -> float:
    return 1e3 * float(np.sqrt(np.mean(distance_mm**2)))


_SWING_RAD = np.radians(2.0)
"""Distance over which every joint approaches from the given side. Chosen: wider than any backlash."""
_SWING_S, _STEPS = 0.1, 20
"""Time from the reversal of a joint to the target, at about 20 degrees per second, and number of samples. Chosen."""
_REST_S = 1.0
"""Rest before the next target. Chosen: longer than the decay of a reversal spike."""
_LATE_S = 1e6
"""Time of a late approach, beyond all thermal time constants."""


def left_out_mm(rig: Rig, effects: Sequence[Effect], q: Array) -> Array:
    """RMS error (n, e) mm of each uncorrected effect at joint angles q (n, 6) rad."""
    nothing = model_of(rig, ())
    squares = np.zeros((len(q), len(effects)))
    for path in _approaches(q) if effects and len(q) else []:
        places = _places(nothing, path)
        for k, effect in enumerate(effects):
            squares[:, k] += ((_places(model_of(rig, (effect,)), path) - places) ** 2).sum(axis=1) / 4
    return np.sqrt(squares)


def apart_mm(model: Model, second: Model, q: Array) -> Array:
    """RMS distance (n,) mm between the tools of two models at joint angles q (n, 6) rad."""
    squares = [((_places(model, path) - _places(second, path)) ** 2).sum(axis=1) for path in _approaches(q)]
    return np.asarray(np.sqrt(np.mean(squares, axis=0)))


def _approaches(q: Array) -> list[Path]:
    """The four approaches to joint angles q (n, 6) rad: from either side, early and late."""
    # Move from each target to the given side, back and beyond, so that joints reverse at a distance, and rest before
    # the next target.
    along = np.concatenate([np.linspace(0, -1, _STEPS, endpoint=False), np.linspace(-1, 1, 2 * _STEPS + 1)])
    swing_s = np.arange(len(along)) * (_SWING_S / _STEPS)
    starts = np.arange(len(q)) * (swing_s[-1] + _REST_S)
    rows = np.arange(len(q)) * len(swing_s) + 2 * _STEPS
    return [
        Path(
            Motion(
                (begin_s + starts[:, None] + swing_s).ravel(),
                (q[:, None, :] + side * _SWING_RAD * along[:, None]).reshape(-1, q.shape[1]),
            ),
            rows,
        )
        for side in (1.0, -1.0)
        for begin_s in (0.0, _LATE_S)
    ]


def _places(model: Model, path: Path) -> Array:
    return moved(model, path).T[path.rows, :3, 3]


_SAME = 1e-9
"""Relative singular value below which positions determine no rotation."""


@dataclass(frozen=True)
class TaughtFrame:
    """Frame and tool taught at tool `poses` (n, 4, 4), positions in mm."""

    poses: Array

    @cached_property
    def _middle(self) -> Array:
        middle: Array = self.poses[:, :3, 3].mean(axis=0)
        return middle

    @cached_property
    def _lever_mm(self) -> float:
        """RMS distance from the centre, at which a rotation counts as much as a shift."""
        return max(1.0, float(np.sqrt(((self.poses[:, :3, 3] - self._middle) ** 2).sum(axis=1).mean())))

    def _columns(self, poses: Array) -> Array:
        """Derivatives (n, 3, 9) at poses (n, 4, 4) by shifts in mm, rotations about the centre, in mm at the lever, and
        shifts of the tool on the flange in mm.
        """
        shifts = np.tile(np.eye(3), (len(poses), 1, 1))
        turns = np.cross(np.eye(3)[None], ((poses[:, :3, 3] - self._middle) / self._lever_mm)[:, None, :])
        return np.concatenate([shifts, turns.transpose(0, 2, 1), poses[:, :3, :3]], axis=2)

    def motions(self, moves: Array) -> Array:
        """Small motions (k, 9) closest to displacements (k, n, 3) mm at the poses of the frame."""
        columns = self._columns(self.poses)
        inverse = np.linalg.pinv(columns.reshape(-1, columns.shape[2]), _SAME)
        return moves.reshape(len(moves), inverse.shape[1]) @ inverse.T

    def remove_motions(self, moves: Array, poses: Array, motions: Array) -> Array:
        displacements: Array = moves - np.einsum("nij,kj->kni", self._columns(poses), motions)
        return displacements


def rest_moves_mm(places: Array, nominal: Array, taught: tuple[Array, Array] | None = None) -> Array:
    """Displacements (n, 3) mm of positions (n, 3) mm from wanted poses (n, 4, 4), with the best frame and tool.

    taught: separate positions (m, 3) mm and wanted poses (m, 4, 4) that determine frame and tool.
    """
    places_taught, poses = taught or (places, nominal)
    T = best_rigid(places_taught, poses[:, :3, 3])  # exact for a large rotation, about which the other terms are linear
    frame, off = TaughtFrame(poses), in_frame(T, places_taught) - poses[:, :3, 3]
    moves = (in_frame(T, places) - nominal[:, :3, 3])[None]
    displacements_mm: Array = frame.remove_motions(moves, nominal, frame.motions(off[None]))[0]
    return displacements_mm


def rest_mm(places: Array, nominal: Array, taught: tuple[Array, Array] | None = None) -> Array:
    return np.asarray(np.linalg.norm(rest_moves_mm(places, nominal, taught), axis=1))


def base_u_um(u_mm: Array, u_frame_mm: Array) -> float:
    """RMS contribution of the arm's position on the base to the uncertainty of positions, from those (n,) in the
    robot's base and in a taught frame.
    """
    return 1e3 * float(np.sqrt(max(0.0, float(np.mean(u_mm**2 - u_frame_mm**2)))))
