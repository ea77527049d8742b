"""Common part of all gauges, with the timing of readings and the certificates of gauge, ball and link."""

from __future__ import annotations

import calendar
import datetime as dt
from itertools import pairwise
from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator, Field, field_validator, model_validator

from rigs.schema.links import ModemLines, Port
from rigs.schema.part import Length, Origin, Part

Correction = Annotated[float, Field(ge=-1, le=1)]
"""Correction in mm. A larger value suggests the table of a different gauge, or a table in µm."""
Celsius = Annotated[float, Field(ge=-50, le=100)]
_TIME_ZONES = dt.timedelta(days=1)
"""Tolerance for the date of a certificate, which may be that of tomorrow in an eastern time zone."""
_STEPS = 200
"""Number of points at which the range of a polynomial is checked."""


class Temperature(Part):
    """Temperature of gauges, link and ball during the measurement."""

    mean_c: Celsius
    u_c: float = Field(ge=0, le=50)
    """Standard uncertainty of the temperature, including changes during a run."""


class Certificate(Part):
    """Common part of certificates. The uncertainty is expanded, U = k u, as usual in certificates."""

    number: str = Field(min_length=1, max_length=100)
    date: dt.date
    valid_until: dt.date | None = None
    interval_months: int | None = Field(default=None, ge=1, le=240)
    """Interval until the next calibration, as an alternative to valid_until."""
    u_mm: float = Field(ge=0, le=10)
    k: float = Field(gt=0, le=10)
    """Coverage factor of u_mm: u_mm / k is the standard uncertainty."""
    reference_c: Celsius = 20.0
    """Reference temperature of the certificate; 20 °C by ISO 1."""
    coefficient_per_c: float = Field(default=0.0, ge=-1e-3, le=1e-3)
    """Thermal expansion: 11.5e-6 for steel; 0 if unknown and not corrected."""

    @field_validator("date")
    @classmethod
    def _has_been(cls, date: dt.date) -> dt.date:
        if date > dt.datetime.now(dt.UTC).date() + _TIME_ZONES:
            raise ValueError(f"{date} is in the future; give the day of the calibration")
        return date

    @model_validator(mode="after")
    def _due_once(self) -> Certificate:
        if self.valid_until and self.interval_months:
            raise ValueError("valid_until and interval_months both define the due date; remove one of them")
        if self.valid_until and self.valid_until <= self.date:
            raise ValueError(f"valid_until {self.valid_until} must be after the date {self.date}; correct one of them")
        return self

    @property
    def due(self) -> dt.date | None:
        if self.interval_months is None:
            return self.valid_until
        years, month = divmod(self.date.month - 1 + self.interval_months, 12)
        year = self.date.year + years
        return dt.date(year, month + 1, min(self.date.day, calendar.monthrange(year, month + 1)[1]))


