"""Contents of a chart for the script of the page (`templates/report.js`), which draws it with plotly."""

from __future__ import annotations

import base64
from dataclasses import asdict
from typing import Any

import numpy as np

from analysis.apps.report.chart import ChartLine, Picture, SphereChart
from analysis.robot.kinematics.arm import Array
from rigs.text import plain_values


def live(picture: Picture) -> dict[str, Any]:
    contents: dict[str, Any] = {"frame": picture.frame}
    if isinstance(picture, SphereChart):
        contents |= {
            "sphere": _places(picture.grid * picture.radius_mm),
            "surface": _places(picture.chart_points(picture.grid, picture.grid_deviation_mm)),
            "targets": _places(picture.chart_points(picture.targets, picture.deviation_mm)),
            "deviation": picture.grid_deviation_mm.round(6).tolist(),
            "limit": float(np.abs(picture.deviation_mm).max()),
            "names": picture.names,
            "words": picture.words,
        }
    else:
        names = ["x_label", "y_label", "unit", "shaded", "ticks", "steps"]
        names += ["hole", "largest", "largest_shown"] if picture.frame == "polar" else []
        names += ["reach"] if picture.steps else []
        contents |= {name: getattr(picture, name) for name in names}
        contents |= {
            "marks": [asdict(mark) for mark in picture.marks],
            "lines": [_line(line) for line in picture.lines],
        }
    plain: dict[str, Any] = plain_values(contents)
    return plain


def _line(line: ChartLine) -> dict[str, Any]:
    return {
        "name": line.name, "role": line.role, "points": line.points, "x": _packed(line.x), "y": _packed(line.y),
        "half": None if line.half is None else _packed(line.half),
        "steps": None if line.steps is None else [_packed(values) for values in line.steps],
    }  # fmt: skip


def _places(points: Array) -> dict[str, Any]:
    return {axis: values.round(4).tolist() for axis, values in zip("xyz", np.moveaxis(points, -1, 0), strict=True)}


def _packed(values: Array) -> str:
    """Single precision: finer than the screen, at a third of the size of text."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode()
