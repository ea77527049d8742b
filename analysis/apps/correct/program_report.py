"""Report of a program with corrected targets, on the screen and as JSON."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict
from typing import Any

import numpy as np

from analysis.apps.correct.corrected_program import MOST_MM, CorrectedProgram
from analysis.apps.correct.shared_corrections import REMAINING_SHARE, SharedCorrection
from analysis.apps.makers.target import UncorrectedTarget
from analysis.correction.corrected_targets import WorkError
from analysis.correction.reasons import WHY, Reason
from analysis.robot.kinematics.arm import Array
from analysis.runs.noise.readings import rms

_LISTED = 30
"""Maximum number of uncorrected targets on the screen; corrections.yaml lists more."""
_KEPT = 10_000
"""Maximum number of uncorrected targets in corrections.yaml and in JSON. Robot programs are smaller."""
NOT_TRIED = (
    "Programs corrected by rig were tested only on rig's models of controllers: first follow the trial "
    "run in docs/correct-a-program.md"
)
_SHOWN_UM = 1.0
"""Rounding in µm below which nothing is reported: no supported gauge resolves it."""


_MORE: dict[Reason, str] = {
    "too_large": f" (more than {MOST_MM:g} mm, 1°, or 10° of a joint)",
    "not_understood": " (add the files of called routines, or name them with --neutral)",
}
"""Limits and remedies after the reason for uncorrected targets."""


def lines(program: CorrectedProgram) -> list[str]:
    """Return the lines for the screen."""
    count, moved = len(program.names), program.moved_mm
    text_lines = [_head(program)]
    if program.held:
        text_lines.append(
            "  not written: some places are uncorrected, and --all-or-nothing writes only complete programs"
        )
    if steps := len(program.beside_left_mm):
        text_lines.append(
            f"  partly corrected: pairs of neighbouring targets with only one corrected ({_steps(steps)}) "
            f"are now {program.beside_left_mm.mean():.3f} mm (mean) off their taught distance"
            + ("" if program.held else "; --all-or-nothing does not write such programs")
        )
    text_lines += [
        f"  {_place(program, overruling.file, overruling.line)}: the numbers of the program for "
        f"{overruling.kind} {overruling.name} differ from --{overruling.kind}; from there the program's "
        "numbers are used"
        for overruling in program.overruled[:_LISTED]
    ]
    text_lines += [
        f"  {_place(program, notice.file, notice.line)}: {notice.text}" for notice in program.notices[:_LISTED]
    ]
    if program.neutral:
        text_lines.append(
            "  --neutral states that these routines neither move the arm nor change tools, frames, registers "
            f"or displacements: {', '.join(program.neutral)}"
        )
    if program.start:
        start = ", ".join(f"{angle:g}" for angle in np.degrees(program.start).round(6))
        text_lines.append(
            f"  --start-joints states that the arm stands at {start}° whenever this program starts; "
            "from a different posture, the first targets get the wrong correction"
        )
    if count:
        text_lines.append(
            f"  moved by up to {moved.max():.3f} mm, {rms(moved):.3f} mm rms; "
            f"{reached(program.u_frame_mm, program.u_mm)}"
        )
    if len(given_away := program.given_away_mm[np.isfinite(program.given_away_mm)]):
        text_lines.append(
            f"  {targets_in_words(len(given_away))} used with an offset: the offset positions get the same "
            f"correction and stay up to {given_away.max():.3f} mm off"
        )
    if program.shared:
        text_lines.append(
            f"  {_positions(len(program.shared))} next to corrected targets keep more than "
            f"{100 * REMAINING_SHARE:.0f} % of the error and more than the uncertainty:"
        )
        text_lines += [f"    {_shared_words(program, position)}" for position in program.shared[:_LISTED]]
        text_lines += ["    …"] * (len(program.shared) > _LISTED)
    if count and program.rounded_um.max() > _SHOWN_UM:
        text_lines.append(f"  the decimals of this format shift targets by up to {program.rounded_um.max():.1f} µm")
    if outside := sum(map(bool, program.unknown)):
        text_lines.append(f"  {targets_in_words(outside)} outside the range of the runs, corrected by extrapolation:")
        reasons = zip(program.places, program.unknown, strict=True)
        where = dict.fromkeys(f"    {_place(program, *place)}: {why}" for place, why in reasons if why)
        text_lines += list(where)[:_LISTED] + ["    …"] * (len(where) > _LISTED)
    return [*text_lines, *_left_lines(program), *([f"  {NOT_TRIED}"] if count else [])]


def reached(u_frame_mm: Array, u_mm: Array) -> str:
    """Return a sentence on the accuracy of corrected targets, from their uncertainties (n,) mm.

    An uncertainty is NaN if the runs do not cover the target.
    """
    if np.isnan(u_mm).all():
        return "their uncertainty is unknown"
    return (
        f"accuracy after the correction ± {np.nanmax(u_frame_mm):.3f} mm with frame and tool taught with the robot, "
        f"± {np.nanmax(u_mm):.3f} mm in the base (standard uncertainty at the worst target"
        f"{' of those that the runs cover' if np.isnan(u_mm).any() else ''})"
    )


def _head(program: CorrectedProgram) -> str:
    """Return the numbers of corrected targets, of uncorrected targets, and of steps between the two."""
    count, steps = len(program.names), len(program.beside_left_mm)
    head = f"{program.path.name} ({program.maker}): {targets_in_words(count)} corrected"
    between = f", {_steps(steps)} between corrected and unchanged targets" if steps else ""
    places = len(program.left)
    stay = f"{places or 'no'} place unchanged" if places < 2 else f"{places} places unchanged"
    return f"{head}, {stay}{between}"


def _left_lines(program: CorrectedProgram) -> list[str]:
    """For each reason, the number of uncorrected targets and their names, with the program lines that cause it."""
    text_lines, untold = list[str](), _LISTED
    for reason, number in Counter(one.reason for one in program.left).most_common():
        text_lines.append(f"  unchanged, {number} ×: {WHY[reason]}{_MORE.get(reason, '')}")
        shown = [one for one in program.left if one.reason == reason][: max(untold, 0)]
        untold -= len(shown)
        alike = [f"{one.name} ({_place(program, one.file, one.line)})" for one in shown if not one.because]
        text_lines += [f"    {', '.join(alike)}"] if alike else []
        text_lines += [f"    {_because(program, one)}" for one in shown if one.because]
    if len(program.left) > _LISTED:
        text_lines.append(f"    and {len(program.left) - _LISTED} more, all in corrections.yaml")
    return text_lines


def _because(program: CorrectedProgram, left: UncorrectedTarget) -> str:
    causes = [f"{_place(program, at.file, at.line)}: {at.why}" if at.line else at.why for at in left.because]
    return f"{_place(program, left.file, left.line)}: {left.name} ({'; '.join(causes)})"


def as_object(program: CorrectedProgram) -> dict[str, Any]:
    """Return the program as an object for JSON, with lengths in mm and rounding errors in µm."""
    in_mm = (program.moved_mm, program.u_mm, program.u_frame_mm)
    columns = (program.names, program.places, *in_mm, program.rounded_um, program.given_away_mm, program.unknown)
    return {
        "program": program.path.name,
        "controller": program.maker,
        "files": list(program.files),
        "corrected": len(program.names),
        "written": not program.held,
        "run_by_a_real_controller": False,
        "neutral_routines": list(program.neutral),
        "start_joints_deg": np.degrees(program.start).round(6).tolist() if program.start else None,
        "beside_left": {
            "steps": len(program.beside_left_mm),
            "mean_mm": float(program.beside_left_mm.mean()) if len(program.beside_left_mm) else None,
        },
        "overruled": [
            {
                "name": overruling.name,
                "kind": overruling.kind,
                "file": program.sources[overruling.file],
                "line": overruling.line,
            }
            for overruling in program.overruled[:_KEPT]
        ],
        "moved_mm": {
            "largest": float(program.moved_mm.max(initial=0.0)),
            "rms": rms(program.moved_mm) if len(program.moved_mm) else 0.0,
        },
        "rounded_um": float(program.rounded_um.max(initial=0.0)),
        "used_with_offset": {
            "targets": int(np.isfinite(program.given_away_mm).sum()),
            "largest_given_away_mm": (
                float(np.nanmax(program.given_away_mm)) if np.isfinite(program.given_away_mm).any() else None
            ),
            "bound_share": REMAINING_SHARE,
        },
        "shared_corrections": [
            {
                "file": program.sources[position.file],
                "line": position.line,
                "name": position.name,
                "kind": position.kind,
                "before_mm": None if position.unknown else round(position.before_mm, 6),
                "after_mm": None if position.unknown else round(position.after_mm, 6),
                "unknown": position.unknown,
            }
            for position in program.shared[:_KEPT]
        ],
        "notices": [
            {"file": program.sources[notice.file], "line": notice.line, "text": notice.text}
            for notice in program.notices[:_KEPT]
        ],
        "named": sorted(f"--{kind} {name}" for kind, name in program.named),
        "outside_driven_ranges": sum(map(bool, program.unknown)),
        "error": program.error and error_object(program.error),
        "targets": [
            {
                "name": name,
                "file": program.sources[file],
                "line": line,
                "moved_mm": round(float(moved), 6),
                "u_mm": None if np.isnan(u) else round(float(u), 6),
                "u_frame_mm": None if np.isnan(u_frame) else round(float(u_frame), 6),
                "rounded_um": round(float(rounded), 3),
                "given_away_mm": None if np.isnan(given_away) else round(float(given_away), 6),
                "outside_driven_ranges": bool(why),
                "unknown": why or None,
            }
            for name, (file, line), moved, u, u_frame, rounded, given_away, why in zip(*columns, strict=True)
        ],
        "left": [
            {
                "file": program.sources[left_target.file],
                "line": left_target.line,
                "name": left_target.name,
                "reason": left_target.reason,
                "why": WHY[left_target.reason],
                "because": [
                    {"file": program.sources[place.file] if place.line else None, "line": place.line, "why": place.why}
                    for place in left_target.because
                ],
            }
            for left_target in program.left[:_KEPT]
        ],
        "left_count": len(program.left),
    }


def error_object(error: WorkError) -> dict[str, Any]:
    """Return the error over the work or over targets for scripts, in µm."""
    in_base = {name: round(um, 3) for name, um in asdict(error.base).items()}
    sizes = {name: round(getattr(error, name), 3) for name in (*in_base, "base_u_um")}
    return {**sizes, "unknown_share": round(error.unknown, 3), "in_base": in_base}


def targets_in_words(count: int) -> str:
    return "1 target" if count == 1 else f"{count} targets"


def _positions(count: int) -> str:
    return "1 position" if count == 1 else f"{count} positions"


def _shared_words(program: CorrectedProgram, position: SharedCorrection) -> str:
    """Return the place, the error before and after, and the reason of a position that shares a correction."""
    words = {
        "offset": "with an offset",
        "via": "as via point of an arc, if the controller interpolates the orientation from start to end",
    }[position.kind]
    error = f"{position.before_mm:.3f} → {position.after_mm:.3f} mm"
    if position.unknown:
        error = f"the remaining error is unknown: the position {WHY[position.unknown]}"
    return f"{_place(program, position.file, position.line)}: {position.name} {words}: {error}"


def _steps(count: int) -> str:
    return "1 step" if count == 1 else f"{count} steps"


def _place(program: CorrectedProgram, file: int, line: int) -> str:
    is_single = len(program.files) == 1 and program.sources[file] == program.path.name
    return f"line {line}" if is_single else f"{program.sources[file]} line {line}"
