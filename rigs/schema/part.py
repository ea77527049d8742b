"""Base of all parts of a rig file (unknown keys refused, values frozen), and the provenance of interfaces.

`rig interfaces` lists the sources of each interface and their reliability.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

MM_PER_M = 1000
"""Factor between a length in mm and the same length written in metres."""

LONGEST_MM = 1e5
"""Largest length: no cell is longer than 100 m. It catches errors by orders of magnitude immediately."""
Length = Annotated[float, Field(ge=-LONGEST_MM, le=LONGEST_MM)]
Angle = Annotated[float, Field(ge=-1440, le=1440)]
"""An angle in degrees. Four turns are more than any wrist can make."""
Vector = tuple[Length, Length, Length]
Axis = Annotated[int, Field(ge=1, le=7)]


class Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)


Standing = Literal["confirmed", "weak", "unconfirmed"]
"""confirmed: from the manual of the maker, public code, or a captured wire. weak: second-hand. unconfirmed: assumed."""


@dataclass(frozen=True)
class Origin:
    """Provenance of an interface."""

    instruments: str
    """Makers and models, for display."""
    source: str
    """Manual and page, public code, or a capture."""
    standing: Standing
    """Reliability of the complete conversation."""
    doubts: str = ""
    """Unconfirmed details."""
