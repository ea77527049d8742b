"""The report of a program with corrected targets: blocks, and plain values for JSON."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np

from analysis.apps.correct.corrected_program import CorrectedProgram, PointGroup
from analysis.apps.correct.shared_corrections import REMAINING_SHARE, SharedCorrection
from analysis.apps.report.blocks import Block, Heading, Sentence, paragraphs
from analysis.apps.report.texts import ENGLISH, joined
from analysis.correction.corrected_targets import WorkError
from analysis.correction.point_origins import ChangedArm, ConvertedPoints, PointOrigin
from analysis.correction.reasons import WHY, Reason
from analysis.robot.description.controller_constants import MOST_ZERO_DEG
from analysis.robot.kinematics.arm import Array
from analysis.runs.noise.readings import rms
from analysis.runs.tabular import pick_fields
from rigs.text import counted, first_of

_LISTED = 30
"""Places of one kind in the answer; corrections.yaml lists more."""
_KEPT = 10_000
"""Uncorrected targets in corrections.yaml and in JSON. Robot programs are smaller."""
_SHOWN_UM = 1.0
"""Rounding in µm below which nothing is reported: no supported gauge resolves it."""
_HOW_TO_STATE = (
    " (if the arm reaches all targets in one posture, state it: --near with the joint angles at one of them, as the "
    "pendant shows them)"
)
_MORE: dict[Reason, str] = {
    "too_large": f" (more than a zero wrong by {MOST_ZERO_DEG:g}° causes at full reach, 1°, or 10° of a joint)",
    "not_understood": " (add the files of called routines, or name them with --neutral)",
    "no_posture": _HOW_TO_STATE,
    "ambiguous": _HOW_TO_STATE,
}
"""Limits and remedies after the reason for uncorrected targets."""


def blocks(program: CorrectedProgram) -> list[Block]:
    """The numbers of targets, remarks on the correction, and the uncorrected targets with their reasons."""
    if program.is_right:
        return [Heading(ENGLISH("program_head_right", program=program), 3), *paragraphs(_origins(program))]
    count, steps, left = len(program.names), len(program.beside_left_mm), len(program.left)
    places = counted(left, "place") if left else "no place"
    targets = counted(count, "target")
    head = ENGLISH("program_head", program=program, targets=targets, places=places)
    between = ENGLISH("program_between", steps=counted(steps, "step")) if steps else ""
    not_tried = ENGLISH("program_not_tried") if count else ""
    return [
        Heading(joined([head, between], ", "), 3),
        *paragraphs(_remarks(program)),
        *_left(program),
        *paragraphs([not_tried], "doubt"),
    ]


def _remarks(program: CorrectedProgram) -> Iterator[str]:
    moved, left_mm = program.moved_mm, program.beside_left_mm
    if program.held:
        yield ENGLISH("program_held")
    if len(left_mm):
        partly = ENGLISH("program_partly", steps=counted(len(left_mm), "step"), mm=f"{left_mm.mean():.3f}")
        yield joined([partly, "" if program.held else ENGLISH("program_all_or_nothing")], "; ")
    for stated in program.overruled[:_LISTED]:
        yield ENGLISH("program_overruled", place=_place(program, stated.file, stated.line), stated=stated)
    yield from _origins(program)
    yield from (f"{_place(program, notice.file, notice.line)}: {notice.text}" for notice in program.notices[:_LISTED])
    if program.neutral:
        yield ENGLISH("program_neutral", names=", ".join(program.neutral))
    if program.start:
        angles = ", ".join(f"{angle:g}" for angle in np.degrees(program.start).round(6))
        yield ENGLISH("program_start", angles=angles)
    if program.near and program.by_user:
        angles = ", ".join(f"{angle:z.4g}°" for angle in np.degrees(program.near))
        looked_at = [_place(program, *place) for place in sorted(set(program.by_user))]
        places = first_of(looked_at, _LISTED) + " (all in corrections.yaml)" * (len(looked_at) > _LISTED)
        yield ENGLISH("program_near", places=places, angles=angles)
    if program.judged:
        accuracy = reached(program.u_frame_mm, program.u_mm)
        yield ENGLISH("program_moved", largest=f"{moved.max():.3f}", rms=f"{rms(moved):.3f}", accuracy=accuracy)
    if len(given_away := program.given_away_mm[np.isfinite(program.given_away_mm)]):
        targets = counted(len(given_away), "target")
        yield ENGLISH("program_offset", targets=targets, mm=f"{given_away.max():.3f}")
    if program.shared:
        positions, share = counted(len(program.shared), "position"), f"{100 * REMAINING_SHARE:.0f}"
        places = first_of([_shared(program, position) for position in program.shared], _LISTED, "; ")
        yield ENGLISH("program_shared", positions=positions, share=share, places=places)
    if program.names and program.rounded_um.max() > _SHOWN_UM:
        yield ENGLISH("program_rounded", um=f"{program.rounded_um.max():.1f}")
    if outside := sum(map(bool, program.unknown)):
        reasons = zip(program.places, program.unknown, strict=True)
        where = [*dict.fromkeys(f"{_place(program, *place)}: {why}" for place, why in reasons if why)]
        yield ENGLISH("program_outside", targets=counted(outside, "target"), places=first_of(where, _LISTED, "; "))


def _origins(program: CorrectedProgram) -> Iterator[str]:
    """For each origin: the number of points, the changes since they were taught, and the effect of the new numbers."""
    for group in program.groups:
        origin, points = group.origin, counted(len(group.names), "point")
        yield ENGLISH(
            f"points_{_key(origin)}", points=points, since=origin.since, moved=f"{group.moved_mm.max(initial=0.0):.3f}",
            tool=f"{_within_mm(group):.3f}", u=_u_words(group),
        )  # fmt: skip
        if isinstance(origin, ConvertedPoints):
            yield ENGLISH("points_changes", changes=first_of(origin.change.lines, _LISTED, "; "))
            yield ENGLISH("points_frames")


def _key(origin: PointOrigin) -> str:
    if origin.is_unchanged:
        return f"unchanged_{origin.kind}"
    if isinstance(origin, ChangedArm):
        return "another" if origin.is_another_arm else "changed"
    return "converted" if origin.is_exact else "computed"


def _within_mm(group: PointGroup) -> float:
    """Largest distance of the tool from its taught places, rounded up to a micrometre."""
    return float(np.ceil(1e3 * np.hypot(group.tool_mm, group.u_mm)).max(initial=1.0)) / 1e3


def _u_words(group: PointGroup) -> str:
    if np.isnan(group.u_mm).all():
        return ENGLISH("points_u_unknown")
    return ENGLISH("points_u", u=f"{np.nanmax(group.u_mm):.3f}")


def _left(program: CorrectedProgram) -> Iterator[Block]:
    """For each reason, the uncorrected targets and the lines of the program that cause it."""
    for reason, number in Counter(one.reason for one in program.left).most_common():
        yield Sentence(ENGLISH("program_left", count=number, why=f"{WHY[reason]}{_MORE.get(reason, '')}"))
        targets = []
        for left in (one for one in program.left[:_LISTED] if one.reason == reason):
            causes = [f"{_place(program, at.file, at.line)}: {at.why}" if at.line else at.why for at in left.because]
            place = _place(program, left.file, left.line)
            targets.append(f"{place}: {left.name} ({'; '.join(causes)})" if causes else f"{left.name} ({place})")
        yield from paragraphs(["; ".join(targets)], "note")
        if reason == "not_understood" and program.missing:
            yield Sentence(ENGLISH("program_missing", names=shlex.quote(",".join(program.missing))))
    if (others := len(program.left) - _LISTED) > 0:
        yield Sentence(ENGLISH("program_left_more", count=others), "note")


def _shared(program: CorrectedProgram, position: SharedCorrection) -> str:
    error = f"{position.before_mm:.3f} → {position.after_mm:.3f} mm"
    if position.unknown:
        error = ENGLISH("program_shared_unknown", why=WHY[position.unknown])
    place, use = _place(program, position.file, position.line), ENGLISH(f"program_shared_{position.kind}")
    return f"{place}: {position.name} {use}: {error}"


def _place(program: CorrectedProgram, file: int, line: int) -> str:
    is_single = len(program.files) == 1 and program.sources[file] == program.path.name
    return f"line {line}" if is_single else f"{program.sources[file]} line {line}"


def reached(u_frame_mm: Array, u_mm: Array) -> str:
    """Accuracy of targets in words, given their uncertainties (n,), NaN if the runs do not cover a target."""
    if np.isnan(u_mm).all():
        return ENGLISH("correct_accuracy_unknown")
    key = "correct_accuracy_covered" if np.isnan(u_mm).any() else "correct_accuracy"
    return ENGLISH(key, frame=f"{np.nanmax(u_frame_mm):.3f}", base=f"{np.nanmax(u_mm):.3f}")


def as_object(program: CorrectedProgram) -> dict[str, Any]:
    """Object for JSON (see `for_json`)."""
    beside, given_away = program.beside_left_mm, program.given_away_mm[np.isfinite(program.given_away_mm)]

    def at(place: Any, *names: str) -> dict[str, Any]:
        return {"file": program.sources[place.file]} | pick_fields(place, "line", *names)

    return {
        "program": program.path.name,
        "controller": program.maker,
        "files": list(program.files),
        "corrected": len(program.names),
        "written": not program.held,
        "run_by_a_real_controller": False,
        "neutral_routines": program.neutral,
        "missing_routines": program.missing,
        "start_joints_deg": np.degrees(program.start).round(6) if program.start else None,
        "near_deg": np.degrees(program.near).round(6) if program.near else None,
        "posture_by_near": [{"file": program.sources[file], "line": line} for file, line in program.by_user[:_KEPT]],
        "beside_left": {"steps": len(beside), "mean_mm": beside.mean() if len(beside) else None},
        "overruled": [at(one, "name", "kind") for one in program.overruled[:_KEPT]],
        "moved_mm": {
            "largest": program.moved_mm.max(initial=0.0),
            "rms": rms(program.moved_mm) if len(program.moved_mm) else 0.0,
        },
        "rounded_um": program.rounded_um.max(initial=0.0),
        "used_with_offset": {
            "targets": len(given_away),
            "largest_given_away_mm": given_away.max() if len(given_away) else None,
            "bound_share": REMAINING_SHARE,
        },
        "shared_corrections": [
            at(one, "name", "kind", "unknown")
            | {"before_mm": round(one.before_mm, 6), "after_mm": round(one.after_mm, 6)}
            for one in program.shared[:_KEPT]
        ],
        "notices": [at(notice, "text") for notice in program.notices[:_KEPT]],
        "named": sorted(f"--{kind} {name}" for kind, name in program.named),
        "outside_driven_ranges": sum(map(bool, program.unknown)),
        "error": program.error and error_object(program.error),
        "points": [_group_object(group) for group in program.groups],
        "targets": [
            {"name": name, "file": program.sources[file], "line": line}
            | {key: round(float(getattr(program, key)[k]), digits) for key, digits in _DIGITS.items()}
            | {"outside_driven_ranges": bool(unknown), "unknown": unknown or None}
            for k, (name, (file, line), unknown) in enumerate(
                zip(program.names, program.places, program.unknown, strict=True)
            )
        ],
        "left": [
            at(left, "name", "reason")
            | {
                "why": WHY[left.reason],
                "because": [
                    at(place, "why") if place.line else {"file": None, **pick_fields(place, "line", "why")}
                    for place in left.because
                ],
            }
            for left in program.left[:_KEPT]
        ],
        "left_count": len(program.left),
    }  # fmt: skip


def _group_object(group: PointGroup) -> dict[str, Any]:
    origin = group.origin
    return {
        "origin": origin.kind,
        "since": origin.since or None,
        "treatment": {"unchanged_taught": "unchanged", "unchanged_computed": "unchanged"}.get(
            key := _key(origin), "difference" if key in ("changed", "another") else key
        ),
        "count": len(group.names),
        "numbers_moved_mm": {
            "largest": round(group.moved_mm.max(initial=0.0), 6),
            "rms": round(rms(group.moved_mm), 6) if len(group.moved_mm) else 0.0,
        },
        "tool_moved_mm": round(group.tool_mm.max(initial=0.0), 6),
        "u_mm": None if np.isnan(group.u_mm).all() else round(float(np.nanmax(group.u_mm)), 6),
        "error": group.error and error_object(group.error),
    }


_DIGITS = {"moved_mm": 6, "u_mm": 6, "u_frame_mm": 6, "rounded_um": 3, "given_away_mm": 6}
"""Decimals of the figures of a target: a nanometre."""


def error_object(error: WorkError) -> dict[str, Any]:
    """Object for JSON, in µm."""
    in_base = {name: round(um, 3) for name, um in vars(error.base).items()}
    sizes = {name: round(um, 3) for name, um in pick_fields(error, *in_base, "base_u_um").items()}
    return {**sizes, "unknown_share": round(error.unknown, 3), "in_base": in_base}