class GaugeCertificate(Certificate):
    """Certificate of a gauge: optional correction of the readings, as a table or a polynomial."""

    correction_mm: tuple[tuple[Length, Correction], ...] = Field(default=(), max_length=10_000)
    """Pairs of a reading and its correction, interpolated linearly."""
    polynomial_mm: tuple[Annotated[float, Field(ge=-1e6, le=1e6)], ...] = Field(default=(), max_length=20)
    """Coefficients c0, c1, c2, …: the correction is c0 + c1 r + c2 r² + … mm for the reading r mm."""
    range_mm: tuple[Length, Length] | None = None
    """Valid readings of the polynomial. A table defines the range by itself."""

    @field_validator("correction_mm")
    @classmethod
    def _rises(cls, table: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        if len(table) == 1:
            raise ValueError(
                "has only one pair, but a table needs at least two; give [reading, correction] at both ends"
            )
        for (before, _), (reading, _) in pairwise(table):
            if reading <= before:
                raise ValueError(
                    f"readings must increase, but {reading:g} mm follows {before:g} mm; sort the readings, each once"
                )
        _require_rising(table, "correct the table")
        return table

    @model_validator(mode="after")
    def _one_form(self) -> GaugeCertificate:
        if self.correction_mm and self.polynomial_mm:
            raise ValueError("correction_mm and polynomial_mm both define the correction; remove one of them")
        if bool(self.polynomial_mm) != (self.range_mm is not None):
            raise ValueError("polynomial_mm and range_mm belong together; give both or neither")
        if self.range_mm is not None:
            low, high = self.range_mm
            if low >= high:
                raise ValueError(f"range_mm is from {low:g} to {high:g}; give the smaller end first")
            table = list[tuple[float, float]]()
            for step in range(_STEPS + 1):
                reading = low + (high - low) * step / _STEPS
                correction = sum(c * reading**power for power, c in enumerate(self.polynomial_mm))
                table.append((reading, correction))
            _require_rising(table, "correct polynomial_mm, with mm as input and output")
        return self

    @property
    def valid_mm(self) -> tuple[float, float] | None:
        return (self.correction_mm[0][0], self.correction_mm[-1][0]) if self.correction_mm else self.range_mm


class Ball(Certificate):
    """Certificate of the base-ball: roundness."""

    form_mm: float = Field(ge=0, le=1)
    """Form error, peak to valley, of the region touched by the link."""


class BallLink(Certificate):
    """Certificate of the link for the hemisphere: distance between the balls at a gauge reading of 0."""

    length_mm: float = Field(ge=1, le=10_000)


def _require_rising(table: tuple[tuple[float, float], ...] | list[tuple[float, float]], remedy: str) -> None:
    for (before, least), (reading, correction) in pairwise(table):
        if reading + correction <= before + least:
            raise ValueError(
                f"corrected readings must increase, but they decrease between {before:g} and {reading:g} mm; {remedy}"
            )


Latch = Literal["on_request", "own_cycle", "streamed", "unknown"]
"""on_request: the reading is taken between request and answer. own_cycle: the answer is the latest reading of an
internal cycle. streamed: the reading is taken when sent. unknown: no source, so the delay is estimated from the data.
"""

_FILTER_U = 0.1
"""Relative uncertainty of the delay of a filter: makers give its length, but rarely the shape."""


class Timing(Part):
    """Latching time of the reading in an answer. Emulated gauges follow it."""

    latch: Latch = "unknown"
    cycle_ms: float | None = Field(default=None, gt=0, le=10_000)
    """Length of an internal cycle, or the interval of a streaming gauge."""
    filter_ms: float = Field(default=0.0, ge=0, le=10_000)
    """Group delay of the averaging filter. For a moving average over n cycles it is (n-1)/2 cycles."""
    filter_u_ms: float | None = Field(default=None, ge=0, le=10_000)
    """Standard uncertainty of the group delay; one tenth by default."""
    answer_delay_ms: float = Field(default=0.0, ge=0, le=10_000)
    """Minimum delay of the answer, during which no reading is taken."""
    latched_within_ms: float | None = Field(default=None, gt=0, le=10_000)
    """Latest latching time after the end of the request."""

    @model_validator(mode="after")
    def _consistent(self) -> Timing:
        if self.latch != "on_request" and self.latched_within_ms is not None:
            raise ValueError("latched_within_ms requires `latch: on_request`; add that, or remove the key")
        if self.cycle_ms is not None and self.latch not in ("own_cycle", "streamed"):
            raise ValueError(
                "cycle_ms requires `latch: own_cycle` or `latch: streamed`; add one of them, or remove the key"
            )
        return self

    def require_unasked(self) -> None:
        """Check the timing of a gauge that sends unprompted. Raises ValueError for a timing relative to requests."""
        if self.latch == "on_request" or self.answer_delay_ms:
            raise ValueError(
                "the timing is for an answer to a request, but this gauge sends unprompted; write `latch: "
                "streamed` or `latch: own_cycle`, and remove answer_delay_ms"
            )

    @property
    def filter_uncertainty_ms(self) -> float:
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
"""Lowest and highest reading in mm."""


class Probe(Part):
    """Gauge: port, position on the baseline, and accuracy."""

    origin: ClassVar[Origin]
    shares: ClassVar[bool] = False
    """True if an answer contains several gauges of a port, distinguished by `channel`."""
    cables: ClassVar[dict[str, ModemLines]] = {}
    """Modem lines by kind of cable, for cables powered by the port."""
    bus: ClassVar[bool] = False
    """True if a port can have several gauges, polled separately."""
    ends_in_cr: ClassVar[bool] = False
    """True if messages end in a single carriage return, which also fits instruments that add a line feed."""
    request_bytes: ClassVar[int] = 1
    """Minimum number of characters of a request on a serial line, for the transmission time."""
    timing_source: ClassVar[str] = "the instant of a reading is not published"
    """Source of the default `timing`."""

    port: Port
    """Serial device, preferably by a name in `/dev/serial/by-id/`, or `tcp://host:number`."""
    channel: int = Field(default=1, ge=1, le=32)
    """Index in an answer shared by the gauges of a port; 1 for an instrument with a single gauge."""
    units: Units = "mm"
    """Unit set at the instrument. A reading in a different unit is a fault, never a value."""
    counts: Counts = "away"
    """Direction of increasing readings: as the tool moves away from the ball, or towards it. Most plunger gauges count
    towards it, because the plunger is then pushed in. Runs store readings as displayed.
    """
    offset_mm: Length
    """Position on the baseline, along y_T (yaw) or x_T (roll): +25 for gauge 1, -25 for gauge 2."""
    accuracy_mm: float = Field(default=0.0005, gt=0, le=10)
    """Standard uncertainty of a single reading. Errors common to all readings belong to the certificate."""
    range_mm: Range | None = None
    """Lowest and highest possible reading. A reading outside this range is counted as a fault and dropped."""
    certificate: GaugeCertificate | None = None
    calibrated: dt.date | None = None
    """Calibration date, in files older than `certificate`; not used."""
    timeout_s: float = Field(default=0.5, ge=0.01, le=60)
    """Time without an answer after which the gauge counts as silent."""
    timing: Timing = Timing()
    """Latching time of readings. A value in the rig file replaces the default of the maker completely."""

    @property
    def modem(self) -> ModemLines | None:
        """Modem lines required by the cable; None if it needs none, and both are on."""
        return None

    @property
    def sign(self) -> int:
        """Sign that makes readings increase with the distance from the ball."""
        return 1 if self.counts == "away" else -1

    @property
    def place(self) -> str:
        return f"channel {self.channel}"

    @property
    def limits_mm(self) -> tuple[float, float] | None:
        return self.range_mm
