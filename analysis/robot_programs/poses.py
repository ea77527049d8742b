"""The plan of poses for a tracker: all joints together from one to the next, and a stand at each."""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import Array, arm_of, forward
from analysis.robot_programs.plan import Comment, Dwell, Hold, JointMove, Plan, SignalPlace, Step, Target, in_base
from rigs.rig import Rig

_SPEED_RAD_S = float(np.radians(20.0))
"""Fastest joint between poses: slow enough to be stopped by hand."""


def poses_plan(rig: Rig, q: Array, dwell_s: float) -> Plan:
    """The plan that stands at each posture q (n, 6) rad for so many seconds, in order."""
    arm = arm_of(rig.robot)
    targets = [Target(T, angles) for T, angles in zip(in_base(arm, forward(arm, q)), q, strict=True)]
    steps: list[Step] = [JointMove(targets[0], _SPEED_RAD_S / 2), Hold("start the tracker, continue")]
    for number, target in enumerate(targets, start=1):
        steps += [Comment(f"pose {number}"), JointMove(target, _SPEED_RAD_S), Dwell(dwell_s)]
    return Plan(
        name=f"pose {rig.name}",
        arm=arm,
        payload_kg=rig.robot.payload_kg,
        ball_mm=np.zeros(3),
        signal_place=SignalPlace(),
        feedback=rig.feedback,
        steps=tuple(steps),
        has_link=False,
    )
