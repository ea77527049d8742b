"""The arm of a run as Foxglove shows it: joint angles as `foxglove.JointStates`, and its URDF, whose joints have these
names, so that the arm moves.

The schemas are those of docs.foxglove.dev/docs/sdk/schemas, and of `std_msgs/String` for the URDF, in JSON.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from analysis.arms.urdf_text import urdf_text
from analysis.kinematics.arm import arm_of
from rigs.errors import RigError
from rigs.rig import Rig

JOINT_STATES, DESCRIPTION = "foxglove.JointStates", "std_msgs/String"
JOINTS_TOPIC, DESCRIPTION_TOPIC = "/joint_states", "/robot_description"
_TIME = {"type": "object", "title": "time", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}
_JOINT = {
    "type": "object",
    "title": "foxglove.JointState",
    "properties": {"name": {"type": "string"}, "position": {"type": "number"}},
}
SCHEMAS: dict[str, dict[str, Any]] = {
    JOINT_STATES: {
        "type": "object",
        "title": JOINT_STATES,
        "properties": {"timestamp": _TIME, "joints": {"type": "array", "items": _JOINT}},
    },
    DESCRIPTION: {"type": "object", "title": DESCRIPTION, "properties": {"data": {"type": "string"}}},
}
"""The schemas by name; a position is in radians."""


def urdf_of(rig: Rig) -> str:
    """Return the URDF of a rig's arm as its constants say, empty where it can have none."""
    try:
        return urdf_text(rig.robot, arm_of(rig.robot), rig.name)
    except RigError:
        return ""


def joint_states(names: Sequence[str], q_deg: Sequence[float | None], at_ns: int) -> dict[str, Any]:
    """Return the message of joint angles in degrees at a time in ns since 1970, without those that are not known."""
    sec, nsec = divmod(at_ns, 1_000_000_000)
    joints = [
        {"name": name, "position": math.radians(deg)}
        for name, deg in zip(names, q_deg, strict=True)
        if deg is not None and math.isfinite(deg)
    ]
    return {"timestamp": {"sec": sec, "nsec": nsec}, "joints": joints}
