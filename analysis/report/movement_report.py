"""Result of a movement check on the screen and as a page."""

from __future__ import annotations

from pathlib import Path

from rich.console import Group, RenderableType
from rich.text import Text

from analysis.movement.result import MovementResult
from analysis.report.diagnosis_words import sure
from analysis.report.html_page import environment, write_html
from analysis.report.movement_words import headline, name_of, remarks, size_of, what_to_do
from analysis.report.plain_console import bare_table, right
from rigs.schema.part import Vector

_MOST_CAUSES = 8
"""Number of causes listed; the JSON contains all."""
COLUMNS = ("cause", "probability", "size ± u", "at the middle of the work, x, y, z")


def rows_of(moved: MovementResult) -> list[tuple[str, str, str, str]]:
    """Return a row for each cause, likeliest first."""
    return [
        (
            name_of(cause.cause, of_tracker=moved.of_tracker), sure(cause.posterior), size_of(cause) or "–",
            "–" if cause.point_mm is None else _at(cause.point_mm),
        )
        for cause in moved.causes[:_MOST_CAUSES]
    ]  # fmt: skip


def _at(point: Vector) -> str:
    return ", ".join(f"{value:+.2f}" for value in point) + " mm"


def as_screen(moved: MovementResult) -> RenderableType:
    """Return the answer, the recommended action, the causes and the remarks."""
    sure = moved.named is not None
    colour = "bold yellow" if not sure or (moved.named and moved.named.what != "nothing") else "bold green"
    parts: list[RenderableType] = [Text(headline(moved), style=colour), Text(what_to_do(moved))]
    if moved.causes:
        table = bare_table(COLUMNS[0], right(COLUMNS[1]), *COLUMNS[2:])
        for row in rows_of(moved):
            table.add_row(*row)
        parts += [Text(), table]
    parts += [Text(line, style="yellow") for line in remarks(moved)]
    return Group(*parts, Text(footer(moved), style="dim"))


def footer(moved: MovementResult) -> str:
    """Return the numbers of readings, their scatter, and the middle of the work."""
    counts = f"{moved.readings} new readings, {moved.reference_readings} of the reference"
    at = ", ".join(f"{value:.0f}" for value in moved.centre_mm)
    return f"{counts} · scatter {moved.scatter_mm:.3f} mm · middle of the work at {at} mm"


def write_page(moved: MovementResult, path: Path, title: str) -> None:
    """Write the page. Raises FileError if it cannot be written."""
    html = environment().get_template("moved.html").render(
        title=title, headline=headline(moved), act=what_to_do(moved), columns=COLUMNS, rows=rows_of(moved),
        remarks=remarks(moved), footer=footer(moved),
        standing="pass" if moved.named and moved.named.what == "nothing" else "watch",
    )  # fmt: skip
    write_html(html, path)
