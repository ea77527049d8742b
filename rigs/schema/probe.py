"""Common part of all gauges: timing of readings, certificates of gauge, ball and link, and temperature."""

from __future__ import annotations

import calendar
import datetime as dt
from itertools import pairwise
from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator, Field, field_validator, model_validator

from rigs.schema.links import ModemLines, Port
from rigs.schema.part import Length, Origin, Part

Correction = Annotated[float, Field(ge=-1, le=1)]
"""Correction in mm. A larger value suggests the table of another gauge, or a table in µm."""
Celsius = Annotated[float, Field(ge=-50, le=100)]
_TIME_ZONES = dt.timedelta(days=1)
"""Tolerance of dates. A certificate from a place further east may have tomorrow's date."""
_STEPS = 200
"""Number of steps for checking the range of a polynomial."""


class Temperature(Part):
    """Temperature of gauges, link and ball during the measurement."""

    mean_c: Celsius
    u_c: float = Field(ge=0, le=50)
    """Standard uncertainty of the temperature, including changes during a run."""


class Certificate(Part):
    """Common part of certificates. The uncertainty is expanded, U = k u, as stated in certificates."""

    number: str = Field(min_length=1, max_length=100)
    date: dt.date
    valid_until: dt.date | None = None
    interval_months: int | None = Field(default=None, ge=1, le=240)
    """Interval until the next calibration, as an alternative to valid_until."""
    u_mm: float = Field(ge=0, le=10)
    k: float = Field(gt=0, le=10)
    """Coverage factor of u_mm. The standard uncertainty is u_mm / k."""
    reference_c: Celsius = 20.0
    """Reference temperature of the certificate; 20 °C by ISO 1."""
    coefficient_per_c: float = Field(default=0.0, ge=-1e-3, le=1e-3)
    """Thermal expansion: 11.5e-6 for steel, 0 if unknown and not corrected."""

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
        """Last day of validity, or None if not stated."""
        if self.interval_months is None:
            return self.valid_until
        years, month = divmod(self.date.month - 1 + self.interval_months, 12)
        year = self.date.year + years
        return dt.date(year, month + 1, min(self.date.day, calendar.monthrange(year, month + 1)[1]))


class GaugeCertificate(Certificate):
    """Certificate of a gauge, with an optional correction of the readings as a table or a polynomial."""

    correction_mm: tuple[tuple[Length, Correction], ...] = Field(default=(), max_length=10_000)
    """Pairs of a reading and its correction, interpolated linearly."""
    polynomial_mm: tuple[Annotated[float, Field(ge=-1e6, le=1e6)], ...] = Field(default=(), max_length=20)
    """Coefficients c0, c1, c2, … of the correction c0 + c1 r + c2 r² + … mm for a reading of r mm."""
    range_mm: tuple[Length, Length] | None = None
    """Range of readings for which the polynomial is valid. A table defines its own range."""

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
        """Range of readings with a known correction, None if readings are not corrected."""
        return (self.correction_mm[0][0], self.correction_mm[-1][0]) if self.correction_mm else self.range_mm


class Ball(Certificate):
    """Certificate of the base-ball: roundness."""

    form_mm: float = Field(ge=0, le=1)
    """Form error, peak to valley, of the region in contact with the link."""


class Link(Certificate):
    """Certificate of the link for the hemisphere: distance between the balls at a gauge reading of 0."""

    length_mm: float = Field(ge=1, le=10_000)


def _hold_rising(table: tuple[tuple[float, float], ...] | list[tuple[float, float]], remedy: str) -> None:
    """Check that the corrected readings of a table increase strictly. Raises ValueError."""
    for (before, least), (reading, correction) in pairwise(table):
        if reading + correction <= before + least:
            raise ValueError(f"corrected readings fall between {before:g} and {reading:g} mm; {remedy}")


Latch = Literal["on_request", "own_cycle", "streamed", "unknown"]
"""Time at which a reading is taken.

on_request: between request and answer. own_cycle: the answer is the latest reading of an internal cycle. streamed: when
the reading is sent. unknown: not documented, so the delay is estimated from the data.
"""

_FILTER_U = 0.1
"""Relative standard uncertainty of a filter's delay.
Makers state the length of an averaging filter, rarely the shape.
"""


