"""Result of a movement check on the screen and as a page."""

from __future__ import annotations

from pathlib import Path

from rich.console import Group, RenderableType
from rich.text import Text

from analysis.apps.report.diagnosis_words import sure
from analysis.apps.report.html_page import environment, write_html
from analysis.apps.report.movement_words import headline, name_of, remarks, size_of, what_to_do
from analysis.apps.report.texts import Language, Texts, texts_of
from analysis.cli.plain_console import bare_table, right
from analysis.movement.result import MovementResult
from rigs.schema.part import Vector

_MOST_CAUSES = 8
"""Number of causes listed; the JSON contains all."""


def columns(texts: Texts) -> tuple[str, ...]:
    """Return the headings of the table of causes."""
    return tuple(texts(f"check_column_{name}") for name in ("cause", "probability", "size", "point"))


def rows_of(moved: MovementResult, texts: Texts) -> list[tuple[str, str, str, str]]:
    """Return a row for each cause, likeliest first."""
    return [
        (
            name_of(cause.cause, texts, of_tracker=moved.of_tracker), sure(cause.posterior),
            size_of(cause, texts) or "–", "–" if cause.point_mm is None else _at(cause.point_mm),
        )
        for cause in moved.causes[:_MOST_CAUSES]
    ]  # fmt: skip


def _at(point: Vector) -> str:
    return ", ".join(f"{value:+z.2f}" for value in point) + " mm"


def as_screen(moved: MovementResult, language: Language = "en") -> RenderableType:
    """Return the answer, the recommended action, the causes and the remarks."""
    texts = texts_of(language)
    colour = "bold green" if moved.named and moved.named.what == "nothing" else "bold yellow"
    parts: list[RenderableType] = [Text(headline(moved, texts), style=colour), Text(what_to_do(moved, texts))]
    if moved.causes:
        cause, probability, *others = columns(texts)
        table = bare_table(cause, right(probability), *others)
        for row in rows_of(moved, texts):
            table.add_row(*row)
        parts += [Text(), table]
    parts += [Text(line, style="yellow") for line in remarks(moved, texts)]
    return Group(*parts, Text(footer(moved, texts), style="dim"))


def footer(moved: MovementResult, texts: Texts) -> str:
    """Return the numbers of readings, their scatter, and the middle of the work area."""
    at = ", ".join(f"{value:z.0f}" for value in moved.centre_mm)
    scatter = f"{moved.scatter_mm:.3f}"
    return texts("check_footer", new=moved.readings, old=moved.reference_readings, scatter=scatter, at=at)


def write_page(moved: MovementResult, path: Path, name: str, language: Language = "en") -> None:
    """Write the page. name: of the rig. Raises FileError if it cannot be written."""
    texts = texts_of(language)
    html = environment().get_template("moved.html").render(
        title=texts("check_title", name=name), headline=headline(moved, texts), act=what_to_do(moved, texts),
        columns=columns(texts), rows=rows_of(moved, texts), remarks=remarks(moved, texts),
        footer=footer(moved, texts), note=texts("check_note"), lang=language,
        standing="pass" if moved.named and moved.named.what == "nothing" else "watch",
    )  # fmt: skip
    write_html(html, path)
