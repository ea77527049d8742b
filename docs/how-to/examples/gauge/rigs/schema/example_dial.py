"""What a rig file says of the example dial, which does not exist: for docs/how-to/add-a-gauge.md."""

from __future__ import annotations

from typing import ClassVar, Literal

from rigs.schema.links import Line
from rigs.schema.part import Origin
from rigs.schema.probe import Probe


class ExampleDial(Probe):
    """Example dial, one gauge a cable."""

    origin: ClassVar[Origin] = Origin(
        instruments="Example dial (no such instrument)",
        source="docs/how-to/add-a-gauge.md",
        standing="unconfirmed",
        doubts="everything: the instrument was made up for the page",
    )

    request_bytes = 2
    interface: Literal["example_dial"]
    line: Line = Line(baud=9600, bits=8, parity="N", stop=1)
    units: Literal["mm", "inch"] = "mm"
