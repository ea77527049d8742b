"""The gauges of a rig: which instrument, on which port, where on the baseline.

`interface` is the name of the file in `daq/gauges/` that speaks to it.
Gauges that name the same port share one instrument, and differ in `channel`.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

from pydantic import Field, field_validator, model_validator

from rigs.base import Length, Part
from rigs.links import Line, Port

MM_PER_UNIT = {"mm": 1.0, "um": 1e-3, "inch": 25.4}


class _Gauge(Part):
    request_bytes: ClassVar[int] = 1
    """Characters of a request on a serial line, from which its wire time follows: at the least."""
    port: Port
    channel: int = Field(default=1, ge=1, le=32)
    units: Literal["mm", "um", "inch"] = "mm"
    offset_mm: Length
    """Place on the baseline, along y_T (yaw) or x_T (roll): +25 for gauge 1, -25 for gauge 2."""
    accuracy_mm: float = Field(default=0.0005, gt=0, le=10)
    """Standard uncertainty of one reading, from its certificate."""
    calibrated: dt.date | None = None
    timeout_s: float = Field(default=0.5, ge=0.01, le=60)
    """Without an answer for so long it counts as silent."""


class SylvacOptoRS(_Gauge):
    """Sylvac simplex or duplex cable, and what speaks like it."""

    request_bytes = 2
    interface: Literal["sylvac_opto_rs"]
    line: Line = Line(baud=4800, bits=7, parity="E", stop=2)
    mode: Literal["polled", "continuous"] = "polled"


class KeyenceDLRS1A(_Gauge):
    """Keyence GT2 heads behind a DL-RS1A: every head in one answer."""

    request_bytes = 4
    interface: Literal["keyence_dl_rs1a"]
    line: Line = Line(baud=9600, bits=8, parity="N", stop=1)


class Register(Part):
    """One value in a Modbus register map."""

    address: int = Field(ge=0, le=65535)
    type: Literal["int16", "uint16", "int32", "uint32", "float32"]

    @property
    def count(self) -> int:
        """Registers it takes."""
        return 1 if self.type.endswith("16") else 2


class ValueRegister(Register):
    """The reading itself: `raw * scale + offset`, in the gauge's units."""

    scale: float = Field(default=1.0, ge=-1e6, le=1e6)
    offset: float = Field(default=0.0, ge=-1e6, le=1e6)

    @field_validator("scale")
    @classmethod
    def _not_zero(cls, value: float) -> float:
        if value == 0:
            raise ValueError("a scale of zero makes every reading the same; give the units of one count")
        return value


class StatusRegister(Register):
    """The instrument's own verdict on its reading; any value not listed is an error."""

    type: Literal["int16", "uint16", "int32", "uint32", "float32"] = "uint16"
    good: tuple[int, ...] = (0,)
    doubtful: tuple[int, ...] = ()


class RegisterBlock(Part):
    """Modbus registers that are read in one request."""

    unit: int = Field(default=1, ge=0, le=247)
    function: Literal[3, 4] = 4
    address: int = Field(ge=0, le=65535)
    count: int = Field(ge=1, le=125)
    word_order: Literal["big", "little"] = "big"
    rate_hz: float = Field(default=500.0, ge=0.1)
    """Most requests in a second; a serial line is slower by itself, TCP is not."""

    def check_inside(self, **registers: Register | None) -> None:
        """Raises ValueError for the first of these that the block does not hold."""
        for name, register in registers.items():
            if register is None:
                continue
            if register.address < self.address or register.address + register.count > self.address + self.count:
                raise ValueError(
                    f"{name} at {register.address} lies outside the block {self.address} … "
                    f"{self.address + self.count - 1}; widen address and count"
                )


class ModbusMap(_Gauge, RegisterBlock):
    """Any Modbus gauge: a block of registers read in one request, RTU on a serial port, else TCP."""

    request_bytes = 8
    interface: Literal["modbus_map"]
    line: Line = Line(baud=19200, bits=8, parity="E", stop=1)
    value: ValueRegister
    status: StatusRegister | None = None
    clock_s: Register | None = None
    clock_us: Register | None = None

    @model_validator(mode="after")
    def _inside_the_block(self) -> ModbusMap:
        self.check_inside(value=self.value, status=self.status, clock_s=self.clock_s, clock_us=self.clock_us)
        return self


Gauge = Annotated[SylvacOptoRS | KeyenceDLRS1A | ModbusMap, Field(discriminator="interface")]


class Gauges(Part):
    """Gauge 1, and gauge 2 where the test measures an angle."""

    g1: Gauge
    g2: Gauge | None = None
    baseline_u_mm: float = Field(default=0.05, ge=0, le=100)
    """Standard uncertainty of the distance between the two gauges."""

    @model_validator(mode="after")
    def _apart(self) -> Gauges:
        if self.g2 is None or self.baseline_mm > 0:
            return self
        places = f"g1 at {self.g1.offset_mm:g} mm and g2 at {self.g2.offset_mm:g} mm"
        if self.baseline_mm == 0:
            raise ValueError(f"{places} stand at one place, which measures no angle; correct offset_mm")
        raise ValueError(f"{places} are exchanged: g1 stands on the side of +; swap their offset_mm, or their ports")

    @model_validator(mode="after")
    def _sharing(self) -> Gauges:
        if self.g2 is None or self.g1.port != self.g2.port:
            return self
        own = {"offset_mm", "channel", "accuracy_mm", "calibrated", "value", "status", "clock_s", "clock_us"}
        if self.g1.model_dump(exclude=own) != self.g2.model_dump(exclude=own):
            raise ValueError(f"g1 and g2 share {self.g1.port} but differ in interface or settings; make them equal")
        if self.g1.interface == "keyence_dl_rs1a" and self.g1.channel == self.g2.channel:
            raise ValueError(f"g1 and g2 share {self.g1.port} and channel {self.g1.channel}; give each its channel")
        if self.g1.interface != "keyence_dl_rs1a":
            raise ValueError(f"{self.g1.interface} carries one gauge a port, not two; give g2 its own port")
        return self

    def __iter__(self) -> Iterator[tuple[str, Gauge]]:  # type: ignore[override]
        """Name and gauge, in order."""
        yield "g1", self.g1
        if self.g2 is not None:
            yield "g2", self.g2

    @property
    def baseline_mm(self) -> float:
        """Distance between the gauges, offset of g1 less that of g2: positive where there are two."""
        return self.g1.offset_mm - (self.g2.offset_mm if self.g2 else 0.0)
