"""What every gauge of a rig file has, whatever it speaks.

How a gauge's reading relates in time to its request and its answer.
"""

from __future__ import annotations

import datetime as dt
from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator, Field, model_validator

from rigs.schema.certificate import GaugeCertificate
from rigs.schema.links import ModemLines, Port
from rigs.schema.part import Length, Origin, Part

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


Units = Literal["mm", "um", "inch"]
Counts = Literal["away", "towards"]
MM_PER_UNIT: dict[Units, float] = {"mm": 1.0, "um": 1e-3, "inch": 25.4}


def _rising(limits_mm: tuple[float, float]) -> tuple[float, float]:
    if not limits_mm[0] < limits_mm[1]:
        raise ValueError("the first limit must be below the second; write [lowest, highest]")
    return limits_mm


Range = Annotated[tuple[Length, Length], AfterValidator(_rising)]
"""The lowest and the highest reading, mm."""


class Probe(Part):
    """One gauge: its port, its place on the baseline, and how far to trust it."""

    origin: ClassVar[Origin]
    shares: ClassVar[bool] = False
    """Whether several gauges on one port come in one answer, distinguished by `channel`."""
    cables: ClassVar[dict[str, ModemLines]] = {}
    """The modem lines of each kind of cable that takes its power from them."""
    bus: ClassVar[bool] = False
    """Whether several gauges may be on one port, each asked by itself."""
    request_bytes: ClassVar[int] = 1
    """Characters of a request on a serial line, from which its wire time follows: at the least."""
    timing_source: ClassVar[str] = "no public source says when a reading is latched"
    """Where the default of `timing` is known from."""

    port: Port
    """Serial device, better by its name in `/dev/serial/by-id/`, or `tcp://host:number`."""
    channel: int = Field(default=1, ge=1, le=32)
    """Its place in an answer that several gauges on one port share; 1 where an instrument carries one gauge."""
    units: Units = "mm"
    """What the instrument is set to; a reading that comes in another unit is a fault, never a value."""
    counts: Counts = "away"
    """When its reading grows: as the tool moves away from the ball, or towards it, as most gauges do whose plunger is
    pushed in by that. A run keeps the reading as it is shown."""
    offset_mm: Length
    """Place on the baseline, along y_T (yaw) or x_T (roll): +25 for gauge 1, -25 for gauge 2."""
    accuracy_mm: float = Field(default=0.0005, gt=0, le=10)
    """Standard uncertainty of one reading beside what all readings share, which the certificate has."""
    range_mm: Range | None = None
    """The lowest and the highest reading that the gauge can give; a reading outside is a fault, and left out."""
    certificate: GaugeCertificate | None = None
    calibrated: dt.date | None = None
    """When it was calibrated, in files older than `certificate`; nothing follows from it."""
    timeout_s: float = Field(default=0.5, ge=0.01, le=60)
    """Without an answer for so long it counts as silent."""
    timing: Timing = Timing()
    """When a reading was latched; what the rig file states takes the place of all of the maker's default."""

    @property
    def modem(self) -> ModemLines | None:
        """The modem lines that its cable needs; None where it needs none, and both are on."""
        return None

    @property
    def sign(self) -> int:
        """What a reading is multiplied by to grow with the distance from the ball."""
        return 1 if self.counts == "away" else -1

    @property
    def place(self) -> str:
        """Which of the gauges on one port it is."""
        return f"channel {self.channel}"

    @property
    def limits_mm(self) -> tuple[float, float] | None:
        """The lowest and the highest reading, where they are to be checked."""
        return self.range_mm
