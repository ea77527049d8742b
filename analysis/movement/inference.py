"""Inference of movements: analysis of a reference, comparison of new readings with it, and the causes by odds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from analysis.diagnosis.evidence.observation import ObservedRun, parts, socket_of
from analysis.diagnosis.evidence.setups import FRAME, fit_setups, folds_of
from analysis.diagnosis.evidence.significance import ODDS
from analysis.diagnosis.judge.result import Movement
from analysis.movement.causes import NOTHING, OTHER, Cause, What, prior_of
from analysis.movement.evidence import (
    CausePosterior,
    Conditioned,
    Estimate,
    LinearReadings,
    Prediction,
    Shift,
    condition,
    likeliest,
    posterior,
    regional_scatter,
)
from analysis.movement.linearise import (
    Workplace,
    angles_of,
    causes_of,
    constants_count,
    corrected_arm,
    day_columns,
    linearise,
    selected,
    shift_of,
    tool_places,
    with_cause,
    workplace,
)
from analysis.robot.geometry.pose_setup import frame
from analysis.robot.kinematics.arm import Array, Mask, forward
from rigs.schema.part import Vector

NAMED = ODDS / (ODDS + 1)
"""Probability from which a cause is named."""
FEWEST_OF_REFERENCE = 12
"""Minimum number of readings of a reference. Chosen: arm and set-up have about as many uncertain constants."""
FEWEST_TO_CLEAR = 4
"""Minimum number of new readings from which "nothing moved" is an answer. Chosen: fewer hardly show the wrist."""
_REGIONS = 4
"""Number of regions in joint space, and of parts of each run, used to compare the reference with itself. Chosen."""
_FEWEST_OF_REGIONS = 20
"""Minimum number of readings for a comparison of regions."""
_ROUNDS = 3
"""Maximum number of linearisations of the reference. Chosen: an arm with an error of 10 mm needs two."""
_STRAIGHT_MM = 0.3
"""Change of a reading above which the derivatives are recomputed. Chosen: a rotation that moves a point at a metre by 5
mm deviates from the linear path by 0.01 mm.
"""
_OUTLIER_SDS = 8.0
"""Robust standard deviations from which a reading of the reference is an outlier."""
_LARGE_MM = 2.0
"""Movement of the new readings above which the derivatives of a cause are recomputed at the estimate."""


MOST_MM = 30.0
"""Largest distance between new readings and the reference that counts as a movement. Chosen: larger ones mostly mean a
different placement or a socket with the same name.
"""


def square_to_name(prior_odds: float) -> float:
    """Squared shift, in standard deviations, above which a cause with the given prior odds is named."""
    return float(2 * np.log(NAMED / (1 - NAMED) / prior_odds))


@dataclass(frozen=True)
class Reference:
    """Runs before a possible movement, with the posterior of arm and set-ups."""

    runs: tuple[ObservedRun, ...]
    place: Workplace
    conditioned: Conditioned
    wild: int
    regional: Mapping[Cause, Array]
    names: tuple[str, ...] = ()
    """Runs of this state of the arm."""
    movements: tuple[Movement, ...] = ()
    """Movements among the given runs before this state."""
    doubts: tuple[str, ...] = ()

    @property
    def causes(self) -> list[Cause]:
        return causes_of(self.runs)

    @property
    def scatter_mm(self) -> float:
        """Standard deviation in mm of a coordinate of a reading, including the part that recurs in the same posture."""
        scenarios = self.conditioned.scenarios
        own = self.conditioned.scatter_mm
        return float(np.sqrt(own**2 + sum(s.weight * s.unexplained_mm**2 for s in scenarios)))


def study(runs: Sequence[ObservedRun]) -> Reference:
    """Analyse the reference runs of an arm with a common model, touches split by socket."""
    runs = selected(runs)
    nominal, wild = runs[0].model, 0
    model, constants = nominal, np.zeros(constants_count(nominal.arm))
    for turn in range(_ROUNDS):
        runs = [replace(run, model=model) for run in runs]
        place = workplace(model, runs, fit_setups(runs), constants)
        readings = linearise(runs, place)
        conditioned = condition(readings)
        left, estimate = _explained(conditioned)
        keep = _near(left, readings)
        if not keep.all() and turn < _ROUNDS - 1:  # after the last round, keep the conditioned runs
            wild += int(np.count_nonzero(~keep))
            runs = parts(runs, keep)
            continue
        estimate = estimate[: len(constants)]
        change = readings.arm[:, : len(constants)] @ (estimate - constants)
        if turn == _ROUNDS - 1 or np.abs(change).max() < _STRAIGHT_MM:
            break
        constants = estimate
        model = replace(nominal, arm=corrected_arm(nominal.arm, constants))
    return Reference(tuple(runs), place, conditioned, wild, _regional(runs, place, conditioned))


def _regional(runs: Sequence[ObservedRun], place: Workplace, conditioned: Conditioned) -> dict[Cause, Array]:
    """Scatter of base, tool and zeros between regions of the reference."""
    angles, row = conditioned.reference.angles, conditioned.reference.row
    first = np.unique(row, return_index=True)[1]
    if len(first) < _FEWEST_OF_REGIONS:
        return {}
    fold = folds_of(angles[first], _REGIONS)
    quarter = np.concatenate([np.arange(len(run.rows)) * _REGIONS // len(run.rows) for run in runs])
    causes = [cause for cause in causes_of(runs) if cause.what in ("base", "tool", "zero")]
    columns = {cause: shift_of(runs, place, cause).columns for cause in causes}
    return regional_scatter(conditioned, columns, [fold[row], quarter[row]])


def _explained(conditioned: Conditioned) -> tuple[Array, Array]:
    """Residuals (n,) mm in the likeliest scenario, and the constants (a,) in prior standard deviations."""
    s = conditioned.likeliest
    readings = conditioned.reference
    known = s.vectors @ ((s.vectors.T @ (readings.residual / readings.sd_mm)) / (s.values + s.scatter**2))
    constants = s.arm_level**2 * (readings.arm / readings.sd_mm[:, None]).T @ known
    return s.scatter**2 * known * readings.sd_mm, constants


def _near(left: Array, readings: LinearReadings) -> Mask:
    """Mask (m,) of the rows that are not outliers."""
    rows = np.zeros(int(readings.row.max()) + 1)
    np.maximum.at(rows, readings.row, np.abs(left) / readings.sd_mm)
    return rows < _OUTLIER_SDS * 1.4826 * np.median(np.abs(left) / readings.sd_mm) + 1e-6


@dataclass(frozen=True)
class ReferenceComparison:
    """New readings compared with a reference."""

    runs: tuple[ObservedRun, ...]
    readings: LinearReadings
    predictions: tuple[Prediction, ...]
    shifts: Mapping[Cause, Shift]
    posterior: CausePosterior

    @property
    def identified_cause(self) -> Cause | None:
        """The cause with odds of at least 20 to 1, if any. Causes that the readings cannot show are added to "nothing",
        which needs FEWEST_TO_CLEAR readings.
        """
        cause, probability = next(iter(self.posterior.probability.items()))
        if cause == NOTHING:
            if not self.can_clear:
                return None
            probability += sum(self.posterior.probability[unseen] for unseen in self.unseen)
        return cause if probability >= NAMED else None

    @property
    def count(self) -> int:
        return sum(len(run.rows) for run in self.runs)

    @property
    def can_clear(self) -> bool:
        return self.count >= FEWEST_TO_CLEAR

    @property
    def distance_mm(self) -> float:
        """Median distance between coordinates of the new readings and the prediction."""
        return float(np.median(np.abs(likeliest(self.predictions).excess) * self.readings.sd_mm))

    @property
    def unseen(self) -> list[Cause]:
        """Zeros that the readings do not favour, and that would not be named at their typical size."""
        prediction = likeliest(self.predictions)
        probability, prior = self.posterior.probability, prior_of(list(self.posterior.probability))
        found = []
        for cause, shift in self.shifts.items():
            white = prediction.whitened(shift.columns * cause.scale / self.readings.sd_mm[:, None])
            odds = prior[cause] / prior[NOTHING]
            shown = float((white**2).sum()) > square_to_name(odds)
            if cause.what == "zero" and not shown and probability[cause] <= odds * probability[NOTHING]:
                found.append(cause)
        return found


def compare(reference: Reference, new: Sequence[ObservedRun]) -> ReferenceComparison:
    """Compare new readings, in set-ups of the reference, with it."""
    runs = [replace(run, model=reference.place.model) for run in selected(new)]
    readings = linearise(runs, reference.place)
    shifts = {cause: shift_of(runs, reference.place, cause) for cause in reference.causes}
    usual = [shifts[cause].columns * scatter for cause, scatter in reference.regional.items() if scatter.any()]
    day = np.column_stack([day_columns(runs, readings), *usual])
    predictions = reference.conditioned.predict(readings, day)
    found = posterior(predictions, shifts, readings.sd_mm, readings.row)
    for _ in range(2):
        large = {
            cause: estimate.mean
            for cause, estimate in found.estimates.items()
            if cause in shifts and np.abs(shifts[cause].columns @ estimate.mean).max(initial=0.0) > _LARGE_MM
        }
        if not large:
            break
        shifts |= {cause: shift_of(runs, reference.place, cause, about) for cause, about in large.items()}
        found = posterior(predictions, shifts, readings.sd_mm, readings.row)
    return ReferenceComparison(tuple(runs), readings, tuple(predictions), shifts, found)


# ----------------------------------------------------------------------------------------------------------------------
# Causes of a movement with odds, size, direction and effect on the work.

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
