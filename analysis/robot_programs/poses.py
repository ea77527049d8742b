"""The plan of poses for a tracker: all joints together from one to the next, and a stand at each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.kinematics.arm import Arm, Array, arm_of, forward
from analysis.robot_programs.plan import Comment, Dwell, Hold, JointMove, Plan, SignalPlace, Step, Target, in_base
from rigs.rig import Rig

_SPEED_RAD_S = float(np.radians(20.0))
"""Fastest joint between poses: slow enough to be stopped by hand."""


def poses_plan(
    rig: Rig,
    q: Array,
    dwell_s: float,
    *,
    start: Array | None = None,
    names: Sequence[str] | None = None,
    speed_rad_s: float = _SPEED_RAD_S,
    name: str = "pose",
) -> Plan:
    """The plan that stands at each posture q (n, 6) rad for so many seconds, in order. start (6,): where it begins, at
    the first unless given; names (n,): what stands beside each; name: of the program, before the rig's."""
    arm = arm_of(rig.robot)
    first, *targets = targets_at(arm, np.concatenate([q[:1] if start is None else start[None], q]))
    names = names or [f"pose {number}" for number in range(1, len(q) + 1)]
    steps: list[Step] = [JointMove(first, _SPEED_RAD_S / 2), Hold("start the tracker, continue")]
    for what, target in zip(names, targets, strict=True):
        steps += [Comment(what), JointMove(target, speed_rad_s), Dwell(dwell_s)]
    return tracker_plan(rig, f"{name} {rig.name}", steps)


def targets_at(arm: Arm, q: Array) -> list[Target]:
    """Targets at joint angles q (n, 6) rad."""
    return [Target(T, angles) for T, angles in zip(in_base(arm, forward(arm, q)), q, strict=True)]


def tracker_plan(rig: Rig, name: str, steps: Sequence[Step]) -> Plan:
    """The plan of steps in front of a tracker, without a ball link and without the signal of automatic runs."""
    return Plan(
        name=name,
        arm=arm_of(rig.robot),
        payload_kg=rig.robot.payload_kg,
        ball_mm=np.zeros(3),
        signal_place=SignalPlace(),
        feedback=rig.feedback,
        steps=tuple(steps),
        has_link=False,
    )
