"""Backlash of a joint: `transit` spreads the crossing, as several elements would (Prandtl-Ishlinskii).

In the share `preload` of the width, gravity instead of friction determines the flank: the link rests on the side to
which the torque pushes it, and a reversal has no effect. A joint without gravity torque shows the full width.
"""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np

from rigs.schema.effect import (
    AT_AXIS,
    Compensation,
    Departures,
    Effect,
    FreeShape,
    scaled,
    shape,
    size,
)
from rigs.schema.part import Axis
from rigs.schema.scene import S, plays, plays_of_visits
from rigs.schema.vocabulary import Build

_SPREAD = np.linspace(-0.9, 0.9, 7)
_FIRM_NM = 1.0
"""Torque that presses the gear firmly against one flank. At smaller torques the transition is smooth."""
_SPECTRUM = (0.1, 0.25, 0.5, 0.75, 1.25, 1.5, 2.0, 3.0, 4.0)
_SHARE = 0.05
"""Widths of parallel backlash elements relative to the effect, and the standard deviation of the share of each.

Friction builds up gradually, and wind-up adds to it: the hysteresis of a joint has a spectrum of widths. Chosen: with
five widths the residual of a backlash of 0.62° was mistaken for a servo lag.
"""


class Backlash(Effect):
    """Backlash of `width_deg`: the link lags by half of it, -w/2 while q rises and +w/2 while it falls.

    The link crosses the backlash after a reversal. transit: gradual crossing, 0 sharp, 1 spread over twice the width.
    preload: share of the width in which gravity determines the flank.
    """

    effect: Literal["backlash"] = "backlash"
    axis: Axis
    width_deg: float = size(2, 0.01, least=0.0)
    transit: float = shape(0, 1, 0.0)
    preload: float = shape(0, 1, 0.0)

    STAGE = "joint"
    KIND_NAME = "play"
    USUAL_TIMES: ClassVar[dict[Build, float]] = {"servo": 30.0}
    """A multiple of thirty for servos: more than 1.5° is a fault.

    New Feetech STS3215, as in an SO-101, show 0.87° (robonine.com, test of 2025), about 1°
    (TheRobotStudio/SO-ARM100, issue 134), 1.30° (robonine.com, backlash compensation) and up to 1.49° in logs of
    complete arms, although the data sheet allows 0.5°. A test stand with its logs: doi.org/10.5281/zenodo.19261714.
    """
    IDLE = "axis {e.axis} does not reverse"
    REMEDY = "inspect the reducer of axis {e.axis}: {e.width_deg:.4f}° of play; until then approach from one side"
    CORRECTION = Compensation("none", "depends on the direction of approach: approach every target from the same side")
    SEAT_NOUN = "axis"
    PLACE = AT_AXIS
    STRAIGHT = 0.0
    MOST = 200.0
    """Largest width in a rig file, 2°. New servos of hobby arms have 0.9°."""
    FREE = (FreeShape("transit", 0.2, 0.4, tried=(1.0,)), FreeShape("preload", 0.0, 0.15, tried=(1.0,)))

    def apply(self, scene: S) -> S:
        """A continuous trace, and each visit of an untimed table, starts in the middle of the backlash."""
        half = np.radians(self.width_deg) / 2
        q = scene.q[:, self.axis - 1]
        widths = half * (1 + self.transit * _SPREAD) if self.transit else np.array([half])
        visit = scene.samples_per_visit
        deviation = np.mean(plays_of_visits(q, widths, visit) if visit else plays(q, widths), axis=0) - q
        if self.preload:
            side = self.preload * np.tanh(scene.torques()[:, self.axis - 1] / _FIRM_NM)
            deviation = (1 - np.abs(side)) * deviation + side * half
        return scene.turned(self.axis, deviation)

    def flank_deg(self) -> float | None:
        return None if self.preload else self.width_deg / 2

    def departures(self) -> Departures:
        half_deg = self.width_deg / 2
        free = scaled(self, 1.0, preload=0.0)
        spectrum = tuple(((_SHARE / ratio, scaled(free, ratio, transit=0.0)), (-_SHARE, free)) for ratio in _SPECTRUM)
        return Departures(alike=spectrum, gap=(self.axis, half_deg), jolt=(self.axis, half_deg, 0.0))
