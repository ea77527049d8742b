"""Text panels: header, joints, events, links, keys and help."""

from __future__ import annotations

import math
from textwrap import wrap
from typing import Any

import numpy as np

from analysis.apps.live.canvas import Area, direction_colour
from analysis.apps.live.controls import KEYS, LiveControls
from analysis.apps.live.figures import OLD_S
from analysis.apps.live.lap import LiveReversal, moves, speeds
from analysis.apps.live.view import LiveEvent, LiveView
from rigs.schema.condition import CONDITION, condition_words
from rigs.schema.vocabulary import FURTHER
from rigs.text import plain

_LITTLE_DISK = 0.05
"""Share of free disk space below which a warning is shown."""
_LATE_DRIFT_PPM = 500.0
"""Drift from which a clock is marked: instrument clocks are within about 100 ppm of the host."""


def draw_head(area: Area, view: LiveView) -> None:
    column = area.put(0, 1, view.cell.name if view.cell else (view.state or {}).get("rig", "rig live"), "bold") + 2
    if view.lost:
        area.put(0, column, view.lost, "bold red")
        return
    if view.played:
        played = view.played
        mark = "■ ended" if played.ended else "‖ paused" if played.paused else "▶ played"
        words = f"{mark} {played.name}, {played.at_s:.1f} of {played.of_s:.1f} s, speed {played.speed:g}"
        column = area.put(0, column, words, "bold green") + 2
        area.put(0, column, " ".join(filter(None, (view.test, view.direction))))
        return
    if not (state := view.state):
        return
    if state["recording"]:
        label = " ".join(filter(None, (state["test"], state["direction"])))
        words = f"● recording {state['recording']} ({label}) {state['seconds']:.0f} s"
        area.put(0, column, words, "bold red")
        return
    column = area.put(0, column, "not recording", "dim") + 2
    if state.get("waiting"):
        area.put(0, column, f"{state['waiting']} waits for the disk", "bold red")
    elif state.get("beginning"):
        area.put(0, column, f"{state['beginning']} begins", "yellow")
    elif view.cut:
        area.put(0, column, view.cut, "bold yellow")
    elif (automatic := state["automatic"]) is not None:
        why = f"; not started: {automatic['why_not']}" if automatic["why_not"] else ""
        area.put(0, column, f"automatic, waits for {'; '.join(automatic['waits_for'])}{why}", "dim")
    elif state["last_end"]:
        area.put(0, column, f"last: {state['last_end']}", "dim")


def draw_joints(area: Area, view: LiveView) -> None:
    if not len(view.rows) or not np.isfinite(view.rows.q[-1]).all():
        area.put(0, 1, "joint angles missing: the robot sends no data" if view.readings else "no joints yet", "dim")
        return
    names = view.cell.axes if view.cell else tuple(f"axis {axis}" for axis in range(1, 7))
    speed = speeds(view.rows)
    last = view.last_reversals
    for k, name in enumerate(names):
        sense = moves(float(speed[k]))
        column = area.put(k, 1, f"{k + 1} ", "bold")
        area.put(k, column, name[:9])
        area.put(k, 13, f"{math.degrees(view.rows.q[-1, k]):z9.3f}°")
        column = area.put(k, 24, {1: "▲", -1: "▼", 0: "■"}[sense], "" if sense else "dim")
        column = area.put(k, column + 1, f"{math.degrees(speed[k]):+z6.1f}°/s" if sense else "   stands", "dim")
        if k + 1 in last:
            area.put(
                k, 37, f"{view.reversal_counts[k]} rev, last {_place(last[k + 1])}", direction_colour(last[k + 1].sense)
            )


def draw_events(area: Area, view: LiveView) -> None:
    """Draw the events, newest first."""
    area.put(0, 1, "what happened", "bold")
    now_s = float(view.rows.t_s[-1]) if len(view.rows) else 0.0
    for row, event in enumerate(reversed(view.events[-max(0, area.height - 1) :] if area.height > 1 else ()), start=1):
        area.put(
            row,
            1,
            f"{now_s - event.t_s:6.1f} s ago  {event_words(event, view)}",
            "yellow" if event.reversal is None else direction_colour(event.reversal.sense),
        )


