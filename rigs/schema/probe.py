"""What every gauge of a rig file has, whatever it speaks: how its reading relates in time to its request and its
answer, and what calibration certificates say, of a gauge, of the ball's form and of the link's length; and how warm the
cell is."""

from __future__ import annotations

import calendar
import datetime as dt
from itertools import pairwise
from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator, Field, field_validator, model_validator

from rigs.schema.links import ModemLines, Port
from rigs.schema.part import Length, Origin, Part

Correction = Annotated[float, Field(ge=-1, le=1)]
"""mm; what is off by more is another gauge's table, or one in µm."""
Celsius = Annotated[float, Field(ge=-50, le=100)]
_TIME_ZONES = dt.timedelta(days=1)
"""A certificate written today further east may bear tomorrow's date."""
_STEPS = 200
"""Steps in which the range of a polynomial is checked."""


class Temperature(Part):
    """Temperature of gauges, link and ball while the cell is measured."""

    mean_c: Celsius
    u_c: float = Field(ge=0, le=50)
    """Standard uncertainty of it, with its changes during a run."""


class Certificate(Part):
    """What every certificate has. The uncertainty is the expanded one, U = k u, as certificates state it."""

    number: str = Field(min_length=1, max_length=100)
    date: dt.date
    valid_until: dt.date | None = None
    interval_months: int | None = Field(default=None, ge=1, le=240)
    """After which the next calibration is due; instead of valid_until."""
    u_mm: float = Field(ge=0, le=10)
    k: float = Field(gt=0, le=10)
    """Coverage factor of u_mm: u_mm / k is the standard uncertainty."""
    reference_c: Celsius = 20.0
    """Temperature that the certificate holds for; 20 °C by ISO 1."""
    coefficient_per_c: float = Field(default=0.0, ge=-1e-3, le=1e-3)
    """Growth with temperature: 11.5e-6 for steel, 0 where it is not known and left alone."""

    @field_validator("date")
    @classmethod
    def _has_been(cls, date: dt.date) -> dt.date:
        if date > dt.datetime.now(dt.UTC).date() + _TIME_ZONES:
            raise ValueError(f"{date} lies in the future; give the day of the calibration")
        return date

    @model_validator(mode="after")
    def _due_once(self) -> Certificate:
        if self.valid_until and self.interval_months:
            raise ValueError("valid_until and interval_months both say when it is due; leave one out")
        if self.valid_until and self.valid_until <= self.date:
            raise ValueError(f"valid_until {self.valid_until} is not after its date {self.date}; correct one of them")
        return self

    @property
    def due(self) -> dt.date | None:
        """The last day that it holds for; None where it does not say."""
        if self.interval_months is None:
            return self.valid_until
        years, month = divmod(self.date.month - 1 + self.interval_months, 12)
        year = self.date.year + years
        return dt.date(year, month + 1, min(self.date.day, calendar.monthrange(year, month + 1)[1]))


class GaugeCertificate(Certificate):
    """Certificate of a gauge: what is to be added to its readings, as a table or a polynomial, or neither."""

    correction_mm: tuple[tuple[Length, Correction], ...] = Field(default=(), max_length=10_000)
    """Pairs of a reading and its correction; straight lines between them."""
    polynomial_mm: tuple[Annotated[float, Field(ge=-1e6, le=1e6)], ...] = Field(default=(), max_length=20)
    """c0, c1, c2, …: the correction is c0 + c1 r + c2 r² + … mm of the reading r mm."""
    range_mm: tuple[Length, Length] | None = None
    """Readings that the polynomial holds for; a table has its own."""

    @field_validator("correction_mm")
    @classmethod
    def _rises(cls, table: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        if len(table) == 1:
            raise ValueError("has one pair, and a table needs two or more; give [reading, correction] at both ends")
        for (before, _), (reading, _) in pairwise(table):
            if reading <= before:
                raise ValueError(f"readings must rise, and {reading:g} mm follows {before:g} mm; sort them, each once")
        _hold_rising(table, "correct the table")
        return table

    @model_validator(mode="after")
    def _one_form(self) -> GaugeCertificate:
        if self.correction_mm and self.polynomial_mm:
            raise ValueError("correction_mm and polynomial_mm both say the correction; leave one out")
        if bool(self.polynomial_mm) != (self.range_mm is not None):
            raise ValueError("polynomial_mm and range_mm belong together; give both, or neither")
        if self.range_mm is not None:
            low, high = self.range_mm
            if low >= high:
                raise ValueError(f"range_mm goes from {low:g} to {high:g}; give the smaller end first")
            readings = [low + (high - low) * step / _STEPS for step in range(_STEPS + 1)]
            _hold_rising([(r, self._polynomial(r)) for r in readings], "correct polynomial_mm, in mm of mm")
        return self

    def _polynomial(self, reading: float) -> float:
        value = 0.0
        for coefficient in reversed(self.polynomial_mm):
            value = value * reading + coefficient
        return value

    @property
    def valid_mm(self) -> tuple[float, float] | None:
        """The readings that the correction is known for; None without a correction."""
        return (self.correction_mm[0][0], self.correction_mm[-1][0]) if self.correction_mm else self.range_mm


class Ball(Certificate):
    """Certificate of the base-ball: how round it is."""

    form_mm: float = Field(ge=0, le=1)
    """Deviation from round, peak to valley, of the part that the link touches."""


class Link(Certificate):
    """Certificate of the link that is set for the hemisphere: its length from ball to ball where its gauge shows 0."""

    length_mm: float = Field(ge=1, le=10_000)


def _hold_rising(table: tuple[tuple[float, float], ...] | list[tuple[float, float]], remedy: str) -> None:
    """Two readings corrected to one length, or in another order, are not a correction. Raises ValueError."""
    for (before, least), (reading, correction) in pairwise(table):
        if reading + correction <= before + least:
            raise ValueError(f"corrected readings fall between {before:g} and {reading:g} mm; {remedy}")


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
