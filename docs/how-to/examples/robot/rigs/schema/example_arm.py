"""What a rig file says of the example arm, which does not exist: for docs/how-to/add-a-robot-interface.md."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from rigs.schema.links import UDPPort
from rigs.schema.part import Origin, Part


class ExampleArm(Part):
    """Example arm: the controller sends its joint angles to `port`, an address of this computer."""

    listens: ClassVar[bool] = True
    origin: ClassVar[Origin] = Origin(
        instruments="Example arm (no such controller)",
        source="docs/how-to/add-a-robot-interface.md",
        standing="unconfirmed",
        doubts="everything: the controller was made up for the page",
    )

    interface: Literal["example_arm"]
    port: UDPPort
    timeout_s: float = Field(default=1.0, ge=0.01, le=60)
    """Without a message for so long it counts as silent."""
