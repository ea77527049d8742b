"""The words of an answer, for tests that look for a key, a name or a figure in it."""

from __future__ import annotations

import io
from collections.abc import Sequence

from rich.console import Console

from analysis.apps.report.blocks import Block, Figure, Heading, Segments, Table, on_screen


def printed(blocks: Sequence[Block], width: int = 80) -> str:
    """The blocks as a terminal of this width shows them."""
    console = Console(width=width, file=io.StringIO())
    with console.capture() as shown:
        console.print(on_screen(blocks))
    return shown.get()


def words_of(blocks: Sequence[Block]) -> list[str]:
    """Return the text of each heading, sentence and command, and of each row of a table."""
    words = []
    for block in blocks:
        match block:
            case Heading():
                words.append(block.text)
            case Table():
                words += [" ".join(text for cell in row for text in (cell.text, *cell.lines)) for row in block.cells()]
            case Segments() | Figure():
                pass
            case _:
                words.append(block.words)
    return words
