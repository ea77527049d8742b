"""Report of all corrections: on the screen, as JSON, and as the files for the cell."""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from functools import partial, reduce
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from rich.console import Group, RenderableType
from rich.table import Column, Table
from rich.text import Text

from analysis.apps.correct import controller_report, program_report
from analysis.apps.correct.controller_report import base_note, short
from analysis.apps.correct.correct_rig import Corrections
from analysis.apps.correct.corrected_constants import CONSTANTS, corrected_table
from analysis.apps.makers import maker_by
from analysis.apps.makers.reading import mark_of, with_remark
from analysis.apps.programs.target_path import corrected_columns
from analysis.apps.report.diagnosis_words import plain
from analysis.apps.report.texts import texts_of
from analysis.cli.plain_console import fold_long_words, right
from analysis.correction.corrected_targets import GAIN_UM, CorrectedTargets, WorkError
from analysis.correction.reasons import how_to_state_controller
from analysis.correction.support import ANYWAY, reason_against_model, why_nothing
from analysis.correction.work import rest_effects
from analysis.procedures.shared.quantity import quantity_of
from analysis.robot.kinematics.arm import Array
from rigs.effects import size_field
from rigs.errors import FileError
from rigs.schema.effect import label_of

_REPORTED_MM = 1e-3
"""Minimum displacement of a target, in mm, for an uncorrected effect to be reported."""
_count = program_report.targets_in_words
_HEAD = "Corrections for the cell {name} by the effects of the rig file and the calibration beside it, {date}."
_WAYS = {
    "joint_zeros": "master each axis so that the reading at the same position is `add_deg` larger.",
    "link_constants": "enter these values into the controller if possible; dh.csv is the complete table.",
    "controller": "changes of the controller's own parameters that cover most of the model.",
    "path": "the corrected targets cover the whole model, for a controller with unchanged zeros and constants.",
    "programs": "they contain the complete model, but none has run on a real controller: try each at reduced speed.",
}
_NOTHING = (
    "Nothing to enter is here: --for MAKER writes values to enter, --program FILE or --path FILE corrected targets."
)
_ONE = "Use only one: zeros and constants, or the parameters of the controller, or corrected targets."


_UNKNOWN = (
    "The constants with which this controller computes poses are unknown: only joint targets are corrected, and no "
    "values to enter are computed. To change this"
)


def as_table(corrections: Corrections) -> RenderableType:
    """Return the report for the screen: a sentence of advice, the effects, the values to change, and the benefit."""
    columns = ("error", right("value"), "corrected by", Column("reason", ratio=1))
    effects = Table(*columns, title="value ± standard uncertainty", title_style="dim", header_style="bold")
    for support in (*corrections.effects, *corrections.calibrated):
        field = size_field(support.effect)
        quantity = quantity_of(support.effect, field, {field: support.u})
        value = str(quantity) if support.u > 0 else f"{support.value:g} {quantity.sign}".rstrip()
        use = Text("not corrected", "yellow") if support.use == "none" else Text(support.use, "green")
        effects.add_row(plain(corrections.rig, support.effect), value, use, support.reason)
    parts: list[RenderableType] = [Text(_first(corrections), style="bold")]
    if calibrated := corrections.rig.calibrated:
        of_runs = (
            f"The diagnosis states {calibrated.before_um:.0f} µm rms, because its runs cover only a part of this area."
        )
        parts.append(Text(of_runs))
    if effects.row_count:
        parts += [Text(), fold_long_words(effects)]
    wrong = [item.effect for item in corrections.effects if item.use != "none" and item.effect.DEED == "check"]
    if checked := ", ".join(plain(corrections.rig, effect) for effect in wrong):
        advice = "Use corrected targets only if this value cannot be corrected in the controller."
        parts.insert(0, Text(f"First check this value in the controller: {checked}. {advice}", style="bold yellow"))
    if why := why_nothing(corrections.rig):
        parts.insert(0, Text(f"The diagnosis advises against this: {why}.", style="bold red"))
    # The entries of a controller already cover the complete model. Listing these values too would correct twice.
    if not corrections.at_controller:
        instead = [
            f"master axis {zero.axis} so that the reading at the same position is {zero.delta:+z.4f}° (± {zero.u:.4f}°)"
            " larger"
            for zero in corrections.zeros
        ]
        instead += [
            f"axis {constant.axis}, {constant.key}: {constant.corrected:.6g} instead of {constant.nominal:.6g} "
            f"(± {constant.u:.2g})"
            for constant in corrections.constants
        ]
        parts += [Text(f"alternatively, {line}") for line in instead]
    parts += [Text(line) for line in _path_lines(corrections)]
    if corrections.at_controller:
        parts += [Text(), controller_report.as_table(corrections.at_controller, corrections.rig, corrections.entered)]
    parts += [Text(line) for program in corrections.programs for line in ("", *program_report.lines(program))]
    if corrections.rig.controller == "unknown":
        parts += [Text(), Text(f"{_UNKNOWN}: {how_to_state_controller(corrections.rig)}", style="yellow")]
    return Group(*parts)


