"""The circle in braille dots: the error as it grows around it, acw and cw over each other, magnified.

Seen against the circle's normal, phi = 0 to the right and growing anticlockwise, as in docs/conventions.md.
"""

from __future__ import annotations

import math

import numpy as np

from analysis.kinematics.arm import Array
from analysis.live.canvas import ACW_COLOUR, CW_COLOUR, Area, Dots, direction_colour
from analysis.live.controls import Controls
from analysis.live.sweeps import ErrorCurve, pieces
from analysis.live.view import LiveView

_MIDDLE, _REACH = 0.66, 0.3
"""Radius of the nominal circle and the largest error drawn, as shares of half the panel."""
_OUTSIDE = 1.1
"""Where reversals are marked, in shares of the reach."""
_INSIDE = 0.3
"""Where the start of the lap is marked."""
_MARKS = 24
"""Reversals that are marked: the last of some two laps."""
_SCALES = (1.0, 2.0, 5.0)
_SMALLEST = 1e-4
"""The smallest scale, in degrees or mm: as fine as a gauge resolves."""


def scale_of(curves: tuple[ErrorCurve, ErrorCurve]) -> float:
    """Return the error at full deflection: 1, 2 or 5 times a power of ten, above the largest error."""
    largest = max((float(np.abs(curve.error).max()) for curve in curves if len(curve.error)), default=0.0)
    power = 10.0 ** math.floor(math.log10(max(largest, _SMALLEST)))
    return next(scale * power for scale in (*_SCALES, 10.0) if scale * power >= largest)


def unit_of(view: LiveView, controls: Controls) -> tuple[str, float]:
    """Return the unit in which the error is shown, and the factor from degrees or mm."""
    if view.cell is not None and view.cell.has_angle:
        return "°", 1.0
    return f" {controls.units.name}", controls.units.per_mm


def draw_circle(area: Area, view: LiveView, controls: Controls, curves: tuple[ErrorCurve, ErrorCurve]) -> None:
    """Draw the circle with its errors, the tool's place, and the places where joints turned back."""
    if view.cell is None or view.cell.frame is None:
        area.put(area.height // 2, 1, "no circle test" if view.cell else "no rig file yet", "dim")
        return
    dots = Dots(area)
    middle_x, middle_y = dots.width_dots / 2, dots.height_dots / 2
    size = min(middle_x, middle_y) - 1

    def placed(phi: Array, share: Array | float) -> tuple[Array, Array]:
        radius = size * (_MIDDLE + _REACH * np.asarray(share))
        return middle_x + radius * np.cos(phi), middle_y - radius * np.sin(phi)

    around = np.linspace(0, 2 * np.pi, max(8, int(size)), endpoint=False)
    dots.points(*placed(around, 0.0), "dim")
    scale = scale_of(curves)
    for curve, colour, every in zip(curves, (ACW_COLOUR, CW_COLOUR), (1, 2), strict=True):
        for piece in pieces(curve):
            dots.polyline(*placed(curve.phi[piece], curve.error[piece] / scale), colour, every)

    def mark(phi_rad: float, share: float, character: str, style: str) -> None:
        x, y = placed(np.array([phi_rad]), share)
        area.put(int(y[0] // 4), int(x[0] // 2), character, style)

    for reversal in view.reversals[-_MARKS:]:
        if math.isfinite(reversal.phi_rad):
            mark(reversal.phi_rad, _OUTSIDE, f"{reversal.axis}", direction_colour(reversal.sense))
    mark(view.cell.start_rad, -_INSIDE, "┼", "dim")
    for row, words in enumerate(_legend(view, controls, curves, scale)):
        area.put(
            (area.height - 4) // 2 + row,
            (area.width - len(words)) // 2,
            words,
            (ACW_COLOUR, CW_COLOUR, "dim", "dim")[row],
        )
    if len(view.phi) and math.isfinite(view.phi[-1]):
        mark(float(view.phi[-1]), 0.0, "●", "bold")


def _legend(view: LiveView, controls: Controls, curves: tuple[ErrorCurve, ErrorCurve], scale: float) -> list[str]:
    """Bands and scale, as far as the middle of the circle has room."""
    unit, factor = unit_of(view, controls)
    words = []
    for name, curve in zip(("acw", "cw"), curves, strict=True):
        ending = "" if curve.is_whole or not len(curve.phi) else "…"
        words.append(f"{name} {curve.band * factor:.4f}{unit}{ending}" if len(curve.phi) else f"{name} –")
    if not any(len(curve.phi) for curve in curves):
        return words
    less = "sine" if all(curve.less_sine for curve in curves if len(curve.phi)) else "mean"
    return [*words, f"less {less}", f"reach {scale * factor:g}{unit}"]
