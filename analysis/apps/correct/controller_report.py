"""The report of the corrections for one controller: blocks, and plain values for JSON and corrections.yaml."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from analysis.apps.correct.controller_entries import ControllerChange, ControllerEntries
from analysis.apps.report.blocks import Block, Heading, Sentence, Table, paragraphs
from analysis.apps.report.diagnosis_words import plain
from analysis.apps.report.texts import joined, texts_of
from analysis.runs.tabular import pick_fields
from rigs.rig import Rig
from rigs.schema.effect import label_of

_TEXTS = texts_of("en")
_REPORTED_UM = 1.0
"""Minimum rms displacement of the tool, in µm, for an uncorrected effect to be listed."""
_THIRD = 1 / 3
"""Share of the squared error above which the first sentence names a cause."""


def first_sentence(entries: ControllerEntries, *, entered: bool = False) -> str:
    """The values to enter, their benefit, and the check before any motion. entered: the controller has the values."""
    note = base_note(entries.base_u_um, entries.by_targets_um)
    if not entries.entries:
        is_better = entries.carried_by_targets_um >= _REPORTED_UM
        instead = _TEXTS("entries_targets", error=entries) if is_better else ""
        return joined([_TEXTS("entries_none", error=entries), instead, note])
    count = len(entries.entries)
    values = _TEXTS("entries_value" if count == 1 else "entries_values", count=count)
    does = _TEXTS("entries_entered" if entered else "entries_enter", values=values)
    check = _TEXTS("entries_readings_change" if entries.controller.changes_reading else "entries_readings_stay")
    return joined([_TEXTS("entries_first", does=does, error=entries, check=check), note])


def base_note(base_u_um: float, after_um: float) -> str:
    """Note on the position of the arm on its base, if its uncertainty is more than a third of the squared error."""
    is_large = base_u_um**2 > _THIRD * (base_u_um**2 + after_um**2)
    return _TEXTS("correct_base_unknown", u=f"{base_u_um / 1e3:.2g}") if is_large else ""


def blocks(entries: ControllerEntries, rig: Rig, *, entered: bool = False) -> list[Block]:
    """The values to enter with their benefit, the steps, and the remaining error. entered: the controller has them."""
    controller, parts = entries.controller, list[Block]()
    if entries.entries:
        heading = _TEXTS("entries_heading_entered" if entered else "entries_heading", maker=controller.maker)
        parts += [Heading(heading, 3), _table(entries.entries), Sentence(_TEXTS("entries_about"), "note")]
        parts += [Sentence(f"{k}. {step}") for k, step in enumerate(() if entered else entries.steps, start=1)]
        parts += paragraphs([_TEXTS("entries_source", source=controller.source), controller.missing], "note")
    if controller.scale and any(entry.unit == "deg" for entry in entries.entries):
        parts.append(Sentence(_TEXTS("entries_scale", scale=controller.scale, unit=controller.unit)))
    lines = [_TEXTS("entries_twins", names=", ".join(group)) for group in entries.twins]
    lines += [
        _TEXTS("entries_not_entered", name=plain(rig, effect), um=f"{um:.0f}")
        for effect, um in entries.not_entered
        if um >= _REPORTED_UM
    ]
    parts += paragraphs(lines)
    if not entries.entries:
        return parts
    before_um, after_um = entries.elsewhere_um
    is_worse = after_um > before_um
    key = "entries_elsewhere_worse" if is_worse else "entries_elsewhere"
    elsewhere = Sentence(_TEXTS(key, before=before_um, after=after_um), "doubt" if is_worse else "plain")
    return [*parts, Sentence(_TEXTS("entries_gain", error=entries), "strong"), elsewhere]


def _table(entries: Sequence[ControllerChange]) -> Table:
    is_length = any(entry.now is not None for entry in entries)
    columns = ("add to", *["now"] * is_length, "value", "± u", "unit", "reading", "tool moves", "± u (tool)")
    rows = []
    for entry in entries:
        # The value has a sign and as many decimals as its uncertainty with two digits; counts are whole numbers.
        digits = 1 - math.floor(math.log10(entry.u)) if entry.u > 0 else 6
        now = ["" if entry.now is None else f"±{entry.now:g}"] * is_length
        value = f"{entry.add:+z.{max(0, digits)}f}", f"{entry.u:.2g}", entry.unit
        reading = f"{entry.reading_deg:+z.4f}°" if entry.reading_deg else "same"
        turns_only = not round(entry.worth_um)
        moves = ("turns only", "") if turns_only else (f"{entry.worth_um:.0f} µm", f"{entry.leaves_um:.0f} µm")
        rows.append((entry.parameter, *now, *value, reading, *moves))
    return Table(columns, rows, set(range(1, len(columns))) - {3 + is_length})


def as_object(entries: ControllerEntries) -> dict[str, Any]:
    """Object for JSON and corrections.yaml."""
    return {
        "name": entries.name,
        "entries": [
            pick_fields(entry, "parameter", "axis")
            | {"add": short(entry.add), "u": short(entry.u), "unit": entry.unit}
            | {"now": entry.now and short(entry.now), "reading_deg": short(entry.reading_deg)}
            | {"worth_um": round(entry.worth_um, 3), "leaves_um": round(entry.leaves_um, 3)}
            for entry in entries.entries
        ],
        "readings_deg": list(map(short, entries.readings_deg)),
        "not_entered": [{"name": label_of(effect), "worth_um": round(um, 3)} for effect, um in entries.not_entered],
        **{name: round(getattr(entries, field), 3) for name, field in _ERRORS.items()},
        "elsewhere_um": [round(um, 3) for um in entries.elsewhere_um],
        "known_only_together": entries.twins,
        "steps": entries.steps,
        "source": entries.controller.source,
        "not_found_in_public": entries.controller.missing,
    }


_ERRORS = {
    "before_um": "before_um", "after_um": "after_um", "corrected_targets_um": "by_targets_um",
    "carried_um": "carried_um", "carried_by_corrected_targets_um": "carried_by_targets_um", "base_u_um": "base_u_um",
}  # fmt: skip
"""Errors by their name in the JSON."""


def short(value: float) -> float:
    """Round to nine digits, more than any controller accepts."""
    return float(f"{value:.9g}")
