"""Effects known of a rig: why link side = reported + effect. Names and signs as in the shared vocabulary.

Each class is served by the file of the same name in `analysis/effects/`.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from rigs.base import Axis, Part


class JointOffset(Part):
    """The datum location error: link = reported + offset."""

    effect: Literal["joint_offset"]
    axis: Axis
    offset_deg: float = Field(ge=-5, le=5)


class Backlash(Part):
    """A play of `width_deg`; under friction the link lags, -w/2 while q rises, +w/2 while it falls."""

    effect: Literal["backlash"]
    axis: Axis
    width_deg: float = Field(ge=0, le=2)


class TransmissionError(Part):
    """Gear error `amplitude sin(order q + phase)`, `order` in cycles a turn of the joint."""

    effect: Literal["transmission_error"]
    axis: Axis
    order: float = Field(gt=0, le=1000)
    amplitude_deg: float = Field(ge=0, le=2)
    phase_deg: float = 0.0


Effect = Annotated[JointOffset | Backlash | TransmissionError, Field(discriminator="effect")]
