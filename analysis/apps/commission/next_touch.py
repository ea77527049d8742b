"""Selection of the next touch: the posture expected to separate the remaining causes best.

In each posture, each cause of each size predicts a reading, so the reading is a mixture of normal distributions. The
uncertainty about the cause that it removes, plus its probability to name one, ranks the postures.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.evidence.observation import ObservedRun, socket_of
from analysis.movement.causes import LEVELS, NOTHING, OTHER, Cause, prior_of
from analysis.movement.evidence import OTHER_LEVELS, LinearReadings, Prediction, likeliest
from analysis.movement.inference import NAMED, Reference, ReferenceComparison, square_to_name
from analysis.movement.linearise import day_columns, shift_of
from analysis.procedures.shared.test_kind import facts_of
from analysis.robot.kinematics.arm import Array, Integers

_REMAINING = 1e-3
"""Share of the probability of a movement below which a cause of some size is ignored."""
_SAME_RAD = 0.02
"""Distance below which two postures are the same."""
_DRAWS = 16
"""Draws of each cause and size, and mirror images. Twice as many change hardly any choice."""


@dataclass(frozen=True)
class ReferencePosture:
    setup: str
    row: int
    """Row in the file."""
    angles: Array

    @property
    def socket(self) -> str:
        """Socket to touch; empty for a pose."""
        return socket_of(self.setup)


@dataclass(frozen=True)
class Lever:
    """A cause that no posture reveals, because its largest effect at typical size is hidden by the scatter."""

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
    """Postures that can be touched again; circles have none."""
    runs = tuple(run for run in reference.runs if facts_of(run.table.test).of_places)
    every = reference.conditioned.reference
    of_places = np.concatenate([
        np.full(run.values.size, facts_of(run.table.test).of_places) for run in reference.runs
    ])  # fmt: skip
    readings = every.rows(of_places)
    postures = tuple(
        ReferencePosture(run.setup, int(run.table.rows[np.abs(run.table.q - angles).max(axis=1).argmin()]), angles)
        for run in runs
        for angles in run.path.q[run.samples]
    )
    shifts = {cause: shift_of(runs, reference.place, cause).columns for cause in reference.causes} if runs else {}
    return Candidates(runs, readings, shifts, postures)


def next_posture(
    reference: Reference, candidates: Candidates, compared: ReferenceComparison | None
) -> ReferencePosture | None:
    """Posture expected to separate the remaining causes best; None if there are no postures."""
    count = len(candidates.postures)
    if not count:
        return None
    probability = compared.posterior.probability if compared else prior_of([NOTHING, *reference.causes, OTHER])
    floor = _REMAINING * (1 - probability.get(NOTHING, 0.0))
    causes = [NOTHING, *(cause for cause, value in probability.items() if cause != NOTHING and value > floor)]
    joint, day, known = _all_readings(candidates, compared)
    prediction = likeliest(reference.conditioned.predict(joint, day))
    outcomes: list[tuple[float, int, Array, Array]] = []
    for number, cause in enumerate(causes):
        spread = _spread(cause, candidates, compared, joint, prediction.scatter)
        for level, share in zip(*_levels(cause, compared), strict=True):
            if (weight := probability.get(cause, 0.0) * share) > floor:
                outcomes.append((weight, number, *_predict_readings(prediction, level**2 * spread, known, count)))
    weights, numbers = (np.array(column) for column in list(zip(*outcomes, strict=True))[:2])
    means, covs = (np.stack(column, axis=1) for column in list(zip(*outcomes, strict=True))[2:])
    gains = np.array([_usefulness(weights, numbers, mean, cov) for mean, cov in zip(means, covs, strict=True)])
    if compared is not None:  # a posture that was just touched adds less information
        seen = np.concatenate([run.path.q[run.samples] for run in compared.runs])
        angles = np.array([posture.angles for posture in candidates.postures])
        gains[np.abs(angles[:, None] - seen[None]).max(axis=2).min(axis=1) < _SAME_RAD] *= 0.5
    return candidates.postures[int(np.argmax(gains))]


def _all_readings(candidates: Candidates, compared: ReferenceComparison | None) -> tuple[LinearReadings, Array, int]:
    """Readings taken and those of all candidates, their changes between days, and the number of known entries."""
    new = compared.readings if compared else candidates.readings.rows(np.zeros(len(candidates.readings.sd_mm), bool))
    joint = LinearReadings.together([new, candidates.readings])
    runs = [*(compared.runs if compared else ()), *candidates.runs]
    return joint, day_columns(runs, joint), len(new.residual)


def _spread(
    cause: Cause, candidates: Candidates, compared: ReferenceComparison | None, joint: LinearReadings, scatter: float
) -> Array:
    """Covariance (n, n) that a cause of typical size adds, in units of the assumed scatter."""
    if cause == NOTHING:
        return np.zeros((len(joint.sd_mm), len(joint.sd_mm)))
    if cause == OTHER:
        return scatter**2 * np.eye(len(joint.sd_mm))
    members = cause.members or (cause,)
    parts = [np.concatenate([candidates.shifts[member] for member in members], axis=1)]
    if compared is not None:
        parts.insert(0, np.concatenate([compared.shifts[member].columns for member in members], axis=1))
    columns = np.concatenate(parts) * cause.scale / joint.sd_mm[:, None]
    return np.asarray(columns @ columns.T)


def _levels(cause: Cause, compared: ReferenceComparison | None) -> tuple[Array, Array]:
    levels = {NOTHING: np.ones(1), OTHER: OTHER_LEVELS}.get(cause, LEVELS)
    if compared is not None and len(cause.scale) and not cause.members:
        return levels, compared.posterior.estimates[cause].level
    return levels, np.full(len(levels), 1 / len(levels))


def _predict_readings(prediction: Prediction, spread: Array, known: int, count: int) -> tuple[Array, Array]:
    """Mean (c, k) and covariance (c, k, k) of the reading at each candidate, given the readings taken.

    spread (n, n): covariance that a cause adds.
    """
    cov = prediction.cov + spread
    width = (len(cov) - known) // count
    gain = np.linalg.solve(cov[:known, :known], cov[:known, known:]) if known else np.empty((0, len(cov)))
    mean = (gain.T @ prediction.excess[:known] if known else np.zeros(len(cov))).reshape(count, width)
    own = np.arange(known, len(cov)).reshape(count, width)
    covs = cov[own[:, :, None], own[:, None, :]]
    if known:
        of_candidate = cov[:known, known:].reshape(known, count, width)
        covs = covs - np.einsum("ncw,ncv->cwv", of_candidate, gain.reshape(known, count, width))
    return mean, covs


def _usefulness(weights: Array, causes: Integers, means: Array, covs: Array) -> float:
    """Share of the uncertainty that a reading removes plus its probability to name a cause if one moved.

    The reading is a mixture with weights (m,), causes (m,) from 0 (nothing), means (m, k) and covs (m, k, k).
    """
    chols = np.linalg.cholesky(covs)
    inverses = np.linalg.inv(chols)
    log_sizes = np.log(np.einsum("mii->mi", chols)).sum(axis=1)
    draws = np.random.default_rng(0).normal(size=(_DRAWS, means.shape[1]))
    draws = np.concatenate([draws, -draws])
    readings = means[:, None] + np.einsum("mij,sj->msi", chols, draws)
    white = np.einsum("mij,nsj->nsmi", inverses, readings) - np.einsum("mij,mj->mi", inverses, means)
    logs = np.log(weights) - log_sizes - 0.5 * (white**2).sum(axis=3)
    weights = weights / weights.sum()
    of_cause = np.eye(int(causes.max()) + 1)[causes]
    shares = np.exp(logs - logs.max(axis=2, keepdims=True)) @ of_cause
    shares /= shares.sum(axis=2, keepdims=True)
    before = weights @ of_cause
    uncertainty = -(np.log(np.maximum(before, 1e-300)) @ before)
    own = np.take_along_axis(shares, causes[:, None, None], axis=2)[..., 0]
    removed = weights @ np.log(own / before[causes, None]).mean(axis=1) / max(uncertainty, 1e-12)
    moved = weights * (causes > 0)
    named = moved @ (shares[..., 1:].max(axis=2, initial=0.0) >= NAMED).mean(axis=1) / max(moved.sum(), 1e-12)
    return float(removed + named)


def hidden_causes(reference: Reference, candidates: Candidates) -> list[Lever]:
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