def draw_links(area: Area, view: LiveView) -> None:
    """A row for each stream, and one for disk and recording."""
    state = view.state
    if state is None:
        return
    rows = list(state["streams"].items())[: max(0, area.height - 1)]
    for row, (name, stream) in enumerate(rows):
        column = area.put(row, 1, f"{name:<6}"[:12], "bold")
        words, style = ("connected", "green") if stream["connected"] else ("lost     ", "bold red")
        column = area.put(row, column + 1, *(("last known", "") if view.lost else (words, style)))
        column = area.put(row, column + 1, f"{stream['rate_hz']:6.1f} Hz")
        now = {column: value for column, value in stream["last"].items() if stream["age_s"][column] <= OLD_S}
        disturbed = [words for words, disturbs in condition_words(now) if disturbs]
        if disturbed and stream["connected"]:
            column = area.put(row, column + 1, " · ".join(disturbed), "bold red")
        old = [name for name, age_s in stream["age_s"].items() if age_s > OLD_S and name not in CONDITION]
        if old and stream["connected"]:
            column = area.put(row, column + 1, f"silent {stream['age_s'][old[0]]:.0f} s", "yellow")
        for gauge in [part for part in name.split("_") if part in FURTHER and part in view.readings]:
            column = area.put(row, column + 1, f"{gauge} {view.readings[gauge].mm:z.4f} mm", "bold")
        column = _clock(area, row, column + 1, state.get("clocks", {}).get(name))
        faults = ", ".join(f"{n} {kind}" for kind, n in stream["counters"].items() if kind != "samples")
        area.put(
            row,
            column + 1,
            f"{faults}; last: {stream['last_fault']}" if faults else "no faults",
            "yellow" if faults else "dim",
        )
    row, column = len(rows), 1
    if disk := state.get("disk"):
        share = disk["free_bytes"] / max(disk["size_bytes"], 1)
        words = f"disk {disk['free_bytes'] / 1e9:.1f} GB free ({100 * share:.0f} %)"
        column = area.put(row, column, words, "bold yellow" if share < _LITTLE_DISK else "dim") + 2
    if host := ", ".join(f"{count} {kind}" for kind, count in state.get("host", {}).items()):
        column = area.put(row, column, f"computer: {host}", "yellow") + 2
    if state["recording"] and "samples" in state:
        synced = ", ".join(f"{name} {count}" for name, count in state.get("synced", {}).items())
        area.put(row, column, f"on the disk: {synced}", "dim")


def draw_foot(area: Area, view: LiveView, controls: LiveControls) -> None:
    """The typed label or the keys in the last row, and a message above or, in a single row, instead."""
    row = area.height - 1
    if controls.prompt is not None:
        column = area.put(row, 1, "label (name test direction, Esc to leave): ", "bold")
        column = area.put(row, column, controls.prompt)
        area.put(row, column, "█")
    elif view.played:
        area.put(row, 1, "space pause  + - speed  u units  z zero  r restart  ? help  q quit", "dim")
    else:
        area.put(row, 1, "s start  e end  l label  z zero  u units  r restart  ? help  q quit", "dim")
    lines = wrap(plain(controls.message), max(1, area.width - 2))
    top = max(0, row - len(lines))
    for k, line in enumerate(lines[: max(1, row)]):
        area.put(top + k, 0, f" {line}".ljust(area.width), "yellow")


def draw_help(area: Area) -> None:
    width = min(area.width, 72)
    box = area.part((area.height - len(KEYS) - 2) // 2, (area.width - width) // 2, width, len(KEYS) + 2)
    for row in range(box.height):
        edge = row in (0, box.height - 1)
        box.put(row, 0, ("╭" if row == 0 else "╰" if edge else "│") + ("─" if edge else " ") * (width - 2))
        box.put(row, width - 1, "╮" if row == 0 else "╯" if edge else "│")
    box.put(0, 2, " keys ", "bold")
    for row, (key, words) in enumerate(KEYS, start=1):
        box.put(row, 2, f"{key:<6}", "bold")
        box.put(row, 9, words)


def _clock(area: Area, row: int, column: int, clock: dict[str, Any] | None) -> int:
    if not clock:
        return column
    drift = clock.get("drift_ppm")
    words = f"late {1e3 * clock['late_s']:z.1f} ms" + (f", clock {drift:+z.0f} ppm" if drift is not None else "")
    return area.put(row, column, words, "yellow" if drift is not None and abs(drift) > _LATE_DRIFT_PPM else "dim") + 1


def event_words(event: LiveEvent, view: LiveView) -> str:
    if event.reversal is None:
        return event.words
    reversal = event.reversal
    name = f" ({view.cell.axes[reversal.axis - 1]})" if view.cell else ""
    return f"axis {reversal.axis}{name} turned back at {_place(reversal)}"


def _place(reversal: LiveReversal) -> str:
    """Position and direction of a joint reversal; upper is from rising to falling."""
    return (f"φ {math.degrees(reversal.phi_rad):5.1f}° " if math.isfinite(reversal.phi_rad) else "") + (
        "▲▼" if reversal.upper else "▼▲"
    )
