"""The screen of `rig live`: panels of the view and the controls, in the size of the terminal."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from textwrap import wrap
from typing import Any, Literal

import numpy as np
from rich.align import Align
from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.layout import Layout
from rich.padding import Padding
from rich.panel import Panel
from rich.styled import Styled
from rich.text import Text

from analysis.apps.live.canvas import (
    ANGLE_COLOUR,
    GAUGE_COLOURS,
    Plot,
    below_each_other,
    direction_colour,
    draw_circle,
    draw_straight,
    draw_trace,
    height_of,
    large,
    row_of,
    width_of,
)
from analysis.apps.live.controls import KEYS, LiveControls
from analysis.apps.live.figures import OLD_S, angle_deg, angle_name, lap_state, phi_deg, plain_line, shown_curves
from analysis.apps.live.lap import LiveReversal, motion_sense, speeds
from analysis.apps.live.view import LiveEvent, LiveView
from rigs.schema.condition import CONDITION, condition_words
from rigs.schema.vocabulary import FURTHER
from rigs.text import plain

_STEADY_MM_S = 0.0005
"""Trend below which a reading is steady: the noise of a 0.5 µm gauge over two seconds."""
_LARGEST_SCALE = 4
_ANGLE_TEXT = "-00.0000"


def _largest_scale(text: str, width: int, most: int) -> int:
    """Largest scale up to `most` at which a number fits, at least 1."""
    return max((scale for scale in range(1, most + 1) if width_of(text, scale) <= width - 2), default=1)


def gauge_rows(scale: int) -> int:
    return height_of(scale) + 2


def gauge_panel(view: LiveView, controls: LiveControls, k: int, scale: int, width: int) -> Text:
    name, units, colour = f"g{k + 1}", controls.units, GAUGE_COLOURS[k]
    head = [(name, f"bold {colour}"), (f" {units.name}", "")]
    if name not in view.readings:
        return row_of(*head, ("  no reading yet", "dim"))
    reading = view.readings[name]
    if controls.zero_mm[k]:
        head.append((f"  less {controls.zero_mm[k] * units.per_mm:.{units.decimals}f}", "bold"))
    old = reading.age_s > OLD_S
    if old:
        head.append((f"  {reading.age_s:.0f} s old", "yellow"))
    elif not math.isnan(slope := float(view.trends_mm_s[k])):
        sign = 0 if abs(slope) < _STEADY_MM_S else int(math.copysign(1, slope))
        # Two decimals fewer than a reading: a slope over two seconds is not more accurate.
        rate = f" {slope * units.per_mm:+.{max(0, units.decimals - 1)}f}/s" if sign else " steady"
        head.append((f"  {_ARROWS[sign]}{rate}", "" if sign else "dim"))
    room = len(_widest(view, controls, k))
    shown = f"{(reading.mm - controls.zero_mm[k]) * units.per_mm:{room}.{units.decimals}f}"
    digits = [row_of((shown, "bold"))]
    if width_of(shown, scale) <= width - 1:
        digits = large(shown, scale, "dim" if old else f"bold {colour}")
    digits += [Text()] * (height_of(scale) - len(digits))
    return below_each_other(row_of(*head), *digits, _range_row(view, controls, k, width - 1))


_ARROWS = {1: "▲", -1: "▼", 0: "■"}


def angle_panel(view: LiveView, controls: LiveControls, scale: int, width: int) -> Text:
    degrees, name = angle_deg(view, controls.zero_mm), (angle_name(view), f"bold {ANGLE_COLOUR}")
    if degrees is None:
        rows = [row_of(name, (" needs two gauges", "dim"))]
    else:
        scale_here = _largest_scale(_ANGLE_TEXT, width, scale)
        rows = [row_of(name, " °"), *large(f"{degrees:z8.4f}", scale_here, f"bold {ANGLE_COLOUR}")]
    rows += [Text()] * (gauge_rows(scale) - 1 - len(rows))
    return below_each_other(*rows, lap_row(view, width))


def lap_row(view: LiveView, width: int) -> Text:
    phi, lap, sense = phi_deg(view), lap_state(view), view.lap.sense
    if view.cell is None or lap.place == "no_circle":
        return row_of(("the rig file has no circle test" if view.cell else "", "dim"))
    if phi is None:
        return row_of(("φ –  the tool is not on the circle", "dim"))
    angle = (f"φ {phi:5.1f}°  ", "bold")
    if lap.place == "stands":
        return row_of(angle, ("stands", "dim"))
    way = ({1: "acw ↺", -1: "cw ↻"}[sense], direction_colour(sense))
    if lap.place in ("way_back", "lead_out"):
        return row_of(angle, way, {"way_back": " way back", "lead_out": " lead-out"}[lap.place])
    words = f" lap {lap.number}" + (f" of {view.cell.laps} " if view.direction else " ")
    part = "lead-in" if lap.place == "lead_in" else f"{100 * lap.share:3.0f} %"
    length = min(30, width - sum(map(len, (angle[0], way[0], words, part))) - 3)
    full = round(length * lap.share)
    bar = f"{'█' * full}{'░' * (length - full)} " if length > 3 else ""
    return row_of(angle, way, words, (bar, direction_colour(sense)), part)


def _widest(view: LiveView, controls: LiveControls, k: int) -> str:
    """The largest reading so far with a sign, whose width keeps the figures in place."""
    units, name = controls.units, f"g{k + 1}"
    every_mm = [*([] if view.extremes_mm is None else view.extremes_mm[k])]
    every_mm += [view.readings[name].mm] if name in view.readings else []
    largest_mm = max((abs(mm - controls.zero_mm[k]) for mm in every_mm if math.isfinite(mm)), default=0.0)
    return f"{-largest_mm * units.per_mm:.{units.decimals}f}"


def _range_row(view: LiveView, controls: LiveControls, k: int, width: int) -> Text:
    if view.extremes_mm is None or not np.isfinite(view.extremes_mm[k]).all():
        return Text()
    low, high = view.extremes_mm[k].tolist()
    units, zero = controls.units, controls.zero_mm[k]
    least, most = (f"{(mm - zero) * units.per_mm:.{units.decimals}f}" for mm in (low, high))
    ranges = view.cell.range_mm if view.cell else ()
    stated = ranges[k] if k < len(ranges) else None
    length = width - len(least) - len(most) - 11
    if length < 5:
        return row_of((f"min {least}  max {most}", "dim"))
    shown_mm = low, high, view.readings[f"g{k + 1}"].mm
    places = np.interp(shown_mm, stated or (low, max(high, low + 1e-9)), (0, length - 1))
    first, last, at = places.round().astype(int)
    bar = ["·" if stated else "─"] * length
    bar[first : last + 1] = "─" * (last + 1 - first)
    bar[0], bar[-1] = "├", "┤"
    left, right = "".join(bar[:at]), "".join(bar[at + 1 :])
    return row_of((f"min {least} {left}", "dim"), ("●", GAUGE_COLOURS[k]), (f"{right} max {most}", "dim"))


_LITTLE_DISK = 0.05
"""Share of free disk space below which a warning is shown."""
_LATE_DRIFT_PPM = 500.0
"""Drift from which a clock is marked: instrument clocks are within about 100 ppm of the host."""


def _state_of(view: LiveView) -> Iterator[tuple[str, str]]:
    if view.lost:
        yield view.lost, "bold red"
    elif played := view.played:
        mark = "■ ended" if played.ended else "‖ paused" if played.paused else "▶ played"
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


def joints_panel(view: LiveView) -> Text:
    if not len(view.rows) or not np.isfinite(view.rows.q[-1]).all():
        missing = "joint angles missing: the robot sends no data" if view.readings else "no joints yet"
        return row_of((missing, "dim"))
    names = view.cell.axes if view.cell else tuple(f"axis {axis}" for axis in range(1, 7))
    rows, speed = [], speeds(view.rows)
    for k, (name, angle) in enumerate(zip(names, np.degrees(view.rows.q[-1]).tolist(), strict=True)):
        sense, last = motion_sense(float(speed[k])), view.last_reversals.get(k + 1)
        pace = f" {math.degrees(speed[k]):+z6.1f}°/s" if sense else "    stands"
        turned = f"{view.reversal_counts[k]} rev, last {_place(last)}" if last else ""
        rows.append(
            row_of(
                (f"{k + 1} ", "bold"), f"{name[:9]:<9} {angle:z9.3f}° ", _ARROWS[sense],
                (f"{pace:<11}", "dim"), (turned, direction_colour(last.sense) if last else ""),
            )
        )  # fmt: skip
    return below_each_other(*rows)


def events_panel(view: LiveView, most: int) -> Text:
    now_s = float(view.rows.t_s[-1]) if len(view.rows) else 0.0
    rows = [row_of(("what happened", "bold"))]
    for event in reversed(view.events[-max(1, most) :]):
        style = "yellow" if event.reversal is None else direction_colour(event.reversal.sense)
        rows.append(row_of((f"{now_s - event.t_s:6.1f} s ago  {event_words(event, view)}", style)))
    return below_each_other(*rows)


def links_panel(view: LiveView, height: int) -> Text:
    if (state := view.state) is None:
        return Text()
    streams = list(state["streams"].items())[: max(0, height - 1)]
    rows = [row_of(*_stream(name, stream, view, state.get("clocks", {}).get(name))) for name, stream in streams]
    last = []
    if disk := state.get("disk"):
        share = disk["free_bytes"] / max(disk["size_bytes"], 1)
        words = f"disk {disk['free_bytes'] / 1e9:.1f} GB free ({100 * share:.0f} %)  "
        last.append((words, "bold yellow" if share < _LITTLE_DISK else "dim"))
    if host := ", ".join(f"{count} {kind}" for kind, count in state.get("host", {}).items()):
        last.append((f"computer: {host}  ", "yellow"))
    if state["recording"] and "samples" in state:
        synced = ", ".join(f"{name} {count}" for name, count in state.get("synced", {}).items())
        last.append((f"on the disk: {synced}", "dim"))
    return below_each_other(*rows, row_of(*last))


def _stream(
    name: str, stream: dict[str, Any], view: LiveView, clock: dict[str, Any] | None
) -> Iterator[tuple[str, str]]:
    words = ("connected ", "green") if stream["connected"] else ("lost      ", "bold red")
    yield f"{name:<6}"[:12] + " ", "bold"
    yield ("last known ", "") if view.lost else words
    yield f"{stream['rate_hz']:6.1f} Hz ", ""
    now = {column: value for column, value in stream["last"].items() if stream["age_s"][column] <= OLD_S}
    disturbed = [words for words, disturbs in condition_words(now) if disturbs]
    if disturbed and stream["connected"]:
        yield " · ".join(disturbed) + " ", "bold red"
    old = [column for column, age_s in stream["age_s"].items() if age_s > OLD_S and column not in CONDITION]
    if old and stream["connected"]:
        yield f"silent {stream['age_s'][old[0]]:.0f} s ", "yellow"
    for gauge in [part for part in name.split("_") if part in FURTHER and part in view.readings]:
        yield f"{gauge} {view.readings[gauge].mm:z.4f} mm ", "bold"
    if clock:
        drift = clock.get("drift_ppm")
        late = f"late {1e3 * clock['late_s']:z.1f} ms" + (f", clock {drift:+z.0f} ppm " if drift is not None else " ")
        yield late, "yellow" if drift is not None and abs(drift) > _LATE_DRIFT_PPM else "dim"
    faults = ", ".join(f"{n} {kind}" for kind, n in stream["counters"].items() if kind != "samples")
    yield (f"{faults}; last: {stream['last_fault']}", "yellow") if faults else ("no faults", "dim")


def foot_rows(view: LiveView, controls: LiveControls, width: int) -> list[Text]:
    message = [row_of((line, "yellow")) for line in wrap(plain(controls.message), max(1, width - 2))]
    if controls.prompt is not None:
        label = ("label (name test direction, Esc to leave): ", "bold")
        return [*message, row_of(label, f"{controls.prompt}█")]
    keys = "space pause  + - speed  u units  z zero" if view.played else "s start  e end  l label  z zero  u units"
    return [*message, row_of((f"{keys}  r restart  ? help  q quit", "dim"))]


def event_words(event: LiveEvent, view: LiveView) -> str:
    if event.reversal is None:
        return event.words
    reversal = event.reversal
    name = f" ({view.cell.axes[reversal.axis - 1]})" if view.cell else ""
    return f"axis {reversal.axis}{name} turned back at {_place(reversal)}"


def _place(reversal: LiveReversal) -> str:
    phi = f"φ {math.degrees(reversal.phi_rad):5.1f}° " if math.isfinite(reversal.phi_rad) else ""
    return f"{phi}{'▲▼' if reversal.upper else '▼▲'}"


_LEAST_WIDTH, _LEAST_HEIGHT = 60, 18
"""Minimum size of the terminal for panels. A smaller one shows only figures."""
_THREE_WIDE = 150
_STRAIGHT = 170
_JOINT_ROWS = 7


@dataclass(frozen=True)
class LiveScreen:
    view: LiveView
    controls: LiveControls

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        width, height = options.max_width, options.height or options.max_height
        foot = below_each_other(*foot_rows(self.view, self.controls, width)[-max(1, height - 1) :])
        rows = foot.plain.count("\n") + 1
        if self.controls.shows_help:
            keys = below_each_other(*(row_of((f"{key:<7}", "bold"), words) for key, words in KEYS))
            panel = Panel(keys, title="keys", title_align="left", expand=False)
            body: RenderableType = Align.center(panel, vertical="middle")
        elif width < _LEAST_WIDTH or height < _LEAST_HEIGHT:
            line = plain_line(self.view, self.controls.units, self.controls.zero_mm)
            body = below_each_other(*(row_of(part.strip()) for part in line.split(";")))
        else:
            panels = _panels(self.view, self.controls, width, height - rows - 1)
            shown = Styled(panels, "dim") if self.view.lost else panels  # the last known state
            name = self.view.cell.name if self.view.cell else (self.view.state or {}).get("rig", "rig live")
            body = _split([(row_of((f"{name}  ", "bold"), *_state_of(self.view)), 1), (shown, None)])
        yield from console.render(_split([(body, None), (foot, rows)]), options)  # `yield` would drop the height


def _panels(view: LiveView, controls: LiveControls, width: int, height: int) -> Layout:
    figures = 3 if width >= _THREE_WIDE else 2
    widest = max((_widest(view, controls, k) for k in range(2)), key=len)
    scale = _largest_scale(widest, width // figures, 1 if height < 28 else _LARGEST_SCALE)
    links = 1 + len(view.state["streams"]) if view.state else 0 if view.played else 4
    links = min(links, max(4, height // 6))
    gauges: list[RenderableType] = [gauge_panel(view, controls, k, scale, width // figures) for k in range(2)]
    if figures == 3:
        gauges.append(angle_panel(view, controls, scale, width // figures))
    free = height - gauge_rows(scale) - links
    trace = max(3, free // 4)
    return _split([
        (_split([(gauge, None) for gauge in gauges], "row"), gauge_rows(scale)),
        (_middle(view, controls, width, free - trace, with_angle=figures == 2), None),
        (Plot(partial(draw_trace, view, controls)), trace),
        (links_panel(view, links), links),
    ])  # fmt: skip


def _middle(view: LiveView, controls: LiveControls, width: int, height: int, *, with_angle: bool) -> Layout:
    curves = shown_curves(view)
    side = min(2 * height + 2, width // 2)
    right: list[_Part] = [("", 1)]
    if with_angle and height >= 14:
        right = [(angle_panel(view, controls, 1, width - side), gauge_rows(1)), ("", 1)]
    elif with_angle:
        degrees = angle_deg(view, controls.zero_mm)
        shown = f"{angle_name(view)} {degrees:z.4f}°" if degrees is not None else ""
        right = [(below_each_other(row_of((shown, "bold")), lap_row(view, width - side)), 2)]
    below = _split([(joints_panel(view), _JOINT_ROWS), (events_panel(view, height), None)])
    if width >= _STRAIGHT:
        plot = Plot(partial(draw_straight, view, controls, curves))
        below = _split([(below, min(66, (width - side) // 2)), (plot, None)], "row")
    circle = Plot(partial(draw_circle, view, controls, curves))
    return _split([(circle, side), (_split([*right, (below, None)]), None)], "row")


_Part = tuple[RenderableType, int | None]
"""A part of the screen and its height or width; None for the rest."""


def _split(parts: Sequence[_Part], way: Literal["column", "row"] = "column") -> Layout:
    """Only text needs a margin on the left."""
    layout, shown = Layout(), list[Layout]()
    for part, size in parts:
        if size != 0:
            has_margin = not isinstance(part, Layout | Plot | Styled | Align)
            shown.append(Layout(Padding(part, (0, 0, 0, 1)) if has_margin else part, size=size))
    layout.split(*shown, splitter=way)
    return layout
