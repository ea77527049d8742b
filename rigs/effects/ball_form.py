from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from rigs.schema.effect import Compensation, Departures, Effect, Scope, SeatNotation, shape, size
from rigs.schema.scene import S

_FEWEST, _MOST = 2, 30
_LIKELY = (2, 3, 4, 5, 6)
_NEIGHBOUR = 0.25


class BallForm(Effect):
    """Form error of the ball with `lobes` around it."""

    effect: Literal["ball_form"] = "ball_form"
    lobes: int = Field(ge=_FEWEST, le=_MOST)
    amplitude_mm: float = size(0.1, 0.001, least=0.0)
    phase_deg: float = shape(-360, 360, 0.0)

    STAGE = "setup"
    KIND_NAME = "form of the ball"
    PLAIN = "form of the ball, {e.lobes} lobes"
    REMEDY = (
        "the ball is out of round: turn the ball by 90° and repeat the measurement; replace the ball if the error "
        "turns with it"
    )
    CORRECTION = Compensation("none", "is a property of the ball, which the robot's controller cannot correct")
    DEED = "mount"
    PLACE = SeatNotation(r"(?P<lobes>\d+)", "3 (lobes)")

    def apply(self, scene: S) -> S:
        return scene.with_form(self.amplitude_mm * np.sin(self.lobes * scene.contact + np.radians(self.phase_deg)))

    @classmethod
    def forms(cls, scope: Scope) -> list[list[BallForm]]:
        return [[cls(lobes=lobes) for lobes in _LIKELY]] if scope.gauges else []

    def departures(self) -> Departures:
        """Deviations of a real ball: unequal lobes, represented by one lobe more and one lobe less."""
        near = [lobes for lobes in (self.lobes - 1, self.lobes + 1) if _FEWEST <= lobes <= _MOST]
        return Departures(
            tuple(
                (_NEIGHBOUR, self.model_copy(update={"lobes": lobes, "phase_deg": phase}))
                for lobes in near
                for phase in (0.0, 90.0)
            )
        )
