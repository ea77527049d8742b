"""Grid of character cells with the size of the terminal. Drawing outside of it is clipped.

A wide character takes two cells; zero-width characters are dropped. Braille patterns provide two by four dots per cell
for finer drawing. Colours are pairs of the sixteen terminal colours that colour-blind users can distinguish.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby

import numpy as np
from rich.cells import get_character_cell_size
from rich.console import Console, ConsoleOptions, RenderResult
from rich.segment import Segment
from rich.style import Style

from analysis.robot.kinematics.arm import Array, Mask
from rigs.text import plain

_Cell = tuple[str, str]
"""Character and style. The second cell of a wide character is empty."""


class Canvas:
    """Rows of cells that rich can render."""

    def __init__(self, width: int, height: int) -> None:
        self.width, self.height = width, height
        self._cells: list[list[_Cell]] = [[(" ", "")] * width for _ in range(height)]

    def area(self) -> Area:
        return Area(self, 0, 0, self.width, self.height)

    def lines(self) -> list[str]:
        return ["".join(character for character, _ in row) for row in self._cells]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for number, row in enumerate(self._cells):
            if number:
                yield Segment.line()
            for style, cells in groupby(row, key=lambda cell: cell[1]):
                yield Segment("".join(character for character, _ in cells), Style.parse(style) if style else None)

    def at(self, row: int, column: int) -> str:
        return self._cells[row][column][0]

    def put(self, row: int, column: int, character: str, style: str) -> None:
        """Set the cells of a character. Partially covered wide characters become spaces."""
        cells = self._cells[row]
        width = get_character_cell_size(character)
        for place in range(column, min(column + width, self.width)):
            if cells[place][0] == "" and place:
                cells[place - 1] = (" ", "")
            if place + 1 < self.width and cells[place + 1][0] == "":
                cells[place + 1] = (" ", "")
            cells[place] = (" ", "")
        cells[column] = (character, style)
        if width == 2:
            cells[column + 1] = ("", style)

    def dim(self, row: int, column: int) -> None:
        """Make a cell dim and remove its colour."""
        self._cells[row][column] = (self.at(row, column), "dim")


@dataclass(frozen=True)
class Area:
    """Rectangle of a canvas with relative coordinates."""

    canvas: Canvas
    top: int
    left: int
    width: int
    height: int

    def put(self, row: int, column: int, text: str, style: str = "") -> int:
        """Write clipped text from a cell on. Returns the next column."""
        for character in plain(text):
            size = get_character_cell_size(character)
            if size and 0 <= row < self.height and column >= 0 and column + size <= self.width:
                self.canvas.put(self.top + row, self.left + column, character, style)
            column += size
        return column

    def dim(self) -> None:
        """Make the content dim and remove its colours."""
        for row in range(self.height):
            for column in range(self.width):
                self.canvas.dim(self.top + row, self.left + column)

    def part(self, top: int, left: int, width: int, height: int) -> Area:
        """Clipped rectangle within this area."""
        top, left = min(max(top, 0), self.height), min(max(left, 0), self.width)
        width, height = max(0, min(width, self.width - left)), max(0, min(height, self.height - top))
        return Area(self.canvas, self.top + top, self.left + left, width, height)

    def rows(self, *heights: int) -> list[Area]:
        """Rectangles below each other."""
        tops = [sum(heights[:k]) for k in range(len(heights))]
        return [self.part(top, 0, self.width, height) for top, height in zip(tops, heights, strict=True)]

    def columns(self, *widths: int) -> list[Area]:
        """Rectangles next to each other."""
        lefts = [sum(widths[:k]) for k in range(len(widths))]
        return [self.part(0, column, width, self.height) for column, width in zip(lefts, widths, strict=True)]


_BRAILLE = 0x2800
_BITS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
"""Bits of the dots in a cell, row by row (Unicode 4.0, chapter 14.9)."""


class Dots:
    """Dots over an area. x increases to the right from 0 to width_dots, y downwards from 0 to height_dots."""

    def __init__(self, area: Area) -> None:
        self._area = area
        self.width_dots, self.height_dots = 2 * area.width, 4 * area.height

    def polyline(self, x: Array, y: Array, style: str, every: int = 1) -> None:
        """Draw a line through points (n,) in dots.

        every: spacing of the dots, which distinguishes lines of equal colour.
        """
        if len(x) < 2:
            return
        steps = np.maximum(np.abs(np.diff(x)), np.abs(np.diff(y)))
        along = np.concatenate([[0.0], np.cumsum(np.maximum(steps, 1e-9))])
        at = np.linspace(0.0, along[-1], 2 + int(min(along[-1], 20_000)))
        self.points(np.interp(at, along, x)[::every], np.interp(at, along, y)[::every], style)

    def points(self, x: Array, y: Array, style: str) -> None:
        """Draw points (n,) in dots over the existing content. Points outside are dropped."""
        if not self.width_dots or not self.height_dots:
            return
        finite = np.isfinite(x) & np.isfinite(y)
        column, row = np.floor(x[finite]).astype(np.int64), np.floor(y[finite]).astype(np.int64)
        inside = (column >= 0) & (column < self.width_dots) & (row >= 0) & (row < self.height_dots)
        lit: Mask = np.zeros((self.height_dots, self.width_dots), dtype=bool)
        lit[row[inside], column[inside]] = True
        cells = lit.reshape(self._area.height, 4, self._area.width, 2).transpose(0, 2, 1, 3)
        bits = (cells * _BITS).sum(axis=(2, 3))
        for r, c in np.argwhere(bits).tolist():
            before = self._area.canvas.at(self._area.top + r, self._area.left + c)
            old = ord(before) - _BRAILLE if len(before) == 1 and _BRAILLE <= ord(before) < _BRAILLE + 256 else 0
            self._area.put(r, c, chr(_BRAILLE + (old | int(bits[r, c]))), style)


GAUGE_COLOURS = ("bright_cyan", "bright_yellow")
"""Colours of g1 and g2."""
ANGLE_COLOUR = "bright_white"
ACW_COLOUR, CW_COLOUR = "bright_green", "bright_magenta"


def direction_colour(sense: float) -> str:
    """Colour of a direction: 1 for acw, -1 for cw, 0 if unknown."""
    return {1: ACW_COLOUR, -1: CW_COLOUR}.get(int(sense), "")


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


def put_large(area: Area, row: int, column: int, text: str, scale: int, style: str) -> None:
    """Draw a large number of digits, a sign, a point and spaces, from its upper left corner."""
    for character in text:
        shape = _SHAPES[character]
        pixels = [line for line in shape for _ in range(scale)]
        pixels += [" " * len(shape[0])] * (len(pixels) % 2)
        for k in range(0, len(pixels), 2):
            upper, lower = ("".join(pixel * scale for pixel in line) for line in pixels[k : k + 2])
            blocks = "".join(_HALVES[a == "#", b == "#"] for a, b in zip(upper, lower, strict=True))
            area.put(row + k // 2, column, blocks, style)
        column += scale * (len(shape[0]) + 1)
