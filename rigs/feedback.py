"""Where the robot's position comes from. `interface` is the name of a file in `daq/feedback/`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator

from rigs.base import Part
from rigs.links import Port

JOINT_FIELDS = {f"q{axis}_{unit}" for axis in range(1, 7) for unit in ("deg", "rad")}
CLOCK_FIELDS = {"t_s", "t_ms", "t_us"}


class URRTDE(Part):
    """Universal Robots, Real-Time Data Exchange."""

    interface: Literal["ur_rtde"]
    port: Port
    rate_hz: float = Field(default=500, ge=1, le=500)
    timeout_s: float = Field(default=2.0, ge=0.01, le=60)


class LineFeed(Part):
    """What a user's program on the controller prints: one line a sample over TCP."""

    interface: Literal["line_feed"]
    port: Port
    fields: tuple[str, ...] = ("t_ms", *(f"q{axis}_deg" for axis in range(1, 7)))
    """Names in the order of the line: q1_deg … q6_deg (or _rad), at most one of t_s, t_ms, t_us; `_` is skipped."""
    separator: str = Field(default=",", min_length=1)
    """A blank stands for any run of blanks and tabs."""
    timeout_s: float = Field(default=2.0, ge=0.01, le=60)

    @field_validator("fields")
    @classmethod
    def _known(cls, fields: tuple[str, ...]) -> tuple[str, ...]:
        unknown = [name for name in fields if name not in JOINT_FIELDS | CLOCK_FIELDS | {"_"}]
        if unknown:
            raise ValueError(f"unknown field {unknown[0]!r}; known: q1_deg … q6_deg, q1_rad …, t_s, t_ms, t_us, _")
        axes = [name[:2] for name in fields if name in JOINT_FIELDS]
        if sorted(axes) != [f"q{axis}" for axis in range(1, 7)]:
            raise ValueError("each of q1 … q6 must stand in the line once, in _deg or _rad")
        if len(CLOCK_FIELDS & set(fields)) > 1:
            raise ValueError("only one of t_s, t_ms, t_us can be the controller's clock")
        return fields


Feedback = Annotated[URRTDE | LineFeed, Field(discriminator="interface")]
