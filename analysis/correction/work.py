"""The work of a rig: the postures of its tests, at which the worth of a correction is computed."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from analysis.correction.support import Support
from analysis.geometry.circle import frame_of
from analysis.geometry.programs import drive, radial_program
from analysis.kinematics.arm import RAIL_MM, Array, arm_of
from analysis.model.hysteresis import Motion
from analysis.model.predict import Model, Path, model_of, moved
from rigs.effects import Effect
from rigs.errors import FileError
from rigs.rig import Rig

_FEWEST, _SPREAD = 12, 60
"""Postures below which the work is too little to judge a correction by, and those that are taken then instead. Chosen:
some 24 constants need several times as many numbers."""
_AROUND_RAD = np.radians(30.0)
"""How far to either side of the work they are, where the runs' joint angles are unknown. Chosen: a usual reach."""
_STEP_RAD = np.radians(15.0)
"""Between postures on the circle. Chosen: the orders of a circle that zeros and link constants cause are below 4."""


def work_angles(rig: Rig) -> Array:
    """Return the joint angles (n, 6) rad of the rig's circle and of its hemisphere, each as far as the arm can drive
    it, or the middle of the limits where it can drive neither."""
    angles = []
    arm, circle, hemisphere = arm_of(rig.robot), rig.tests.circle, rig.tests.hemisphere
    if circle:
        phi = np.arange(0.0, 2 * np.pi, _STEP_RAD)
        with suppress(FileError):  # `rig check` reports it
            angles.append(drive(arm, frame_of(circle), phi, np.radians(circle.posture_deg), rig.name))
    if hemisphere:
        with suppress(FileError):
            q = radial_program(rig).q
            angles.append(q[: len(q) // hemisphere.visits])
    return np.concatenate(angles) if angles else posture_limits(rig).mean(axis=1)[None]


def posture_limits(rig: Rig) -> Array:
    """Return the limits (6, 2) rad of the joints, and then those in m of the rail that carries them."""
    limits, rail = arm_of(rig.robot).limits, rig.robot.rail
    return limits if rail is None else np.vstack([limits, np.array(rail.limits_mm) / RAIL_MM])


def spread_angles(rig: Rig, joints_rad: Array | None) -> Array:
    """Return postures (n, 6) rad spread over the joint angles (6, 2) rad of the runs, or else over those around the
    work."""
    work, limits = work_angles(rig), posture_limits(rig)
    low, high = work.min(axis=0), work.max(axis=0)
    if joints_rad is not None:
        low, high = np.vstack([joints_rad, limits[len(joints_rad) :]]).T
    elif len(work) < _FEWEST:
        low, high = low - _AROUND_RAD, high + _AROUND_RAD
    low, high = np.maximum(low, limits[:, 0]), np.minimum(high, limits[:, 1])
    postures: Array = np.random.default_rng(0).uniform(low, np.maximum(low, high), (_SPREAD, len(low)))
    return postures


def work_or_spread(rig: Rig, joints_rad: Array | None) -> Array:
    """Return the joint angles (n, 6) rad of the work, or where these are too few those spread over the joint angles (6,
    2) rad of the runs."""
    work = work_angles(rig)
    return work if len(work) >= _FEWEST else spread_angles(rig, joints_rad)


def tool_poses(model: Model, q: Array) -> Array:
    """Return the poses (n, 4, 4) of the real arm's tool at commanded angles q (n, 6) rad, for effects that do not
    depend on history. It stands at each, so that it does not matter by which clock."""
    return moved(model, Path(Motion(np.arange(len(q), dtype=float), q), np.arange(len(q)), stands=True)).T


def tool_places(rig: Rig, effects: Sequence[Effect], q: Array) -> Array:
    """Return where (n, 3) mm the tool stands with effects that do not depend on history at joint angles q (n, 6)
    rad."""
    return tool_poses(model_of(rig, effects), q)[:, :3, 3]


def used_effects(rig: Rig, supported: Sequence[Support]) -> tuple[Effect, ...]:
    """Return what a correction corrects of the whole model: all that depends on the posture alone, but for effects that
    the rig file names without sufficient certainty."""
    unsure = _unsure(supported)
    return tuple(effect for effect in model_of(rig).effects if not _stays(effect, unsure))


def rest_effects(rig: Rig, supported: Sequence[Support]) -> tuple[Effect, ...]:
    """Return what a correction leaves of the whole model."""
    unsure = _unsure(supported)
    return tuple(effect for effect in model_of(rig).effects if _stays(effect, unsure))


def _unsure(supported: Sequence[Support]) -> set[int]:
    """Return the identities of the rig file's own effects that are not corrected; equal effects may stand there
    twice."""
    return {id(support.effect) for support in supported if support.use == "none"}


def _stays(effect: Effect, unsure: set[int]) -> bool:
    return id(effect) in unsure or effect.compensation().use == "none"


def rms_um(distance_mm: Array) -> float:
    """Return the root mean square in µm of distances (n,) mm."""
    return 1e3 * float(np.sqrt(np.mean(distance_mm**2)))
