"""Evidence of causes given the posterior of a reference, in a linear Gaussian model.

The reference conditions the arm constants, the set-ups and the unexplained part; the remaining covariance is correlated
noise of the new readings. Scatter and sizes of the errors are marginalised on a grid, weighted by the evidence of the
reference. An outlier is a separate hypothesis, so that a bad touch neither creates nor hides a cause.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import combinations, product

import numpy as np

from analysis.movement.causes import LEVELS, NOTHING, OTHER, Cause, prior_of
from analysis.robot.kinematics.arm import Array, Integers, Mask

_ARM_LEVELS = np.array([0.2, 0.5, 1.0, 2.0, 5.0, 25.0])
"""Multiples of the prior widths of arm constants, from a calibrated arm to an error of centimetres."""
_UNEXPLAINED_MM = np.array([0.0, 0.05, 0.2, 0.8])
"""Sizes of the unexplained part; calibrated arms have 0.03 to 0.5 mm (UR10, Panda, iiwa)."""
_UNEXPLAINED_SHARES = np.array([0.7, 0.1, 0.1, 0.1])
"""Prior probabilities of these sizes. Chosen: without repeats, scatter is the cautious assumption."""
_SCATTERS = np.geomspace(0.03, 10.0, 25)
"""Multiples of the assumed scatter of a kind of reading."""
_SCATTER_PRIOR = -0.5 * (np.log(_SCATTERS / 0.7) / np.log(2.0)) ** 2
"""Log prior of these multiples: cells differ by a factor of two, and the assumed scatter includes a part of the model
error.
"""
_NEAR_RAD = (0.6, 1.5)
"""Correlation lengths of the unexplained part in joint space. Chosen: the once-per-turn error of a gear and the gravity
torque change over about a radian.
"""
_NEGLIGIBLE = 1e-3
"""Weight relative to the largest below which a grid point is dropped."""
_OUTLIER_ODDS = 0.01
"""Prior probability of an outlier in the new readings: a ball not seated, a disturbed tracker. Chosen."""
OTHER_LEVELS = np.array([3.0, 10.0, 30.0, 100.0, 300.0])
"""Multiples of the scatter for changes explained by neither causes nor noise."""
_MEMBER_LEVELS = LEVELS[:3]
"""Size levels of each member of a pair or triple."""


@dataclass(frozen=True)
class LinearReadings:
    """Linearised readings in mm, with derivatives."""

    residual: Array
    """Measured minus predicted (n,)."""
    arm: Array
    """Change (n, a) of the prediction for a prior standard deviation of each arm constant."""
    setup: Array
    """The same (n, s) of each set-up term."""
    angles: Array
    """Joint angles (n, axes) rad."""
    channel: Integers
    """Readings (n,) of the same channel share the unexplained part."""
    row: Integers
    """Index (n,) of the reading of each coordinate."""
    sd_mm: Array
    """Assumed scatter (n,)."""

    def rows(self, keep: Mask) -> LinearReadings:
        return LinearReadings(*(getattr(self, field.name)[keep] for field in fields(self)))

    @classmethod
    def together(cls, parts: Sequence[LinearReadings]) -> LinearReadings:
        return cls(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(cls)))


@dataclass(frozen=True)
class Shift:
    """Effect of a cause on new readings. columns (n, m): change for 1 mm or 1 rad of each parameter. offset (n,):
    correction if the derivatives were taken at a large change.
    """

    columns: Array
    offset: Array


def _nearness(first: LinearReadings, second: LinearReadings) -> Array:
    apart = (first.angles[:, None] - second.angles[None] + np.pi) % (2 * np.pi) - np.pi
    square = (apart**2).sum(axis=2)
    near = sum(np.exp(-0.5 * square / length**2) for length in _NEAR_RAD) / len(_NEAR_RAD)
    return np.asarray(near * (first.channel[:, None] == second.channel[None]), dtype=float)


@dataclass(frozen=True)
class Scenario:
    """A grid point with its weight, and the matrix decomposition for predicting other readings."""

    weight: float
    scatter: float
    arm_level: float
    unexplained_mm: float
    vectors: Array
    values: Array


@dataclass(frozen=True)
class Conditioned:
    """A reference with the scenarios that predict new readings."""

    reference: LinearReadings
    scenarios: tuple[Scenario, ...]

    @property
    def likeliest(self) -> Scenario:
        return max(self.scenarios, key=lambda scenario: scenario.weight)

    @property
    def scatter_mm(self) -> float:
        """Standard deviation in mm of a coordinate of the commonest kind of reading: the mean over scenarios."""
        mean = sum(s.weight * s.scatter for s in self.scenarios)
        return float(mean * np.median(self.reference.sd_mm))

    def predict(self, new: LinearReadings, day: Array) -> list[Prediction]:
        """Predict new readings in every scenario, in units of their assumed scatter. day (n, d) mm: contribution of a
        standard deviation of each change from day to day.
        """
        unit = new.sd_mm[:, None]
        predictions, near = [], {id(other): _nearness(other, new) for other in (self.reference, new)}
        day_cov = (day / unit) @ (day / unit).T
        for s in self.scenarios:
            across, within = (
                (s.arm_level**2 * other.arm @ new.arm.T + other.setup @ new.setup.T
                 + s.unexplained_mm**2 * near[id(other)]) / (other.sd_mm[:, None] * unit.T)
                for other in (self.reference, new)
            )  # fmt: skip
            turned = s.vectors.T @ across
            weighted = turned / (s.values + s.scatter**2)[:, None]
            projected = s.vectors.T @ (self.reference.residual / self.reference.sd_mm)
            mean = weighted.T @ projected
            cov = within - turned.T @ weighted + day_cov + s.scatter**2 * np.eye(len(new.residual))
            predictions.append(Prediction(s.weight, s.scatter, new.residual / new.sd_mm - mean, cov))
        return predictions


def regional_scatter(
    conditioned: Conditioned, columns: Mapping[Cause, Array], folds: Sequence[Integers]
) -> dict[Cause, Array]:
    """Standard deviations (m,) in mm and rad of each cause parameter between regions of the reference.

    Each fold (n,) numbers the regions of the readings. The parameters of each region are predicted from all other
    regions in the likeliest scenario. The scatter beyond their uncertainty is estimated by the method of moments for
    random effects (DerSimonian and Laird 1986) and counts from two standard errors on.
    """
    s = conditioned.likeliest
    reference = conditioned.reference
    inverse = (s.vectors / (s.values + s.scatter**2)) @ s.vectors.T
    weighted = inverse @ (reference.residual / reference.sd_mm)
    scores: dict[Cause, list[Array]] = {cause: [] for cause in columns}
    for fold in folds:
        for number in np.unique(fold).tolist():
            rows = np.flatnonzero(fold == number)
            precision = inverse[np.ix_(rows, rows)]
            for cause, whole in columns.items():
                own_columns = whole[rows] / reference.sd_mm[rows, None]
                information = np.einsum("nm,nk,km->m", own_columns, precision, own_columns)
                estimate = own_columns.T @ weighted[rows] / np.maximum(information, 1e-12)
                scores[cause].append(np.stack([estimate**2, 1 / np.maximum(information, 1e-12)]))
    sizes = {}
    for cause, pairs in scores.items():
        squares, variances = np.stack(pairs, axis=1)
        excess = (squares / variances).mean(axis=0) - 1 - 2 * np.sqrt(2 / len(squares))
        sizes[cause] = np.sqrt(np.where(excess > 0, np.maximum((squares - variances).mean(axis=0), 0.0), 0.0))
    return sizes


@dataclass(frozen=True)
class Prediction:
    """New readings (n,) minus the prediction of a scenario, with covariance (n, n), in units of the assumed scatter."""

    weight: float
    scatter: float
    excess: Array
    cov: Array

    @cached_property
    def chol(self) -> Array:
        return np.asarray(np.linalg.cholesky(self.cov), dtype=float)

    def whitened(self, columns: Array) -> Array:
        from scipy.linalg import solve_triangular  # noqa: PLC0415 - slow to import

        return solve_triangular(self.chol, columns, lower=True, check_finite=False)


def likeliest(predictions: Sequence[Prediction]) -> Prediction:
    return max(predictions, key=lambda prediction: prediction.weight)


def condition(reference: LinearReadings) -> Conditioned:
    """Weight the scenarios of a reference by their evidence."""
    unit = reference.sd_mm
    y, arm, setup = (getattr(reference, name).T / unit for name in ("residual", "arm", "setup"))
    of_arm, of_setup = arm.T @ arm, setup.T @ setup
    near = _nearness(reference, reference) / np.outer(unit, unit)
    points: list[tuple[float, float, float, float, Array, Array]] = []
    for level in _ARM_LEVELS.tolist():
        for unexplained_mm, share in zip(_UNEXPLAINED_MM.tolist(), _UNEXPLAINED_SHARES.tolist(), strict=True):
            values, vectors = np.linalg.eigh(level**2 * of_arm + of_setup + unexplained_mm**2 * near)
            values = np.maximum(values, 0.0)
            turned = (vectors.T @ y) ** 2
            for scatter, log_prior in zip(_SCATTERS.tolist(), _SCATTER_PRIOR.tolist(), strict=True):
                total = values + scatter**2
                log_weight = np.log(share) + log_prior - 0.5 * float(np.log(total).sum() + (turned / total).sum())
                points.append((log_weight, scatter, level, unexplained_mm, vectors, values))
    most = max(point[0] for point in points)
    kept = [(np.exp(point[0] - most), *point[1:]) for point in points if point[0] > most + np.log(_NEGLIGIBLE)]
    total_weight = sum(point[0] for point in kept)
    return Conditioned(reference, tuple(Scenario(float(point[0] / total_weight), *point[1:]) for point in kept))


# ----------------------------------------------------------------------------------------------------------------------
# Evidence of each cause.


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
    """Probabilities of no movement, of the given causes, and of an unknown change.

    shifts: effect of each cause on the readings (n,) in mm. Pairs and triples of causes are tried if no single cause
    fits: a pair competes with the same pair and a third cause.
    """
    single = [NOTHING, *shifts, OTHER]
    columns = {cause: Shift(shift.columns / sd_mm[:, None], shift.offset / sd_mm) for cause, shift in shifts.items()}
    none = Shift(np.empty((len(row), 0)), np.zeros(len(row)))
    estimates = {cause: _estimate(predictions, columns[cause], cause.scale, LEVELS) for cause in columns}
    estimates[NOTHING] = _estimate(predictions, none, np.empty(0), LEVELS[:1])
    estimates[OTHER] = _estimate_other(predictions)
    outlier_log, wild_row = {}, {}
    for cause in [NOTHING, *columns]:
        shift = columns.get(cause, none)
        outlier_log[cause], wild_row[cause] = _with_outlier(predictions, shift, cause, estimates[cause], row)
    probability = _normalised(single, estimates, outlier_log)
    best = max(probability, key=lambda cause: probability[cause])
    if probability[OTHER] > 1 / 21 or not _fits(predictions, columns, estimates, best):
        estimates |= _joint_estimates(predictions, columns)
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
            np.log(1 - _OUTLIER_ODDS) + estimates[cause].log_evidence,
            np.log(_OUTLIER_ODDS) + outlier_log.get(cause, -np.inf),
        )
        for cause in causes
    }
    most = max(logs.values())
    raw = {cause: float(np.exp(log - most)) for cause, log in logs.items()}
    total = sum(raw.values())
    return {cause: value / total for cause, value in raw.items()}


def _estimate(predictions: Sequence[Prediction], shift: Shift, scale: Array, levels: Array) -> Estimate:
    """Estimate a cause; `levels` (l,) or (l, m) multiply the typical sizes (m,)."""
    excess = [p.whitened(p.excess + shift.offset) for p in predictions]
    # Log of weight times density for no movement in each scenario.
    logs = [
        np.log(p.weight) - 0.5 * float(e @ e) - float(np.log(np.diag(p.chol)).sum())
        for p, e in zip(predictions, excess, strict=True)
    ]
    if not len(scale):
        return Estimate(float(np.logaddexp.reduce(logs)), np.empty(0), np.empty((0, 0)), np.ones(1))
    sizes = scale * (levels[:, None] if levels.ndim == 1 else levels)
    all_logs, means, covs = [], [], []
    for p, e, log in zip(predictions, excess, logs, strict=True):
        white = p.whitened(shift.columns)
        design = white[None] * sizes[:, None]
        inner = np.einsum("lnm,lnk->lmk", design, design) + np.eye(len(scale))
        projected = design.transpose(0, 2, 1) @ e
        solved = np.linalg.solve(inner, projected[..., None])[..., 0]
        gain = 0.5 * (projected * solved).sum(axis=1) - 0.5 * np.linalg.slogdet(inner)[1]
        all_logs.append(log + gain - np.log(len(sizes)))
        means.append(sizes * solved)
        covs.append(np.linalg.inv(inner) * sizes[:, :, None] * sizes[:, None])
    flat = np.concatenate(all_logs)
    total = float(np.logaddexp.reduce(flat))
    share = np.exp(flat - total)
    mean_of, cov_of = np.concatenate(means), np.concatenate(covs)
    mean = share @ mean_of
    off = mean_of - mean
    cov = np.einsum("l,lij->ij", share, cov_of + off[:, :, None] * off[:, None])
    return Estimate(total, mean, cov, share.reshape(len(predictions), -1).sum(axis=0))


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
    predictions: Sequence[Prediction], shift: Shift, cause: Cause, alone: Estimate, row: Integers
) -> tuple[float, int]:
    """Log evidence of a cause combined with an outlier, at the size of the cause alone, and the row of the outlier."""
    level = float(LEVELS[int(np.argmax(alone.level))])
    numbers, scatter = np.unique(row), sum(p.weight * p.scatter for p in predictions)
    logs = []
    for number in numbers.tolist():
        entries = np.flatnonzero(row == number)
        outlier = np.eye(len(row))[:, entries]
        both = Shift(np.concatenate([shift.columns, outlier], axis=1), shift.offset)
        scale = np.concatenate([cause.scale * level, np.full(len(entries), _OUTLIER_UNITS * scatter)])
        log = _estimate(
            predictions, both, scale, _OUTLIER_LEVELS[:, None] ** (np.arange(len(scale)) >= len(cause.scale))
        )
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


def _joint_estimates(predictions: Sequence[Prediction], columns: Mapping[Cause, Shift]) -> dict[Cause, Estimate]:
    """Estimate each pair and each triple of causes that has fewer parameters than readings."""
    estimates = {}
    for members in (*combinations(columns, 2), *combinations(columns, 3)):
        joint = Cause("pair" if len(members) == 2 else "triple", members=members)
        if len(joint.scale) >= len(predictions[0].excess):
            continue
        grid = list(product(_MEMBER_LEVELS, repeat=len(members)))
        levels = np.repeat(grid, [len(member.scale) for member in members], axis=1)
        shifts = [columns[member] for member in members]
        shift = Shift(np.concatenate([s.columns for s in shifts], axis=1), np.sum([s.offset for s in shifts], axis=0))
        estimates[joint] = _estimate(predictions, shift, joint.scale, levels)
    return estimates
