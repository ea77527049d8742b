"""The screen of `rig live`: gauges in large digits, the last seconds as a sparkline, and a table of the instruments."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from analysis.apps.live.figures import OLD_S, angle_deg, angle_name, event_words, lap_state, phi_deg, plain_line
from analysis.apps.live.lap import motion_sense, speeds
from analysis.apps.live.view import LiveView
from analysis.cli.plain_console import bare_table, right
from analysis.robot.kinematics.arm import Array
from rigs.schema.condition import CONDITION, condition_words
from rigs.schema.vocabulary import FURTHER
from rigs.text import escape_text

_GAUGES = ("g1", "g2")
_COLOURS = ("bright_cyan", "bright_magenta")
_DIGITS = {
    "0": "┏━┓┃ ┃┗━┛", "1": " ╻  ┃  ╹ ", "2": "╺━┓┏━┛┗━╸", "3": "╺━┓ ━┫╺━┛", "4": "╻ ╻┗━┫  ╹", "5": "┏━╸┗━┓╺━┛",
    "6": "┏━╸┣━┓┗━┛", "7": "╺━┓  ┃  ╹", "8": "┏━┓┣━┫┗━┛", "9": "┏━┓┗━┫╺━┛", "-": "   ╺━╸   ", ".": "  ▪", " ": " " * 9,
}  # fmt: skip
"""Three rows of each character of a number."""
_BARS = "▁▂▃▄▅▆▇█"
_SHOWN_S = 20.0
_LEAST_MM = 0.001
"""Height of a sparkline at least: the noise of a gauge at rest stays a flat line."""
_STEADY_MM_S = 0.0005
"""Trend below which a reading is steady: the noise of a 0.5 µm gauge over two seconds."""
_LATE_DRIFT_PPM = 500.0
"""Drift from which a clock is marked: instrument clocks are within about 100 ppm of the host."""
_LITTLE_DISK = 0.05
"""Share of free disk space below which a warning is shown."""
_LEAST_WIDTH, _LEAST_HEIGHT = 60, 14
"""Minimum size of the terminal. A smaller one shows only figures."""


@dataclass(frozen=True)
class LiveScreen:
    view: LiveView
    zero_mm: tuple[float, float] = (0.0, 0.0)

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        width, height = options.max_width, options.height or options.max_height
        if width < _LEAST_WIDTH or height < _LEAST_HEIGHT:
            line = plain_line(self.view, self.zero_mm)
            body: RenderableType = Group(*(_row(part.strip()) for part in line.split(";")))
        else:
            body = Group(*_parts(self.view, self.zero_mm, width, height))
        lines = console.render_lines(body, options.update(height=None), pad=True)[:height]
        yield from (segment for line in lines for segment in (*line, Segment.line()))


def _parts(view: LiveView, zero_mm: tuple[float, float], width: int, height: int) -> Iterator[RenderableType]:
    name = view.cell.name if view.cell else (view.state or {}).get("rig", "rig live")
    yield _row((f"{name}  ", "bold"), *_state_of(view))
    columns = Table.grid(expand=True, padding=0)
    for _ in _GAUGES:
        columns.add_column(ratio=1)
    columns.add_row(*(_gauge(view, k, zero_mm[k], width // 2) for k in range(2)))
    yield columns
    yield _row(*_angle_words(view, zero_mm), *_lap_words(view))
    streams, joints = _streams(view), _joints(view)
    yield joints
    if view.state:
        yield streams
        yield from _computer(view)
    free = height - 11 - joints.row_count - streams.row_count
    for event in view.events[: -max(1, free) - 1 : -1]:
        age_s = (float(view.rows.t_s[-1]) if len(view.rows) else 0.0) - event.t_s
        yield _row((f"{age_s:6.1f} s ago  {event_words(event, view)}", "yellow" if event.reversal is None else "dim"))


def _row(*parts: str | tuple[str, str]) -> Text:
    """A row that the edge of the terminal cuts off."""
    styled = [(escape_text(part), "") if isinstance(part, str) else (escape_text(part[0]), part[1]) for part in parts]
    return Text.assemble(*styled, no_wrap=True, overflow="crop")


def _gauge(view: LiveView, k: int, zero_mm: float, width: int) -> Text:
    """Name and trend, the reading in large digits, the last seconds, and the range."""
    name, colour = _GAUGES[k], _COLOURS[k]
    if name not in view.readings:
        return Text("\n").join([_row((name, f"bold {colour}"), (" mm  no reading yet", "dim")), *[Text()] * 5])
    reading = view.readings[name]
    is_old, slope = reading.age_s > OLD_S, float(view.trends_mm_s[k])
    head = [(name, f"bold {colour}"), (" mm", "")]
    head += [(f"  less {zero_mm:.4f}", "bold")] if zero_mm else []
    if is_old:
        head.append((f"  {reading.age_s:.0f} s old", "yellow"))
    elif not math.isnan(slope):
        is_steady = abs(slope) < _STEADY_MM_S
        head.append(("  steady", "dim") if is_steady else (f"  {'▲' if slope > 0 else '▼'} {slope:+.3f}/s", ""))
    shown = f"{reading.mm - zero_mm:8.4f}"
    digits = _large(shown) if 3 * len(shown) < width else [shown, "", ""]
    low, high = (np.full(2, np.nan) if view.extremes_mm is None else view.extremes_mm[k] - zero_mm).tolist()
    ranges = f"  min {low:.4f} max {high:.4f}" if math.isfinite(low) else ""
    recent = view.since(_SHOWN_S)
    line = sparkline(recent.t_s, recent.g_mm[:, k], max(1, width - 2))
    style = "dim" if is_old or view.lost else f"bold {colour}"
    rows = [_row(*head), *(_row((row, style)) for row in digits), _row((line, colour)), _row((ranges, "dim"))]
    return Text("\n").join(rows)


def _large(number: str) -> list[str]:
    """Rows of a number in large digits."""
    glyphs = [_DIGITS[character] for character in number]
    return ["".join(glyph[row * len(glyph) // 3 : (row + 1) * len(glyph) // 3] for glyph in glyphs) for row in range(3)]


def sparkline(t_s: Array, values: Array, width: int) -> str:
    """Mean of the values in each of `width` equal times up to now, as bars from the smallest to the largest."""
    finite = np.isfinite(values)
    if not finite.any():
        return ""
    place = np.floor((t_s[finite] - t_s[-1]) / _SHOWN_S * width).astype(int) + width - 1
    count = np.bincount(np.maximum(place, 0), minlength=width)
    with np.errstate(invalid="ignore"):
        mean = np.bincount(np.maximum(place, 0), values[finite], width) / count
    low, span = np.nanmin(mean), max(float(np.ptp(mean[count > 0])), _LEAST_MM)
    heights = np.clip((mean - low) / span * (len(_BARS) - 1), 0, len(_BARS) - 1)
    return "".join(" " if math.isnan(one) else _BARS[round(one)] for one in heights.tolist())


def _angle_words(view: LiveView, zero_mm: tuple[float, float]) -> Iterator[tuple[str, str]]:
    degrees = angle_deg(view, zero_mm)
    if degrees is not None:
        yield f"{angle_name(view)} {degrees:z.4f}°  ", "bold bright_green"


def _lap_words(view: LiveView) -> Iterator[tuple[str, str]]:
    phi, lap, sense = phi_deg(view), lap_state(view), view.lap.sense
    if view.cell is None or lap.place == "no_circle":
        yield "the rig file has no circle test" if view.cell else "", "dim"
    elif phi is None:
        yield "φ –  the tool is not on the circle", "dim"
    elif lap.place == "stands":
        yield f"φ {phi:5.1f}°  stands", ""
    else:
        way = {1: "acw ↺", -1: "cw ↻"}[sense]
        laps = f" of {view.cell.laps}" if view.direction else ""
        words = {"way_back": "way back", "lead_out": "lead-out", "lead_in": f"lap {lap.number}{laps} lead-in"}
        words["lap"] = f"lap {lap.number}{laps}  {100 * lap.share:3.0f} %"
        yield f"φ {phi:5.1f}°  {way}  {words[lap.place]}", "bold"


def _state_of(view: LiveView) -> Iterator[tuple[str, str]]:
    if view.lost:
        yield view.lost, "bold red"
    elif played := view.played:
        mark = "■ ended" if played.ended else "▶ played"
        yield f"{mark} {played.name}, {played.at_s:.1f} of {played.of_s:.1f} s, speed {played.speed:g}  ", "bold green"
        yield " ".join(filter(None, (view.test, view.direction))), ""
    elif state := view.state:
        if state["recording"]:
            label = " ".join(filter(None, (state["test"], state["direction"])))
            yield f"● recording {state['recording']} ({label}) {state['seconds']:.0f} s", "bold red"
            return
        yield "not recording  ", "dim"
        if state.get("waiting"):
            yield f"{state['waiting']} waits for the disk", "bold red"
        elif state.get("beginning"):
            yield f"{state['beginning']} begins", "yellow"
        elif view.cut:
            yield view.cut, "bold yellow"
        elif (automatic := state["automatic"]) is not None:
            why = f"; not started: {automatic['why_not']}" if automatic["why_not"] else ""
            yield f"automatic, waits for {'; '.join(automatic['waits_for'])}{why}", "dim"
        elif state["last_end"]:
            yield f"last: {state['last_end']}", "dim"


def _joints(view: LiveView) -> Table:
    table = bare_table("joint", right("°"), right("°/s"), right("reversals"))
    if not len(view.rows) or not np.isfinite(view.rows.q[-1]).all():
        table.add_row(_row(("no joint angles yet", "dim")))
        return table
    names = view.cell.axes if view.cell else tuple(f"axis {axis}" for axis in range(1, 7))
    speed = speeds(view.rows)
    for k, (name, angle) in enumerate(zip(names, np.degrees(view.rows.q[-1]).tolist(), strict=True)):
        pace = f"{math.degrees(speed[k]):+.1f}" if motion_sense(float(speed[k])) else "stands"
        table.add_row(_row(f"{k + 1} {name}"), f"{angle:z.3f}", pace, str(view.reversal_counts[k] or ""))
    return table


def _streams(view: LiveView) -> Table:
    table = bare_table("instrument", "", right("Hz"), right("late / ms"), "faults")
    for name, stream in (view.state or {"streams": {}})["streams"].items():
        clock = (view.state or {}).get("clocks", {}).get(name)
        connected = ("connected", "green") if stream["connected"] else ("lost", "bold red")
        late = (f"{1e3 * clock['late_s']:z.1f}", _drift_style(clock)) if clock else ("", "")
        table.add_row(
            _row((name[:20], "bold")), _row(("last known", "dim") if view.lost else connected),
            f"{stream['rate_hz']:.1f}", _row(late), _row(*_remarks(name, stream, view)),
        )  # fmt: skip
    return table


def _drift_style(clock: dict[str, Any]) -> str:
    return "yellow" if abs(clock.get("drift_ppm") or 0.0) > _LATE_DRIFT_PPM else ""


def _remarks(name: str, stream: dict[str, Any], view: LiveView) -> Iterator[tuple[str, str]]:
    now = {column: value for column, value in stream["last"].items() if stream["age_s"][column] <= OLD_S}
    disturbed = [words for words, disturbs in condition_words(now) if disturbs]
    if disturbed and stream["connected"]:
        yield " · ".join(disturbed) + " ", "bold red"
    old = [column for column, age_s in stream["age_s"].items() if age_s > OLD_S and column not in CONDITION]
    if old and stream["connected"]:
        yield f"silent {stream['age_s'][old[0]]:.0f} s ", "yellow"
    for gauge in [part for part in name.split("_") if part in FURTHER and part in view.readings]:
        yield f"{gauge} {view.readings[gauge].mm:z.4f} mm ", "bold"
    faults = ", ".join(f"{n} {kind}" for kind, n in stream["counters"].items() if kind != "samples")
    yield (f"{faults}; last: {stream['last_fault']}", "yellow") if faults else ("none", "dim")


def _computer(view: LiveView) -> Iterator[Text]:
    parts = list[tuple[str, str]]()
    state = view.state or {}
    if disk := state.get("disk"):
        share = disk["free_bytes"] / max(disk["size_bytes"], 1)
        words = f"disk {disk['free_bytes'] / 1e9:.1f} GB free ({100 * share:.0f} %)  "
        parts.append((words, "bold yellow" if share < _LITTLE_DISK else "dim"))
    if host := ", ".join(f"{count} {kind}" for kind, count in state.get("host", {}).items()):
        parts.append((f"computer: {host}  ", "yellow"))
    if state.get("recording") and "samples" in state:
        synced = ", ".join(f"{name} {count}" for name, count in state.get("synced", {}).items())
        parts.append((f"on the disk: {synced}", "dim"))
    if parts:
        yield _row(*parts)
