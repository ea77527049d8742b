"""Report of the corrections for one controller, on the screen and as an object."""

from __future__ import annotations

import math
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Column, Table
from rich.text import Text

from analysis.apps.correct.controller_entries import ControllerEntries
from analysis.apps.report.diagnosis_words import plain
from analysis.cli.plain_console import fold_long_words, right
from rigs.rig import Rig
from rigs.schema.effect import label_of

_REPORTED_UM = 1.0
"""Minimum rms displacement of the tool, in µm, for an uncorrected effect to be listed."""
_THIRD = 1 / 3
"""Share of the squared error above which the first sentence names a cause."""


def first_sentence(entries: ControllerEntries, *, entered: bool = False) -> str:
    """Return the summary: the values to enter, the benefit, and the check before any motion.

    entered: the controller already has these values.
    """
    maker, targets = entries.controller.maker, f"{entries.by_targets_um:.0f} µm"
    if not entries.entries:
        better = entries.carried_by_targets_um >= _REPORTED_UM
        instead = f" With corrected targets (--path) the error is {targets}." if better else ""
        return (
            f"Do not change the {maker} controller: these runs do not show that it would help (error over the work "
            f"{entries.before_um:.0f} µm rms, with frame and tool taught with the robot).{instead}"
            f"{base_note(entries.base_u_um, entries.by_targets_um)}"
        )
    count = "the value" if len(entries.entries) == 1 else f"the {len(entries.entries)} values"
    reads = entries.controller.changes_reading
    check = "the reading of each axis has increased as listed below" if reads else "the joint angles are unchanged"
    does = f"With {count} below entered" if entered else f"Enter {count} below"
    return (
        f"{does} in {entries.controller.place} of the {maker} controller: the tool error over the work "
        f"area falls from {entries.before_um:.0f} to {entries.after_um:.0f} µm rms with frame and tool "
        f"taught with the robot (corrected targets: {targets}). Before any motion, check that "
        f"{check}.{base_note(entries.base_u_um, entries.by_targets_um)}"
    )


def base_note(base_u_um: float, after_um: float) -> str:
    """Return the note on the uncertain position of the arm on its base, or an empty text.

    The note appears only if this uncertainty makes up more than a third of the squared error.
    """
    if base_u_um**2 <= _THIRD * (base_u_um**2 + after_um**2):
        return ""
    return (
        f" (The place of the whole arm on the base is known only to ± {base_u_um / 1e3:.2g} mm from these runs; teach "
        "the frame of the work with the robot.)"
    )


def as_table(entries: ControllerEntries, rig: Rig, entered: bool = False) -> RenderableType:
    """Return the values to enter with their benefit, the steps, and the remaining error.

    entered: the controller already has these values.
    """
    parts: list[RenderableType] = []
    if entries.entries:
        parts.append(_entries(entries, entered))
        steps = () if entered else entries.steps
        parts += [Text(f"{number}. {step}") for number, step in enumerate(steps, start=1)]
        parts.append(Text(f"from {entries.controller.source}", style="dim"))
        parts.append(Text(entries.controller.missing, style="dim"))
    if bool(entries.controller.scale) and any(entry.unit == "deg" for entry in entries.entries):
        parts.append(Text(f"with --scale, six {entries.controller.scale}: in the units of {entries.controller.unit}"))
    parts += [
        Text(f"only the sum of these is known, so it was divided by typical sizes: {', '.join(group)}")
        for group in entries.twins
    ]
    kept = [each for each in entries.not_entered if each.worth_um >= _REPORTED_UM]
    stays = "µm rms; neither a constant nor a target can correct it"
    parts += [Text(f"not entered: {plain(rig, each.effect)}, {each.worth_um:.0f} {stays}") for each in kept]
    before, after = entries.elsewhere_um
    if entries.entries:
        parts.append(Text(carried(entries), style="bold"))
        elsewhere = f"outside the work area, at other measured joint angles: {before:.0f} µm before, "
        elsewhere += f"{after:.0f} µm after"
        worse = ": larger, so enter the values for this work area only" if after > before else ""
        parts.append(Text(elsewhere + worse, style="yellow" if worse else ""))
    return Group(*parts)


def carried(entries: ControllerEntries) -> str:
    """Return a sentence comparing the error removed by the entries with the error removed by corrected targets."""
    return (
        f"the entries correct {entries.carried_um:.0f} of {entries.before_um:.0f} µm rms over the work area "
        f"(in a frame taught with the robot); corrected targets correct {entries.carried_by_targets_um:.0f} µm"
    )


def _entries(entries: ControllerEntries, entered: bool) -> Table:
    state = "already entered" if entered else "to be entered together, and only once,"
    where = f"{state} at the controller ({entries.controller.maker})"
    title = f"{where}; tool moves: by this value alone, over the work area, rms"
    lengths = any(entry.now is not None for entry in entries.entries)
    numbers = (*["now"] * lengths, "value", "± u")
    sizes = map(right, ("reading", "tool moves", "± u (tool)"))
    columns: tuple[str | Column, ...] = ("add to", *map(right, numbers), "unit", *sizes)
    table = Table(*columns, title=title, title_style="bold", title_justify="left", header_style="bold")
    for entry in entries.entries:
        reading = f"{entry.reading_deg:+z.4f}°" if entry.reading_deg else "same"
        # The value has a sign and as many decimals as its uncertainty with two digits; counts are whole numbers.
        digits = 1 - math.floor(math.log10(entry.u)) if entry.u > 0 else 6
        numbers = (f"{entry.add:+z.{max(0, digits)}f}", f"{entry.u:.2g}", entry.unit, reading)
        now = ["" if entry.now is None else f"±{entry.now:g}"] * lengths
        worths = (entry.worth_um, entry.leaves_um) if round(entry.worth_um) else ()
        table.add_row(entry.parameter, *now, *numbers, *([f"{um:.0f} µm" for um in worths] or ["turns only"]))
    return fold_long_words(table)


def as_object(entries: ControllerEntries) -> dict[str, Any]:
    """Return the corrections as an object for JSON and corrections.yaml."""
    return {
        "name": entries.name,
        "entries": [
            {
                "parameter": entry.parameter,
                "axis": entry.axis,
                "add": short(entry.add),
                "u": short(entry.u),
                "unit": entry.unit,
                "now": entry.now and short(entry.now),
                "reading_deg": short(entry.reading_deg),
                "worth_um": rounded_um(entry.worth_um),
                "leaves_um": rounded_um(entry.leaves_um),
            }
            for entry in entries.entries
        ],
        "readings_deg": [short(degrees) for degrees in entries.readings_deg],
        "not_entered": [
            {"name": label_of(kept.effect), "worth_um": rounded_um(kept.worth_um)} for kept in entries.not_entered
        ],
        "before_um": rounded_um(entries.before_um),
        "after_um": rounded_um(entries.after_um),
        "corrected_targets_um": rounded_um(entries.by_targets_um),
        "carried_um": rounded_um(entries.carried_um),
        "carried_by_corrected_targets_um": rounded_um(entries.carried_by_targets_um),
        "elsewhere_um": [rounded_um(um) for um in entries.elsewhere_um],
        "base_u_um": rounded_um(entries.base_u_um),
        "known_only_together": [list(group) for group in entries.twins],
        "steps": list(entries.steps),
        "source": entries.controller.source,
        "not_found_in_public": entries.controller.missing,
    }


def short(value: float) -> float:
    """Return a value rounded to nine digits, more than any controller accepts."""
    return float(f"{value:.9g}")


def rounded_um(value: float) -> float:
    """Return a size in µm rounded to 1 nm."""
    return round(value, 3)
