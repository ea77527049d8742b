"""What the recorder reports: its state, and why it rejects a request."""

from __future__ import annotations

from collections.abc import Mapping

from daq import clock
from daq.recording import machine
from daq.recording.active_run import ActiveRun, Gap
from daq.recording.machine import Reject, Running, State
from rigs.errors import CellError


def status_of(
    state: State,
    run: ActiveRun | None,
    gap: Gap | None,
    last_end: str,
    synced: Mapping[str, int],
    *,
    closing: bool,
) -> dict[str, object]:
    """Return what is being recorded and since when, or how the last recording ended.

    run: takes what comes; gap: what is missed while a recording waits for the disk; synced: rows of each stream of a
    device that are on the disk; closing: whether another run is not closed yet.
    """
    if run is None or run.writer is None or not isinstance(state.phase, Running):
        gap = run.gap if run else gap
        return {
            "recording": None,
            "beginning": run.label.name if run else None,
            "closing": closing,
            "last_end": last_end,
            "waiting": state.recording.label.name if gap and state.recording else None,
            "missed": dict(gap.missed) if gap else {},
        }
    return {
        "recording": run.label.name,
        "test": run.label.test,
        "direction": run.label.direction,
        "run": str(run.writer.path),
        "seconds": round((clock.now_ns() - run.since_ns) / 1e9, 1),
        "samples": {name: run.counters[name]["samples"] for name in synced},
        "synced": dict(synced),
    }


def rejection(rejected: Reject, state: State, last_end: str) -> CellError:
    """Return the error for a request that the machine rejects in a state."""
    if rejected.why == "running" and state.recording:
        return CellError(f"recording {state.recording.label.name}", "already running", "stop it: rig record stop")
    if rejected.why == "making":
        problem = f"is still creating the last {machine.MOST_LEAVING} runs, which were stopped early"
        return CellError("disk", problem, "try again in some seconds; if it stays so, run rig doctor")
    why = f" (the last one: {last_end})" if last_end else ""
    return CellError("rigd", f"nothing is being recorded{why}", "start it: rig record start NAME …")
