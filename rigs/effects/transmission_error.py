from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from rigs.schema.effect import (
    BY_TARGETS,
    EVERY_AXIS,
    NUMBER,
    Departures,
    Effect,
    FreeShape,
    Scope,
    SeatNotation,
    StretchedShape,
    shape,
    size,
    waves_in_words,
    whole_order,
)
from rigs.schema.part import Axis
from rigs.schema.scene import S

_MOST_ORDER, _MOST_OF_STANDS = 200, 100
"""Highest orders of the waves tried: on circles, with slowly turning joints, and for static poses, which hardly show
higher orders: 60, 100 or 200 made little difference between two series of a UR10.
"""
_MOST_WAVES = 135
"""Maximum number of waves within the range of a joint: three readings per wave in a lap of 8 s at 50 Hz."""
_HARMONIC = 0.15


class TransmissionError(Effect):
    """Gear error `amplitude sin(order q + phase)`, with `order` in cycles per turn.

    third: share of the wave at three times the order.
    """

    effect: Literal["transmission_error"] = "transmission_error"
    axis: Axis
    order: float = Field(gt=0, le=1000)
    amplitude_deg: float = size(2, 0.005, least=0.0)
    phase_deg: float = shape(-360, 360, 0.0)
    third: float = shape(-1, 1, 0.0)

    STAGE = "joint"
    KIND_NAME = "gear error"
    CORRECTION = BY_TARGETS
    SEAT_NOUN = "axis"
    PART = "curve"
    # An open gear starts with eccentricity and twice that order.
    PLACE = SeatNotation(
        rf"(?:(?P<axis>[1-7])(?::(?P<order>{NUMBER}))?)?", "4:2 (axis:order)", {"axis": EVERY_AXIS, "order": "12"}
    )
    FREE = (FreeShape("third", 0.0, 0.3),)
    # A period of more than a turn does not repeat with the joint, so gears cannot cause it.
    STRETCHED = (StretchedShape("order", 0.03, least=0.5, low=1.0),)

    def apply(self, scene: S) -> S:
        """Turn the joint by the wave.

        N = 1 is eccentricity; the gear ratio, twice the wave generator and the tooth mesh are other orders.
        """
        turn = self.order * scene.q[:, self.axis - 1] + np.radians(self.phase_deg)
        wave = np.sin(turn) + self.third * np.sin(3 * turn) if self.third else np.sin(turn)
        return scene.turned(self.axis, np.radians(self.amplitude_deg) * wave)

    @classmethod
    def forms(cls, scope: Scope) -> list[list[TransmissionError]]:
        most = _MOST_ORDER if scope.timed else _MOST_OF_STANDS
        return [
            [cls(axis=axis, order=order) for order in _orders_for(scope.turned[axis - 1], most)] for axis in scope.axes
        ]

    @property
    def repeats_each_turn(self) -> bool:
        return self.order % 1 == 0

    def plain(self, joint: str) -> str:
        return f"gear error of {joint}, {waves_in_words(self.order)}"

    def remedy(self) -> str:
        return (
            f"inspect the gear stage of axis {self.axis} with {whole_order(self.order):.4g} turns per turn "
            f"of the axis: ± {self.amplitude_deg:.4f}°"
        )

    def departures(self) -> Departures:
        """Deviations of a real gear from a pure sine: harmonics."""
        return Departures(
            tuple(
                (_HARMONIC, self.model_copy(update={"order": n * self.order, "phase_deg": phase, "third": 0.0}))
                for n in (2, 3)
                for phase in (0.0, 90.0)
            )
        )


def _orders_for(turned: float, most: int) -> list[int]:
    """Orders distinguishable over the range of the joint (in turns).

    Low orders are denser by a third; fits refine them.
    """
    orders, order = [], 1.0
    while order <= most:
        if order * turned < _MOST_WAVES:
            orders.append(round(order))
        order += max(1.0, min(0.8 / max(turned, 1e-3), 0.35 * order))
    return orders
