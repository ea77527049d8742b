"""Tables on the screen and as JSON: interfaces, runs, and the state of a daemon."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rich.console import Group, RenderableType
from rich.table import Column, Table
from rich.text import Text

from analysis.cli.plain_console import right
from rigs.text import counted

if TYPE_CHECKING:
    from daq.store import RunInfo
    from rigs.interfaces import Interface


_STYLE = {"confirmed": "green", "weak": "yellow", "unconfirmed": "red"}


def interfaces_table(interfaces: Sequence[Interface]) -> RenderableType:
    table = Table(
        Column("interface, line", no_wrap=True),
        Column("instruments", ratio=1, overflow="fold"),
        Column("standing", no_wrap=True),
        Column("source; what is in doubt; time of a reading", ratio=2, overflow="fold"),
        header_style="bold",
        show_lines=True,
    )
    for interface in interfaces:
        origin = interface.origin
        standing = Text(origin.standing, style=_STYLE[origin.standing])
        timing = f"\ntime: {interface.timing} ({interface.timing_source})" if interface.timing else ""
        modem = f"\nmodem lines: {interface.modem}" if interface.modem else ""
        source = Text.assemble(origin.source, ("\n" + origin.doubts if origin.doubts else "", "yellow"), modem, timing)
        name = Text.assemble((interface.name, "bold"), "\n" + interface.line if interface.line else "")
        table.add_row(name, origin.instruments, standing, source)
    counts = Counter[str](interface.origin.standing for interface in interfaces)
    words = ", ".join(f"{counts[standing]} {standing}" for standing in _STYLE)
    return Group(table, Text(f"{len(interfaces)} interfaces: {words}"))


_MINUTE_S, _HOUR_S, _DAY_S = 60.0, 3600.0, 86400.0


def run_row(run: RunInfo, now_s: float) -> dict[str, Any]:
    """Listed properties of a run; values are None if the manifest or the marks cannot be read."""
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


def runs_table(rows: Sequence[dict[str, Any]]) -> Table:
    runs = Column("run", counted(len(rows), "run"))
    size = right("size", footer=_size(sum(listed_row["bytes"] for listed_row in rows)))
    table = Table(
        runs, "test", "status", size, right("age"), "exported", "kept",
        box=None, padding=(0, 1), header_style="dim", show_footer=True, footer_style="dim",
    )  # fmt: skip
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
        return "in the future"  # the clock was set back
    seconds = max(seconds, 0.0)
    if seconds >= _DAY_S:
        return f"{seconds / _DAY_S:.0f} d"
    return f"{seconds / _HOUR_S:.1f} h" if seconds >= _HOUR_S else f"{seconds / _MINUTE_S:.0f} min"
