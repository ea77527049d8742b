"""The list of runs, for people and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.table import Table
from rich.text import Text

from daq.store import RunInfo

_MINUTE_S, _HOUR_S, _DAY_S = 60.0, 3600.0, 86400.0


def row(run: RunInfo, now_s: float) -> dict[str, Any]:
    """What is worth knowing of a run; None where its manifest or marks cannot be read."""
    manifest, marks = run.manifest, run.marks
    return {
        "run": str(run.path),
        "name": manifest and manifest.name,
        "test": manifest and manifest.test,
        "direction": manifest and manifest.direction,
        "rig": manifest and manifest.rig_name,
        "operator": manifest and manifest.operator,
        "relabelled": manifest and bool(manifest.relabelled),
        "status": run.status,
        "bytes": run.size,
        "age_s": round(now_s - run.ended_s),
        "exported": marks.exports[-1].at if marks and marks.exports else None,
        "kept": marks and marks.kept,
    }


def listed(rows: Sequence[dict[str, Any]]) -> Table:
    """A line a run, and what all of them take."""
    table = Table(box=None, padding=(0, 1), header_style="dim", show_footer=True, footer_style="dim")
    table.add_column("run", f"{len(rows)} run{'s' * (len(rows) != 1)}")
    table.add_column("test")
    table.add_column("status")
    table.add_column("size", _size(sum(listed_row["bytes"] for listed_row in rows)), justify="right")
    table.add_column("age", justify="right")
    table.add_column("exported")
    table.add_column("kept")
    for listed_row in rows:
        test = " ".join(filter(None, (listed_row["test"], listed_row["direction"]))) or "?"
        status = Text(listed_row["status"], "" if listed_row["status"] == "complete" else "yellow")
        exported = listed_row["exported"][:10] if listed_row["exported"] else "no"
        kept = "kept" if listed_row["kept"] else ""
        table.add_row(
            listed_row["run"], test, status, _size(listed_row["bytes"]), _age(listed_row["age_s"]), exported, kept
        )
    return table


def _size(count: int) -> str:
    for unit, size in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= size:
            return f"{count / size:.1f} {unit}"
    return f"{count} B"


def _age(seconds: float) -> str:
    if seconds < -_MINUTE_S:
        return "in the future"  # the clock was set back since
    seconds = max(seconds, 0.0)
    if seconds >= _DAY_S:
        return f"{seconds / _DAY_S:.0f} d"
    return f"{seconds / _HOUR_S:.1f} h" if seconds >= _HOUR_S else f"{seconds / _MINUTE_S:.0f} min"
