"""What all parts of a rig file share: unknown keys refused, values frozen."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

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
