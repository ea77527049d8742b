"""The label of a recording: its name, its test, and who measures.

Whether a recording can begin: every gauge that its test needs, and the robot, must have been read lately.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from pydantic import Field

from daq.acquisition.stream_buffer import StreamBuffer
from daq.store.manifest import DrivenWith, Operator, Placement, ViewZero
from rigs.errors import CellError
from rigs.schema.part import Part
from rigs.schema.vocabulary import Direction, TestName

NAME_RULE = "use up to 64 letters, digits, . _ and -, a letter or digit first"


class Label(Part):
    """What a person enters about a recording when it starts."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,63}$")]
    test: TestName
    direction: Direction | None = None
    operator: Operator = ""
    placement: Placement = ""
    corrected: DrivenWith = ""
    view_zero_mm: ViewZero | None = None


_FRESH_S = 3.0


def require_readings(buffers: Mapping[str, StreamBuffer], test: TestName) -> None:
    """Raise CellError if a gauge that the test needs, or the robot, is missing or has no fresh reading."""
    needed = {"g1_mm", "q1_deg"} | ({"g2_mm"} if test in ("yaw", "roll") else set())
    for column in sorted(needed):
        states = [buffer.state() for buffer in buffers.values() if column in buffer.columns]
        name = "robot" if column == "q1_deg" else column.removesuffix("_mm")
        if not states:
            raise CellError(name, f"the {test} test needs it, but the rig file has none", f"add gauges.{name}")
        if states[0].age_s.get(column, 1e9) > _FRESH_S:
            last = states[0].last_fault or "nothing was received"
            stale = f"no reading in the last {_FRESH_S:.0f} s ({last})"
            raise CellError(name, stale, "fix the cause, then start the recording again")
