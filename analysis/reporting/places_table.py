"""The places where model and readings disagree, on the screen."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from analysis.inference.result import Place
from analysis.reporting.diagnosis_words import runs_of, stretch
from analysis.reporting.plain_console import whole

_MOST_PLACES = 6
_NUMBERS = ("axis", "µm", "sigma")


def places_table(where: Sequence[Place]) -> list[RenderableType]:
    """The worst places, each with the axis that turns back there."""
    if not where:
        return [Text("nowhere by more than the noise")]
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim", pad_edge=False)
    for heading in ("test", "part", "where", "axis", "why", "µm", "sigma"):
        number = heading in _NUMBERS
        table.add_column(heading, justify="right" if number else "left", no_wrap=number)
    for place in sorted(where, key=lambda place_of_error: -place_of_error.sigma)[:_MOST_PLACES]:
        row = (runs_of(place), place.part, stretch(place), f"{place.joint or ''}", place.why)
        table.add_row(*row, f"{place.rms_um:.1f}", f"{place.sigma:.0f}")
    unlisted = len(where) - _MOST_PLACES
    return [whole(table), *([Text(f"and {unlisted} more (all with --json)", style="dim")] if unlisted > 0 else [])]
