"""What calibration certificates say: of a gauge, of the ball's form, of the link's length; and how warm the cell is."""

from __future__ import annotations

import calendar
import datetime as dt
from itertools import pairwise
from typing import Annotated

from pydantic import Field, field_validator, model_validator

from rigs.schema.part import Length, Part

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