def _first(corrections: Corrections) -> str:
    work, of_work = corrections.work, texts_of("en").not_known(corrections.work.unknown)
    if all(support.use == "none" for support in corrections.effects) and work.model_um < GAIN_UM:
        head = f"None of the tool error over the work area ({work.before_um:.0f} µm rms) can be corrected"
        reason = "; the table gives the reasons" if corrections.effects else ""
        return f"{head}{reason}.{of_work}"
    if corrections.at_controller:
        first = controller_report.first_sentence(corrections.at_controller, entered=corrections.entered)
        return first + _never_both(corrections) + of_work
    if corrections.programs and all(program.held for program in corrections.programs) and not corrections.path:
        return "No program was written: some targets were not corrected (--all-or-nothing requires all of them)."
    if corrections.programs and not any(program.names for program in corrections.programs) and not corrections.path:
        names = ", ".join(program.path.name for program in corrections.programs)
        return f"No target was corrected in {names}; the reasons are listed below."
    errors, options = corrections.errors, "--program FILE, or " * corrections.rig.takes_programs + "--path TARGETS.csv"
    send = "Move the robot to the corrected targets of"
    sentences = [_falls(f"{send} {path.name}", error, of_work=False) for path, error in errors.items() if error]
    sentences = sentences or [_falls(f"Move the robot to corrected targets ({options})", work, of_work=True)]
    gains = any(error.gains for error in errors.values() if error) if errors else work.gains
    return " ".join(sentences) + (_never_both(corrections) if gains else "")


def _falls(how: str, error: WorkError, *, of_work: bool) -> str:
    """Return a sentence on the error after a way of correction.

    of_work: the error refers to the work area; otherwise to the targets of a file.
    """
    before, after = f"{error.before_um:.0f}", f"{error.after_um:.0f}"
    where, unknown = "over the work", texts_of("en").not_known(error.unknown)
    if not of_work:
        where, share = "at these targets", max(100 * error.unknown, 1)
        guess = (
            f" The other {share:.0f} % of these targets lie outside the measured area, so their correction is a guess "
        )
        guess += "and may increase the error. Measure there first, or leave these targets unchanged."
        unknown = guess if error.unknown else ""
    falls = f"{how}: the tool error {where} falls from"
    taught = "taught with the robot" + " over the work area" * error.taught_elsewhere
    if error.before_um - error.after_um >= GAIN_UM:
        return (
            f"{falls} {before} to {after} µm rms with frame and tool {taught} (standard uncertainty of "
            f"the model {error.u_um:.0f} µm).{base_note(error.base_u_um, error.after_um)}{unknown}"
        )
    if error.gains:
        return (
            f"{falls} {error.base.before_um:.0f} to {error.base.after_um:.0f} µm rms in the robot's base; "
            f"in a frame taught with the robot the error remains {before} µm.{unknown}"
        )
    return (
        f"Do not change the targets: a correction would move the tool by only {error.model_um:.0f} ± {error.u_um:.0f} "
        f"µm rms {where}, with frame and tool {taught}. The error would change from {before} to {after} "
        "µm. "
        f"More runs, at a different place or of a different test, would reduce the uncertainty.{unknown}"
    )


