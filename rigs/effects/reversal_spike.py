from __future__ import annotations

from typing import Literal

import numpy as np

from rigs.schema.effect import AT_AXIS, Compensation, Departures, Effect, FreeShape, Scope, StretchedShape, shape, size
from rigs.schema.part import Axis
from rigs.schema.scene import S

_SLOWER = 4.0
_DECAYS_S = (0.1, 0.3, 1.0)
_GONE = 40.0
"""Number of decay times after which a spike is negligible: exp(-40) is 4e-18, below the resolution of a double at 1."""


class ReversalSpike(Effect):
    """Wind-up of `amplitude_deg` against the new direction at each reversal, relaxing within `decay_s`.

    slow: share that relaxes four times as slowly. rise: rise time as a share of the decay.
    """

    effect: Literal["reversal_spike"] = "reversal_spike"
    axis: Axis
    amplitude_deg: float = size(1, 0.005)
    decay_s: float = shape(0.02, 10, 0.3)
    slow: float = shape(0, 1, 0.0)
    rise: float = shape(0, 1, 0.0)

    STAGE = "joint"
    KIND_NAME = "wind-up after reversals"
    PLAIN = "wind-up of {joint} after reversals"
    IDLE = "axis {e.axis} does not reverse"
    REMEDY = "axis {e.axis} sticks at reversals: inspect brake, seals, grease and the tuning of the servo"
    CORRECTION = Compensation("none", "fades after each reversal: only a pause, or the same approach direction, helps")
    SEAT_NOUN = "axis"
    PLACE = AT_AXIS
    FREE = (FreeShape("slow", 0.0, 0.2), FreeShape("rise", 0.02, 0.05))
    STRETCHED = (StretchedShape("decay_s", 0.7),)

    def apply(self, scene: S) -> S:
        """Add a spike exp(-t / decay) at each reversal, partly four times as slow, after the rise."""
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
        return [[cls(axis=axis, decay_s=decay) for decay in _DECAYS_S] for axis in scope.axes if scope.timed]

    def departures(self) -> Departures:
        """Deviations of a real spike: an earlier or later start, and any decay time at a target."""
        return Departures(jolt=(self.axis, abs(self.amplitude_deg), self.decay_s), fades=True)
