"""Causes of a movement with odds, size, direction and effect on the work."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.diagnosis.evidence.observation import ObservedRun, socket_of
from analysis.diagnosis.evidence.setups import FRAME
from analysis.movement.cause_posterior import Estimate
from analysis.movement.causes import NOTHING, OTHER, Cause, What
from analysis.movement.inference import Reference, ReferenceComparison
from analysis.movement.linearise import (
    angles_of,
    tool_places,
    with_cause,
)
from analysis.robot.geometry.pose_setup import frame
from analysis.robot.kinematics.arm import Array, forward
from rigs.schema.part import Vector

_SHOWN = 1e-4
"""Posterior probability from which a cause is listed."""
MOST_ODDS = 1000.0
"""Largest odds stated. Chosen: larger ones depend on the assumed distribution of the scatter."""


def odds_of(probability: float) -> float:
    return min(probability / max(1 - probability, 1e-12), MOST_ODDS)


@dataclass(frozen=True)
class CauseOdds:
    """A cause with posterior probability and size."""

    cause: Cause
    posterior: float
    translation_mm: Vector | None = None
    rotation_deg: Vector | None = None
    size_deg: float | None = None
    u: float | None = None
    """Standard uncertainty of the length of the shift in mm, or of the zero in degrees."""
    u_rotation_deg: float | None = None
    point_mm: Vector | None = None
    """Displacement of a point in the middle of the work area."""
    together: tuple[CauseOdds, ...] = ()
    """The members of a pair or triple."""

    @property
    def what(self) -> What:
        return self.cause.what

    @property
    def name(self) -> str:
        """Name of the socket, target or instrument as entered by the user."""
        return short_name(self.cause)

    def to_dict(self) -> dict[str, Any]:
        found: dict[str, Any] = {"what": self.what, "axis": self.cause.axis, "name": self.name or None}
        for key in ("posterior", "translation_mm", "rotation_deg", "size_deg", "u", "u_rotation_deg", "point_mm"):
            value = getattr(self, key)
            found[key] = list(value) if isinstance(value, tuple) else value
        if self.together:
            found["together"] = [member.to_dict() for member in self.together]
        return found


def short_name(cause: Cause) -> str:
    name = socket_of(cause.name) or cause.name
    return name.partition(FRAME)[0]


def causes_by_odds(reference: Reference, compared: ReferenceComparison) -> list[CauseOdds]:
    """The causes with a material posterior probability, likeliest first."""
    return [
        _sized(reference, cause, probability, compared.posterior.estimates[cause])
        for k, (cause, probability) in enumerate(compared.posterior.probability.items())
        if k == 0 or probability >= _SHOWN
    ]


def _sized(reference: Reference, cause: Cause, probability: float, estimate: Estimate) -> CauseOdds:
    if cause in (NOTHING, OTHER):
        return CauseOdds(cause, probability)
    if cause.members:
        together, first = list[CauseOdds](), 0
        for member in cause.members:
            own = slice(first, first := first + len(member.scale))
            part = Estimate(0.0, estimate.mean[own], estimate.cov[own, own], estimate.level)
            together.append(_sized(reference, member, probability, part))
        return CauseOdds(cause, probability, together=tuple(together))
    point = vector_of(_at_point(reference, cause, estimate.mean))
    if cause.what == "zero":
        size, u = np.degrees(estimate.mean[0]), np.degrees(np.sqrt(estimate.cov[0, 0]))
        return CauseOdds(cause, probability, size_deg=float(size), u=float(u), point_mm=point)
    shift, turn = estimate.mean[:3], estimate.mean[3:]
    u, rotation_deg, u_rotation_deg = _length_uncertainty(shift, estimate.cov[:3, :3]), None, None
    if len(turn):
        rotation_deg = vector_of(np.degrees(turn))
        u_rotation_deg = float(np.degrees(_length_uncertainty(turn, estimate.cov[3:, 3:])))
    return CauseOdds(cause, probability, vector_of(shift), rotation_deg, None, u, u_rotation_deg, point)


def _length_uncertainty(vector: Array, cov: Array) -> float:
    direction = vector / max(float(np.linalg.norm(vector)), 1e-12)
    return float(np.sqrt(direction @ cov @ direction))


def vector_of(values: Array) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _at_point(reference: Reference, cause: Cause, change: Array) -> Array:
    """Displacement (3,) mm of the ball or target in the posture nearest to the middle of the work area."""
    place, nearest = reference.place, list[tuple[float, int, ObservedRun]]()
    for run in reference.runs:
        far = np.linalg.norm(tool_places(run, place.setups[run.setup]) - place.centre_mm, axis=1)
        nearest.append((float(far.min()), int(far.argmin()), run))
    _, row, run = min(nearest, key=lambda each: each[0])
    q, target = angles_of(run)[row : row + 1], place.setups[run.setup].T_tool_target[:3, 3]
    arms = run.model.arm, with_cause(run.model.arm, cause, place.centre_mm, change)
    before, after = (forward(arm, q)[0] @ frame(np.eye(3), target) for arm in arms)
    return np.asarray((after - before)[:3, 3])
