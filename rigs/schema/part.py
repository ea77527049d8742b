"""What all parts of a rig file share: unknown keys refused, values frozen.

Where what is known of an interface comes from, and how far it can be trusted; `rig interfaces` lists it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

MM_PER_M = 1000
"""By how much a length is too small that was written in metres."""

LONGEST_MM = 1e5
"""No cell is longer than 100 m. What is meant to be wrong by orders of magnitude is refused where it stands."""
Length = Annotated[float, Field(ge=-LONGEST_MM, le=LONGEST_MM)]
"""mm."""
Angle = Annotated[float, Field(ge=-1440, le=1440)]
"""Degrees; four turns are more than a wrist makes."""
Vector = tuple[Length, Length, Length]
Axis = Annotated[int, Field(ge=1, le=7)]


class Part(BaseModel):
    """A mapping in a rig file."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)


Standing = Literal["confirmed", "weak", "unconfirmed"]
"""confirmed: read in the maker's manual or public code, or seen on a wire. weak: second-hand. unconfirmed: believed."""


@dataclass(frozen=True)
class Origin:
    """What an interface speaks to, and why it is believed to speak so.

    instruments: makers and models, for a person. source: manual and page, public code, or a capture. standing: of the
    whole conversation. doubts: what of it is not confirmed, in words; empty where everything is.
    """

    instruments: str
    source: str
    standing: Standing
    doubts: str = ""
