"""Lists on the screen and as JSON: arms of the library, interfaces, calibrations, and runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rich.console import Group, RenderableType
from rich.table import Column, Table
from rich.text import Text

from analysis.report.plain_console import right
from rigs.calibration import verdict_of
from rigs.text import counted, plain

if TYPE_CHECKING:
    from analysis.correction.versions import Version
    from daq.store import RunInfo
    from rigs.arms import LibraryArm
    from rigs.interfaces import Interface


def arms_table(arms: Sequence[LibraryArm]) -> RenderableType:
    """Return a row for each arm: name, model, repeatability, and availability of masses."""
    name, model = Column("name", no_wrap=True), Column("arm", overflow="fold")
    table = Table(name, model, right("repeatability"), "masses", header_style="bold")
    for arm in arms:
        repeatability = f"{arm.repeatability_mm:g} mm" if arm.repeatability_mm else "unknown"
        masses = "known" if arm.sources.masses else "unknown"
        table.add_row(Text(arm.name, style="bold"), f"{arm.maker} {arm.model}", repeatability, masses)
    return Group(table, Text(f"{len(arms)} arms; rig arms NAME shows the robot section and the sources of an arm"))


def arm_object(arm: LibraryArm) -> dict[str, Any]:
    """Return an arm as a JSON object."""
    return {
        "name": arm.name,
        "maker": arm.maker,
        "model": arm.model,
        "note": arm.note,
        "repeatability_mm": arm.repeatability_mm,
        "sources": arm.sources.model_dump(),
        "frames": arm.frames,
        "robot": arm.robot.model_dump(mode="json"),
    }


def arm_section(arm: LibraryArm) -> str:
    """Return the robot section of an arm, with the sources of the numbers as comments."""
    repeatability = f", repeatability {arm.repeatability_mm:g} mm" if arm.repeatability_mm else ""
    head = [f"{arm.maker} {arm.model}{repeatability}", *([arm.note] if arm.note else []), f"frames: {arm.frames}"]
    head += [f"{key}: {words}" for key, words in arm.sources.model_dump(exclude_defaults=True).items()]
    return "".join(f"# {line}\n" for line in head) + arm.text


_STYLE = {"confirmed": "green", "weak": "yellow", "unconfirmed": "red"}


def interfaces_table(interfaces: Sequence[Interface]) -> RenderableType:
    """Return a table of the interfaces and the count of each standing."""
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


def versions_table(versions: Sequence[Version]) -> RenderableType:
    """Return a row for each calibration, newest first."""
    if not versions:
        return Text("This directory has no calibration of this robot. To write one: rig diagnose RUN… -o DIRECTORY")
    numbers = map(right, ("runs", "before µm", "calibrated µm", "left out µm", "to correct by"))
    table = Table("", "date", "rig file", *numbers, header_style="bold")
    for version in versions:
        model = version.calibrated
        left_out = "" if model.held_out_um is None else f"{model.held_out_um:.1f}"
        figures = (f"{model.before_um:.1f}", f"{model.calibrated_um:.1f}", left_out)
        verdict = "yes" if verdict_of(model) == "correct" else "no"
        use, path = "in use" if version.in_use else "", plain(str(version.path))
        table.add_row(use, f"{model.date}", path, f"{len(model.runs)}", *figures, verdict)
    return table


def version_object(version: Version) -> dict[str, Any]:
    """Return a calibration in plain types."""
    model = version.calibrated
    return {
        "path": str(version.path),
        "sha256": version.sha256,
        "in_use": version.in_use,
        "date": str(model.date),
        "version": model.version,
        "runs": [run.name for run in model.runs],
        "before_um": model.before_um,
        "calibrated_um": model.calibrated_um,
        "held_out_um": model.held_out_um,
        "verdict": verdict_of(model),
    }


_MINUTE_S, _HOUR_S, _DAY_S = 60.0, 3600.0, 86400.0


def run_row(run: RunInfo, now_s: float) -> dict[str, Any]:
    """Return the listed properties of a run; values are None if the manifest or the marks cannot be read."""
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
    """Return a row for each run, and the total size."""
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
