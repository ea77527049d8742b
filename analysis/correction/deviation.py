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


@dataclass(frozen=True)
class Side:
    """The error on the same circle or at the other place: before and after, None where nothing was driven afterwards,
    and what was expected."""

    place: Literal["same", "elsewhere"]
    before: Deviation
    after: Deviation | None
    expected: Expected | None
