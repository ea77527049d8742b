"""Contents of a chart.

The script of the page draws the interactive version from `live`, `still_chart` that for paper and for browsers
without scripts.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from analysis.apps.report.texts import Texts
from analysis.robot.kinematics.arm import Array
from analysis.runs.tabular import pick_fields
from rigs.text import plain_values

Role = Literal["acw", "cw", "measured", "model", "after", "quiet", "fifth", "sixth"]
"""Meaning of a line; determines colour, dash and symbol together, so that no meaning depends on colour only."""
Frame = Literal["straight", "polar", "targets", "plane"]
"""Horizontal axis: circle angle, straight or polar, target number, or a plane with equal scales."""
_HOLE = 2.6
"""Radius of the zero circle in a polar chart, in units of the largest deviation, as in roundness diagrams."""
_SAME_DEG = 8.0
"""Distance of marks on the circle below which they share a label."""


@dataclass(frozen=True)
class RoleStyle:
    """Colours on light and dark paper, dashes, and symbol of points.

    Orange, blue and green are distinguishable with colour blindness (Okabe and Ito), and dashes in black and white.
    """

    light: str
    dark: str
    dash: Literal["solid", "dash", "dot", "dashdot"]
    symbol: Literal["circle", "square", "diamond"]
    width: float = 1.2


ROLE_STYLES: dict[Role, RoleStyle] = {
    "acw": RoleStyle("#b34700", "#ffa14d", "solid", "circle"),
    "cw": RoleStyle("#0060a8", "#6cb8ff", "dash", "square"),
    "measured": RoleStyle("#e08a4a", "#b0703c", "solid", "circle", 3.2),
    "model": RoleStyle("#0060a8", "#6cb8ff", "dash", "square"),
    "after": RoleStyle("#004d36", "#7fe8c4", "dot", "diamond"),
    "quiet": RoleStyle("#6b6b6b", "#a8a8a8", "dot", "circle"),
    "fifth": RoleStyle("#7d2c83", "#dd9fe2", "dashdot", "square"),
    "sixth": RoleStyle("#1c1c1c", "#ececec", "solid", "diamond", 0.8),
}


@dataclass(frozen=True)
class ChartLine:
    """Values y (n,) at x (n,).

    half (n,): half length of the error bars. steps (steps, n): values at each step of an animated chart; y is the last.
    """

    name: str
    role: Role
    x: Array
    y: Array
    points: bool = False
    half: Array | None = None
    steps: Array | None = None


Marks = tuple[tuple[float, str], ...]
"""Places on the circle in degrees, each with a text."""


@dataclass(frozen=True)
class Chart:
    """shaded (from, to): in degrees of the circle. ticks: names at the positions x of the targets."""

    title: str
    caption: str
    frame: Frame
    x_label: str
    y_label: str
    unit: str
    lines: tuple[ChartLine, ...]
    marks: Marks = ()
    shaded: tuple[tuple[float, float], ...] = ()
    ticks: tuple[tuple[float, str], ...] = ()
    panels: tuple[str, ...] = ()
    """Names of the steps; paper shows a panel for each."""
    span: tuple[float, float] | None = None
    """Range of the vertical axis on paper, common to several charts."""

    @property
    def steps(self) -> int:
        return max((len(line.steps) for line in self.lines if line.steps is not None), default=0)

    def at_step(self, step: int) -> Chart:
        lines = [line if line.steps is None else replace(line, y=line.steps[step], steps=None) for line in self.lines]
        return replace(self, lines=tuple(lines))

    @property
    def reach(self) -> tuple[float, float]:
        every = [line.y if line.steps is None else line.steps for line in self.lines]
        low, high = min(float(values.min()) for values in every), max(float(values.max()) for values in every)
        room = 0.06 * max(high - low, 1e-9)
        return low - room, high + room

    @property
    def largest(self) -> float:
        """Scale of a polar chart."""
        return max(1e-9, *(float(np.abs(line.y).max()) for line in self.lines))

    @property
    def largest_shown(self) -> str:
        return f"{float(f'{self.largest:.2g}'):g}"

    @property
    def hole(self) -> float:
        return _HOLE * self.largest


@dataclass(frozen=True)
class SphereChart:
    """A measured surface around the least-squares sphere, with the largest deviation drawn as a fifth of the radius.

    grid: directions (n, m, 3) with grid_deviation_mm (n, m). targets: directions (t, 3) with deviation_mm (t,).
    """

    title: str
    caption: str
    radius_mm: float
    grid: Array
    grid_deviation_mm: Array
    targets: Array
    deviation_mm: Array
    names: tuple[str, ...]
    words: tuple[str, str, str]
    """Names of the sphere, the surface and the targets."""
    frame: Literal["sphere"] = "sphere"

    @property
    def magnified(self) -> float:
        largest = max(float(np.abs(self.deviation_mm).max()), float(np.abs(self.grid_deviation_mm).max()), 1e-9)
        return 0.2 * self.radius_mm / largest

    def chart_points(self, direction: Array, deviation_mm: Array) -> Array:
        """Positions (..., 3) mm of points with a deviation (...) mm in a direction (..., 3), magnified."""
        place: Array = direction * (self.radius_mm + self.magnified * deviation_mm)[..., None]
        return place


Picture = Chart | SphereChart


def marks_of(turns: Sequence[tuple[float, int]], texts: Texts) -> Marks:
    """Marks of reversals, given as angle in degrees and axis. Close marks share a label."""
    groups: list[list[tuple[float, int]]] = []
    for turn in sorted(turns):
        if groups and turn[0] - groups[-1][0][0] < _SAME_DEG:
            groups[-1].append(turn)
        else:
            groups.append([turn])
    names = [texts("marked", axes=", ".join(dict.fromkeys(str(axis) for _, axis in group))) for group in groups]
    return tuple(
        (at_deg, name if place == 0 else "")
        for group, name in zip(groups, names, strict=True)
        for place, (at_deg, _) in enumerate(group)
    )


def stretches(places: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    parts: list[tuple[float, float]] = []
    for low, high in places:
        parts += [(low, high)] if low <= high else [(low, 360.0), (0.0, high)]
    return tuple(parts)


def live(picture: Picture) -> dict[str, Any]:
    """Contents for the script of the page (`templates/report.js`), which draws them with plotly."""
    if isinstance(picture, SphereChart):
        contents = pick_fields(picture, "frame", "names", "words") | {
            "sphere": _places(picture.grid * picture.radius_mm),
            "surface": _places(picture.chart_points(picture.grid, picture.grid_deviation_mm)),
            "targets": _places(picture.chart_points(picture.targets, picture.deviation_mm)),
            "deviation": picture.grid_deviation_mm.round(6).tolist(),
            "limit": float(np.abs(picture.deviation_mm).max()),
        }
    else:
        names = ["frame", "x_label", "y_label", "unit", "marks", "shaded", "ticks", "steps"]
        names += ["hole", "largest", "largest_shown"] if picture.frame == "polar" else []
        names += ["reach"] if picture.steps else []
        lines = [{name: _packed(value) for name, value in vars(line).items()} for line in picture.lines]
        contents = pick_fields(picture, *names) | {"lines": lines}
    plain: dict[str, Any] = plain_values(contents)
    return plain


def _places(points: Array) -> dict[str, Any]:
    return {axis: values.round(4).tolist() for axis, values in zip("xyz", np.moveaxis(points, -1, 0), strict=True)}


def _packed(value: object) -> object:
    """An array, or each of its rows, in single precision: finer than the screen, at a third of the size of text."""
    if not isinstance(value, np.ndarray):
        return value
    return _base64(value) if value.ndim == 1 else list(map(_base64, value))


def _base64(values: Array) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode()
