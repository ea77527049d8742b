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


_LEAST_MM = 1.0
"""Least length of a tool, or of a ball on it. Chosen: the longest tools have 1 m, 1.0 in metres."""


def place_not_in_metres(place: Vector) -> Vector:
    """A place on the flange in mm unchanged. Raises ValueError if no coordinate reaches 1 mm, because the place
    was probably meant in metres.
    """
    if 0 < max(map(abs, place)) < _LEAST_MM:
        in_mm = ", ".join(f"{MM_PER_M * value:g}" for value in place)
        raise ValueError(
            f"[{', '.join(f'{value:g}' for value in place)}] has no coordinate of {_LEAST_MM:g} mm or more; it looks "
            f"like metres: multiply it by {MM_PER_M} and write [{in_mm}]"
        )
    return place


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
