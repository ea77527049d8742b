"""Wind-up at reversal: after each turn the link hangs back against the new direction, and relaxes."""

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
    StretchedShape,
    shape,
    size,
)
from rigs.schema.part import Axis
from rigs.schema.scene import S

_SLOWER = 4.0
_DECAYS_S = (0.1, 0.3, 1.0)
_GONE = 40.0
"""Times its decay after which nothing is left of a spike: exp(-40) is 4e-18, less than a double resolves beside 1."""


class ReversalSpike(Effect):
    """Wind-up at each reversal, `amplitude_deg` against the new direction, that relaxes within `decay_s`; `slow` of it
    takes four times as long, and it needs `rise` of that time to wind up."""

    effect: Literal["reversal_spike"] = "reversal_spike"
    axis: Axis
    amplitude_deg: float = size(1, 0.005)
    decay_s: float = shape(0.02, 10, 0.3)
    slow: float = shape(0, 1, 0.0)
    rise: float = shape(0, 1, 0.0)

    STAGE = "joint"
    PLACE = AT_AXIS
    FREE = (FreeShape("slow", 0.0, 0.2), FreeShape("rise", 0.02, 0.05))
    STRETCHED = (StretchedShape("decay_s", 0.7),)

    def apply(self, scene: S) -> S:
        """A spike at each reversal, exp(-t / decay), in part four times as slow, once it has risen."""
        t_s, gone_s = scene.t_s, _GONE * self.decay_s * (_SLOWER if self.slow else 1.0)
        deviation = np.zeros(len(t_s))
        for when, direction in scene.reversals(self.axis):
            after = slice(*np.searchsorted(t_s, [when, when + gone_s]))
            since = (t_s[after] - when) / self.decay_s
            relaxing = (1 - self.slow) * np.exp(-since) + self.slow * np.exp(-since / _SLOWER)
            if self.rise:
                relaxing *= -np.expm1(-since / self.rise)
            deviation[after] -= direction * relaxing
        return scene.turned(self.axis, np.radians(self.amplitude_deg) * deviation)

    @classmethod
    def forms(cls, scope: Scope) -> list[list[ReversalSpike]]:
        """At each joint that turns back while it is read, quick and slow ones."""
        return [[cls(axis=axis, decay_s=decay) for decay in _DECAYS_S] for axis in scope.axes if scope.timed]

    def plain(self, joint: str) -> str:
        return f"wind-up of {joint} after reversals"

    def remedy(self) -> str:
        return f"axis {self.axis} sticks at reversals: inspect brake, seals, grease and the tuning of the servo"

    def compensation(self) -> Compensation:
        """It has a history, which no target has."""
        return Compensation("none", "fades after each reversal: only a pause, or the same approach direction, helps")

    @property
    def idle(self) -> str:
        """It shows where a joint turns back."""
        return f"axis {self.axis} does not turn back"

    def departures(self) -> Departures:
        """It may begin sooner or later, and fade at a target for any time."""
        return Departures(jolt=(self.axis, abs(self.amplitude_deg), self.decay_s), fades=True)
