"""What a picture of the page shows, free of how it is drawn.

`live_chart` makes the interactive picture of it and `still_chart` the one for paper and for browsers without scripts,
so that both show the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from analysis.report.texts import Texts
from analysis.robot.kinematics.arm import Array

Role = Literal["acw", "cw", "measured", "model", "after", "quiet", "fifth", "sixth"]
"""What a line stands for; it decides colour, dash and symbol alike, since no meaning hangs on colour alone."""
Frame = Literal["straight", "polar", "targets", "plane"]
"""Along the circle angle, around the circle, target by target, or on a plane of one scale in both directions."""
_HOLE = 2.6
"""Radius of the circle of no deviation in a polar picture, in largest deviations, as in roundness diagrams."""
_SAME_DEG = 8.0
"""Marks nearer than this on the circle have no room for a name each."""


@dataclass(frozen=True)
class Look:
    """How a role looks: colours on light and on dark paper, dashes, and the symbol of points. The colour-blind see
    orange, blue and green as three (Okabe and Ito), and in black and white the dashes differ."""

    light: str
    dark: str
    dash: Literal["solid", "dash", "dot", "dashdot"]
    symbol: Literal["circle", "square", "diamond"]
    width: float = 1.2


LOOKS: dict[Role, Look] = {
    "acw": Look("#b34700", "#ffa14d", "solid", "circle"),
    "cw": Look("#0060a8", "#6cb8ff", "dash", "square"),
    "measured": Look("#e08a4a", "#b0703c", "solid", "circle", 3.2),
    "model": Look("#0060a8", "#6cb8ff", "dash", "square"),
    "after": Look("#004d36", "#7fe8c4", "dot", "diamond"),
    "quiet": Look("#6b6b6b", "#a8a8a8", "dot", "circle"),
    "fifth": Look("#7d2c83", "#dd9fe2", "dashdot", "square"),
    "sixth": Look("#1c1c1c", "#ececec", "solid", "diamond", 0.8),
}


@dataclass(frozen=True)
class Line:
    """Values y (n,) at x (n,), as a line or as points; half (n,): half of the range that a bar shows, where there is
    one; steps (steps, n): the values at each step of a chart that is stepped through, of which y is the last."""

    name: str
    role: Role
    x: Array
    y: Array
    points: bool = False
    half: Array | None = None
    steps: Array | None = None


@dataclass(frozen=True)
class Mark:
    """A place on the circle, in degrees, with the word that stands there."""

    at_deg: float
    text: str


@dataclass(frozen=True)
class Chart:
    """Lines in one frame. y_label has the unit, and `unit` is what stands behind a number; marks and shaded stretches
    (from, to) are in degrees of the circle; ticks: names of the places x of targets."""

    title: str
    caption: str
    frame: Frame
    x_label: str
    y_label: str
    unit: str
    lines: tuple[Line, ...]
    marks: tuple[Mark, ...] = ()
    shaded: tuple[tuple[float, float], ...] = ()
    ticks: tuple[tuple[float, str], ...] = ()
    panels: tuple[str, ...] = ()
    """Names of the steps, for the one picture of which paper shows each step."""
    span: tuple[float, float] | None = None
    """From where to where the scale of paper goes, where several pictures share it."""

    @property
    def steps(self) -> int:
        """How many steps there are to go through; 0 where the picture has none."""
        return max((len(line.steps) for line in self.lines if line.steps is not None), default=0)

    def at_step(self, step: int) -> Chart:
        """The picture at a step."""
        lines = [line if line.steps is None else replace(line, y=line.steps[step], steps=None) for line in self.lines]
        return replace(self, lines=tuple(lines))

    @property
    def reach(self) -> tuple[float, float]:
        """From where to where the values of all steps go, with some room."""
        every = [line.y if line.steps is None else line.steps for line in self.lines]
        low, high = min(float(values.min()) for values in every), max(float(values.max()) for values in every)
        room = 0.06 * max(high - low, 1e-9)
        return low - room, high + room

    @property
    def largest(self) -> float:
        """Largest size of any value; the scale of a polar picture."""
        return max(1e-9, *(float(np.abs(line.y).max()) for line in self.lines))

    @property
    def largest_shown(self) -> str:
        """The largest size in two digits, and never as a power of ten where it is readable without one."""
        return f"{float(f'{self.largest:.2g}'):g}"

    @property
    def hole(self) -> float:
        """Radius at which a polar picture has its circle of no deviation."""
        return _HOLE * self.largest


@dataclass(frozen=True)
class SphereChart:
    """A measured surface about its least-squares sphere: directions (n, m, 3) of a grid on the hemisphere, its
    deviation_mm (n, m) from the sphere, and the targets' directions (t, 3) with their deviation_mm (t,). Deviations are
    drawn magnified, so that the largest is a fifth of the radius."""

    title: str
    caption: str
    radius_mm: float
    grid: Array
    grid_deviation_mm: Array
    targets: Array
    deviation_mm: Array
    names: tuple[str, ...]
    words: tuple[str, str, str]
    """What the sphere, the surface and the targets are called."""
    frame: Literal["sphere"] = "sphere"

    @property
    def magnified(self) -> float:
        """How many times larger than the sphere a deviation is drawn."""
        largest = max(float(np.abs(self.deviation_mm).max()), float(np.abs(self.grid_deviation_mm).max()), 1e-9)
        return 0.2 * self.radius_mm / largest

    def drawn(self, direction: Array, deviation_mm: Array) -> Array:
        """Where points (..., 3) mm are drawn, that lie in a direction (..., 3) with a deviation (...)."""
        place: Array = direction * (self.radius_mm + self.magnified * deviation_mm)[..., None]
        return place


Picture = Chart | SphereChart


def marks_of(turns: Sequence[tuple[float, int]], texts: Texts) -> tuple[Mark, ...]:
    """A mark where each axis (angle in degrees, number) turns back; of near ones the first bears the numbers of all."""
    groups: list[list[tuple[float, int]]] = []
    for turn in sorted(turns):
        if groups and turn[0] - groups[-1][0][0] < _SAME_DEG:
            groups[-1].append(turn)
        else:
            groups.append([turn])
    names = [texts("marked", axes=", ".join(str(axis) for _, axis in group)) for group in groups]
    return tuple(
        Mark(at_deg, name if place == 0 else "")
        for group, name in zip(groups, names, strict=True)
        for place, (at_deg, _) in enumerate(group)
    )


def stretches(places: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """Stretches (from, to) in degrees, one that passes 360° as two."""
    parts: list[tuple[float, float]] = []
    for low, high in places:
        parts += [(low, high)] if low <= high else [(low, 360.0), (0.0, high)]
    return tuple(parts)
