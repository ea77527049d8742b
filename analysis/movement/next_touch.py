"""Selection of the next touch: the posture of the reference expected to separate the remaining causes best.

In each posture, each cause predicts a reading with mean and covariance. The separation of two causes is 1 minus the
Bhattacharyya coefficient of their predictions, which bounds the error of a decision between them. The sum over pairs of
causes and over levels of size, weighted by their odds, ranks the postures. A movement of typical size is separated in
most postures; small movements decide which posture is better.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from analysis.diagnosis.evidence.observation import ObservedRun, socket_of
from analysis.movement.causes import LEVELS, NOTHING, Cause, prior_of
from analysis.movement.evidence import LinearReadings, Prediction, likeliest
from analysis.movement.inference import Reference, ReferenceComparison, square_to_name
from analysis.movement.linearise import day_columns, shift_of
from analysis.procedures.facts import facts_of
from analysis.robot.kinematics.arm import Array

_REMAINING = 1e-3
"""Probability below which a cause is ignored."""


@dataclass(frozen=True)
class ReferencePosture:
    """A reading of the reference to repeat: set-up, row in the file, and joint angles (axes,) rad."""

    setup: str
    row: int
    angles: Array
    gain: float

    @property
    def socket(self) -> str:
        """Name of the socket to touch; empty for a pose."""
        return socket_of(self.setup)


@dataclass(frozen=True)
class Lever:
    """A cause that is invisible in all postures of the reference.

    It contains the largest effect in mm at the typical size of the cause, and the scatter that hides it.
    """

    cause: Cause
    moves_mm: float
    scatter_mm: float


@dataclass(frozen=True)
class Candidates:
    """Postures of a reference with predicted readings and the effect of each cause on them."""

    runs: tuple[ObservedRun, ...]
    readings: LinearReadings
    shifts: Mapping[Cause, Array]
    postures: tuple[ReferencePosture, ...]


def candidates_of(reference: Reference) -> Candidates:
    """Return the postures of a reference that can be touched again; circles have none."""
    runs = tuple(run for run in reference.runs if facts_of(run.table.test).of_places)
    every = reference.conditioned.reference
    of_places = np.concatenate([
        np.full(run.values.size, facts_of(run.table.test).of_places) for run in reference.runs
    ])  # fmt: skip
    readings = every.rows(of_places)
    postures = tuple(
        ReferencePosture(run.setup, int(run.table.rows[row]), angles, 0.0)
        for run in runs
        for row, angles in zip(_table_rows(run), run.path.q[run.samples], strict=True)
    )
    shifts = {cause: shift_of(runs, reference.place, cause).columns for cause in reference.causes} if runs else {}
    return Candidates(runs, readings, shifts, postures)


def _table_rows(run: ObservedRun) -> list[int]:
    """Return the table rows of the readings of a run, matched by joint angles."""
    apart = np.abs(run.path.q[run.samples][:, None] - run.table.q[None]).max(axis=2)
    return [int(row) for row in apart.argmin(axis=1)]


def next_posture(
    reference: Reference, candidates: Candidates, compared: ReferenceComparison | None
) -> ReferencePosture | None:
    """Return the posture expected to separate the remaining causes best; None if there are no postures."""
    count = len(candidates.postures)
    if not count:
        return None
    probability = _remaining(reference, compared)
    joint, day, known = _joined(candidates, compared)
    prediction = likeliest(reference.conditioned.predict(joint, day))
    columns = {cause: _columns(cause, candidates, compared, joint) for cause in probability}
    gains = np.zeros(count)
    for k, level in enumerate(LEVELS.tolist()):
        weights = {cause: value * _level_share(cause, compared, k) for cause, value in probability.items()}
        kept = [cause for cause, weight in weights.items() if weight > _REMAINING * max(weights.values())]
        predicted = {
            cause: _predicted(prediction, columns[cause] * (cause.scale * level), known, count) for cause in kept
        }
        for first, second in combinations(kept, 2):
            weight = np.sqrt(weights[first] * weights[second])
            gains += weight * (1 - _overlap(*predicted[first], *predicted[second]))
    if compared is not None:  # a posture that was just touched adds less information
        seen = np.concatenate([run.path.q[run.samples] for run in compared.runs])
        angles = np.array([posture.angles for posture in candidates.postures])
        gains[np.abs(angles[:, None] - seen[None]).max(axis=2).min(axis=1) < _SAME_RAD] *= 0.5
    best = int(np.argmax(gains))
    return replace(candidates.postures[best], gain=float(gains[best]))


_SAME_RAD = 0.02


def _remaining(reference: Reference, compared: ReferenceComparison | None) -> dict[Cause, float]:
    if compared is None:
        every = prior_of([NOTHING, *reference.causes])
    else:
        every = {
            cause: value
            for cause, value in compared.posterior.probability.items()
            if cause == NOTHING or cause in compared.shifts
        }
    kept = {cause: value for cause, value in every.items() if value > _REMAINING}
    return kept if len(kept) > 1 else every


def _joined(candidates: Candidates, compared: ReferenceComparison | None) -> tuple[LinearReadings, Array, int]:
    """Return the readings taken and those of all candidates together, their changes between days, and the number of
    known entries.
    """
    new = compared.readings if compared else candidates.readings.rows(np.zeros(len(candidates.readings.sd_mm), bool))
    joint = LinearReadings.together([new, candidates.readings])
    runs = [*(compared.runs if compared else ()), *candidates.runs]
    return joint, day_columns(runs, joint), len(new.residual)


def _columns(
    cause: Cause, candidates: Candidates, compared: ReferenceComparison | None, joint: LinearReadings
) -> Array:
    if cause == NOTHING:
        return np.empty((len(joint.sd_mm), 0))
    parts = [candidates.shifts[cause]]
    if compared is not None:
        parts.insert(0, compared.shifts[cause].columns)
    return np.asarray(np.concatenate(parts) / joint.sd_mm[:, None])


def _level_share(cause: Cause, compared: ReferenceComparison | None, k: int) -> float:
    """Return the probability that the size of a cause belongs to level k."""
    if compared is not None and cause in compared.posterior.estimates and len(cause.scale):
        return float(compared.posterior.estimates[cause].level[k])
    return 1 / len(LEVELS)


def _predicted(prediction: Prediction, sized: Array, known: int, count: int) -> tuple[Array, Array]:
    """Return mean (c, k) and covariance (c, k, k) of the reading at each candidate, given the readings taken.

    sized (n, m): effect of a standard deviation of each parameter of a cause.
    """
    cov = prediction.cov + sized @ sized.T
    width = (len(cov) - known) // count
    gain = np.linalg.solve(cov[:known, :known], cov[:known, known:]) if known else np.empty((0, len(cov)))
    mean = (gain.T @ prediction.excess[:known] if known else np.zeros(len(cov))).reshape(count, width)
    own = np.arange(known, len(cov)).reshape(count, width)
    covs = cov[own[:, :, None], own[:, None, :]]
    if known:
        of_candidate = cov[:known, known:].reshape(known, count, width)
        covs = covs - np.einsum("ncw,ncv->cwv", of_candidate, gain.reshape(known, count, width))
    return mean, covs


def _overlap(first: Array, first_cov: Array, second: Array, second_cov: Array) -> Array:
    """Return the Bhattacharyya coefficient (c,) of two normal distributions at each candidate, as a ratio."""
    middle, apart = (first_cov + second_cov) / 2, first - second
    far = np.einsum("ci,ci->c", apart, np.linalg.solve(middle, apart[..., None])[..., 0]) / 8
    logs = [np.linalg.slogdet(cov)[1] for cov in (middle, first_cov, second_cov)]
    return np.asarray(np.exp(-far - 0.5 * (logs[0] - 0.5 * (logs[1] + logs[2]))))


def hidden_causes(reference: Reference, candidates: Candidates) -> list[Lever]:
    """Return the causes of typical size that touches in all postures of the reference could not reveal."""
    if not candidates.postures:
        return []
    day = day_columns(candidates.runs, candidates.readings)
    prediction = likeliest(reference.conditioned.predict(candidates.readings, day))
    prior, hidden = prior_of([NOTHING, *reference.causes]), []
    for cause, columns in candidates.shifts.items():
        moves = columns * cause.scale
        white = prediction.whitened(moves / candidates.readings.sd_mm[:, None])
        shown = float((white**2).sum(axis=0).max())
        if shown < square_to_name(prior[cause] / prior[NOTHING]):
            by_row = np.linalg.norm(moves.reshape(len(candidates.postures), -1, moves.shape[1]), axis=1)
            hidden.append(Lever(cause, float(by_row.max()), reference.scatter_mm))
    return hidden
