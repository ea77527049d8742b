"""Movement between a reference and new readings, and the next posture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from analysis.apps.commission.next_touch import (
    Lever,
    ReferencePosture,
    candidates_of,
    hidden_causes,
    next_posture,
)
from analysis.diagnosis.evidence.observation import ObservedRun
from analysis.diagnosis.judge.result import Alike, Movement
from analysis.movement.between import observed, without_moved
from analysis.movement.cause_odds import CauseOdds, causes_by_odds, short_name, vector_of
from analysis.movement.causes import NOTHING, Cause, look_alike
from analysis.movement.inference import (
    FEWEST_OF_REFERENCE,
    MOST_MM,
    NAMED,
    Reference,
    ReferenceComparison,
    compare,
    study,
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
