"""Modbus gauges: general register maps, and instruments with a known map."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, field_validator, model_validator

from rigs.schema.links import Line, tcp_address
from rigs.schema.part import Origin, Part
from rigs.schema.probe import Probe

SLOWEST_HZ = 0.5
"""Slowest rate. A recording cannot start with a reading older than 3 s, and a connection silent for 10 s is lost."""
Number = Literal[
    "int16", "uint16", "float16", "int32", "uint32", "float32", "int64", "uint64", "float64"
]  # fmt: skip
Order = Literal["big", "little"]
Framing = Literal["rtu", "ascii"]


class Register(Part):
    """Value in a Modbus register map."""

    address: int = Field(ge=0, le=65535)
    type: Number

    @property
    def count(self) -> int:
        return int(self.type[-2:]) // 16


class ValueRegister(Register):
    """The reading: `raw * scale + offset`, in the units of the gauge."""

    scale: float = Field(default=1.0, ge=-1e6, le=1e6)
    offset: float = Field(default=0.0, ge=-1e6, le=1e6)

    @field_validator("scale")
    @classmethod
    def _not_zero(cls, value: float) -> float:
        if value == 0:
            raise ValueError("scale must not be zero; give the value of one count")
        return value


class StatusRegister(Register):
    """Status of a reading. Unlisted values are errors."""

    type: Number = "uint16"
    good: tuple[int, ...] = (0,)
    doubtful: tuple[Annotated[int, Field(ge=-(2**31), lt=2**32)], ...] = ()
    """Codes stored with the reading: 32 bits, signed or unsigned."""


class RegisterBlock(Part):
    """Modbus registers read in a single request."""

    unit: int = Field(default=1, ge=0, le=247)
    function: Literal[3, 4] = 4
    address: int = Field(ge=0, le=65535)
    count: int = Field(ge=1, le=125)
    word_order: Order = "big"
    """Order of the registers of a 32 or 64 bit value: the highest (big) or the lowest first."""
    byte_order: Order = "big"
    """Order of the bytes of a register. The standard is the higher (big) first, but some instruments swap them."""
    rate_hz: float = Field(default=500.0, ge=SLOWEST_HZ)
    """Maximum requests per second. A serial line limits the rate by itself, TCP does not."""

    def check_inside(self, **registers: Register | None) -> None:
        for name, register in registers.items():
            if register is None:
                continue
            if register.address < self.address or register.address + register.count > self.address + self.count:
                raise ValueError(
                    f"{name} at {register.address} is outside the block {self.address} … "
                    f"{self.address + self.count - 1}; adjust address and count"
                )


class ModbusMap(Probe, RegisterBlock):
    """Any Modbus gauge: a block of registers read in a single request, on a serial port or over TCP."""

    origin: ClassVar[Origin] = Origin(
        instruments="any Modbus gauge; Baumer OM20, OM30",
        source="Modbus specification; Baumer OM20/OM30 manual p. 14, 22-23",
        standing="confirmed",
    )

    bus: ClassVar[bool] = True

    request_bytes = 8
    timing_source = (
        "the instrument's manual; for OM20 and OM30 p. 22-28: registers 207-208 contain the delay, and "
        "filters average up to 128 values"
    )
    interface: Literal["modbus_map"]
    line: Line = Line(baud=19200, bits=8, parity="E", stop=1)
    framing: Framing = "rtu"
    """Framing of a serial line; not used with TCP."""
    value: ValueRegister
    status: StatusRegister | None = None
    clock_s: Register | None = None
    clock_us: Register | None = None

    @model_validator(mode="after")
    def _inside_the_block(self) -> ModbusMap:
        self.check_inside(value=self.value, status=self.status, clock_s=self.clock_s, clock_us=self.clock_us)
        return self

    @property
    def place(self) -> str:
        return f"unit {self.unit}, {'holding' if self.function == 3 else 'input'} register {self.value.address}"


class SolartronOrbit(Probe):
    """Solartron Orbit ACS, SI100, SI200 or SI400: two parameters, the reading and the status."""

    origin: ClassVar[Origin] = Origin(
        instruments="Solartron Orbit ACS: SI100, SI200, SI400",
        source="Orbit ACS manual (503110) p. 32, 48-54",
        standing="weak",
        doubts="function 3, word order, status as float32, line settings; the parameter numbers are in the "
        "maker's parameter map; the unit is not sent: `units` must match the unit set there",
    )

    bus: ClassVar[bool] = True

    request_bytes = 8
    interface: Literal["solartron_orbit"]
    line: Line
    framing: Framing = "rtu"
    unit: int = Field(default=1, ge=0, le=247)
    function: Literal[3, 4] = 3
    word_order: Order = "big"
    byte_order: Order = "big"
    parameter: int = Field(ge=0, le=7999)
    """Address of the reading in the parameter map of the maker (503116, 503166)."""
    status_parameter: int = Field(ge=0, le=7999)
    """Address of the status."""

    @model_validator(mode="after")
    def _of_its_own(self) -> SolartronOrbit:
        if tcp_address(self.port):
            raise ValueError("an Orbit ACS is read over a serial port; over TCP use modbus_map")
        if self.parameter == self.status_parameter:
            raise ValueError("parameter and status_parameter are the same; give two different addresses")
        return self

    @property
    def place(self) -> str:
        return f"unit {self.unit}, parameter {self.parameter}"
