"""How a gauge's reading relates in time to its request and its answer."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from rigs.schema.part import Part

Latch = Literal["on_request", "own_cycle", "streamed", "unknown"]
"""on_request: the reading is taken between request and answer. own_cycle: the answer is the last reading of a cycle
that runs by itself. streamed: the reading is taken as it is sent. unknown: no source says, so the data are searched."""

_FILTER_U = 0.1
"""Makers state the length of an averaging filter, and seldom its shape; a tenth of the delay is assumed."""


class Timing(Part):
    """When the reading in an answer was latched. An emulated gauge does what is stated here."""

    latch: Latch = "unknown"
    cycle_ms: float | None = Field(default=None, gt=0, le=10_000)
    """Length of an own cycle, or the pace of a streamed gauge."""
    filter_ms: float = Field(default=0.0, ge=0, le=10_000)
    """Group delay of the averaging filter: of a moving average over n cycles, (n - 1)/2 cycles."""
    filter_u_ms: float | None = Field(default=None, ge=0, le=10_000)
    """Standard uncertainty of it; a tenth where it is not stated."""
    answer_delay_ms: float = Field(default=0.0, ge=0, le=10_000)
    """What passes at the least between the end of the request and the answer in which no reading is taken."""
    latched_within_ms: float | None = Field(default=None, gt=0, le=10_000)
    """The reading is taken no later than this after the end of the request."""

    @model_validator(mode="after")
    def _consistent(self) -> Timing:
        if self.latch != "on_request" and self.latched_within_ms is not None:
            raise ValueError("latched_within_ms belongs to `latch: on_request`; state that, or leave it out")
        if self.cycle_ms is not None and self.latch not in ("own_cycle", "streamed"):
            raise ValueError("cycle_ms belongs to `latch: own_cycle` or `latch: streamed`; state one, or leave it out")
        return self

    def require_unasked(self) -> None:
        """Check the timing of a gauge that sends unasked. Raises ValueError where it is timed by a request."""
        if self.latch == "on_request" or self.answer_delay_ms:
            raise ValueError(
                "timing is that of an answer to a request, but this gauge sends unasked; state `latch: streamed` or "
                "`latch: own_cycle`, and leave answer_delay_ms out"
            )

    @property
    def filter_uncertainty_ms(self) -> float:
        """Standard uncertainty of the filter's delay."""
        return _FILTER_U * self.filter_ms if self.filter_u_ms is None else self.filter_u_ms

    def __str__(self) -> str:
        words = self.latch.replace("_", " ")
        stated = {"of": self.cycle_ms, "within": self.latched_within_ms}
        further = {"filter": self.filter_ms, "answer delay": self.answer_delay_ms}
        parts = [f"{key} {value:g} ms" for key, value in stated.items() if value is not None]
        parts += [f"{key} {value:g} ms" for key, value in further.items() if value]
        return " ".join([words, ", ".join(parts)]).strip()
