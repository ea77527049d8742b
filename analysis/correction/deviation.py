"""How far a robot is from its commanded path, before and after a correction: what sessions keep and pages show."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from rigs.schema.part import Part

NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
"""A length in µm, or seconds."""
Count = Annotated[int, Field(ge=0)]
"""How many runs."""


class Deviation(Part):
    """How far the tool drove from where the program sends it, in µm of the readings with set-ups fitted: root mean
    square and at most, in so many runs. u_um: standard uncertainty of the root mean square."""

    um: NotNegative
    largest_um: NotNegative
    u_um: NotNegative
    runs: Count


class Expected(Part):
    """What a correction is expected to leave, µm rms, with its standard uncertainty by the model, None where its runs
    do not say how well it is known."""

    um: float
    u_um: float | None

    @property
    def text(self) -> str:
        """`1.9 ± 7.7 µm rms`, or why there is no ±."""
        if self.u_um is None:
            return f"{self.um:.1f} µm rms, without u: the runs behind the model do not say how well it holds there"
        return f"{self.um:.1f} ± {self.u_um:.1f} µm rms"


class Work(Part):
    """The error of the tool's place over the work of the rig file, µm rms, without and with the correction; u_um: the
    standard uncertainty of the model there, a part of after_um; unknown: the share of the work at which no run says how
    well the arm is known, so that both are the model's guess there."""

    before_um: float
    after_um: float
    u_um: float
    unknown: Annotated[float, Field(ge=0, le=1)] = 0.0


@dataclass(frozen=True)
class Side:
    """The error on the same circle or at the other place: before and after, None where nothing was driven afterwards,
    and what was expected."""

    place: Literal["same", "elsewhere"]
    before: Deviation
    after: Deviation | None
    expected: Expected | None
