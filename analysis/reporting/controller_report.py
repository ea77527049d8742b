"""Corrections in the words of a controller, on the screen and as an object."""

from __future__ import annotations

import math
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from analysis.correction.controller_entries import ControllerEntries, NotEntered
from analysis.reporting.wide_tables import whole
from rigs.schema.effect import label_of


def as_table(found: ControllerEntries) -> RenderableType:
    """What to enter, in which order, what it is worth, and what stays."""
    maker = found.controller.maker
    if not found.entries:
        head: RenderableType = Text(f"{maker}: no effect of this rig file has a parameter here", style="yellow")
    else:
        head = _entries(found)
    parts: list[RenderableType] = [head]
    if found.entries:
        parts += [Text(f"{number}. {step}") for number, step in enumerate(found.steps, start=1)]
        parts.append(Text(f"from {found.controller.source}", style="dim"))
    parts.append(Text(found.controller.missing, style="dim"))
    if _unscaled(found):
        parts.append(Text(f"with --scale, six {found.controller.scale}: the same as {found.controller.unit}"))
    parts += [Text(_not_entered(one)) for one in found.not_entered]
    parts.append(
        Text(
            f"error of the tool over the tests of the rig file, rms: {found.before_um:.0f} µm before, "
            f"{found.after_um:.0f} µm after these entries",
            style="bold",
        )
    )
    if found.entries and found.after_um > found.before_um:
        warning = "these entries alone make it worse: they make up for effects that are not entered, so hold those too"
        parts.append(Text(warning, style="yellow"))
    return Group(*parts)


def _entries(found: ControllerEntries) -> Table:
    title = (
        f"the same at the controller ({found.controller.maker}), to be entered once; "
        "worth and leaves: rms of the tool over the tests"
    )
    table = Table(title=title, title_style="bold", title_justify="left", header_style="bold")
    for heading in ("add to", "value", "± u", "unit", "reading", "worth", "leaves"):
        table.add_column(heading, justify="left" if heading in ("add to", "unit") else "right")
    for one in found.entries:
        reading = f"{one.reading_deg:+.4f}°" if one.reading_deg else "same"
        numbers = (_number(one.add, one.u), f"{one.u:.2g}", one.unit, reading)
        table.add_row(one.parameter, *numbers, f"{one.worth_um:.0f} µm", f"{one.leaves_um:.0f} µm")
    return whole(table)


def _number(value: float, u: float) -> str:
    """Return a value with its sign, to the second digit of its uncertainty; a count to whole counts."""
    digits = 1 - math.floor(math.log10(u)) if u > 0 else 6
    return f"{value:+.{max(0, digits)}f}"


def _unscaled(found: ControllerEntries) -> bool:
    return bool(found.controller.scale) and any(one.unit == "deg" for one in found.entries)


def _not_entered(one: NotEntered) -> str:
    way = "hold it by corrected targets: --path and --entered" if one.by_path else "stays"
    return f"not entered: {label_of(one.effect)}, {one.worth_um:.0f} µm rms: {way}"


def as_object(found: ControllerEntries) -> dict[str, Any]:
    """The same for scripts and for corrections.yaml."""
    return {
        "name": found.name,
        "entries": [
            {
                "parameter": one.parameter,
                "axis": one.axis,
                "add": _short(one.add),
                "u": _short(one.u),
                "unit": one.unit,
                "reading_deg": _short(one.reading_deg),
                "worth_um": _um(one.worth_um),
                "leaves_um": _um(one.leaves_um),
            }
            for one in found.entries
        ],
        "not_entered": [
            {"name": label_of(one.effect), "worth_um": _um(one.worth_um), "by_corrected_targets": one.by_path}
            for one in found.not_entered
        ],
        "before_um": _um(found.before_um),
        "after_um": _um(found.after_um),
        "steps": list(found.steps),
        "source": found.controller.source,
        "not_found_in_public": found.controller.missing,
    }


def _short(value: float) -> float:
    return float(f"{value:.9g}")


def _um(value: float) -> float:
    return round(value, 3)
