"""Summary of a diagnosis on a terminal of any width."""

from __future__ import annotations

from dataclasses import dataclass

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.padding import Padding
from rich.segment import Segment
from rich.text import Text

from analysis.report.summary import BarSegment, Summary
from analysis.report.texts import Texts

BAR_WIDTH = 40
"""Width of the stacked bar in columns on a wide terminal: half of the usual 80."""
_FILLS = "█▓▒░"
"""Fill characters of the segments, distinguishable on a terminal that shows no colours."""


@dataclass(frozen=True)
class StackedBar:
    """Stacked bar for a terminal, at most as wide as the terminal."""

    causes: tuple[BarSegment, ...]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the bar as a single line."""
        width, begin = min(BAR_WIDTH, options.max_width), 0.0
        for fill, cause in zip(_FILLS, self.causes, strict=False):
            end = begin + cause.share
            yield Segment(fill * (round(width * end) - round(width * begin)))
            begin = end
        yield Segment.line()


def on_screen(summary: Summary, texts: Texts, style: str = "bold") -> list[RenderableType]:
    """Return the headline and the tiles as elements of rich, for a terminal of any width."""
    error = summary.error
    causes: list[RenderableType] = [Text("–")]
    if summary.causes:
        names = (f"{fill} {cause.name} {cause.percent}" for fill, cause in zip(_FILLS, summary.causes, strict=False))
        causes = [StackedBar(summary.causes), *map(Text, names)]
    step = [Text(summary.next or "–"), *([Text(summary.command, style="bold")] if summary.command else [])]
    tiles: tuple[tuple[str, list[RenderableType]], ...] = (
        (error.title, [Text(error.words, style="bold"), Text(f"{error.basis} {error.standing}".rstrip())]),
        (texts("main_causes"), causes),
        (texts("do_next"), list(step)),
    )
    shown: list[RenderableType] = [Text(f"{summary.badge}: {summary.headline}", style=style)]
    shown += [Text(unknown, style="yellow") for unknown in summary.unknowns]
    for heading, body in tiles:
        shown += [Text(heading, style="bold"), Padding(Group(*body), (0, 0, 0, 2))]
    return shown
