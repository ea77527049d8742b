"""Deviation of a robot from the commanded path, before and after a correction, for sessions and pages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from rigs.schema.part import Part

NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
"""Length in µm, or seconds."""
Count = Annotated[int, Field(ge=0)]
"""Number of runs."""


class Deviation(Part):
    """Deviation of the tool from the program, in µm of the readings with fitted set-ups, over several runs. u_um:
    standard uncertainty of the rms, 0 if no repeats measured it.
    """

    um: NotNegative
    largest_um: NotNegative
    u_um: NotNegative
    runs: Count


class Expected(Part):
    """Expected remaining error of a correction, µm rms, with the standard uncertainty by the model, None if unknown."""

    um: float
    u_um: float | None

    @property
    def text(self) -> str:
        if self.u_um is None:
            return f"{self.um:.1f} µm rms, uncertainty unknown: the calibration runs do not cover this place"
        return f"{self.um:.1f} ± {self.u_um:.1f} µm rms"


class Work(Part):
    """Position error of the tool over the work area of the rig file, µm rms, uncorrected and corrected.

    u_um: standard uncertainty of the model there, included in after_um. unknown: share of the work area not covered by
    runs.
    """

    before_um: float
    after_um: float
    u_um: float
    unknown: Annotated[float, Field(ge=0, le=1)] = 0.0


@dataclass(frozen=True)
class Side:
    """Error on the same circle or at a second place: before, after (None without later runs), and expected."""

    place: Literal["same", "elsewhere"]
    before: Deviation
    after: Deviation | None
    expected: Expected | None
