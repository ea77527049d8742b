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

_REPORTED_UM = 1.0
"""An effect that stays is listed where it moves the tool by at least this."""
_THIRD = 1 / 3
"""Part of a squared error from which its cause is said in the first sentence."""


def first_sentence(found: ControllerEntries) -> str:
    """What to enter where, what it gains, and what to check before motion."""
    maker, targets = found.controller.maker, f"{found.by_targets_um:.0f} µm"
    if not found.entries:
        return (
            f"Nothing is to be entered at this {maker} controller: none of its parameters takes up 1 µm of the "
            f"tool's {found.before_um:.0f} µm over the work; corrected targets (--path) leave {targets}, with frame "
            f"and tool taught with the robot.{base_note(found.base_u_um, found.by_targets_um)}"
        )
    if found.carried_um <= 0:
        return (
            f"Leave the parameters of this {maker} controller as they are: with frame and tool taught with the "
            f"robot the tool's error over the work is {found.before_um:.0f} µm rms as it is and "
            f"{found.after_um:.0f} with the values below; corrected targets (--path) leave {targets}."
            f"{base_note(found.base_u_um, found.by_targets_um)}"
        )
    count = "the value" if len(found.entries) == 1 else f"the {len(found.entries)} values"
    reads = found.controller.changes_reading
    check = "each axis reads as much more as said below" if reads else "the joint angles are those of before"
    return (
        f"Enter {count} below in {found.controller.place} of the {maker} controller: the tool's error over the work "
        f"falls from {found.before_um:.0f} to {found.after_um:.0f} µm rms with frame and tool taught with the robot "
        f"(corrected targets: {targets}); before any motion check that {check}."
        f"{base_note(found.base_u_um, found.by_targets_um)}"
    )


def base_note(base_u_um: float, after_um: float) -> str:
    """What to say of the place of the whole arm on its base, where that makes more than a third of the squared
    error."""
    if base_u_um**2 <= _THIRD * (base_u_um**2 + after_um**2):
        return ""
    return (
        f" (The place of the whole arm on its base is known only to ± {base_u_um / 1e3:.2g} mm from these runs; teach "
        "the frame of the work with the robot.)"
    )


def as_table(found: ControllerEntries) -> RenderableType:
    """What to enter, in which order, what it is worth, and what stays."""
    parts: list[RenderableType] = []
    if found.entries:
        parts.append(_entries(found))
        parts += [Text(f"{number}. {step}") for number, step in enumerate(found.steps, start=1)]
        parts.append(Text(f"from {found.controller.source}", style="dim"))
    parts.append(Text(found.controller.missing, style="dim"))
    if _unscaled(found):
        parts.append(Text(f"with --scale, six {found.controller.scale}: the same as {found.controller.unit}"))
    parts += [Text(f"known only together, so divided by usual sizes: {', '.join(group)}") for group in found.twins]
    parts += [Text(f"not entered: {_stays(one)}") for one in found.not_entered if one.worth_um >= _REPORTED_UM]
    parts.append(Text(carried(found), style="bold"))
    before, after = found.elsewhere_um
    if found.entries:
        elsewhere = f"beside the work, at other joint angles for which the model is known: {before:.0f} µm before, "
        elsewhere += f"{after:.0f} µm after"
        worse = ": worse, so enter them for this work only" if after > before else ""
        parts.append(Text(elsewhere + worse, style="yellow" if worse else ""))
    return Group(*parts)


def carried(found: ControllerEntries) -> str:
    """What the entries carry of the tool's error, and what corrected targets do."""
    return (
        f"entries carry {found.carried_um:.0f} of {found.before_um:.0f} µm over the work (rms, in a frame taught with "
        f"the robot); corrected targets "
        f"carry {found.carried_by_targets_um:.0f}"
    )


def _entries(found: ControllerEntries) -> Table:
    title = (
        f"to be entered once at the controller ({found.controller.maker}); "
        "worth and leaves: rms of the tool over the tests"
    )
    table = Table(title=title, title_style="bold", title_justify="left", header_style="bold")
    lengths = any(one.now is not None for one in found.entries)
    for heading in ("add to", *["now"] * lengths, "value", "± u", "unit", "reading", "worth", "leaves"):
        table.add_column(heading, justify="left" if heading in ("add to", "unit") else "right")
    for one in found.entries:
        reading = f"{one.reading_deg:+.4f}°" if one.reading_deg else "same"
        numbers = (_number(one.add, one.u), f"{one.u:.2g}", one.unit, reading)
        now = ["" if one.now is None else f"±{one.now:g}"] * lengths
        table.add_row(one.parameter, *now, *numbers, f"{one.worth_um:.0f} µm", f"{one.leaves_um:.0f} µm")
    return whole(table)


def _number(value: float, u: float) -> str:
    """Return a value with its sign, to the second digit of its uncertainty; a count to whole counts."""
    digits = 1 - math.floor(math.log10(u)) if u > 0 else 6
    return f"{value:+.{max(0, digits)}f}"


def _unscaled(found: ControllerEntries) -> bool:
    return bool(found.controller.scale) and any(one.unit == "deg" for one in found.entries)


def _stays(one: NotEntered) -> str:
    return f"{label_of(one.effect)}, {one.worth_um:.0f} µm rms: no constant and no target holds it"


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
                "now": one.now and _short(one.now),
                "reading_deg": _short(one.reading_deg),
                "worth_um": _um(one.worth_um),
                "leaves_um": _um(one.leaves_um),
            }
            for one in found.entries
        ],
        "not_entered": [{"name": label_of(one.effect), "worth_um": _um(one.worth_um)} for one in found.not_entered],
        "before_um": _um(found.before_um),
        "after_um": _um(found.after_um),
        "corrected_targets_um": _um(found.by_targets_um),
        "carried_um": _um(found.carried_um),
        "carried_by_corrected_targets_um": _um(found.carried_by_targets_um),
        "elsewhere_um": [_um(one) for one in found.elsewhere_um],
        "base_u_um": _um(found.base_u_um),
        "known_only_together": [list(group) for group in found.twins],
        "steps": list(found.steps),
        "source": found.controller.source,
        "not_found_in_public": found.controller.missing,
    }


def _short(value: float) -> float:
    return float(f"{value:.9g}")


def _um(value: float) -> float:
    return round(value, 3)
