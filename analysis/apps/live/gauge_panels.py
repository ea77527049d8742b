"""Panels of gauges and angle in large figures, with range bar, extremes and trend."""

from __future__ import annotations

import math

import numpy as np

from analysis.apps.live.canvas import (
    ANGLE_COLOUR,
    GAUGE_COLOURS,
    Area,
    direction_colour,
    height_of,
    put_large,
    width_of,
)
from analysis.apps.live.controls import LiveControls
from analysis.apps.live.figures import OLD_S, angle_deg, angle_name, lap_state, phi_deg
from analysis.apps.live.view import LiveView

_STEADY_MM_S = 0.0005
"""Trend below which a reading is steady: the noise of a 0.5 µm gauge over two seconds."""
_LARGEST_SCALE = 4
_ANGLE_TEXT = "-00.0000"


def scale_for(view: LiveView, controls: LiveControls, width: int) -> int:
    """Largest scale at which both gauges fit, at least 1."""
    text = max((_text(view, controls, k, _widest(view, controls, k)) for k in range(2)), key=len)
    text = "".join("0" if character.isdigit() else character for character in text)
    fits = [scale for scale in range(1, _LARGEST_SCALE + 1) if width_of(text, scale) <= width - 2]
    return max(fits, default=1)


def gauge_rows(scale: int) -> int:
    return height_of(scale) + 2


def draw_gauge(area: Area, view: LiveView, controls: LiveControls, k: int, scale: int) -> None:
    name, units = f"g{k + 1}", controls.units
    column = area.put(0, 1, name, f"bold {GAUGE_COLOURS[k]}")
    column = area.put(0, column, f" {units.name}")
    if name not in view.readings:
        area.put(0, column + 2, "no reading yet", "dim")
        return
    reading = view.readings[name]
    if controls.zero_mm[k]:
        zero = controls.zero_mm[k] * units.per_mm
        column = area.put(0, column, f"  less {zero:.{units.decimals}f}", "bold")
    old = reading.age_s > OLD_S
    if old:
        area.put(0, column + 2, f"{reading.age_s:.0f} s old", "yellow")
    elif not math.isnan(slope := float(view.trends_mm_s[k])):
        sign = 0 if abs(slope) < _STEADY_MM_S else int(math.copysign(1, slope))
        # Two decimals fewer than a reading: a slope over two seconds is not more accurate.
        rate = f" {slope * units.per_mm:+.{max(0, units.decimals - 1)}f}/s" if sign else " steady"
        area.put(0, column + 2, {1: "▲", -1: "▼", 0: "■"}[sign] + rate, "" if sign else "dim")
    shown = _text(view, controls, k, reading.mm)
    if width_of(shown, scale) <= area.width - 1:
        put_large(area, 1, 1, shown, scale, "dim" if old else f"bold {GAUGE_COLOURS[k]}")
    else:
        area.put(1, 1, shown, "bold")
    _range(area, view, controls, k)


def draw_angle(area: Area, view: LiveView, controls: LiveControls, scale: int) -> None:
    """Yaw or roll in large figures, with circle angle and lap below."""
    degrees = angle_deg(view, controls.zero_mm)
    column = area.put(0, 1, angle_name(view), f"bold {ANGLE_COLOUR}")
    area.put(0, column, " °" if degrees is not None else " needs two gauges", "" if degrees is not None else "dim")
    if degrees is not None:
        fits = [candidate for candidate in range(1, scale + 1) if width_of(_ANGLE_TEXT, candidate) <= area.width - 2]
        put_large(area, 1, 1, f"{degrees:z8.4f}", max(fits, default=1), f"bold {ANGLE_COLOUR}")
    draw_lap(area.part(area.height - 1, 0, area.width, 1), view)


def draw_lap(area: Area, view: LiveView) -> None:
    """Circle angle and progress of the lap in a row, or why they are missing."""
    phi, lap = phi_deg(view), lap_state(view)
    if view.cell is None or lap.place == "no_circle":
        area.put(0, 1, "the rig file has no circle test" if view.cell else "", "dim")
        return
    if phi is None:
        area.put(0, 1, "φ –  the tool is not on the circle", "dim")
        return
    column = area.put(0, 1, f"φ {phi:5.1f}°", "bold")
    if lap.place == "stands":
        area.put(0, column + 2, "stands", "dim")
        return
    column = area.put(0, column + 2, {1: "acw ↺", -1: "cw ↻"}[view.lap.sense], direction_colour(view.lap.sense))
    if lap.place in ("way_back", "lead_out"):
        area.put(0, column + 1, {"way_back": "way back", "lead_out": "lead-out"}[lap.place])
        return
    words = f"lap {lap.number}" + (f" of {view.cell.laps}" if view.direction else "")
    column = area.put(0, column + 1, words) + 1
    part = "lead-in" if lap.place == "lead_in" else f"{100 * lap.share:3.0f} %"
    width = min(30, area.width - column - len(part) - 2)
    if width > 3:
        full = round(width * lap.share)
        column = area.put(0, column, "█" * full + "░" * (width - full), direction_colour(view.lap.sense)) + 1
    area.put(0, column, part)


def _text(view: LiveView, controls: LiveControls, k: int, mm: float) -> str:
    """Reading with the width of the largest previous one, which keeps the figures in place."""
    units = controls.units
    widest = f"{-abs(_widest(view, controls, k) - controls.zero_mm[k]) * units.per_mm:.{units.decimals}f}"
    return f"{(mm - controls.zero_mm[k]) * units.per_mm:{len(widest)}.{units.decimals}f}"


def _widest(view: LiveView, controls: LiveControls, k: int) -> float:
    values = [] if view.extremes_mm is None else [float(mm) for mm in view.extremes_mm[k] if math.isfinite(mm)]
    name = f"g{k + 1}"
    values += [view.readings[name].mm] if name in view.readings else []
    return max(values, key=lambda mm: abs(mm - controls.zero_mm[k]), default=0.0)


def _range(area: Area, view: LiveView, controls: LiveControls, k: int) -> None:
    """Draw the calibrated range if known, otherwise the observed range."""
    if view.extremes_mm is None or not np.isfinite(view.extremes_mm[k]).all():
        return
    low, high = (float(mm) for mm in view.extremes_mm[k])
    units, row, zero = controls.units, area.height - 1, controls.zero_mm[k]
    low_text, right = (f"{(mm - zero) * units.per_mm:.{units.decimals}f}" for mm in (low, high))
    column = area.put(row, 1, f"min {low_text} ", "dim")
    end = area.width - len(right) - 6
    ranges = view.cell.range_mm if view.cell else ()
    stated = ranges[k] if k < len(ranges) else None
    ends = stated or (low, high)
    width = end - column
    if width >= 5:
        bar = ["·" if stated else "─"] * width
        span = max(ends[1] - ends[0], 1e-12)

        def place(mm: float) -> int:
            return round((width - 1) * min(max((mm - ends[0]) / span, 0.0), 1.0))

        bar[place(low) : place(high) + 1] = "─" * (place(high) + 1 - place(low))
        bar[0], bar[-1] = "├", "┤"
        area.put(row, column, "".join(bar), "dim")
        area.put(row, column + place(view.readings[f"g{k + 1}"].mm), "●", GAUGE_COLOURS[k])
    area.put(row, end, f" max {right}", "dim")
