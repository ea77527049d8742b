"""Drawing with characters: dots in braille patterns, large digits, and the curves of the live view.

Colours are pairs that colour-blind users can distinguish.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import groupby

import numpy as np
from rich.console import Console, ConsoleOptions, RenderResult
from rich.segment import Segment
from rich.style import Style
from rich.text import Text

from analysis.apps.live.controls import LiveControls
from analysis.apps.live.lap import ErrorCurve, pieces
from analysis.apps.live.view import LiveView
from analysis.robot.kinematics.arm import Array, Mask
from rigs.text import plain

GAUGE_COLOURS = ("bright_cyan", "bright_yellow")
ANGLE_COLOUR = "bright_white"
ACW_COLOUR, CW_COLOUR = "bright_green", "bright_magenta"


def direction_colour(sense: float) -> str:
    """Colour of a direction: 1 for acw, -1 for cw, 0 if unknown."""
    return {1: ACW_COLOUR, -1: CW_COLOUR}.get(int(sense), "")


def row_of(*parts: str | tuple[str, str]) -> Text:
    styled = (part if isinstance(part, tuple) else (part, "") for part in parts)
    return Text.assemble(*((plain(text), style) for text, style in styled if text))


def below_each_other(*rows: Text) -> Text:
    """Lines that are cut at the edge of their panel."""
    return Text("\n", no_wrap=True, overflow="crop", end="").join(rows)


_BRAILLE = 0x2800
_BITS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
"""Bits of the dots in a cell, row by row (Unicode 4.0, chapter 14.9)."""


class DotGrid:
    """Dots and characters on cells, two by four dots in each; x increases to the right and y downwards."""

    def __init__(self, width: int, height: int) -> None:
        self.width, self.height = width, height
        self.width_dots, self.height_dots = 2 * width, 4 * height
        self._cells = [[(" ", "")] * width for _ in range(height)]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for row in self._cells:
            for style, cells in groupby(row, key=lambda cell: cell[1]):
                yield Segment("".join(character for character, _ in cells), Style.parse(style) if style else None)
            yield Segment.line()

    def put(self, row: int, column: int, text: str, style: str = "") -> None:
        for place, character in enumerate(text, start=column):
            if 0 <= row < self.height and 0 <= place < self.width:
                self._cells[row][place] = (character, style)

    def polyline(self, x: Array, y: Array, style: str, every: int = 1) -> None:
        """Draw a line through points (n,) in dots. every: spacing that distinguishes lines of equal colour."""
        if len(x) < 2:
            return
        steps = np.maximum(np.abs(np.diff(x)), np.abs(np.diff(y)))
        along = np.concatenate([[0.0], np.cumsum(np.maximum(steps, 1e-9))])
        at = np.linspace(0.0, along[-1], 2 + int(min(along[-1], 20_000)))
        self.points(np.interp(at, along, x)[::every], np.interp(at, along, y)[::every], style)

    def points(self, x: Array, y: Array, style: str) -> None:
        finite = np.isfinite(x) & np.isfinite(y)
        column, row = np.floor(x[finite]).astype(np.int64), np.floor(y[finite]).astype(np.int64)
        inside = (column >= 0) & (column < self.width_dots) & (row >= 0) & (row < self.height_dots)
        lit: Mask = np.zeros((self.height_dots, self.width_dots), dtype=bool)
        lit[row[inside], column[inside]] = True
        bits = (lit.reshape(self.height, 4, self.width, 2).transpose(0, 2, 1, 3) * _BITS).sum(axis=(2, 3))
        for r, c in np.argwhere(bits).tolist():
            before = ord(self._cells[r][c][0])
            old = before - _BRAILLE if _BRAILLE <= before < _BRAILLE + 256 else 0
            self.put(r, c, chr(_BRAILLE + (old | int(bits[r, c]))), style)


class Plot:
    def __init__(self, draw: Callable[[DotGrid], None]) -> None:
        self._draw = draw

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        grid = DotGrid(options.max_width, options.height or options.max_height)
        self._draw(grid)
        yield grid


_SHAPES: dict[str, tuple[str, ...]] = {
    "0": ("###", "# #", "# #", "# #", "###"),
    "1": (" # ", "## ", " # ", " # ", "###"),
    "2": ("###", "  #", "###", "#  ", "###"),
    "3": ("###", "  #", " ##", "  #", "###"),
    "4": ("# #", "# #", "###", "  #", "  #"),
    "5": ("###", "#  ", "###", "  #", "###"),
    "6": ("###", "#  ", "###", "# #", "###"),
    "7": ("###", "  #", "  #", "  #", "  #"),
    "8": ("###", "# #", "###", "# #", "###"),
    "9": ("###", "# #", "###", "  #", "###"),
    "-": ("   ", "   ", "###", "   ", "   "),
    "+": ("   ", " # ", "###", " # ", "   "),
    ".": (" ", " ", " ", " ", "#"),
    " ": ("   ", "   ", "   ", "   ", "   "),
}
_PIXEL_ROWS = 5
_HALVES = {(False, False): " ", (True, False): "▀", (False, True): "▄", (True, True): "█"}


def width_of(text: str, scale: int) -> int:
    return scale * (sum(len(_SHAPES[character][0]) + 1 for character in text) - 1)


def height_of(scale: int) -> int:
    return (_PIXEL_ROWS * scale + 1) // 2


def large(text: str, scale: int, style: str) -> list[Text]:
    """Rows of a large number of digits, a sign, a point and spaces."""
    rows = [" ".join(_SHAPES[character][row] for character in text) for row in range(_PIXEL_ROWS)]
    pixels = ["".join(pixel * scale for pixel in row) for row in rows for _ in range(scale)]
    pixels += [" " * len(pixels[0])] * (len(pixels) % 2)
    pairs = zip(pixels[::2], pixels[1::2], strict=True)
    halves = (zip(upper, lower, strict=True) for upper, lower in pairs)
    return [Text("".join(_HALVES[a == "#", b == "#"] for a, b in row), style) for row in halves]


# ----------------------------------------------------------------------------------------------------------------------
# Curves: the error around the circle and over its angle, and readings over time.
#
# The circle is viewed against its normal: phi = 0 is on the right and increases anticlockwise (docs/conventions.md).

_MIDDLE, _REACH = 0.66, 0.3
"""Radius of the nominal circle and largest error, relative to half of the panel."""
_OUTSIDE = 1.1
"""Position of reversal marks, relative to the largest error."""
_INSIDE = 0.3
"""Position of the lap start mark."""
_MARKS = 24
"""Reversal marks, from about the last two laps."""
_SCALES = (1.0, 2.0, 5.0)
_SMALLEST = 1e-4
"""Smallest scale, in degrees or mm: the resolution of a gauge."""


def scale_of(curves: tuple[ErrorCurve, ErrorCurve]) -> float:
    """Error at full scale: 1, 2 or 5 times a power of ten, above the largest error."""
    largest = max((float(np.abs(curve.error).max()) for curve in curves if len(curve.error)), default=0.0)
    power = 10.0 ** math.floor(math.log10(max(largest, _SMALLEST)))
    return next(scale * power for scale in (*_SCALES, 10.0) if scale * power >= largest)


def unit_of(view: LiveView, controls: LiveControls) -> tuple[str, float]:
    """Displayed unit of the error, and the factor from degrees or mm."""
    if view.cell is not None and view.cell.has_angle:
        return "°", 1.0
    return f" {controls.units.name}", controls.units.per_mm


def draw_circle(view: LiveView, controls: LiveControls, curves: tuple[ErrorCurve, ErrorCurve], dots: DotGrid) -> None:
    if view.cell is None or view.cell.frame is None:
        dots.put(dots.height // 2, 1, "no circle test" if view.cell else "no rig file yet", "dim")
        return
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
        dots.put(int(y[0] // 4), int(x[0] // 2), character, style)

    for reversal in view.reversals[-_MARKS:]:
        if math.isfinite(reversal.phi_rad):
            mark(reversal.phi_rad, _OUTSIDE, f"{reversal.axis}", direction_colour(reversal.sense))
    mark(view.cell.start_rad, -_INSIDE, "┼", "dim")
    colours = (ACW_COLOUR, CW_COLOUR, "dim", "dim")
    for row, words in enumerate(_legend(view, controls, curves, scale)):
        dots.put((dots.height - 4) // 2 + row, (dots.width - len(words)) // 2, words, colours[row])
    if len(view.phi) and math.isfinite(view.phi[-1]):
        mark(float(view.phi[-1]), 0.0, "●", "bold")


def _legend(view: LiveView, controls: LiveControls, curves: tuple[ErrorCurve, ErrorCurve], scale: float) -> list[str]:
    unit, factor = unit_of(view, controls)
    words = []
    for name, curve in zip(("acw", "cw"), curves, strict=True):
        ending = "" if curve.is_whole or not len(curve.phi) else "…"
        words.append(f"{name} {curve.band * factor:.4f}{unit}{ending}" if len(curve.phi) else f"{name} –")
    if not any(len(curve.phi) for curve in curves):
        return words
    less = "sine" if all(curve.less_sine for curve in curves if len(curve.phi)) else "mean"
    return [*words, f"less {less}", f"reach {scale * factor:g}{unit}"]


_LABEL = 15
"""Number of columns reserved for the scale."""
_SECONDS_A_COLUMN = 0.25
_LEAST_MM = 0.001
"""Smallest span of a trace. Below it only the last digits of a gauge flicker."""
_QUARTERS = 4


def draw_trace(view: LiveView, controls: LiveControls, dots: DotGrid) -> None:
    columns = dots.width - _LABEL
    seconds = max(5.0, columns * _SECONDS_A_COLUMN)
    recent, units = view.since(seconds), controls.units
    dots.put(0, 1, "trace", "bold")
    if not len(recent) or columns <= 0:
        return
    with_values = [k for k in range(2) if np.isfinite(recent.g_mm[:, k]).any()]
    lines = {k: recent.g_mm[:, k] - np.nanmean(recent.g_mm[:, k]) for k in with_values}
    reach_mm = max([_LEAST_MM / 2, *(float(np.nanmax(np.abs(line))) for line in lines.values())])
    dots.put(dots.height // 2, 1, f"±{reach_mm * units.per_mm:.{max(1, units.decimals - 1)}f} {units.name}", "dim")
    dots.put(dots.height - 1, 1, f"{seconds:.0f} s", "dim")
    x = dots.width_dots - 1 - (recent.t_s[-1] - recent.t_s) / seconds * 2 * columns
    for k, line in lines.items():
        y = (dots.height_dots - 1) * (0.5 - 0.48 * line / reach_mm)
        for piece in np.ma.clump_unmasked(np.ma.masked_invalid(line)):  # type: ignore[no-untyped-call]
            dots.polyline(x[piece], y[piece], GAUGE_COLOURS[k])


def draw_straight(view: LiveView, controls: LiveControls, curves: tuple[ErrorCurve, ErrorCurve], dots: DotGrid) -> None:
    unit, factor = unit_of(view, controls)
    scale = scale_of(curves)
    words = "error over φ"
    if any(len(curve.phi) and not curve.less_sine for curve in curves):
        words += ", less its mean"
    elif any(len(curve.phi) for curve in curves):
        words += ", less its sine"
    dots.put(0, 1, words, "bold")
    columns, height_dots = dots.width - _LABEL - 1, dots.height_dots - 8  # between the title and the angles
    if columns < 2 or height_dots < 4:
        return
    if any(len(curve.phi) for curve in curves):
        dots.put(1, 1, f"{scale * factor:+zg}{unit}", "dim")
        dots.put(dots.height - 2, 1, f"{-scale * factor:+zg}{unit}", "dim")
    for quarter in range(_QUARTERS + 1):
        label = f"{90 * quarter}°"
        column = _LABEL + round(quarter / _QUARTERS * (columns - 1)) - (len(label) - 1 if quarter == _QUARTERS else 0)
        dots.put(dots.height - 1, column, label, "dim")
    zero = np.arange(2 * _LABEL, 2 * (_LABEL + columns), 4.0)
    dots.points(zero, np.full(len(zero), dots.height_dots / 2), "dim")
    for curve, colour, every in zip(curves, (ACW_COLOUR, CW_COLOUR), (1, 2), strict=True):
        for piece in pieces(curve):
            x = 2 * (_LABEL + columns * curve.phi[piece] / (2 * math.pi))
            y = 4 + (height_dots - 1) * (0.5 - 0.5 * curve.error[piece] / scale)
            dots.polyline(x, y, colour, every)
