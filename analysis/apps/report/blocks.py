"""An answer as a list of blocks and its renderers: terminal (`on_screen`), page (`blocks.html`), JSON (`as_object`).

A command builds its list once. Decisions are made before; a block only holds their words and figures.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from markupsafe import Markup
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.padding import Padding
from rich.segment import Segment
from rich.table import Table as RichTable
from rich.text import Text

from analysis.apps.report.texts import keys_of
from analysis.cli.plain_console import PlainConsole, bare_table, right

BadgeTone = Literal["pass", "watch", "fail", "unjudged"]
"""Colour of a badge: green, yellow, red, or grey for an open question."""
Tone = BadgeTone | Literal["plain", "doubt", "note", "strong"]
"""Colour of a text: of a badge, of a doubt, of a note, or of the lead."""
_STYLES: dict[Tone, str] = {
    "pass": "bold green", "watch": "bold yellow", "fail": "bold red", "unjudged": "bold yellow", "plain": "",
    "doubt": "yellow", "note": "dim", "strong": "bold",
}  # fmt: skip
_BAR = 16
_STACKED = 40
"""Half of the usual 80 columns."""
FILLS = "█▓▒░"


@dataclass(frozen=True)
class Heading:
    text: str
    level: int = 2

    @property
    def anchor(self) -> str:
        """Anchor of a section on the page: the key of its heading; empty for a small heading or a text without key."""
        keys = keys_of(self.text)
        return keys[0].replace("_", "-") if keys and self.level == 2 else ""


@dataclass(frozen=True)
class Sentence:
    """One or more sentences; `lead` is the badge before them."""

    text: str
    tone: Tone = "plain"
    lead: str = ""

    @property
    def words(self) -> str:
        return f"{self.lead}: {self.text}" if self.lead else self.text


@dataclass(frozen=True)
class Command:
    words: str


@dataclass(frozen=True)
class BarSegment:
    """share: of the error, 0 to 1; percent: the same as text. rank: class of the part."""

    name: str
    share: float
    percent: str
    rank: str = ""


@dataclass(frozen=True)
class Segments:
    parts: tuple[BarSegment, ...]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        width, begin = min(_STACKED, options.max_width), 0.0
        for fill, part in zip(FILLS, self.parts, strict=False):
            yield Segment(fill * (round(width * (begin + part.share)) - round(width * begin)))
            begin += part.share
        yield Segment.line()
        for fill, part in zip(FILLS, self.parts, strict=False):
            yield from console.render(Text(f"{fill} {part.name} {part.percent}"), options)


@dataclass(frozen=True)
class Cell:
    """A cell with further lines below, empty ones left out, and a bar, from 0 to 1 of the longest in its column."""

    text: str
    below: Sequence[str] = ()
    bar: float | None = None
    tone: Tone = "plain"
    link: str = ""

    @property
    def lines(self) -> list[str]:
        return [line for line in self.below if line]


Row = Sequence[str | Cell]


@dataclass(frozen=True)
class Table:
    """numbers: columns aligned right."""

    columns: Sequence[str]
    rows: Sequence[Row]
    numbers: Collection[int] = ()
    ranks: Sequence[str] = ()
    """Class of each row on the page; unusual rows are bold."""
    key: str = ""
    """Class of the table on the page."""

    def cells(self) -> list[list[Cell]]:
        return [[cell if isinstance(cell, Cell) else Cell(cell) for cell in row] for row in self.rows]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Split into several tables if the columns of numbers do not fit on the terminal."""
        boundless, rest = options.update(max_width=10_000), range(1, len(self.columns))
        can_split = set(rest) <= set(self.numbers)
        while True:
            columns = rest
            while console.measure(shown := _columns(self, columns), options=boundless).maximum > options.max_width:
                if not can_split or len(columns) < 2:
                    break
                columns = columns[:-1]
            yield shown
            if not (rest := rest[len(columns) :]):
                return


@dataclass(frozen=True)
class Figure:
    """A picture (SVG without scripts), shown on a page only."""

    caption: str
    svg: Markup


Block = Heading | Sentence | Command | Segments | Table | Figure


def paragraphs(lines: Iterable[str], tone: Tone = "plain") -> list[Block]:
    """A sentence for each line that is not empty."""
    return [Sentence(line, tone) for line in lines if line]


def on_screen(blocks: Sequence[Block]) -> RenderableType:
    shown: list[RenderableType] = []
    level = 0
    for block in blocks:
        if isinstance(block, Heading):
            level = block.level
            shown.append(Text(f"\n{block.text}" if level < 3 else block.text, style="bold"))
        elif isinstance(block, Command):  # a single line, so that it can be copied
            shown.append(Text("  " * bool(level) + block.words, style="bold", no_wrap=True, overflow="ignore"))
        elif not isinstance(block, Figure):
            words = Text(block.words, style=_STYLES[block.tone]) if isinstance(block, Sentence) else block
            shown.append(Padding(words, (0, 0, 0, 2)) if level else words)
    return Group(*shown)


def say_answer(blocks: Sequence[Block], *, aside: bool = False) -> None:
    """aside: on standard error."""
    PlainConsole(stderr=aside).print(on_screen(blocks), crop=False)


def _columns(table: Table, columns: range) -> RichTable:
    chosen = (0, *columns)
    heads = (right(table.columns[k]) if k in table.numbers else table.columns[k] for k in chosen)
    shown = bare_table(*heads)
    for row, rank in zip(table.cells(), table.ranks or [""] * len(table.rows), strict=True):
        if len(columns) < len(row) - 1 and not any(row[k].text for k in columns):
            continue  # a figure of the columns in another part of a split table
        shown.add_row(*(_cell(row[k]) for k in chosen), style="bold" if rank == "unusual" else "")
    return shown


def _cell(cell: Cell) -> Text:
    bar = f" {'█' * max(1, round(_BAR * cell.bar))}" if cell.bar is not None else ""
    text = Text(f"{cell.text}{bar}", style=_STYLES[cell.tone])
    for line in cell.lines:
        text.append(f"\n  {line}", style="dim")
    return text


def as_object(blocks: Sequence[Block]) -> list[dict[str, Any]]:
    return [{"kind": type(block).__name__.lower()} | _contents(block) for block in blocks]


def _contents(block: Block) -> dict[str, Any]:
    match block:
        case Heading(text):
            return {"text": text, "keys": list(keys_of(text))}
        case Sentence(text, tone, lead):
            return {"text": text, "keys": list(keys_of(text)), "tone": tone, "lead": lead}
        case Command(words):
            return {"words": words}
        case Figure(caption):
            return {"text": caption}
        case Segments(parts):
            return {"parts": [{"name": part.name, "share": part.share} for part in parts]}
        case Table(columns):
            rows = [[[cell.text, *cell.lines] for cell in row] for row in block.cells()]
            return {"columns": list(columns), "rows": rows}
