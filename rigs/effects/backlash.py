"""Backlash: the link lags behind in a play, -w/2 while q rises, +w/2 while it falls.

`transit` spreads the crossing, as several plays of different width side by side would (Prandtl and Ishlinskii).
`preload` is the share of the play in which gravity, and not friction, holds a flank: there the link lies where the
torque presses it, and no reversal shows. A joint that gravity does not load, as that of a vertical axis, shows the
whole play.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from rigs.schema.effect import (
    AT_AXIS,
    Compensation,
    Departures,
    Effect,
    FreeShape,
    Scope,
    at_each_axis,
    scaled,
    shape,
    size,
)
from rigs.schema.part import Axis
from rigs.schema.scene import S, plays, plays_of_visits
from rigs.schema.vocabulary import Build

_SPREAD = np.linspace(-0.9, 0.9, 7)
_FIRM_NM = 1.0
"""A torque of this size presses the flank firmly; below, it gives way smoothly."""
_SPECTRUM = (0.1, 0.25, 0.5, 0.75, 1.25, 1.5, 2.0, 3.0, 4.0)
_SHARE = 0.05
"""Widths of plays, in widths of the effect, that a real joint may have in place of a part of it, and the standard
deviation of each part. Friction is approached gradually and wind-up adds to it, so the hysteresis of a joint has a
spectrum of widths (Prandtl and Ishlinskii), and its height is that of the effect. Chosen: with five widths what was
left of a play of 0.62° was named a servo lag."""


class Backlash(Effect):
    """A play of `width_deg`: the link lags, -w/2 while q rises, +w/2 while it falls, and crosses it at a reversal.

    transit: how gradual the crossing is, 0 sharp, 1 spread over twice the play; preload: share of the play in which
    gravity holds the flank.
    """

    effect: Literal["backlash"] = "backlash"
    axis: Axis
    width_deg: float = size(2, 0.01, least=0.0)
    transit: float = shape(0, 1, 0.0)
    preload: float = shape(0, 1, 0.0)

    STAGE = "joint"
    PLACE = AT_AXIS
    STRAIGHT = 0.0
    MOST = 200.0
    """As wide as a rig file may state it, 2°: servos of hobby arms have 0.9° when they are new."""
    FREE = (FreeShape("transit", 0.2, 0.4, tried=(1.0,)), FreeShape("preload", 0.0, 0.15, tried=(1.0,)))

    def apply(self, scene: S) -> S:
        """The joint lags; the trace, or each visit without a time, begins in the middle of the play."""
        half = np.radians(self.width_deg) / 2
        q = scene.q[:, self.axis - 1]
        widths = half * (1 + self.transit * _SPREAD) if self.transit else np.array([half])
        visit = scene.samples_per_visit
        deviation = np.mean(plays_of_visits(q, widths, visit) if visit else plays(q, widths), axis=0) - q
        if self.preload:
            side = self.preload * np.tanh(scene.torques()[:, self.axis - 1] / _FIRM_NM)
            deviation = (1 - np.abs(side)) * deviation + side * half
        return scene.turned(self.axis, deviation)

    @classmethod
    def forms(cls, scope: Scope) -> list[list[Backlash]]:
        """One at each joint."""
        return at_each_axis(cls, scope)

    def usual_times(self, build: Build) -> float:
        """Servos show thirty times as much, so that more than 1.5° is a fault. New Feetech STS3215, as in an SO-101,
        show 0.87° (robonine.com, test of 2025), about 1° (TheRobotStudio/SO-ARM100, issue 134), 1.30° (robonine.com,
        backlash compensation) and up to 1.49° in logs of whole arms, although their data sheet allows 0.5°. A test
        stand with its logs: doi.org/10.5281/zenodo.19261714."""
        return 30.0 if build == "servo" else 1.0

    def plain(self, joint: str) -> str:
        return f"play of {joint}"

    def remedy(self) -> str:
        return (
            f"inspect the reducer of axis {self.axis}: {self.width_deg:.4f}° of play; approach from one side meanwhile"
        )

    def compensation(self) -> Compensation:
        """It has a history, which no target has."""
        return Compensation(
            "none", "depends on where the joint came from: only the same approach direction to every target helps"
        )

    @property
    def idle(self) -> str:
        """It shows where a joint turns back."""
        return f"axis {self.axis} does not turn back"

    def departures(self) -> Departures:
        """Where in its play the joint began, and how it crosses it."""
        half_deg = self.width_deg / 2
        free = scaled(self, 1.0, preload=0.0)
        spectrum = tuple(((_SHARE / ratio, scaled(free, ratio, transit=0.0)), (-_SHARE, free)) for ratio in _SPECTRUM)
        return Departures(alike=spectrum, gap=(self.axis, half_deg), jolt=(self.axis, half_deg, 0.0))
