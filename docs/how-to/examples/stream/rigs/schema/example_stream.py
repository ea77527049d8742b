"""What a rig file says of the example stream, which does not exist: for docs/how-to/add-a-robot-interface.md."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from rigs.schema.links import Port
from rigs.schema.part import Origin, Part


class ExampleStream(Part):
    """Example stream: the controller serves its joint angles at `port`."""

    listens: ClassVar[bool] = False
    origin: ClassVar[Origin] = Origin(
        instruments="Example stream (no such controller)",
        source="docs/how-to/add-a-robot-interface.md",
        standing="unconfirmed",
        doubts="everything: the controller was made up for the page",
    )

    interface: Literal["example_stream"]
    port: Port
    timeout_s: float = Field(default=1.0, ge=0.01, le=60)
    """Without a message for so long it counts as silent."""
