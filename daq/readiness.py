"""Whether a test can be recorded now: an empty run helps nobody."""

from __future__ import annotations

from collections.abc import Mapping

from daq.inbox import Inbox
from rigs.errors import CellError
from rigs.vocabulary import TestName

_FRESH_S = 3.0


def require_readings(inboxes: Mapping[str, Inbox], test: TestName) -> None:
    """Raises CellError for a gauge that the test needs, or the robot, that is not there or shows nothing."""
    needed = {"g1_mm", "q1_deg"} | ({"g2_mm"} if test in ("yaw", "roll") else set())
    for column in sorted(needed):
        found = [inbox.state() for inbox in inboxes.values() if column in inbox.columns]
        what = "robot" if column == "q1_deg" else column.removesuffix("_mm")
        if not found:
            raise CellError(what, f"the {test} test needs it, the rig file has none", f"add gauges.{what}")
        if found[0].age_s.get(column, 1e9) > _FRESH_S:
            last = found[0].last_fault or "nothing came at all"
            raise CellError(what, f"no reading in the last {_FRESH_S:.0f} s ({last})", "mend it, then start again")
