"""Base of all parts of a rig file (unknown keys are refused, values are immutable), and the provenance of interfaces.

`rig interfaces` lists the sources of each interface, and their reliability.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

MM_PER_M = 1000
"""Factor between a length in mm and the same length written in metres."""

LONGEST_MM = 1e5
"""Largest length: 100 m, more than any cell. This refuses errors by orders of magnitude immediately."""
Length = Annotated[float, Field(ge=-LONGEST_MM, le=LONGEST_MM)]
"""Length in mm."""
Angle = Annotated[float, Field(ge=-1440, le=1440)]
"""Angle in degrees. Four turns are more than a wrist can make."""
Vector = tuple[Length, Length, Length]
Axis = Annotated[int, Field(ge=1, le=7)]


class Part(BaseModel):
    """A mapping in a rig file."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)


Standing = Literal["confirmed", "weak", "unconfirmed"]
"""Reliability of a source.

confirmed: from the maker's manual, public code, or a captured wire. weak: second-hand. unconfirmed: assumed.
"""


@dataclass(frozen=True)
class Origin:
    """Provenance of an interface.

    instruments: makers and models, for display. source: manual and page, public code, or a capture. standing:
    reliability of the complete conversation. doubts: unconfirmed details as text, empty if there are none.
    """

    instruments: str
    source: str
    standing: Standing
    doubts: str = ""
