"""Drawing with characters: dots in braille patterns, and large digits.

Colours are pairs of the sixteen terminal colours that colour-blind users can distinguish.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import groupby

import numpy as np
from rich.console import Console, ConsoleOptions, RenderResult
from rich.segment import Segment
from rich.style import Style
from rich.text import Text

from analysis.robot.kinematics.arm import Array, Mask
from rigs.text import plain

GAUGE_COLOURS = ("bright_cyan", "bright_yellow")
ANGLE_COLOUR = "bright_white"
ACW_COLOUR, CW_COLOUR = "bright_green", "bright_magenta"


def direction_colour(sense: float) -> str:
    """Colour of a direction: 1 for acw, -1 for cw, 0 if unknown."""
    return {1: ACW_COLOUR, -1: CW_COLOUR}.get(int(sense), "")


def row_of(*parts: str | tuple[str, str]) -> Text:
    """A line of texts, each with a style if given."""
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
    """Columns of a large number."""
    return scale * (sum(len(_SHAPES[character][0]) + 1 for character in text) - 1)


def height_of(scale: int) -> int:
    """Rows of a large number."""
    return (_PIXEL_ROWS * scale + 1) // 2


def large(text: str, scale: int, style: str) -> list[Text]:
    """Rows of a large number of digits, a sign, a point and spaces."""
    rows = [" ".join(_SHAPES[character][row] for character in text) for row in range(_PIXEL_ROWS)]
    pixels = ["".join(pixel * scale for pixel in row) for row in rows for _ in range(scale)]
    pixels += [" " * len(pixels[0])] * (len(pixels) % 2)
    pairs = zip(pixels[::2], pixels[1::2], strict=True)
    halves = (zip(upper, lower, strict=True) for upper, lower in pairs)
    return [Text("".join(_HALVES[a == "#", b == "#"] for a, b in row), style) for row in halves]
