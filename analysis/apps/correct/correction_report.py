"""The report of all corrections and of the entries of a controller: blocks, JSON, and the files for the cell."""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial, reduce
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from analysis.apps.correct import program_report
from analysis.apps.correct.controller_entries import ControllerChange, ControllerEntries
from analysis.apps.correct.correct_rig import Corrections
from analysis.apps.correct.corrected_constants import CONSTANTS, corrected_table
from analysis.apps.correct.corrected_program import CorrectedProgram
from analysis.apps.makers import maker_by
from analysis.apps.makers.reading import converted_mark_of, mark_of, with_remark
from analysis.apps.programs.target_path import corrected_columns
from analysis.apps.report.blocks import Block, Cell, Heading, Row, Sentence, Table, paragraphs
from analysis.apps.report.blocks import as_object as blocks_object
from analysis.apps.report.diagnosis_words import plain_name
from analysis.apps.report.texts import ENGLISH, capital, joined
from analysis.correction.corrected_targets import GAIN_UM, CorrectedTargets, WorkError
from analysis.correction.reasons import how_to_state_controller
from analysis.correction.support import ANYWAY, Support, reason_against_model, reason_to_measure_first, why_nothing
from analysis.correction.work import rest_effects
from analysis.procedures.shared.quantity import quantity_of
from analysis.robot.kinematics.arm import Array
from analysis.runs.tabular import for_json, pick_fields, table_of_rows
from rigs.effects import size_field
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.effect import label_of
from rigs.schema.probe import MM_PER_UNIT
from rigs.text import counted

_REPORTED_MM = 1e-3
"""Minimum displacement of a target, in mm, for an uncorrected effect to be reported."""
_WAYS = {
    "joint_zeros": "master each axis so that the reading at the same position is `add_deg` larger.",
    "link_constants": "enter these values into the controller if possible; dh.csv is the complete table.",
    "controller": "changes of the controller's own parameters that cover most of the model.",
    "path": "the corrected targets cover the whole model, for a controller with unchanged zeros and constants.",
    "programs": "their points have new numbers by their origin, but none has run on a real controller: try each at "
    "reduced speed.",
}
_NOTHING = (
    "Nothing to enter is here: --for MAKER writes values to enter, --program FILE or --path FILE corrected targets."
)
_ONE = "Use only one: zeros and constants, or the parameters of the controller, or corrected targets."


def correction_answer(corrections: Corrections) -> list[Block]:
    """The advice, the effects with their use, the values to change, and the benefit."""
    rig, blocks = corrections.rig, list[Block]()
    if corrections.uses_model and (why := why_nothing(rig)):
        blocks.append(Sentence(ENGLISH("correct_advised_against", why=why), "fail"))
    elif why := _measure_first(corrections):
        blocks.append(Sentence(ENGLISH("correct_measure_first", why=capital(why)), "doubt"))
    if not (corrections.uses_model and corrections.corrects_computed):
        blocks.append(Sentence(_first(corrections), "strong"))
        return [*blocks, *(block for program in corrections.programs for block in program_report.blocks(program))]
    wrong = [item.effect for item in corrections.effects if item.use != "none" and item.effect.DEED == "check"]
    if wrong:
        names = ", ".join(plain_name(rig, effect) for effect in wrong)
        blocks.append(Sentence(ENGLISH("correct_check_first", names=names), "watch"))
    blocks.append(Sentence(_first(corrections), "strong"))
    if rig.calibrated:
        blocks.append(Sentence(ENGLISH("correct_of_runs", um=f"{rig.calibrated.before_um:.0f}")))
    if rows := [_effect(support, rig) for support in (*corrections.effects, *corrections.calibrated)]:
        blocks.append(Table(("error", "value ± u", "corrected by", "reason"), rows, {1}))
    blocks += paragraphs((*_changes(corrections), *_path_lines(corrections)))
    if corrections.at_controller:
        blocks += controller_blocks(corrections.at_controller, rig, entered=corrections.entered)
    blocks += [block for program in corrections.programs for block in program_report.blocks(program)]
    if rig.controller == "unknown":
        unknown = ENGLISH("correct_controller_unknown", remedy=how_to_state_controller(rig))
        blocks.append(Sentence(unknown, "doubt"))
    return blocks


