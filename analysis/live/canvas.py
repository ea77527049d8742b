"""A grid of character cells that is exactly as large as the terminal: whatever is drawn beyond its edge is cut off.

Text passes the gate of `rigs.text` here. A wide character takes two cells; what has no width of its own is left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby

from rich.cells import get_character_cell_size
from rich.console import Console, ConsoleOptions, RenderResult
from rich.segment import Segment
from rich.style import Style

from rigs.text import plain

_Cell = tuple[str, str]
"""Character and style; the character of a cell that a wide one before it covers is empty."""


class Canvas:
    """Rows of cells, a rich renderable."""

    def __init__(self, width: int, height: int) -> None:
        self.width, self.height = width, height
        self._cells: list[list[_Cell]] = [[(" ", "")] * width for _ in range(height)]

    def area(self) -> Area:
        """Return all of it."""
        return Area(self, 0, 0, self.width, self.height)

    def lines(self) -> list[str]:
        """Return the text of each row."""
        return ["".join(character for character, _ in row) for row in self._cells]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for number, row in enumerate(self._cells):
            if number:
                yield Segment.line()
            for style, cells in groupby(row, key=lambda cell: cell[1]):
                yield Segment("".join(character for character, _ in cells), Style.parse(style) if style else None)

    def at(self, row: int, column: int) -> str:
        """Return the character of a cell."""
        return self._cells[row][column][0]

    def put(self, row: int, column: int, character: str, style: str) -> None:
        """Set the cells of one character; parts of a wide one that it covers become spaces."""
        cells = self._cells[row]
        width = get_character_cell_size(character)
        for place in range(column, min(column + width, self.width)):
            self._clear(cells, place)
        cells[column] = (character, style)
        if width == 2:
            cells[column + 1] = ("", style)

    def dim(self, row: int, column: int) -> None:
        """Show a cell dim, in no colour."""
        self._cells[row][column] = (self.at(row, column), "dim")

    def _clear(self, cells: list[_Cell], place: int) -> None:
        if cells[place][0] == "" and place:
            cells[place - 1] = (" ", "")
        if place + 1 < self.width and cells[place + 1][0] == "":
            cells[place + 1] = (" ", "")
        cells[place] = (" ", "")


@dataclass(frozen=True)
class Area:
    """A rectangle of a canvas, in which a panel draws with rows and columns of its own."""

    canvas: Canvas
    top: int
    left: int
    width: int
    height: int

    def put(self, row: int, column: int, text: str, style: str = "") -> int:
        """Write text from a cell on, cut off at the edges; return the column after it."""
        for character in plain(text):
            size = get_character_cell_size(character)
            if size and 0 <= row < self.height and column >= 0 and column + size <= self.width:
                self.canvas.put(self.top + row, self.left + column, character, style)
            column += size
        return column

    def dim(self) -> None:
        """Show what has been drawn here dim, in no colour."""
        for row in range(self.height):
            for column in range(self.width):
                self.canvas.dim(self.top + row, self.left + column)

    def part(self, top: int, left: int, width: int, height: int) -> Area:
        """Return a rectangle of this one, no larger than what there is of it."""
        top, left = min(max(top, 0), self.height), min(max(left, 0), self.width)
        width, height = max(0, min(width, self.width - left)), max(0, min(height, self.height - top))
        return Area(self.canvas, self.top + top, self.left + left, width, height)

    def rows(self, *heights: int) -> list[Area]:
        """Return rectangles below each other."""
        tops = [sum(heights[:k]) for k in range(len(heights))]
        return [self.part(top, 0, self.width, height) for top, height in zip(tops, heights, strict=True)]

    def columns(self, *widths: int) -> list[Area]:
        """Return rectangles beside each other."""
        lefts = [sum(widths[:k]) for k in range(len(widths))]
        return [self.part(0, column, width, self.height) for column, width in zip(lefts, widths, strict=True)]
