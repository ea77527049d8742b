"""Inference of movements: analysis of a reference, comparison of new readings with it, and the causes by odds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnosis.evidence.observation import ObservedRun, parts
from analysis.diagnosis.evidence.setups import fit_setups, folds_of
from analysis.diagnosis.evidence.significance import ODDS
from analysis.diagnosis.judge.result import Movement
from analysis.movement.cause_posterior import CausePosterior, posterior
from analysis.movement.causes import NOTHING, Cause, prior_of
from analysis.movement.evidence import (
    Conditioned,
    LinearReadings,
    Prediction,
    Shift,
    condition,
    likeliest,
    regional_scatter,
)
from analysis.movement.linearise import (
    Workplace,
    causes_of,
    constants_count,
    corrected_arm,
    day_columns,
    linearise,
    selected,
    shift_of,
    workplace,
)
from analysis.robot.kinematics.arm import Array, Mask

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
