"""Evidence of causes given the posterior of a reference, in a linear Gaussian model.

The reference conditions the arm constants, the set-ups and the unexplained part; the remaining covariance is correlated
noise of the new readings. Scatter and sizes of the errors are marginalised on a grid, weighted by the evidence of the
reference. An outlier is a separate hypothesis, so that a bad touch neither creates nor hides a cause.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from analysis.movement.causes import LEVELS, Cause
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
OUTLIER_ODDS = 0.01
"""Prior probability of an outlier in the new readings: a ball not seated, a disturbed tracker. Chosen."""
OTHER_LEVELS = np.array([3.0, 10.0, 30.0, 100.0, 300.0])
"""Multiples of the scatter for changes explained by neither causes nor noise."""
MEMBER_LEVELS = LEVELS[:3]
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
        """Scatter in mm per coordinate for the commonest kind of reading, averaged over the scenarios."""
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
