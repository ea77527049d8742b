"""The gauges of a rig: which instrument, on which port, where on the baseline.

`interface` is the name of the file in `daq/gauges/` that speaks to it.
Gauges that name the same port share one instrument, and differ in `channel`; or a line, where each is asked by itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field, model_validator

from rigs.schema.modbus import ModbusMap, SolartronOrbit
from rigs.schema.part import Part
from rigs.schema.serial_gauges import (
    CDIIQ,
    HeidenhainND281B,
    HeidenhainND287,
    KeyenceDLRS1A,
    MagnescaleLT,
    MagnescaleMG80,
    MahrC1202,
    MahrC1208,
    MicroEpsilonILD1420,
    MitutoyoQMHeight,
    MitutoyoUSB,
    SylvacOptoRS,
    TesaTT,
)

Gauge = Annotated[
    SylvacOptoRS
    | TesaTT
    | MahrC1202
    | MahrC1208
    | HeidenhainND281B
    | HeidenhainND287
    | KeyenceDLRS1A
    | MagnescaleLT
    | MagnescaleMG80
    | MitutoyoUSB
    | MitutoyoQMHeight
    | CDIIQ
    | MicroEpsilonILD1420
    | ModbusMap
    | SolartronOrbit,
    Field(discriminator="interface"),
]


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
            raise ValueError(f"{places} are at the same place, which measures no angle; correct offset_mm")
        raise ValueError(
            f"{places} are exchanged: g1 belongs on the positive side; swap their offset_mm, or their ports"
        )

    @model_validator(mode="after")
    def _sharing(self) -> Gauges:
        if self.g2 is None or self.g1.port != self.g2.port:
            return self
        if self.g1.interface == self.g2.interface and not (self.g1.shares or self.g1.bus):
            raise ValueError(f"{self.g1.interface} carries one gauge a port, not two; give g2 its own port")
        own = {"offset_mm", "channel", "accuracy_mm", "range_mm", "certificate", "calibrated"}
        common = {"interface", "line", "framing"} if self.g1.bus else type(self.g1).model_fields.keys() - own
        for key in sorted(common):
            first, second = (getattr(gauge, key, "none") for gauge in (self.g1, self.g2))
            if first != second:
                what = f"g1 and g2 share {self.g1.port} but not `{key}`, which is {first} and {second}"
                raise ValueError(f"{what}; make them equal")
        if self.g1.place == self.g2.place:
            raise ValueError(f"g1 and g2 share {self.g1.port} and {self.g1.place}; give each its own")
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
