"""A console for tables and live displays with plain text (`rigs.text`) and no markup, and tables for narrow screens."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.table import Column, Table
from rich.text import Text

from rigs.text import escape_lines


class PlainConsole(Console):
    """Console of rich without markup: `[/]` in a name is text. follows_window: ignore COLUMNS and LINES."""

    def __init__(self, *, width: int | None = None, stderr: bool = False, follows_window: bool = False) -> None:
        fixed = ("COLUMNS", "LINES") if follows_window else ()
        environ = {name: value for name, value in os.environ.items() if name not in fixed}
        super().__init__(width=width, stderr=stderr, markup=False, emoji=False, _environ=environ)

    def render_str(self, text: str, **options: Any) -> Text:
        """Text in the layout of rich, made plain before, so that the column widths fit."""
        return super().render_str(escape_lines(text), **options)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Segments to show; here text of `Text` objects is made plain."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else segment._replace(text=escape_lines(segment.text))


def right(heading: str | Text = "", **options: Any) -> Column:
    return Column(heading, justify="right", **options)


def bare_table(*headings: str | Column) -> Table:
    """A table without lines. Long entries are folded; rich would truncate them with an ellipsis."""
    table = Table(*headings, box=None, padding=(0, 2, 0, 0), header_style="dim", pad_edge=False)
    for column in table.columns:
        column.no_wrap |= column.justify == "right"
        column.overflow = "fold"
    return table