class Timing(Part):
    """Time at which the reading in an answer was taken. Emulated gauges also use it."""

    latch: Latch = "unknown"
    cycle_ms: float | None = Field(default=None, gt=0, le=10_000)
    """Length of an internal cycle, or interval of a streaming gauge."""
    filter_ms: float = Field(default=0.0, ge=0, le=10_000)
    """Group delay of the averaging filter. For a moving average over n cycles, it is (n - 1)/2 cycles."""
    filter_u_ms: float | None = Field(default=None, ge=0, le=10_000)
    """Standard uncertainty of the group delay. Default: a tenth of it."""
    answer_delay_ms: float = Field(default=0.0, ge=0, le=10_000)
    """Smallest delay of the answer. No reading is taken during this delay."""
    latched_within_ms: float | None = Field(default=None, gt=0, le=10_000)
    """Latest time of the reading after the end of the request."""

    @model_validator(mode="after")
    def _consistent(self) -> Timing:
        if self.latch != "on_request" and self.latched_within_ms is not None:
            raise ValueError("latched_within_ms belongs to `latch: on_request`; state that, or leave it out")
        if self.cycle_ms is not None and self.latch not in ("own_cycle", "streamed"):
            raise ValueError("cycle_ms belongs to `latch: own_cycle` or `latch: streamed`; state one, or leave it out")
        return self

    def require_unasked(self) -> None:
        """Check the timing of a gauge that sends unprompted. Raises ValueError for a timing that refers to requests."""
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
"""Lowest and highest reading, in mm."""


class Probe(Part):
    """A gauge: port, position on the baseline, and accuracy."""

    origin: ClassVar[Origin]
    shares: ClassVar[bool] = False
    """True if an answer contains several gauges of a port, distinguished by `channel`."""
    cables: ClassVar[dict[str, ModemLines]] = {}
    """Modem lines by kind of cable, for cables that they power."""
    bus: ClassVar[bool] = False
    """True if a port can have several gauges, which are polled separately."""
    request_bytes: ClassVar[int] = 1
    """Smallest number of characters of a request on a serial line, which determines the transmission time."""
    timing_source: ClassVar[str] = "no public source says when a reading is latched"
    """Source of the default `timing`."""

    port: Port
    """Serial device, preferably by the name in `/dev/serial/by-id/`, or `tcp://host:number`."""
    channel: int = Field(default=1, ge=1, le=32)
    """Index in an answer shared by several gauges of a port, or 1 for an instrument with a single gauge."""
    units: Units = "mm"
    """Unit set at the instrument. A reading in another unit is a fault, and is never used."""
    counts: Counts = "away"
    """Direction of increasing readings: as the tool moves away from the ball, or towards it. Most plunger gauges
    count towards it, as the plunger is pushed in. Runs contain the readings as displayed.
    """
    offset_mm: Length
    """Position on the baseline, along y_T (yaw) or x_T (roll): +25 for gauge 1, -25 for gauge 2."""
    accuracy_mm: float = Field(default=0.0005, gt=0, le=10)
    """Standard uncertainty of a single reading. Errors common to all readings belong to the certificate."""
    range_mm: Range | None = None
    """Lowest and highest possible reading. A reading outside is a fault and is not used."""
    certificate: GaugeCertificate | None = None
    calibrated: dt.date | None = None
    """Calibration date in files older than `certificate`. Not used."""
    timeout_s: float = Field(default=0.5, ge=0.01, le=60)
    """Time without an answer after which the gauge counts as silent."""
    timing: Timing = Timing()
    """Timing of readings. A value in the rig file replaces the maker's default completely."""

    @property
    def modem(self) -> ModemLines | None:
        """Modem lines that the cable requires. None if it requires none, and both are on."""
        return None

    @property
    def sign(self) -> int:
        """Sign for which readings increase with the distance from the ball."""
        return 1 if self.counts == "away" else -1

    @property
    def place(self) -> str:
        """Identification of the gauge on a shared port."""
        return f"channel {self.channel}"

    @property
    def limits_mm(self) -> tuple[float, float] | None:
        """Lowest and highest reading, if readings are checked."""
        return self.range_mm