def _measure_first(corrections: Corrections) -> str:
    return reason_to_measure_first(corrections.rig) if corrections.uses_model else ""


def _effect(support: Support, rig: Rig) -> Row:
    field = size_field(support.effect)
    quantity = quantity_of(support.effect, field, {field: support.u})
    value = str(quantity) if support.u > 0 else f"{support.value:g} {quantity.sign}".rstrip()
    use = Cell("not corrected", tone="watch") if support.use == "none" else Cell(support.use, tone="pass")
    return plain_name(rig, support.effect), value, use, support.reason


def _changes(corrections: Corrections) -> Iterator[str]:
    """The values to change instead of targets, unless entries for a controller already contain them."""
    if corrections.at_controller:
        return
    for zero in corrections.zeros:
        yield ENGLISH("correct_by_mastering", zero=zero)
    for constant in corrections.constants:
        yield ENGLISH("correct_by_constant", constant=constant)


def _first(corrections: Corrections) -> str:
    work, of_work = corrections.work, ENGLISH.not_known(corrections.work.unknown)
    programs, path = corrections.programs, corrections.path
    if not corrections.uses_model and (sentence := _without_model(corrections)):
        return sentence
    if all(support.use == "none" for support in corrections.effects) and work.model_um < GAIN_UM:
        key = "correct_nothing_reasons" if corrections.effects else "correct_nothing"
        return joined([ENGLISH(key, um=f"{work.before_um:.0f}"), of_work])
    if corrections.at_controller:
        first = controller_sentence(corrections.at_controller, entered=corrections.entered)
        return joined([first, _never_both(corrections), of_work])
    if programs and all(program.held for program in programs) and not path:
        return ENGLISH("correct_none_written")
    if programs and not any(program.names for program in programs) and not path:
        return ENGLISH("correct_no_target", names=", ".join(program.path.name for program in programs))
    errors = {file: error for file, error in corrections.errors.items() if error}
    sentences = [_falls(ENGLISH("correct_move_to_file", file=file.name), error) for file, error in errors.items()]
    if not sentences:
        how = ENGLISH("correct_move" if corrections.rig.takes_programs else "correct_move_targets")
        sentences = [_falls(how, work, of_work=True)]
    gains = any(error.gains for error in errors.values()) if corrections.errors else work.gains
    return joined([*sentences, _never_both(corrections) if gains else ""])


def _without_model(corrections: Corrections) -> str:
    """The answer for programs that are right as they are, were converted, or could not be converted."""
    right = [program.path.name for program in corrections.programs if program.is_right]
    converted = [program for program in corrections.programs if program.names and not program.held]
    sources = {group.origin.since for program in converted for group in program.groups if group.origin.since}
    names = ", ".join(program.path.name for program in converted)
    sentences = [ENGLISH("correct_converted", names=names, since=", ".join(sorted(sources)))] if converted else []
    unchanged = [one for one in corrections.programs if not (one.names or one.held or one.is_right)]
    lost = [one.path.name for one in unchanged if not one.needs_model]
    sentences += [ENGLISH("correct_not_converted", names=", ".join(lost))] if lost else []
    return joined([*sentences, ENGLISH("correct_right", names=", ".join(right)) if right else ""])


def _falls(how: str, error: WorkError, *, of_work: bool = False) -> str:
    """The error after a way of correction, over the work area or at the targets of a file."""
    is_falling = error.before_um - error.after_um >= GAIN_UM
    key = "correct_falls" if is_falling else "correct_falls_in_base" if error.gains else "correct_no_gain"
    taught = ENGLISH("correct_taught_elsewhere" if error.taught_elsewhere else "correct_taught")
    where = ENGLISH("correct_over_work" if of_work else "correct_at_targets")
    sentence = ENGLISH(key, how=how, where=where, taught=taught, error=error)
    note = base_note(error.base_u_um, error.after_um) if is_falling else ""
    if of_work or not error.unknown:
        return joined([sentence, note, ENGLISH.not_known(error.unknown)])
    return joined([sentence, note, ENGLISH("correct_outside", share=f"{max(100 * error.unknown, 1):.0f}")])


def why_not(corrections: Corrections) -> str:
    """Reason for correcting nothing; empty if there are corrections."""
    if not corrections.uses_model:
        return ""
    if why := why_nothing(corrections.rig):
        return why
    if corrections.errors:
        return next((f"{path.name}: {why}" for path, why in corrections.in_vain.items()), "")
    return "" if corrections.work.gains else "corrected targets do not reduce the error over the work"


