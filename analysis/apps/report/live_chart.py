"""Charts in the plotly format: data and layout in plain types.

Colours are given as role names; the script of the page replaces them for light or dark paper.
"""

from __future__ import annotations

import base64
from typing import Any

import numpy as np

from analysis.apps.report.chart import ROLE_STYLES, Chart, ChartLine, Picture, SphereChart
from analysis.robot.kinematics.arm import Array
from rigs.text import plain_values


def live(picture: Picture) -> dict[str, Any]:
    """Return `data`, `layout` and `height` in pixels for plotly. All text is plain."""
    drawn = _sphere(picture) if isinstance(picture, SphereChart) else _chart(picture)
    plain: dict[str, Any] = plain_values(drawn)
    return plain


def colours(*, dark: bool) -> dict[str, str]:
    return {role: look.dark if dark else look.light for role, look in ROLE_STYLES.items()}


def _numbers(values: Array) -> dict[str, Any]:
    """Return numbers as a typed array of plotly: single precision exceeds the screen resolution, at a third of the
    size of text.
    """
    exact = np.ascontiguousarray(values, dtype="<f4")
    packed = {"dtype": "f4", "bdata": base64.b64encode(exact.tobytes()).decode()}
    return packed if exact.ndim == 1 else {**packed, "shape": ", ".join(map(str, exact.shape))}


def _chart(chart: Chart) -> dict[str, Any]:
    if chart.frame == "polar":
        return _polar(chart)
    full = {"yref": "paper", "y0": 0, "y1": 1}
    line = {"type": "line", **full, "line": {"dash": "dot", "width": 1}}
    shade = {"type": "rect", **full, "line": {"width": 0}, "opacity": 0.25, "layer": "below", "shade": True}
    word = {"yref": "paper", "y": 1.0, "yanchor": "bottom", "xanchor": "left", "textangle": -45, "font": {"size": 10}}
    layout: dict[str, Any] = {
        "xaxis": {"title": {"text": chart.x_label}, "zeroline": False},
        "yaxis": {"title": {"text": chart.y_label}, "zeroline": True, "automargin": True},
        "hovermode": "x unified" if chart.frame == "straight" else "closest",
        "shapes": [{**line, "x0": mark.at_deg, "x1": mark.at_deg} for mark in chart.marks]
        + [{**shade, "x0": low, "x1": high} for low, high in chart.shaded],
        "annotations": [{**word, "x": mark.at_deg, "text": mark.text, "showarrow": False} for mark in chart.marks],
    }
    if chart.frame == "plane":
        layout["yaxis"] |= {"scaleanchor": "x"}
    if chart.frame == "straight":
        layout["xaxis"] |= {"range": [0, 360], "dtick": 30, "ticksuffix": "°"}
    if chart.steps:
        layout["yaxis"] |= {"range": list(chart.reach)}
    if chart.ticks:
        layout["xaxis"] |= {"tickvals": [at for at, _ in chart.ticks], "ticktext": [name for _, name in chart.ticks]}
    data = [_trace(line, chart.unit) for line in chart.lines]
    return {"data": data, "layout": layout, "height": 520 if chart.frame == "plane" else 340}


def _trace(line: ChartLine, unit: str) -> dict[str, Any]:
    look = ROLE_STYLES[line.role]
    trace: dict[str, Any] = {
        "type": "scatter",
        "name": line.name,
        "role": line.role,
        "mode": "markers" if line.points else "lines",
        "x": _numbers(line.x),
        "y": _numbers(line.y),
        "line": {"dash": look.dash, "width": 1.5 * look.width},
        "marker": {"symbol": look.symbol, "size": 7},
        "hovertemplate": f"%{{y:.4~g}} {unit}",
    }
    if line.steps is not None:
        trace["steps"] = [_numbers(values) for values in line.steps]
    if line.half is not None:
        trace["error_y"] = {"type": "data", "array": _numbers(line.half), "thickness": 1}
    return trace


def _polar(chart: Chart) -> dict[str, Any]:
    hole, data = chart.hole, []
    for line in chart.lines:
        look, order = ROLE_STYLES[line.role], np.append(np.arange(len(line.x)), 0)  # closed
        around: dict[str, Any] = {
            "type": "scatterpolar",
            "name": line.name,
            "role": line.role,
            "mode": "lines",
            "theta": _numbers(line.x[order]),
            "r": _numbers(hole + line.y[order]),
            "customdata": _numbers(line.y[order]),
            "line": {"dash": look.dash, "width": 1.5 * look.width},
            "hovertemplate": f"φ %{{theta:.0f}}°: %{{customdata:.4~g}} {chart.unit}",
        }
        data.append(around)
    circle_deg = np.linspace(0.0, 360.0, 181)
    zero = {"type": "scatterpolar", "mode": "lines", "role": "quiet", "showlegend": False, "hoverinfo": "skip"}
    data.append(
        {**zero, "theta": _numbers(circle_deg), "r": _numbers(np.full(181, hole)), "line": {"width": 1, "dash": "dot"}}
    )
    radial = {
        "range": [0, hole + 1.4 * chart.largest],
        "tickvals": [hole, hole + chart.largest],
        "ticktext": ["", f"+{chart.largest_shown} {chart.unit}"],
        "angle": 45,
    }
    polar = {"radialaxis": radial, "angularaxis": {"dtick": 30, "ticksuffix": "°"}}
    return {"data": data, "layout": {"polar": polar}, "height": 420}


def _sphere(chart: SphereChart) -> dict[str, Any]:
    """Return the measured surface with grid lines, the translucent least-squares sphere, and the targets."""
    x, y, z = np.moveaxis(chart.chart_points(chart.grid, chart.grid_deviation_mm), -1, 0)
    smooth = np.moveaxis(chart.grid * chart.radius_mm, -1, 0)
    sphere, surface, targets = chart.words
    limit = float(np.abs(chart.deviation_mm).max())
    plain_sphere = {
        "type": "surface", "name": sphere, "opacity": 0.35, "showscale": False, "hoverinfo": "skip",
        "colorscale": [[0, "#9a9a9a"], [1, "#9a9a9a"]], "showlegend": True,
        **{name: _numbers(values) for name, values in zip("xyz", smooth, strict=True)},
    }  # fmt: skip
    measured = {
        "type": "surface", "name": surface, "surfacecolor": _numbers(chart.grid_deviation_mm), "showlegend": True,
        "cmin": -limit, "cmax": limit, "colorscale": "Cividis", "hoverinfo": "skip",
        "colorbar": {"title": {"text": "mm"}, "thickness": 12, "len": 0.7},
        **{name: _numbers(values) for name, values in zip("xyz", (x, y, z), strict=True)},
    }  # fmt: skip
    at = np.moveaxis(chart.chart_points(chart.targets, chart.deviation_mm), -1, 0)
    dots = {
        "type": "scatter3d", "mode": "markers", "name": targets, "marker": {"size": 3, "color": "#000000"},
        "text": list(chart.names), "hovertemplate": "%{text}<extra></extra>",
        **{name: _numbers(values) for name, values in zip("xyz", at, strict=True)},
    }  # fmt: skip
    axes = {f"{name}axis": {"title": {"text": f"{name} / mm"}} for name in "xyz"}
    scene = {
        **axes,
        "aspectmode": "data",
        "camera": {"eye": {"x": 1.5, "y": -1.5, "z": 1.0}, "center": {"x": 0, "y": 0, "z": -0.15}},
    }
    return {"data": [plain_sphere, measured, dots], "layout": {"scene": scene}, "height": 520}
