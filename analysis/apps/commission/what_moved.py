"""Movement between a reference and new readings, and the next posture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from analysis.apps.commission.next_touch import (
    Lever,
    ReferencePosture,
    candidates_of,
    hidden_causes,
    next_posture,
)
from analysis.apps.report.blocks import Block, Sentence, Table, paragraphs
from analysis.apps.report.diagnosis_words import act_after, act_of, movement_sentence, name_of, size_of, sure
from analysis.apps.report.html_page import answer_page, write_html
from analysis.apps.report.texts import Language, Texts, capital, joined, texts_of
from analysis.diagnosis.evidence.observation import ObservedRun
from analysis.diagnosis.judge.result import Alike, Movement
from analysis.movement.between import observed, without_moved
from analysis.movement.causes import NOTHING, Cause, look_alike
from analysis.movement.inference import (
    FEWEST_OF_REFERENCE,
    FEWEST_TO_CLEAR,
    MOST_MM,
    MOST_ODDS,
    NAMED,
    CauseOdds,
    Reference,
    ReferenceComparison,
    causes_by_odds,
    compare,
    odds_of,
    short_name,
    study,
    vector_of,
)
from analysis.procedures.shared.test_kind import facts_of
from analysis.runs.copies import NEW, REFERENCE, refuse_repeated
from analysis.runs.loading import Measured
from rigs.errors import FileError
from rigs.rig import Rig
from rigs.schema.part import Vector
from rigs.text import counted


@dataclass(frozen=True)
class MovementResult:
    causes: tuple[CauseOdds, ...]
    named: CauseOdds | None
    cannot_separate: tuple[CauseOdds, ...]
    """Causes between which the readings do not decide."""
    next_posture: ReferencePosture | None
    """None if a cause is named or no posture helps."""
    hidden: tuple[Lever, ...]
    """Causes not visible in any posture of the reference."""
    readings: int
    reference_readings: int
    scatter_mm: float
    centre_mm: Vector
    wild_row: int | None
    of_tracker: bool
    zero_bounds_deg: tuple[float, ...] = ()
    """Largest error of each zero compatible with the new readings if only that zero moved: |size| + 2 u."""
    doubts: tuple[str, ...] = ()
    reference_names: tuple[str, ...] = ()
    """Runs of the reference state; those before `reference_movements` are left out."""
    reference_movements: tuple[Movement, ...] = ()

    def alike(self, cause: Cause) -> Alike | None:
        """Part with the same readings as a cause."""
        return look_alike(cause, len(self.zero_bounds_deg), of_tracker=self.of_tracker)

    def to_dict(self) -> dict[str, Any]:
        step = self.next_posture
        return {
            "named": self.named and self.named.to_dict() | {"alike": self.alike(self.named.cause)},
            "causes": [cause.to_dict() | {"alike": self.alike(cause.cause)} for cause in self.causes],
            "cannot_separate": [
                {"what": cause.what, "axis": cause.cause.axis, "name": cause.name or None}
                for cause in self.cannot_separate
            ],
            "next": step and {
                "setup": step.setup, "socket": step.socket or None, "row": step.row,
                "joints_deg": np.round(np.degrees(step.angles), 4).tolist()
            },
            "hidden": [
                {"what": lever.cause.what, "axis": lever.cause.axis, "name": short_name(lever.cause) or None,
                 "moves_mm": lever.moves_mm, "scatter_mm": lever.scatter_mm}
                for lever in self.hidden
            ],
            "readings": self.readings, "reference_readings": self.reference_readings, "scatter_mm": self.scatter_mm,
            "point": {"at_mm": list(self.centre_mm)}, "wild_reading": self.wild_row,
            "zero_bounds_deg": list(self.zero_bounds_deg), "doubts": list(self.doubts),
            "reference": list(self.reference_names),
            "reference_movements": [movement.to_dict() for movement in self.reference_movements],
        }  # fmt: skip


def what_moved(reference: Reference, new: list[ObservedRun], *, plan: bool = False) -> MovementResult:
    known = {run.setup for run in reference.runs}
    shared = [run for run in new if run.setup in known]
    if new and not shared:
        remedy = "touch the same sockets, or give the same --placement at import (rig relabel)"
        what = "does not occur in any reference run"
        raise FileError(f"set-up {new[0].setup}", what, remedy, code="readings.unsuitable")
    doubts = [
        f"{name} does not occur in any reference run and is ignored"
        for name in sorted({run.setup for run in new} - known)
    ]
    if reference.wild:
        one, several = "reading of the reference is an outlier and is", "readings of the reference are outliers and are"
        doubts.append(f"{counted(reference.wild, one, several)} ignored")
    compared = compare(reference, shared) if shared else None
    if compared is not None and compared.distance_mm > MOST_MM:
        far = f"the readings are {compared.distance_mm:.0f} mm from the positions of the reference"
        remedy = "check that sockets, targets and placement are those of the reference"
        raise FileError(f"set-up {shared[0].setup}", far, remedy, code="readings.unsuitable")
    return moved_of(reference, compared, plan=plan, doubts=tuple(doubts))


def moved_of(
    reference: Reference, compared: ReferenceComparison | None, *, plan: bool = False, doubts: tuple[str, ...] = ()
) -> MovementResult:
    causes = [] if compared is None else causes_by_odds(reference, compared)
    named = causes[0] if compared is not None and compared.identified_cause is not None else None
    rivals = () if named else tuple(cause for cause in causes if cause.posterior > 1 - NAMED)
    candidates = candidates_of(reference)
    hidden = tuple(hidden_causes(reference, candidates))
    invisible = {NOTHING, *(lever.cause for lever in hidden)}
    is_hopeless = bool(rivals) and all(rival.cause in invisible for rival in rivals)
    step = None
    if named is None and ((compared is None and plan) or (compared and not (is_hopeless and compared.can_clear))):
        step = next_posture(reference, candidates, compared)
    wild = None if compared is None or compared.posterior.wild is None else compared.posterior.wild + 1
    zero_bounds_deg = tuple(
        float(np.degrees(abs(estimate.mean[0]) + 2 * np.sqrt(estimate.cov[0, 0])))
        for cause, estimate in (compared.posterior.estimates.items() if compared else ())
        if cause.what == "zero"
    )
    return MovementResult(
        tuple(causes), named, rivals, step, hidden,
        compared.count if compared else 0, sum(len(run.rows) for run in reference.runs),
        reference.scatter_mm, vector_of(reference.place.centre_mm), wild,
        any(facts_of(run.table.test).of_tracker for run in reference.runs), zero_bounds_deg,
        (*reference.doubts, *doubts), reference.names, reference.movements,
    )  # fmt: skip


def study_runs(rig: Rig, runs: Sequence[Measured]) -> Reference:
    """Reference of runs before a possible movement: their latest state, if they show several."""
    kept, movements, doubts = without_moved(rig, runs, latest=True)
    before = observed(rig, kept)
    names = tuple(run.run.manifest.name for run in kept)
    where = ", ".join(names)
    if not before:
        remedy = "give runs of touches, poses or circles"
        raise FileError(where, "has no joint angles", remedy, code="readings.unsuitable")
    count = sum(len(run.rows) for run in before)
    if count < FEWEST_OF_REFERENCE:
        since = f" since {movements[-1].to}, where a part moved," if movements else ""
        problem = f"has only {count} readings{since} but a reference needs at least {FEWEST_OF_REFERENCE}"
        remedy = "touch more postures while the cell is in order, or give more runs"
        raise FileError(where, problem, remedy, code="readings.too_few")
    return replace(study(before), names=names, movements=tuple(movements), doubts=tuple(doubts))


def what_moved_in(
    rig: Rig, reference: Sequence[Measured], new: Sequence[Measured], *, plan: bool = False
) -> MovementResult:
    refuse_repeated({REFERENCE: reference, NEW: new})
    return what_moved(study_runs(rig, reference), observed(rig, new), plan=plan)


# ----------------------------------------------------------------------------------------------------------------------
# The answer: sentences and blocks for screen and page.

_ENGLISH = texts_of("en")
_WIDE_DEG = 0.03
"""Smallest possible error of a joint zero that is reported: 0.5 mm at 1 m."""
_MOST_CAUSES = 8
"""Number of causes listed; the JSON contains all."""


def movement_answer(moved: MovementResult, texts: Texts) -> list[Block]:
    is_unmoved = moved.named is not None and moved.named.what == "nothing"
    rows = []
    for cause in moved.causes[:_MOST_CAUSES]:
        name = name_of(cause.cause, texts, of_tracker=moved.of_tracker)
        size = size_of(cause, texts, of_tracker=moved.of_tracker) or "–"
        rows.append((name, sure(cause.posterior), size, "–" if cause.point_mm is None else _at(cause.point_mm)))
    columns = tuple(texts(f"check_column_{name}") for name in ("cause", "probability", "size", "point"))
    at, scatter = ", ".join(f"{value:z.0f}" for value in moved.centre_mm), f"{moved.scatter_mm:.3f}"
    footer = texts("check_footer", new=moved.readings, old=moved.reference_readings, scatter=scatter, at=at)
    return [
        Sentence(headline(moved, texts), "pass" if is_unmoved else "watch"),
        Sentence(what_to_do(moved, texts)),
        *([Table(columns, tuple(rows), frozenset({1}), key="causes")] if rows else []),
        *paragraphs(remarks(moved, texts), "doubt"),
        Sentence(f"{texts('check_note')} {footer}", "note"),
    ]


def _at(point: Vector) -> str:
    return ", ".join(f"{value:+z.2f}" for value in point) + " mm"


def write_page(moved: MovementResult, path: Path, name: str, language: Language = "en") -> None:
    texts = texts_of(language)
    write_html(answer_page(texts("check_title", name=name), movement_answer(moved, texts), language, boxed=2), path)


def headline(moved: MovementResult, texts: Texts = _ENGLISH) -> str:
    """The movement with size, direction and odds."""
    answer = _movement(moved, texts)
    if not moved.reference_movements:
        return answer
    return texts("check_references_differ", runs=", ".join(moved.reference_names), answer=answer)


def _movement(moved: MovementResult, texts: Texts) -> str:
    if not moved.readings:
        return texts("check_no_readings", count=moved.reference_readings)
    named, of_tracker = moved.named, moved.of_tracker
    readings = texts("check_reading" if moved.readings == 1 else "check_readings", count=moved.readings)
    if named is None and [cause.cause for cause in moved.cannot_separate] == [NOTHING]:
        return texts("check_unmoved_so_far", readings=readings, fewest=FEWEST_TO_CLEAR)
    if named is None:
        rivals = [
            f"{name_of(cause.cause, texts, of_tracker=of_tracker)} ({100 * cause.posterior:.0f} %)"
            for cause in moved.cannot_separate
        ]
        listed = texts("or").join([", ".join(rivals[:-1]), rivals[-1]]) if len(rivals) > 1 else "".join(rivals)
        return texts("check_open", readings=readings, rivals=listed)
    ratio = odds_of(named.posterior)
    certain = texts("check_odds_bound" if ratio >= MOST_ODDS else "check_odds", ratio=f"{ratio:.0f}")
    if named.what == "nothing":
        return texts("check_unmoved", readings=readings, scatter=f"{moved.scatter_mm:.2f}", odds=certain)
    if named.what == "other":
        return texts("check_other", odds=certain)
    thing = capital(name_of(named.cause, texts, of_tracker=of_tracker))
    size = size_of(named, texts, of_tracker=of_tracker)
    key = "check_pair" if named.together else "check_by_size"
    return texts(key, thing=thing, size=size, odds=certain)


def what_to_do(moved: MovementResult, texts: Texts = _ENGLISH) -> str:
    named = moved.named
    if named is not None:
        causes = [member.cause for member in named.together] or [named.cause]
        acts = [act_of(cause, short_name(cause), texts, moved.alike(cause)) for cause in causes]
        if earlier := moved.reference_movements:
            acts.append(texts("check_act_earlier", run=earlier[-1].to, act=act_after(earlier, texts)))
        return joined(dict.fromkeys(acts))
    if moved.next_posture is not None:
        posture = moved.next_posture
        angles = ", ".join(f"J{k} {np.degrees(angle):z.1f}" for k, angle in enumerate(posture.angles, start=1))
        key = "check_next_touch" if posture.socket else "check_next_pose"
        return texts(key, name=posture.socket, row=posture.row + 1, angles=angles)
    if moved.hidden:
        return joined([texts("check_inseparable"), *(hidden_words(lever, texts) for lever in moved.hidden)])
    return texts("check_act_more")


def hidden_words(lever: Lever, texts: Texts = _ENGLISH) -> str:
    is_zero = lever.cause.what == "zero"
    typical = f"{np.degrees(lever.cause.scale[0]):.2f}°" if is_zero else texts("check_typical_size")
    return texts(
        "check_hidden", thing=capital(name_of(lever.cause, texts)), typical=typical, moves=f"{lever.moves_mm:.2f}",
        scatter=f"{lever.scatter_mm:.2f}",
        remedy=texts("check_mount_ball" if is_zero else "check_add_postures", axis=lever.cause.axis),
    )  # fmt: skip


def remarks(moved: MovementResult, texts: Texts = _ENGLISH) -> list[str]:
    lines = [movement_sentence(movement, texts) for movement in moved.reference_movements] + list(moved.doubts)
    named = moved.named
    if named is not None and named.what != "nothing":
        lines.append(texts("check_not_in_error"))
    if moved.wild_row is not None:
        lines.append(texts("check_wild", row=moved.wild_row))
    alike = named and moved.alike(named.cause)
    if named is not None and alike in ("base", "tool"):
        lines.append(texts(f"check_{alike}_alike", axis=named.cause.axis))
    if named is not None and named.what == "nothing":
        bounds = enumerate(moved.zero_bounds_deg, start=1)
        wide = [texts("check_up_to", axis=k, size=f"{deg:.2f}") for k, deg in bounds if deg > _WIDE_DEG]
        lines += [texts("check_not_excluded", zeros=", ".join(wide))] if wide else []
        lines += [hidden_words(lever, texts) for lever in moved.hidden]
    return lines
