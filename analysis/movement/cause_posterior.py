"""Evidence of each cause of a movement."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from analysis.movement.causes import LEVELS, NOTHING, OTHER, Cause, prior_of
from analysis.movement.evidence import MEMBER_LEVELS, OTHER_LEVELS, OUTLIER_ODDS, Prediction, Shift, likeliest
from analysis.robot.kinematics.arm import Array, Integers


@dataclass(frozen=True)
class Estimate:
    """Log evidence of a cause, mean (m,) and covariance (m, m) of its parameters in mm and rad, and posterior share of
    each prior level.
    """

    log_evidence: float
    mean: Array
    cov: Array
    level: Array


@dataclass(frozen=True)
class CausePosterior:
    """Probabilities of causes, likeliest first, with estimates. `wild`: row of the reading that is probably an
    outlier.
    """

    probability: Mapping[Cause, float]
    estimates: Mapping[Cause, Estimate]
    wild: int | None


def posterior(
    predictions: Sequence[Prediction], shifts: Mapping[Cause, Shift], sd_mm: Array, row: Integers
) -> CausePosterior:
    """Compare no movement, the given causes and an unknown change as explanations of new readings.

    shifts: effect of each cause on the readings (n,) in mm. Pairs and triples of causes are tried if no single cause
    fits: a pair competes with the same pair and a third cause.
    """
    single = [NOTHING, *shifts, OTHER]
    columns = {cause: Shift(shift.columns / sd_mm[:, None], shift.offset / sd_mm) for cause, shift in shifts.items()}
    none, scenarios = Shift(np.empty((len(row), 0)), np.zeros(len(row))), _Scenarios.of(predictions)
    estimates = {cause: _estimate(scenarios, columns[cause], cause.scale, LEVELS) for cause in columns}
    estimates[NOTHING] = _estimate(scenarios, none, np.empty(0), LEVELS[:1])
    estimates[OTHER] = _estimate_other(predictions)
    outlier_log, wild_row = {}, {}
    units = _OUTLIER_UNITS * sum(p.weight * p.scatter for p in predictions)
    for cause in [NOTHING, *columns]:
        shift = columns.get(cause, none)
        outlier_log[cause], wild_row[cause] = _with_outlier(scenarios, shift, cause, estimates[cause], row, units)
    probability = _normalised(single, estimates, outlier_log)
    best = max(probability, key=lambda cause: probability[cause])
    if probability[OTHER] > 1 / 21 or not _fits(predictions, columns, estimates, best):
        estimates |= _joint_estimates(scenarios, columns)
        probability = _normalised(list(estimates), estimates, outlier_log)
        best = max(probability, key=lambda cause: probability[cause])
    wild = wild_row.get(best) if outlier_log.get(best, -np.inf) > estimates[best].log_evidence + np.log(20) else None
    ordered = dict(sorted(probability.items(), key=lambda item: -item[1]))
    return CausePosterior(ordered, estimates, wild)


def _normalised(
    causes: list[Cause], estimates: Mapping[Cause, Estimate], outlier_log: Mapping[Cause, float]
) -> dict[Cause, float]:
    prior = prior_of(causes)
    logs = {
        cause: np.log(prior[cause])
        + np.logaddexp(
            np.log(1 - OUTLIER_ODDS) + estimates[cause].log_evidence,
            np.log(OUTLIER_ODDS) + outlier_log.get(cause, -np.inf),
        )
        for cause in causes
    }
    most = max(logs.values())
    raw = {cause: float(np.exp(log - most)) for cause, log in logs.items()}
    total = sum(raw.values())
    return {cause: value / total for cause, value in raw.items()}


@dataclass(frozen=True)
class _Scenarios:
    """Predictions of s scenarios for the same n readings: log weight and normalisation (s,), inverse Cholesky factors
    (s, n, n) of the covariances, and excess (s, n), in units of the assumed scatter.
    """

    log: Array
    inverse: Array
    excess: Array

    @classmethod
    def of(cls, predictions: Sequence[Prediction]) -> _Scenarios:
        log = [np.log(p.weight) - float(np.log(np.diag(p.chol)).sum()) for p in predictions]
        inverse = [p.whitened(np.eye(len(p.excess))) for p in predictions]
        return cls(np.array(log), np.stack(inverse), np.stack([p.excess for p in predictions]))


def _estimate(scenarios: _Scenarios, shift: Shift, scale: Array, levels: Array) -> Estimate:
    """Estimate a cause; `levels` (l,) or (l, m) multiply the typical sizes (m,)."""
    excess = ((scenarios.excess + shift.offset)[:, None] @ scenarios.inverse.transpose(0, 2, 1))[:, 0]
    # Log of weight times density for no movement in each scenario.
    log = scenarios.log - 0.5 * (excess**2).sum(axis=1)
    if not len(scale):
        return Estimate(float(np.logaddexp.reduce(log)), np.empty(0), np.empty((0, 0)), np.ones(1))
    sizes = scale * (levels[:, None] if levels.ndim == 1 else levels)
    white = scenarios.inverse @ shift.columns
    gram, along = white.transpose(0, 2, 1) @ white, (excess[:, None] @ white)[:, 0]
    squares = sizes[:, :, None] * sizes[:, None]
    inner = gram[:, None] * squares + np.eye(len(scale))
    projected = along[:, None] * sizes
    inverse = np.linalg.inv(inner)
    solved = (inverse @ projected[..., None])[..., 0]
    gain = 0.5 * (projected * solved).sum(axis=2) - 0.5 * np.linalg.slogdet(inner)[1]
    logs = log[:, None] + gain - np.log(len(sizes))
    total = float(np.logaddexp.reduce(logs, axis=None))
    share = np.exp(logs - total)
    means = sizes * solved
    mean = np.einsum("sl,slm->m", share, means)
    off = means - mean
    cov = np.einsum("sl,slij->ij", share, inverse * squares + off[..., :, None] * off[..., None, :])
    return Estimate(total, mean, cov, share.sum(axis=0))


def _estimate_other(predictions: Sequence[Prediction]) -> Estimate:
    """Evidence of an unknown change, modelled as larger scatter of unknown size."""
    logs = []
    for p in predictions:
        values, vectors = np.linalg.eigh(p.cov)
        turned = (vectors.T @ p.excess) ** 2
        total = values + (OTHER_LEVELS[:, None] * p.scatter) ** 2
        logs.append(np.log(p.weight) - 0.5 * (np.log(total) + turned / total).sum(axis=1) - np.log(len(OTHER_LEVELS)))
    return Estimate(float(np.logaddexp.reduce(np.concatenate(logs))), np.empty(0), np.empty((0, 0)), np.ones(1))


def _with_outlier(
    scenarios: _Scenarios, shift: Shift, cause: Cause, alone: Estimate, row: Integers, units: float
) -> tuple[float, int]:
    """Test a cause together with one outlier of a typical size in units of the assumed scatter: the log evidence at the
    cause's own size, and the outlier's row.
    """
    level = float(LEVELS[int(np.argmax(alone.level))])
    numbers = np.unique(row)
    logs = []
    for number in numbers.tolist():
        entries = np.flatnonzero(row == number)
        outlier = np.eye(len(row))[:, entries]
        both = Shift(np.concatenate([shift.columns, outlier], axis=1), shift.offset)
        scale = np.concatenate([cause.scale * level, np.full(len(entries), units)])
        log = _estimate(scenarios, both, scale, _OUTLIER_LEVELS[:, None] ** (np.arange(len(scale)) >= len(cause.scale)))
        logs.append(log.log_evidence)
    of_level = np.log(len(LEVELS)) if len(cause.scale) else 0.0
    total = float(np.logaddexp.reduce(np.array(logs))) - np.log(len(numbers)) - of_level
    return total, int(numbers[int(np.argmax(logs))])


_OUTLIER_UNITS = 10.0
"""Typical size of an outlier in units of the scatter."""
_OUTLIER_LEVELS = np.array([0.5, 3.0, 30.0])


def _fits(
    predictions: Sequence[Prediction], columns: Mapping[Cause, Shift], estimates: Mapping[Cause, Estimate], cause: Cause
) -> bool:
    """Whether the chi-square of a cause is below the 99.9 % bound."""
    from scipy.special import chdtri  # noqa: PLC0415 - slow to import

    p = likeliest(predictions)
    excess = p.excess
    if cause in columns:
        excess = p.excess + columns[cause].offset - columns[cause].columns @ estimates[cause].mean
    left = p.whitened(excess)
    freedom = max(len(left) - len(cause.scale), 1)
    return bool(left @ left < chdtri(freedom, 0.001))


def _joint_estimates(scenarios: _Scenarios, columns: Mapping[Cause, Shift]) -> dict[Cause, Estimate]:
    """Estimate each pair and each triple of causes that has fewer parameters than readings."""
    estimates = {}
    for members in (*combinations(columns, 2), *combinations(columns, 3)):
        joint = Cause("pair" if len(members) == 2 else "triple", members=members)
        if len(joint.scale) >= scenarios.excess.shape[1]:
            continue
        grid = list(product(MEMBER_LEVELS, repeat=len(members)))
        levels = np.repeat(grid, [len(member.scale) for member in members], axis=1)
        shifts = [columns[member] for member in members]
        shift = Shift(np.concatenate([s.columns for s in shifts], axis=1), np.sum([s.offset for s in shifts], axis=0))
        estimates[joint] = _estimate(scenarios, shift, joint.scale, levels)
    return estimates
