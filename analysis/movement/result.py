"""Result of a movement check: causes with odds, size, direction and effect on the work, and the next posture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.diagnosis.evidence.observation import ObservedRun, socket_of
from analysis.diagnosis.evidence.setups import FRAME
from analysis.movement.causes import NOTHING, OTHER, Cause, What
from analysis.movement.evidence import Estimate
from analysis.movement.inference import MOST_MM, NAMED, Reference, ReferenceComparison, compare
from analysis.movement.linearise import angles_of, tool_places, with_cause
from analysis.movement.next_touch import Candidates, Lever, ReferencePosture, candidates_of, hidden_causes, next_posture
from analysis.procedures.facts import facts_of
from analysis.robot.geometry.pose_setup import frame
from analysis.robot.kinematics.arm import Array, forward
from rigs.errors import FileError
from rigs.schema.part import Vector

_SHOWN = 1e-4
"""Posterior probability from which a cause is listed."""


@dataclass(frozen=True)
class CauseOdds:
    """A cause with posterior probability and size.

    u: standard uncertainty of the length of the shift in mm, or of the zero in degrees. u_rotation_deg: of the
    rotation. point_mm: displacement of a point in the middle of the work area. together: the members of a pair.
    """

    cause: Cause
    posterior: float
    translation_mm: Vector | None = None
    rotation_deg: Vector | None = None
    size_deg: float | None = None
    u: float | None = None
    u_rotation_deg: float | None = None
    point_mm: Vector | None = None
    together: tuple[CauseOdds, ...] = ()

    @property
    def what(self) -> What:
        """The kind of cause."""
        return self.cause.what

    @property
    def name(self) -> str:
        """Return the name of the socket, target or instrument as entered by the user."""
        return short_name(self.cause)

    def to_dict(self) -> dict[str, Any]:
        """Return the cause in plain types for JSON."""
        found: dict[str, Any] = {"what": self.what, "axis": self.cause.axis, "name": self.name or None}
        for key in ("posterior", "translation_mm", "rotation_deg", "size_deg", "u", "u_rotation_deg", "point_mm"):
            value = getattr(self, key)
            found[key] = list(value) if isinstance(value, tuple) else value
        if self.together:
            found["together"] = [member.to_dict() for member in self.together]
        return found


@dataclass(frozen=True)
class MovementResult:
    """Movement between a reference and new readings.

    cannot_separate: causes between which the readings do not decide. next_posture: posture to touch next, None if a
    cause is named or no posture helps. hidden: causes not visible in any posture of the reference.
    """

    causes: tuple[CauseOdds, ...]
    named: CauseOdds | None
    cannot_separate: tuple[CauseOdds, ...]
    next_posture: ReferencePosture | None
    hidden: tuple[Lever, ...]
    readings: int
    reference_readings: int
    scatter_mm: float
    centre_mm: Vector
    wild_row: int | None
    of_tracker: bool
    zero_bounds_deg: tuple[float, ...] = ()
    """Largest error of each zero compatible with the new readings if only that zero moved: |size| + 2 u."""
    doubts: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the result in plain types for JSON."""
        step = self.next_posture
        return {
            "named": self.named and self.named.to_dict(),
            "causes": [cause.to_dict() for cause in self.causes],
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
        }  # fmt: skip


def short_name(cause: Cause) -> str:
    """Return the name of a socket, target or instrument after removal of the test name."""
    name = socket_of(cause.name) or cause.name
    return name.partition(FRAME)[0]


def what_moved(reference: Reference, new: list[ObservedRun], *, plan: bool = False) -> MovementResult:
    """Infer the movement between a reference and new runs of an arm, with touches split by socket.

    The result contains the next posture if `plan` is set or no cause is named. Raises FileError if the new readings
    share no set-up with the reference.
    """
    known = {run.setup for run in reference.runs}
    shared = [run for run in new if run.setup in known]
    if new and not shared:
        remedy = "touch the same sockets, or give the same --placement at import (rig relabel)"
        raise FileError(f"set-up {new[0].setup}", "does not occur in any reference run", remedy)
    doubts = [
        f"{name} does not occur in any reference run and is ignored"
        for name in sorted({run.setup for run in new} - known)
    ]
    if reference.wild:
        doubts.append(f"{reference.wild} readings of the reference are outliers and are ignored")
    compared = compare(reference, shared) if shared else None
    if compared is not None and compared.distance_mm > MOST_MM:
        far = f"the readings are {compared.distance_mm:.0f} mm from the positions of the reference"
        remedy = "check that sockets, targets and placement are those of the reference"
        raise FileError(f"set-up {shared[0].setup}", far, remedy)
    return moved_of(reference, compared, plan=plan, doubts=tuple(doubts))