def _never_both(corrections: Corrections) -> str:
    """Warning against correcting twice, at the controller and in the targets."""
    if not corrections.at_controller:
        return ENGLISH("correct_one_method" if corrections.rig.takes_programs else "correct_one_method_targets")
    if not (corrections.at_controller.entries and corrections.path):
        off_mm = f"{corrections.at_controller.taught_off_mm:.2g}"
        return ENGLISH("correct_entries_only", mm=off_mm) if corrections.at_controller.entries else ""
    key = "correct_with_entries" if corrections.entered else "correct_without_entries"
    return ENGLISH(key, file=f"corrected-{corrections.path[0].name}")


def _path_lines(corrections: Corrections) -> Iterator[str]:
    if not corrections.path:
        return
    path, _, targets = corrections.path
    accuracy = program_report.reached(targets.u_frame_mm[targets.done], targets.u_mm[targets.done])
    yield ENGLISH(
        "correct_path", file=path.name, targets=counted(int(targets.done.sum()), "target"), accuracy=accuracy,
        missed=f"{np.nanmax(targets.missed_mm):.3f}", rest=_small(np.nanmax(_left_out_mm(targets))),
    )  # fmt: skip
    yield from _posture_lines(corrections)
    rest = rest_effects(corrections.rig, corrections.effects)
    words = {label_of(effect): plain_name(corrections.rig, effect) for effect in rest}
    each = [f"{words[name]} {_small(mm)}" for name, mm in _budget(targets).items() if mm >= _REPORTED_MM]
    if each:
        yield ENGLISH("correct_path_rest", names=", ".join(each))
    yield from targets.doubts
    if targets.left:
        yield ENGLISH("correct_path_left", targets=counted(len(targets.left), "target"))


def _posture_lines(corrections: Corrections) -> Iterator[str]:
    """The posture in which the poses of a path are corrected, and the targets for which it does not matter."""
    if not (corrections.path and (postures := corrections.postures)):
        return
    if stated := postures.stated:
        key = "correct_posture_start" if stated.source == "--start-joints" else "correct_posture"
        source = "posture_deg in the rig file" if stated.source == "rig_file" else stated.source
        yield ENGLISH(key, angles=stated.words, source=source)
    if any_posture := sum(1 for k in postures.several if corrections.path[2].done[k]):
        yield ENGLISH("correct_posture_any", targets=counted(any_posture, "target"))


def _left_out_mm(targets: CorrectedTargets) -> Array:
    """Displacement (n,) mm of each target by all uncorrected effects."""
    return np.asarray(np.linalg.norm(targets.left_out_mm, axis=1))


def _budget(targets: CorrectedTargets) -> dict[str, float]:
    """Largest displacement of a target in mm by each uncorrected effect, in descending order."""
    worst = dict(zip(targets.left_out, np.nanmax(targets.left_out_mm, axis=0).tolist(), strict=True))
    return dict(sorted(worst.items(), key=lambda item: -item[1]))


def _small(mm: float) -> str:
    return ENGLISH("correct_small") if mm < _REPORTED_MM else f"{mm:.3f} mm"


def as_object(corrections: Corrections, written: Sequence[Path]) -> dict[str, Any]:
    """Object for JSON (see `for_json`)."""
    path = None
    if corrections.path:
        targets = corrections.path[2]
        sizes_mm = {"missed": targets.missed_mm, "left_out": _left_out_mm(targets)}
        sizes_mm |= {"u": targets.u_mm, "u_frame": targets.u_frame_mm}
        path = {
            "targets": len(targets.q),
            "largest_mm": {name: np.fmax.reduce(mm) for name, mm in sizes_mm.items()},  # nan only if all are
            "left_out_mm": _budget(targets),
            "u_um": (1e3 * targets.u_mm).round(3),
            "u_frame_um": (1e3 * targets.u_frame_mm).round(3),
            **pick_fields(targets, "covered", "doubts"),
            "posture": corrections.postures and corrections.postures.to_dict(),
            "error": targets.error and program_report.error_object(targets.error),
        }
    return _contents(corrections) | {
        "path": path,
        "files": written,
        "blocks": blocks_object(correction_answer(corrections)),
    }


