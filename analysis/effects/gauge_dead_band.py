"""Gauge dead band: a plunger that sticks follows only after some motion, like a play."""

from __future__ import annotations

from analysis.model.hysteresis import play
from analysis.model.scene import Scene
from rigs.effects import GaugeDeadBand

STAGE = "gauge"


def apply(effect: GaugeDeadBand, scene: Scene) -> Scene:
    """The play operator on the reading."""
    return scene.read(effect.gauge, lambda g: play(g, effect.width_mm / 2))
