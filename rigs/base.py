"""What all parts of a rig file share: unknown keys refused, values frozen."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Vector = tuple[float, float, float]
Axis = Annotated[int, Field(ge=1, le=6)]


class Part(BaseModel):
    """A mapping in a rig file."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