def moved_of(
    reference: Reference, compared: ReferenceComparison | None, *, plan: bool = False, doubts: tuple[str, ...] = ()
) -> MovementResult:
    """Return the result of a comparison, or of a plan before the first reading."""
    causes = [] if compared is None else _causes(reference, compared)
    named = causes[0] if compared is not None and compared.identified_cause is not None else None
    rivals = () if named else tuple(cause for cause in causes if cause.posterior > 1 - NAMED)
    candidates = candidates_of(reference)
    hidden = tuple(hidden_causes(reference, candidates))
    step = None
    if (plan or compared is not None) and named is None:
        step = _next(reference, candidates, compared, rivals, hidden)
    wild = None if compared is None or compared.posterior.wild is None else compared.posterior.wild + 1
    return MovementResult(
        tuple(causes), named, rivals, step, hidden,
        compared.count if compared else 0, sum(len(run.rows) for run in reference.runs),
        reference.scatter_mm, _vector(reference.place.centre_mm), wild,
        any(facts_of(run.table.test).of_tracker for run in reference.runs), _zero_bounds(compared), doubts,
    )  # fmt: skip


def _zero_bounds(compared: ReferenceComparison | None) -> tuple[float, ...]:
    """Return the largest error in degrees of each zero that is compatible with the readings."""
    estimates = compared.posterior.estimates.items() if compared else ()
    return tuple(
        float(np.degrees(abs(estimate.mean[0]) + 2 * np.sqrt(estimate.cov[0, 0])))
        for cause, estimate in estimates
        if cause.what == "zero"
    )


def _next(
    reference: Reference,
    candidates: Candidates,
    compared: ReferenceComparison | None,
    rivals: tuple[CauseOdds, ...],
    hidden: tuple[Lever, ...],
) -> ReferencePosture | None:
    """Return the next posture; None if only causes remain that no posture shows."""
    invisible = {lever.cause for lever in hidden}
    is_hopeless = bool(rivals) and all(rival.cause in invisible or rival.cause == NOTHING for rival in rivals)
    if is_hopeless and compared is not None and compared.can_clear:
        return None
    return next_posture(reference, candidates, compared)


def _causes(reference: Reference, compared: ReferenceComparison) -> list[CauseOdds]:
    found: list[CauseOdds] = []
    for cause, probability in compared.posterior.probability.items():
        if probability < _SHOWN and len(found) >= 1:
            continue
        found.append(_sized(reference, cause, probability, compared.posterior.estimates[cause]))
    return found


def _sized(reference: Reference, cause: Cause, probability: float, estimate: Estimate) -> CauseOdds:
    if cause in (NOTHING, OTHER):
        return CauseOdds(cause, probability)
    if cause.members:
        together: list[CauseOdds] = []
        first = 0
        for member in cause.members:
            own = slice(first, first + len(member.scale))
            first = own.stop
            part = Estimate(0.0, estimate.mean[own], estimate.cov[own, own], estimate.level)
            together.append(_sized(reference, member, probability, part))
        return CauseOdds(cause, probability, together=tuple(together))
    point = _vector(_at_point(reference, cause, estimate.mean))
    if cause.what == "zero":
        size, u = np.degrees(estimate.mean[0]), np.degrees(np.sqrt(estimate.cov[0, 0]))
        return CauseOdds(cause, probability, size_deg=float(size), u=float(u), point_mm=point)
    shift, turn = estimate.mean[:3], estimate.mean[3:]
    return CauseOdds(
        cause, probability, _vector(shift), _vector(np.degrees(turn)) if len(turn) else None, None,
        _length_uncertainty(shift, estimate.cov[:3, :3]),
        float(np.degrees(_length_uncertainty(turn, estimate.cov[3:, 3:]))) if len(turn) else None, point,
    )  # fmt: skip


def _length_uncertainty(vector: Array, cov: Array) -> float:
    """Return the standard uncertainty of the length of a vector (3,)."""
    direction = vector / max(float(np.linalg.norm(vector)), 1e-12)
    return float(np.sqrt(direction @ cov @ direction))


def _vector(values: Array) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _at_point(reference: Reference, cause: Cause, change: Array) -> Array:
    """Return the displacement (3,) mm of the ball or target in the posture nearest to the middle of the work area."""
    place = reference.place
    best: tuple[float, ObservedRun, int] | None = None
    for run in reference.runs:
        far = np.linalg.norm(tool_places(run, place.setups[run.setup]) - place.centre_mm, axis=1)
        row = int(far.argmin())
        if best is None or far[row] < best[0]:
            best = float(far[row]), run, row
    assert best is not None  # noqa: S101 - a reference has runs
    _, run, row = best
    q, target = angles_of(run)[row : row + 1], place.setups[run.setup].T_tool_target[:3, 3]
    arms = run.model.arm, with_cause(run.model.arm, cause, place.centre_mm, change)
    before, after = (forward(arm, q)[0] @ frame(np.eye(3), target) for arm in arms)
    return np.asarray((after - before)[:3, 3])
