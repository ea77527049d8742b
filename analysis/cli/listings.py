"""Tables on the screen and as JSON: interfaces, runs, and the state of a daemon."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rich.console import Group, RenderableType
from rich.table import Column, Table
from rich.text import Text

from analysis.cli.plain_console import right
from rigs.schema.condition import CONDITION, condition_words
from rigs.schema.vocabulary import FURTHER
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


# ----------------------------------------------------------------------------------------------------------------------
# The state of a daemon.

_OLD_S = 2.0


def screen(state: dict[str, Any]) -> RenderableType:
    text = Text(f"{state['rig']}  ", style="bold")
    if state["recording"]:
        direction = f" {state['direction']}" if state["direction"] else ""
        text.append(
            f"● recording {state['recording']} ({state['test']}{direction}) {state['seconds']:.0f} s", "bold red"
        )
    else:
        text.append("not recording", "dim")
        if state["last_end"]:
            text.append(f"; last: {state['last_end']}", "dim")
        if state.get("waiting"):
            missed = ", ".join(f"{count} of {stream}" for stream, count in state["missed"].items())
            text.append(f"; {state['waiting']} waits for the disk, samples missed: {missed or 'none'}", "bold red")
        elif state.get("beginning"):
            text.append(f"; {state['beginning']} begins", "yellow")
    lines = [text]
    if (automatic := state["automatic"]) is not None:  # the conditions it waits for, and the reason if it did not start
        lines.append(Text(f"automatic, waits for {'; '.join(automatic['waits_for'])}", "dim"))
        if automatic["why_not"]:
            lines[-1].append(f"\nnot started: {automatic['why_not']}", "yellow")
    return Group(*lines, _gauges(state), _links(state))


def _gauges(state: dict[str, Any]) -> Table:
    table = Table(box=None, padding=(0, 2), show_header=False)
    values = {name: value for stream in state["streams"].values() for name, value in stream["last"].items()}
    ages = {name: age for stream in state["streams"].values() for name, age in stream["age_s"].items()}
    for gauge in ("g1", "g2", *FURTHER):
        if (name := f"{gauge}_mm") in values:
            table.add_row(gauge, _number(values[name], ages[name], "z9.4f", "mm"))
    if {"g1_mm", "g2_mm"} <= values.keys() and state["baseline_mm"]:
        degrees = math.degrees(math.atan((values["g2_mm"] - values["g1_mm"]) / state["baseline_mm"]))
        table.add_row("angle", _number(degrees, max(ages["g1_mm"], ages["g2_mm"]), "z9.4f", "°"))
    joints = [f"q{axis}_deg" for axis in range(1, 7)]
    if all(name in values for name in joints):
        row = Text("  ").join(_number(values[name], ages[name], "z8.3f", "") for name in joints)
        table.add_row("joints °", row)
    if "signal" in values:
        table.add_row("signal", _number(values["signal"], ages["signal"], "8.0f", ""))
    if shown := {name: values[name] for name in CONDITION if name in values}:
        # The condition of the robot in words; a stop and a reduced speed are red.
        parts = [Text(words, "bold red" if disturbs else "bold") for words, disturbs in condition_words(shown)]
        age_s = max(ages[name] for name in shown)
        parts += [Text(f"{age_s:.0f} s old", "yellow dim")] if age_s > _OLD_S else []
        if condition := Text(" · ").join(parts):
            table.add_row("robot", condition)
    return table


def _number(value: float, age_s: float, form: str, unit: str) -> Text:
    if age_s > _OLD_S:
        return Text(f"{value:{form}} {unit} ({age_s:.0f} s old)", style="yellow dim")
    return Text(f"{value:{form}} {unit}".rstrip(), style="bold")


def _links(state: dict[str, Any]) -> Table:
    table = Table(box=None, padding=(0, 2), collapse_padding=True, header_style="dim")
    for heading in ("link", "", "rate", "samples", "faults"):
        right, last = heading in ("rate", "samples"), heading == "faults"
        table.add_column(heading, justify="right" if right else "left", no_wrap=not last, overflow="fold")
    for name, stream in state["streams"].items():
        faults = {kind: count for kind, count in stream["counters"].items() if kind != "samples"}
        text = ", ".join(f"{count} {kind}" for kind, count in faults.items())
        text += f"; last: {stream['last_fault']}" if text else ""
        connected = Text("connected", "green") if stream["connected"] else Text("lost", "bold red")
        samples = str(stream["counters"].get("samples", 0))
        table.add_row(
            name, connected, f"{stream['rate_hz']:.1f} Hz", samples, Text(text or "none", "yellow" if text else "dim")
        )
    return table