def why_not(corrections: Corrections) -> str:
    """Return the reason for correcting nothing; empty if there are corrections."""
    why = "" if corrections.work.gains else "corrected targets do not reduce the error over the work"
    if corrections.errors:
        why = next((f"{path.name}: {of_it}" for path, of_it in corrections.in_vain.items()), "")
    return why_nothing(corrections.rig) or why


def _never_both(corrections: Corrections) -> str:
    """Return a warning against correcting twice, once at the controller and once in the targets."""
    if not corrections.at_controller:
        ways = "programs, entered values" if corrections.rig.takes_programs else "targets"
        return f" Choose a single method, corrected {ways} or a re-mastered axis: two methods would correct twice."
    if not corrections.at_controller.entries:
        return ""
    if not corrections.path:
        return " Then leave programs, targets and mastering unchanged: a second method would correct twice."
    has, lacks = (
        "with these values already entered: the targets correct the rest",
        "without these values: choose one of the two",
    )
    state = has if corrections.entered else lacks
    return f" corrected-{corrections.path[0].name} is for a controller {state}."


def _path_lines(corrections: Corrections) -> list[str]:
    lines = []
    if corrections.path:
        path, _, targets = corrections.path
        lines.append(
            f"{path.name}: {_count(int(targets.done.sum()))}, missed by up to {np.nanmax(targets.missed_mm):.3f} mm "
            f"before; {program_report.reached(targets.u_frame_mm[targets.done], targets.u_mm[targets.done])}; "
            f"uncorrected effects leave {_small(np.nanmax(_left_out(targets)))}"
        )
        stays = rest_effects(corrections.rig, corrections.effects)
        words = {label_of(effect): plain(corrections.rig, effect) for effect in stays}
        each = [(words[name], mm) for name, mm in _budget(targets).items() if mm >= _REPORTED_MM]
        if each:
            parts = ", ".join(f"{name} {_small(mm)}" for name, mm in each)
            lines.append(f"not corrected (rms at the worst target, from both sides, cold and warm): {parts}")
        lines += targets.doubts
        if targets.left:
            lines.append(f"{_count(len(targets.left))} left unchanged (marked no in the column corrected)")
    return lines


def _left_out(targets: CorrectedTargets) -> Array:
    """Return the displacement (n,) mm of each target by all uncorrected effects."""
    return np.asarray(np.linalg.norm(targets.left_out_mm, axis=1))


def _budget(targets: CorrectedTargets) -> dict[str, float]:
    """Return the largest displacement in mm of a target by each uncorrected effect, in descending order."""
    worst = dict(zip(targets.left_out, np.nanmax(targets.left_out_mm, axis=0).tolist(), strict=True))
    return dict(sorted(worst.items(), key=lambda item: -item[1]))


def _small(mm: float) -> str:
    return "less than 0.001 mm" if mm < _REPORTED_MM else f"{mm:.3f} mm"


def as_object(corrections: Corrections, written: Sequence[Path]) -> dict[str, Any]:
    """Return the corrections as an object for JSON, with lengths in mm and angles in degrees."""
    path = None
    if corrections.path:
        targets = corrections.path[2]
        largest = {"missed": targets.missed_mm, "left_out": _left_out(targets), "u": targets.u_mm}
        largest["u_frame"] = targets.u_frame_mm
        path = {
            "targets": len(targets.q),
            "largest_mm": {name: None if np.isnan(mm).all() else float(np.nanmax(mm)) for name, mm in largest.items()},
            "left_out_mm": _budget(targets),
            "u_um": _each_um(targets.u_mm),
            "u_frame_um": _each_um(targets.u_frame_mm),
            "covered": None if targets.covered is None else targets.covered.tolist(),
            "doubts": list(targets.doubts),
            "error": targets.error and program_report.error_object(targets.error),
        }
    return {**_contents(corrections), "path": path, "files": [str(file) for file in written]}