def _contents(corrections: Corrections) -> dict[str, Any]:
    why, left = why_not(corrections), []
    if corrections.path:
        _, source, targets = corrections.path
        left = [
            {"line": source.lines[target.place], "reason": target.reason, "why": target.what}
            | ({"error_mm": [*map(short, target.errors_mm)]} if target.errors_mm else {})
            for target in targets.left
        ]
    return {
        "rig": corrections.rig.name,
        "verdict": "nothing" if why else "correct",
        "verdict_why": why or None,
        "measure_first": _measure_first(corrections) or None,
        "controller_arm": corrections.rig.controller,
        "joint_zeros": [
            {"axis": zero.axis, "add_deg": short(zero.delta), "u_deg": short(zero.u)} for zero in corrections.zeros
        ],
        "link_constants": [
            pick_fields(constant, "axis", "key", "nominal")
            | {"corrected": short(constant.corrected), "u": short(constant.u)}
            for constant in corrections.constants
        ],
        "effects": [
            {
                "name": label_of(support.effect),
                "value": support.value,
                "u": support.u if support.u > 0 else None,
                "unit": support.effect.unit(size_field(support.effect)),
                "corrected_as": None if support.use == "none" else support.use,
                "reason": support.reason,
            }
            for support in (*corrections.effects, *corrections.calibrated)
        ],
        "work": program_report.error_object(corrections.work),
        "not_corrected": left,
        "programs": [program_report.as_object(program) for program in corrections.programs],
        "controller": corrections.at_controller and controller_object(corrections.at_controller),
    }


def write(corrections: Corrections, directory: Path) -> list[Path]:
    """Write corrections.yaml and, if they apply, dh.csv, the corrected path and the corrected programs.

    Raises FileError if a file already exists.
    """
    from analysis.runs.written_files import holding, write_all_new, write_csv  # noqa: PLC0415 - slow to import

    contents = _contents(corrections)
    ways = [f"{key}: {way}" for key, way in _WAYS.items() if contents.get(key) or (key == "path" and corrections.path)]
    date = dt.datetime.now(dt.UTC).date()
    source = "the effects of the rig file and the calibration beside it"
    head = f"Corrections for the cell {corrections.rig.name} by {source}, {date}."
    nothing = _NOTHING if corrections.rig.takes_programs else "There are no values to enter: see --path."
    lines = [head, *(ways or [nothing]), _ONE, "u: standard uncertainty."]
    against = corrections.errors if why_nothing(corrections.rig) else corrections.in_vain
    if why := reason_against_model(corrections.rig) or (why_not(corrections) if corrections.errors else ""):
        lines.append(f"{capital(ANYWAY)}. Why: {why}.")
    if why := _measure_first(corrections):
        lines.append(f"{capital(why)}.")
    text = "".join(f"# {line}\n" for line in lines)
    text += yaml.safe_dump(for_json(contents), sort_keys=False, allow_unicode=True, width=10_000)
    files = {"corrections.yaml": holding(text.encode())}
    if corrections.constants:
        rows = corrected_table(corrections.rig, corrections.constants)
        files["dh.csv"] = partial(write_csv, table_of_rows(("axis", "name", *CONSTANTS), rows))
    if (at := corrections.at_controller) and at.entries and at.controller.files and not corrections.entered:
        values = at.controller.files(corrections.rig, {(entry.axis, entry.key): entry.add for entry in at.entries})
        files |= {name: holding(text_of_file.encode()) for name, text_of_file in values.items()}
    if corrections.path:
        given_path, path, targets = corrections.path
        columns = corrected_columns(path, targets, ANYWAY if given_path in against else "")
        files[f"corrected-{given_path.name}"] = partial(write_csv, columns)
    for program in (program for program in corrections.programs if not (program.held or program.is_right)):
        for name, data in program.files.items():
            if name in files:
                remedy = "put corrected programs of the same name into different directories"
                raise FileError(name, "would be written twice", remedy, code="output.invalid")
            remarks = _marks(program, date.isoformat()) if name in program.changed else []
            remarks += [ANYWAY] if program.path in against else []
            form = maker_by(program.maker).reader.remark
            files[name] = holding(reduce(partial(with_remark, form, name), remarks, data))
    return write_all_new(directory, files)


