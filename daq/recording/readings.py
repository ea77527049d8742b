"""Whether a recording can begin: every gauge that its test needs, and the robot, must have been read lately."""

from __future__ import annotations

from collections.abc import Mapping

from daq.acquisition.stream_buffer import StreamBuffer
from rigs.errors import CellError
from rigs.schema.vocabulary import TestName

_FRESH_S = 3.0


def require_readings(buffers: Mapping[str, StreamBuffer], test: TestName) -> None:
    """Raise CellError if a gauge that the test needs, or the robot, is missing or has no fresh reading."""
    needed = {"g1_mm", "q1_deg"} | ({"g2_mm"} if test in ("yaw", "roll") else set())
    for column in sorted(needed):
        found = [buffer.state() for buffer in buffers.values() if column in buffer.columns]
        what = "robot" if column == "q1_deg" else column.removesuffix("_mm")
        if not found:
            raise CellError(what, f"the {test} test needs it, but the rig file has none", f"add gauges.{what}")
        if found[0].age_s.get(column, 1e9) > _FRESH_S:
            last = found[0].last_fault or "nothing was received"
            stale = f"no reading in the last {_FRESH_S:.0f} s ({last})"
            raise CellError(what, stale, "fix the cause, then start the recording again")
