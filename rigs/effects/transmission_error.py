"""Transmission error: a gear that runs ahead and behind with the angle of the joint, A sin(N q + phase)."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from rigs.schema.effect import (
    BY_TARGETS,
    EVERY_AXIS,
    NUMBER,
    Compensation,
    Departures,
    Effect,
    FreeShape,
    Place,
    Scope,
    StretchedShape,
    shape,
    size,
    whole_order,
)
from rigs.schema.part import Axis
from rigs.schema.scene import S

_MOST_ORDER, _MOST_OF_STANDS = 200, 100
"""Orders of the waves that are tried: on circles, which joints drive slowly, and where a robot stands. Stands show the
sum of all waves, whose higher orders hardly show: with waves up to 60, 100 and 200 a turn, poses of one series of a
UR10 left 240, 245 and 248 µm of another, and those of the other 275, 253 and 252 µm."""
_MOST_WAVES = 135
"""Waves on the stretch that a joint turns, of which a wave more than these is shorter than what readings resolve: three
readings a wave, of the 400 that a lap of 8 s has at 50 Hz."""
_HARMONIC = 0.15


class TransmissionError(Effect):
    """Gear error `amplitude sin(order q + phase)`, `order` in cycles a turn; `third` of it at three times the order."""

    effect: Literal["transmission_error"] = "transmission_error"
    axis: Axis
    order: float = Field(gt=0, le=1000)
    amplitude_deg: float = size(2, 0.005, least=0.0)
    phase_deg: float = shape(-360, 360, 0.0)
    third: float = shape(-1, 1, 0.0)

    STAGE = "joint"
    PART = "curve"
    # A gear left open begins with an eccentric wheel and twice that.
    PLACE = Place(
        rf"(?:(?P<axis>[1-7])(?::(?P<order>{NUMBER}))?)?", "4:2 (axis:order)", {"axis": EVERY_AXIS, "order": "12"}
    )
    FREE = (FreeShape("third", 0.0, 0.3),)
    # What goes less often than once a turn does not come back with the joint: no gear makes it.
    STRETCHED = (StretchedShape("order", 0.03, least=0.5, low=1.0),)

    def apply(self, scene: S) -> S:
        """N = 1 is an eccentric wheel; the gear ratio, twice the wave generator, the tooth mesh are others."""
        turn = self.order * scene.q[:, self.axis - 1] + np.radians(self.phase_deg)
        wave = np.sin(turn) + self.third * np.sin(3 * turn) if self.third else np.sin(turn)
        return scene.turned(self.axis, np.radians(self.amplitude_deg) * wave)

    @classmethod
    def forms(cls, scope: Scope) -> list[list[TransmissionError]]:
        """Waves of each joint, by order: as dense as the readings part them."""
        most = _MOST_ORDER if scope.timed else _MOST_OF_STANDS
        return [
            [cls(axis=axis, order=order) for order in _orders_for(scope.turned[axis - 1], most)] for axis in scope.axes
        ]

    def plain(self, joint: str) -> str:
        return f"gear error of {joint}, {whole_order(self.order):.4g} a turn"

    def remedy(self) -> str:
        return (
            f"inspect the gear stage of axis {self.axis} that turns {whole_order(self.order):.4g} times a turn of it:"
            f" ± {self.amplitude_deg:.4f}°"
        )

    def compensation(self) -> Compensation:
        """It depends on the posture alone."""
        return BY_TARGETS

    def departures(self) -> Departures:
        """Harmonics: no gear makes a pure wave."""
        return Departures(
            tuple(
                (_HARMONIC, self.model_copy(update={"order": n * self.order, "phase_deg": phase, "third": 0.0}))
                for n in (2, 3)
                for phase in (0.0, 90.0)
            )
        )


def _orders_for(turned: float, most: int) -> list[int]:
    """Orders as far apart as a joint that turns so far (in turns) parts, low ones by a third; fits find the rest."""
    orders, order = [], 1.0
    while order <= most:
        if order * turned < _MOST_WAVES:
            orders.append(round(order))
        order += max(1.0, min(0.8 / max(turned, 1e-3), 0.35 * order))
    return orders