def _contents(corrections: Corrections) -> dict[str, Any]:
    return {
        "rig": corrections.rig.name,
        "verdict": "nothing" if (why := why_not(corrections)) else "correct",
        "verdict_why": why or None,
        "controller_arm": corrections.rig.controller,
        "joint_zeros": [
            {"axis": zero.axis, "add_deg": short(zero.delta), "u_deg": short(zero.u)} for zero in corrections.zeros
        ],
        "link_constants": [
            (
                {
                    "axis": constant.axis,
                    "key": constant.key,
                    "nominal": constant.nominal,
                    "corrected": short(constant.corrected),
                    "u": short(constant.u),
                }
            )
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
        "not_corrected": _not_corrected(corrections),
        "programs": [program_report.as_object(program) for program in corrections.programs],
        "controller": corrections.at_controller and controller_report.as_object(corrections.at_controller),
    }


def _not_corrected(corrections: Corrections) -> list[dict[str, Any]]:
    """Return the uncorrected targets of the path, by line number in the file."""
    if not corrections.path:
        return []
    _, source, targets = corrections.path
    return [
        {"line": source.lines[target.place], "reason": target.reason, "why": target.what} for target in targets.left
    ]


def _each_um(values_mm: Array) -> list[float | None]:
    """Return values (n,) mm in µm, None for NaN."""
    return [None if np.isnan(mm) else round(1e3 * mm, 3) for mm in values_mm.tolist()]


def write(corrections: Corrections, directory: Path) -> list[Path]:
    """Write corrections.yaml and, if they apply, dh.csv, the corrected path and the corrected programs.

    dh.csv is written if a link constant changes. Raises FileError if a file already exists.
    """
    import pyarrow as pa  # noqa: PLC0415 - slow to import

    from analysis.runs.written_files import holding, write_all_new, write_csv  # noqa: PLC0415

    contents = _contents(corrections)
    ways = [f"{key}: {way}" for key, way in _WAYS.items() if contents.get(key) or (key == "path" and corrections.path)]
    date = dt.datetime.now(dt.UTC).date()
    lines = [
        _HEAD.format(name=corrections.rig.name, date=date),
        *(ways or [_NOTHING if corrections.rig.takes_programs else "There are no values to enter: see --path."]),
        _ONE,
        "u: standard uncertainty.",
    ]
    head = "".join(f"# {line}\n" for line in lines)
    against = [*(corrections.errors if why_nothing(corrections.rig) else corrections.in_vain)]
    if why := reason_against_model(corrections.rig) or (why_not(corrections) if corrections.errors else ""):
        head += f"# {ANYWAY[0].upper()}{ANYWAY[1:]}. Why: {why}.\n"
    text = head + yaml.safe_dump(contents, sort_keys=False, allow_unicode=True, width=10_000)
    files = {"corrections.yaml": holding(text.encode())}
    if corrections.constants:
        rows = corrected_table(corrections.rig, corrections.constants)
        table = pa.table({key: [row[key] for row in rows] for key in ("axis", "name", *CONSTANTS)})
        files["dh.csv"] = partial(write_csv, table)
    if (at := corrections.at_controller) and at.entries and at.controller.files and not corrections.entered:
        values = at.controller.files(corrections.rig, {(entry.axis, entry.key): entry.add for entry in at.entries})
        files |= {name: holding(text_of_file.encode()) for name, text_of_file in values.items()}
    if corrections.path:
        given_path, path, targets = corrections.path
        files[f"corrected-{given_path.name}"] = partial(
            write_csv, corrected_columns(path, targets, ANYWAY if given_path in against else "")
        )
    for program in corrections.programs:
        for name, data in ({} if program.held else program.files).items():
            if name in files:
                raise FileError(
                    name,
                    "would be written twice",
                    "put corrected programs of the same name into different directories",
                    code="program.twice",
                )
            remarks = [mark_of(date.isoformat())] if name in program.changed else []
            remarks += [ANYWAY] if program.path in against else []
            form = maker_by(program.maker).reader.remark
            files[name] = holding(reduce(partial(with_remark, form, name), remarks, data))
    return write_all_new(directory, files)
