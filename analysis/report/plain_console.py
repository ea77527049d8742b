"""A console for tables and live displays whose text is plain (`rigs.text`) and never markup.

Tables on a screen that is too narrow for them.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.table import Column, Table
from rich.text import Text

from rigs.text import plain_lines


class PlainConsole(Console):
    """rich's console without markup: `[/]` in a name is text. What it sends to move the cursor is its own."""

    def __init__(self, *, width: int | None = None, stderr: bool = False) -> None:
        super().__init__(width=width, stderr=stderr, markup=False, emoji=False)

    def render_str(self, text: str, **options: Any) -> Text:
        """Return text as rich lays it out: made plain before, so that the columns fit what is shown."""
        return super().render_str(plain_lines(text), **options)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Yield what is shown: text that was given as rich's own `Text` is made plain here."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=plain_lines(segment.text))


def right(heading: str | Text = "", **options: Any) -> Column:
    """A column of numbers."""
    return Column(heading, justify="right", **options)


def bare_table(*headings: str | Column) -> Table:
    """A table without lines, whose numbers stay whole and whose long words are broken."""
    table = Table(*headings, box=None, padding=(0, 2, 0, 0), header_style="dim", pad_edge=False)
    for column in table.columns:
        column.no_wrap |= column.justify == "right"
    return whole(table)


def whole(table: Table) -> Table:
    """The same, long words of its cells broken where rich would cut them off and leave an ellipsis."""
    for column in table.columns:
        column.overflow = "fold"
    return table
