"""The gauges of a rig: which instrument, on which port, where on the baseline.

`interface` is the name of the file in `daq/gauges/` that speaks to it.
Gauges that name the same port share one instrument, and differ in `channel`; or a line, where each is asked by itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import TYPE_CHECKING, Annotated

from pydantic import Field, model_validator

from rigs.plugins import extended
from rigs.schema.modbus import ModbusMap, SolartronOrbit
from rigs.schema.part import Part
from rigs.schema.probe import Probe
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
from rigs.schema.vocabulary import FURTHER

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
if not TYPE_CHECKING:
    Gauge = extended(Gauge, "rig.gauges", Probe)


class Gauges(Part):
    """Gauge 1, and gauge 2 where the test measures an angle: the two that tests take. Any further ones are recorded,
    exported and shown beside them."""

    g1: Gauge
    g2: Gauge | None = None
    g3: Gauge | None = None
    g4: Gauge | None = None
    g5: Gauge | None = None
    g6: Gauge | None = None
    g7: Gauge | None = None
    g8: Gauge | None = None
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
        for (first_name, first), (second_name, second) in combinations(self.recorded.items(), 2):
            if first.port == second.port:
                _check_sharing(first_name, first, second_name, second)
        return self

    def __iter__(self) -> Iterator[tuple[str, Gauge]]:  # type: ignore[override]
        """Name and gauge of the one or two that tests measure with, in order."""
        for name in ("g1", "g2"):
            if (gauge := getattr(self, name)) is not None:
                yield name, gauge

    @property
    def recorded(self) -> dict[str, Gauge]:
        """All gauges by name, in order."""
        further = {name: gauge for name in FURTHER if (gauge := getattr(self, name)) is not None}
        return dict(self) | further

    @property
    def baseline_mm(self) -> float:
        """Distance between the gauges, offset of g1 less that of g2: positive where there are two."""
        return self.g1.offset_mm - (self.g2.offset_mm if self.g2 else 0.0)


NO_GAUGES = Gauges.model_construct(g1=None)  # type: ignore[arg-type]  # which no rig file can write
"""The gauges of a cell that a tracker measures alone: none."""


def _check_sharing(first_name: str, first: Gauge, second_name: str, second: Gauge) -> None:
    """Raise ValueError where two gauges on one port cannot share it."""
    if first.interface == second.interface and not (first.shares or first.bus):
        raise ValueError(f"{first.interface} carries one gauge a port, not two; give {second_name} its own port")
    its_own = {"offset_mm", "channel", "counts", "accuracy_mm", "range_mm", "certificate", "calibrated"}
    common = {"interface", "line", "framing"} if first.bus else type(first).model_fields.keys() - its_own
    for key in sorted(common):
        settings = [getattr(gauge, key, "none") for gauge in (first, second)]
        if settings[0] != settings[1]:
            problem = f"{first_name} and {second_name} share {first.port} but not `{key}`"
            raise ValueError(f"{problem}, which is {settings[0]} and {settings[1]}; make them equal")
    if first.place == second.place:
        raise ValueError(f"{first_name} and {second_name} share {first.port} and {first.place}; give each its own")
