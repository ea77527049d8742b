"""An arm with hidden errors, computed independently of rig, and the tool positions reached by its controller.

The zeros of axes 3 and 5, the length a2 and a gear of axis 1 (two waves per turn) are wrong. The controller knows only
the nominal arm. It solves a pose with the nominal constants, in the current posture of the arm.
"""

from __future__ import annotations

import datetime as dt

import numpy as np
from scipy.spatial.transform import Rotation

from analysis.robot.kinematics.arm import arm_of
from analysis.robot.kinematics.newton import newton
from rigs.effects import Effect, EffectProvenance, JointOffset, LinkGeometry, TransmissionError
from rigs.rig import Rig
from tests.worlds.arms.independent_arm import Array, Wrong, constants_from, flange, none

_ZERO_3_DEG, _ZERO_5_DEG, _A2_MM, _GEAR_DEG = 0.05, -0.03, 0.4, 0.02


def found(**sd: float) -> EffectProvenance:
    return EffectProvenance(date=dt.date(2026, 11, 20), runs=("yaw-acw-001",), sd=sd)


EFFECTS: tuple[Effect, ...] = (
    JointOffset(axis=3, offset_deg=_ZERO_3_DEG, found=found(offset_deg=0.002)),
    JointOffset(axis=5, offset_deg=_ZERO_5_DEG, found=found(offset_deg=0.002)),
    LinkGeometry(axis=3, field="a", delta=_A2_MM, found=found(delta=0.03)),
    TransmissionError(axis=1, order=2, amplitude_deg=_GEAR_DEG, phase_deg=0, found=found(amplitude_deg=0.001)),
)


def known(rig: Rig) -> Rig:
    """Rig with the hidden errors written in its file, and a controller that computes with the data sheet."""
    return rig.model_copy(
        update={"effects": EFFECTS, "robot": rig.robot.model_copy(update={"controller": "data_sheet"})}
    )


def hidden() -> Wrong:
    """Hidden errors in the notation of the independent arm."""
    wrong = none()
    wrong.offset[[2, 4]] = np.radians([_ZERO_3_DEG, _ZERO_5_DEG])
    wrong.a[2] = _A2_MM
    wrong.sine[0, 1] = np.radians(_GEAR_DEG)
    return wrong


def flange_at(rig: Rig, q: Array, wrong: Wrong | None = None) -> Array:
    """Frame (4, 4) in mm of the flange in the base at joint angles q (6,) rad, of the nominal or an
    erroneous arm.
    """
    R, p = flange(constants_from(rig.robot.model_dump()), wrong or none(), q[None])
    return frame(p[0], Rotation.from_matrix(R[0]))


def joints_of(rig: Rig, T: Array, near: Array) -> Array:
    """Joint angles (6,) rad that the controller chooses for a flange (4, 4) in the base, in the posture
    of `near`.
    """
    arm = arm_of(rig.robot)
    q, good = newton(arm, (arm.T_world_base @ T @ arm.T_flange_tool)[None], near[None])
    assert good.all()
    return q[0]


def frame(place: Array | tuple[float, ...], turn: Rotation) -> Array:
    """A frame (4, 4) in mm."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = turn.as_matrix(), place
    return T
