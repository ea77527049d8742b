"""The state of a daemon on the screen."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from rigs.schema.condition import CONDITION, condition_words
from rigs.schema.vocabulary import FURTHER

if TYPE_CHECKING:
    pass


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
