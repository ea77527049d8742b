"""The table of `rig paper`, and the same for scripts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from analysis.paper.rows import Row
from analysis.reporting.plain_console import whole
from rigs.effects import Effect, size_field
from rigs.rig import Rig

CAVEAT = (
    "The set-up explains Table 1; it is not the author's robot. The effects and the place of the hemisphere are ours, "
    "and the effects were fitted to the figures above from Fig. 6 on: agreement shows that one robot can show them, "
    "not that this is the robot. See docs/paper.md."
)
SLIPS = (
    "Slips of the paper, not copied: 206 stands for 206.265; the last formula for alpha has b11 where b21 belongs; "
    'arctan(b/a) loses the quadrant, atan2 keeps it; "seven times" is 1.567/0.261 = 6.0.'
)


def as_table(rig: Rig, rows: Sequence[Row]) -> RenderableType:
    """Every row, then the effects behind them, the slips and what it does not show."""
    table = Table(title=f"Oh 2019 beside the simulated robot of {rig.name}", title_style="bold", header_style="bold")
    for heading in ("where", "figure", "paper", "ours", "difference", "note"):
        table.add_column(heading, justify="right" if heading in ("paper", "ours", "difference") else "left")
    previous = ""
    for row in rows:
        section = row.where if row.where == "Table 1" else row.figure.split()[0]
        if previous and section != previous:
            table.add_section()
        previous = section
        table.add_row(
            row.where, row.figure, written(row, row.paper), written(row, row.ours), _difference(row), row.note
        )
    effects = "Effects: " + "; ".join(in_words(rig, effect) for effect in rig.effects) + "."
    return Group(whole(table), *(Text(line, style="dim") for line in (effects, SLIPS, CAVEAT)))


def written(row: Row, value: float | str) -> str:
    """A value of a row with its unit."""
    if isinstance(value, str):
        return value
    return f"{value:.{row.digits}f}{'' if row.unit in ('', '°') else ' '}{row.unit}"


def _difference(row: Row) -> str:
    if row.difference is None:
        return ""
    rounded = round(row.difference, row.digits) + 0.0  # no -0.0
    return f"{rounded:+.{row.digits}f}"


def in_words(rig: Rig, effect: Effect) -> str:
    """An effect with its joint by its own name and its size, as `… Theta 0.071°`."""
    axis = getattr(effect, "axis", None)
    name = f" {rig.robot.axes[axis - 1].name}" if axis else ""
    order = getattr(effect, "order", None)
    often = f" ×{order:g} a turn" if order else ""
    unit = "°" if size_field(effect).endswith("_deg") else ""
    return f"{effect.effect.replace('_', ' ')}{name}{often} {getattr(effect, size_field(effect)):g}{unit}"


def as_object(rig: Rig, rows: Sequence[Row]) -> dict[str, Any]:
    """The same as one JSON object."""
    return {
        "rig": rig.name,
        "rows": [{**asdict(row), "difference": row.difference} for row in rows],
        "effects": [effect.model_dump(mode="json", exclude_none=True) for effect in rig.effects],
        "slips": SLIPS,
        "caveat": CAVEAT,
    }
