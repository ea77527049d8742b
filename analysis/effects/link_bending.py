"""Link bending: the link after an axis bends under the torque at that axis; its end moves, the joint does not."""

from __future__ import annotations

import numpy as np

from analysis.kinematics.arm import link_frames
from analysis.model.gravity import torques
from analysis.model.scene import Scene
from rigs.effects import LinkBending

STAGE = "tool"


def apply(effect: LinkBending, scene: Scene) -> Scene:
    """Everything beyond the link moves, without turning, across the link and in the plane that the torque acts in."""
    frames = link_frames(scene.arm, scene.link_q)
    axis = effect.axis - 1
    joint, z = frames[:, axis, :3, 3], frames[:, axis, :3, 2]
    end = frames[:, axis + 1, :3, 3] if axis < 5 else scene.T[:, :3, 3]
    across = np.cross(z, end - joint)
    length = np.linalg.norm(across, axis=1, keepdims=True)
    across = np.divide(across, length, out=np.zeros_like(across), where=length > 1e-6)
    torque = torques(scene.arm, scene.load, scene.q)[:, axis]
    return scene.shifted((effect.mm_per_Nm * torque)[:, None] * across)
