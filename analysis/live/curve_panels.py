"""Curves over time and over the circle angle: the scrolling trace, and the error of the circle laid out straight."""

from __future__ import annotations

import math

import numpy as np

from analysis.live.canvas import ACW_COLOUR, CW_COLOUR, GAUGE_COLOURS, Area, Dots
from analysis.live.circle_panel import scale_of, unit_of
from analysis.live.controls import Controls
from analysis.live.sweeps import ErrorCurve, pieces
from analysis.live.view import LiveView

_LABEL = 15
"""Columns at the left for the scale."""
_SECONDS_A_COLUMN = 0.25
_LEAST_MM = 0.001
"""The smallest span of a trace: below it, only the last digits of a gauge flicker."""
_QUARTERS = 4


def draw_trace(area: Area, view: LiveView, controls: Controls) -> None:
    """Draw the readings of the last seconds, each gauge less its mean over them, on one scale."""
    plot = area.part(0, _LABEL, area.width - _LABEL, area.height)
    seconds = max(5.0, plot.width * _SECONDS_A_COLUMN)
    recent, units = view.since(seconds), controls.units
    area.put(0, 1, "trace", "bold")
    if not len(recent) or not plot.width:
        return
    with_values = [k for k in range(2) if np.isfinite(recent.g_mm[:, k]).any()]
    lines = {k: recent.g_mm[:, k] - np.nanmean(recent.g_mm[:, k]) for k in with_values}
    reach_mm = max([_LEAST_MM / 2, *(float(np.nanmax(np.abs(line))) for line in lines.values())])
    area.put(area.height // 2, 1, f"±{reach_mm * units.per_mm:.{max(1, units.decimals - 1)}f} {units.name}", "dim")
    area.put(area.height - 1, 1, f"{seconds:.0f} s", "dim")
    dots = Dots(plot)
    x = dots.width_dots - 1 - (recent.t_s[-1] - recent.t_s) / seconds * dots.width_dots
    for k, line in lines.items():
        y = (dots.height_dots - 1) * (0.5 - 0.48 * line / reach_mm)
        # The stretches of a line (n,) without nan
        finite = np.concatenate([[False], np.isfinite(line), [False]])
        begins, ends = np.flatnonzero(finite[1:] & ~finite[:-1]), np.flatnonzero(finite[:-1] & ~finite[1:])
        for begin, end in zip(begins.tolist(), ends.tolist(), strict=True):
            dots.polyline(x[begin:end], y[begin:end], GAUGE_COLOURS[k])


def draw_straight(area: Area, view: LiveView, controls: Controls, curves: tuple[ErrorCurve, ErrorCurve]) -> None:
    """Draw the errors acw and cw over the circle angle, on the scale of the circle."""
    unit, factor = unit_of(view, controls)
    scale = scale_of(curves)
    words = "error over φ"
    if any(len(curve.phi) and not curve.less_sine for curve in curves):
        words += ", less its mean"
    elif any(len(curve.phi) for curve in curves):
        words += ", less its sine"
    area.put(0, 1, words, "bold")
    plot = area.part(1, _LABEL, area.width - _LABEL - 1, area.height - 2)
    dots = Dots(plot)
    if dots.width_dots < 4 or dots.height_dots < 4:
        return
    if any(len(curve.phi) for curve in curves):
        area.put(1, 1, f"{scale * factor:+g}{unit}", "dim")
        area.put(area.height - 2, 1, f"{-scale * factor:+g}{unit}", "dim")
    for quarter in range(_QUARTERS + 1):
        label = f"{90 * quarter}°"
        column = _LABEL + round(quarter / _QUARTERS * (plot.width - 1)) - (len(label) if quarter == _QUARTERS else 0)
        area.put(area.height - 1, column + (quarter == _QUARTERS), label, "dim")
    zero = np.arange(0.0, dots.width_dots, 4.0)
    dots.points(zero, np.full(len(zero), dots.height_dots / 2), "dim")
    for curve, colour, every in zip(curves, (ACW_COLOUR, CW_COLOUR), (1, 2), strict=True):
        for piece in pieces(curve):
            x = curve.phi[piece] / (2 * math.pi) * dots.width_dots
            y = (dots.height_dots - 1) * (0.5 - 0.5 * curve.error[piece] / scale)
            dots.polyline(x, y, colour, every)