def _marks(program: CorrectedProgram, date: str) -> list[str]:
    """Remarks for a changed file, by the origins of its program's points."""
    origins = [group.origin for group in program.groups if not group.origin.is_unchanged]
    return [converted_mark_of(date, origin.digest) if origin.digest else mark_of(date) for origin in origins]


_REPORTED_UM = 1.0
"""Minimum rms displacement of the tool, in µm, for an uncorrected effect to be listed."""
_THIRD = 1 / 3
"""Share of the squared error above which the first sentence names a cause."""


def controller_sentence(entries: ControllerEntries, *, entered: bool = False) -> str:
    """The values to enter, their benefit, and the check before any motion. entered: the controller has the values."""
    note = base_note(entries.base_u_um, entries.by_targets_um)
    if not entries.entries:
        is_better = entries.carried_by_targets_um >= _REPORTED_UM
        instead = ENGLISH("entries_targets", error=entries) if is_better else ""
        return joined([ENGLISH("entries_none", error=entries), instead, note])
    count = len(entries.entries)
    values = ENGLISH("entries_value" if count == 1 else "entries_values", count=count)
    does = ENGLISH("entries_entered" if entered else "entries_enter", values=values)
    check = ENGLISH("entries_readings_change" if entries.controller.changes_reading else "entries_readings_stay")
    return joined([ENGLISH("entries_first", does=does, error=entries, check=check), note])


def base_note(base_u_um: float, after_um: float) -> str:
    """Note on the position of the arm on its base, if its uncertainty is more than a third of the squared error."""
    is_large = base_u_um**2 > _THIRD * (base_u_um**2 + after_um**2)
    return ENGLISH("correct_base_unknown", u=f"{base_u_um / 1e3:.2g}") if is_large else ""


def controller_blocks(entries: ControllerEntries, rig: Rig, *, entered: bool = False) -> list[Block]:
    """The values to enter with their benefit, the steps, and the remaining error. entered: the controller has them."""
    controller, parts = entries.controller, list[Block]()
    if entries.entries:
        heading = ENGLISH("entries_heading_entered" if entered else "entries_heading", maker=controller.maker)
        parts += [Heading(heading, 3), entries_table(entries.entries, rig), Sentence(ENGLISH("entries_about"), "note")]
        parts += [Sentence(f"{k}. {step}") for k, step in enumerate(() if entered else entries.steps, start=1)]
        parts += paragraphs([ENGLISH("entries_source", source=controller.source), controller.missing], "note")
    if controller.scale and any(entry.unit == "deg" for entry in entries.entries):
        parts.append(Sentence(ENGLISH("entries_scale", scale=controller.scale, unit=controller.unit)))
    lines = [ENGLISH("entries_twins", names=", ".join(group)) for group in entries.twins]
    lines += [
        ENGLISH("entries_not_entered", name=plain_name(rig, effect), um=f"{um:.0f}")
        for effect, um in entries.not_entered
        if um >= _REPORTED_UM
    ]
    parts += paragraphs(lines)
    if not entries.entries:
        return parts
    before_um, after_um = entries.elsewhere_um
    is_worse = after_um > before_um
    key = "entries_elsewhere_worse" if is_worse else "entries_elsewhere"
    elsewhere = Sentence(ENGLISH(key, before=before_um, after=after_um), "doubt" if is_worse else "plain")
    return [*parts, Sentence(ENGLISH("entries_gain", error=entries), "strong"), elsewhere]


def entries_table(entries: Sequence[ControllerChange], rig: Rig) -> Table:
    """The values in the unit in which the controller shows them."""
    entries = [_in_unit_of(rig, entry) for entry in entries]
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


def _in_unit_of(rig: Rig, entry: ControllerChange) -> ControllerChange:
    """A length in the unit of the controller's files. JSON and corrections.yaml stay in mm."""
    unit = rig.length_unit
    if unit is None or unit == "mm" or entry.unit != "mm":
        return entry
    mm, now = MM_PER_UNIT[unit], entry.now
    return replace(entry, add=entry.add / mm, u=entry.u / mm, unit=unit, now=None if now is None else now / mm)


def controller_object(entries: ControllerEntries) -> dict[str, Any]:
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
        "taught_points_off_mm": round(entries.taught_off_mm, 3),
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
