"""Causes of a movement with odds, size, direction and effect on the work."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.diagnosis.evidence.observation import ObservedRun, socket_of
from analysis.diagnosis.evidence.setups import FRAME
from analysis.movement.causes import NOTHING, OTHER, Cause, What
from analysis.movement.evidence import Estimate
from analysis.movement.inference import Reference, ReferenceComparison
from analysis.movement.linearise import angles_of, tool_places, with_cause
from analysis.robot.geometry.pose_setup import frame
from analysis.robot.kinematics.arm import Array, forward
from rigs.schema.part import Vector

_SHOWN = 1e-4
"""Posterior probability from which a cause is listed."""
MOST_ODDS = 1000.0
"""Largest odds stated. Chosen: larger ones depend on the assumed distribution of the scatter."""


def odds_of(probability: float) -> float:
    """Return the odds of a probability, at most `MOST_ODDS`."""
    return min(probability / max(1 - probability, 1e-12), MOST_ODDS)


@dataclass(frozen=True)
class CauseOdds:
    """A cause with posterior probability and size.

    u: standard uncertainty of the length of the shift in mm, or of the zero in degrees. u_rotation_deg: of the
    rotation. point_mm: displacement of a point in the middle of the work area. together: the members of a pair or
    triple.
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


def short_name(cause: Cause) -> str:
    """Return the name of a socket, target or instrument after removal of the test name."""
    name = socket_of(cause.name) or cause.name
    return name.partition(FRAME)[0]


def causes_by_odds(reference: Reference, compared: ReferenceComparison) -> list[CauseOdds]:
    """Return the causes with a material posterior probability, likeliest first."""
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
    point = vector_of(_at_point(reference, cause, estimate.mean))
    if cause.what == "zero":
        size, u = np.degrees(estimate.mean[0]), np.degrees(np.sqrt(estimate.cov[0, 0]))
        return CauseOdds(cause, probability, size_deg=float(size), u=float(u), point_mm=point)
    shift, turn = estimate.mean[:3], estimate.mean[3:]
    return CauseOdds(
        cause, probability, vector_of(shift), vector_of(np.degrees(turn)) if len(turn) else None, None,
        _length_uncertainty(shift, estimate.cov[:3, :3]),
        float(np.degrees(_length_uncertainty(turn, estimate.cov[3:, 3:]))) if len(turn) else None, point,
    )  # fmt: skip


def _length_uncertainty(vector: Array, cov: Array) -> float:
    """Return the standard uncertainty of the length of a vector (3,)."""
    direction = vector / max(float(np.linalg.norm(vector)), 1e-12)
    return float(np.sqrt(direction @ cov @ direction))


def vector_of(values: Array) -> Vector:
    """Return a vector (3,) in mm or degrees as a tuple."""
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
