"""Thermal growth: every length of the arm grows alike, so the tool moves away from the base."""

from __future__ import annotations

import numpy as np

from analysis.model.scene import Scene
from rigs.effects import ThermalGrowth

STAGE = "tool"


def apply(effect: ThermalGrowth, scene: Scene) -> Scene:
    """ppm (1 - exp(-t / time constant)) of the way from base to tool."""
    growth = effect.ppm * 1e-6 * -np.expm1(-np.maximum(scene.t_s, 0) / effect.time_constant_s)
    return scene.shifted(growth[:, None] * (scene.T[:, :3, 3] - scene.arm.T_world_base[:3, 3]))
