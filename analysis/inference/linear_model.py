"""Bayesian linear regression with independent coefficients and noise by band.

    y = X b + e        b ~ N(m, V), V = diag(v)        e ~ N(0, N), N = diag(noise of the band of each reading)

A column of X is anything that may contribute to the readings y, with the prior of its coefficient: an effect, a set-up,
scatter between runs, a smooth unknown function. With C = N + X V X' the covariance of the readings, Ω = C⁻¹ and
r = y − X m, every result follows from Ω:

    log p(y) = −½ [r'Ωr + log det C + n log 2π]            Rasmussen and Williams (2006), equation 2.30
    score s = X'Ωr, information D = X'ΩX
    mean of b = m + V s, covariance A = V − V D V           the same, equations 2.11 and 2.12
    slope by log v_j = ½ v_j (s_j² − D_jj)                  the same, equation 5.9; MacKay (1992)
    slope by log noise = ½ Σ noise [(Ωr)_i² − Ω_ii], i in the band
    errors of left-out readings g = (Ω_gg)⁻¹ (Ωr)_g         the same, equations 5.10 to 5.12
    cavity of coefficients f: Λ = (A_ff)⁻¹ − (V_f)⁻¹        Opper and Winther (2000)

`condition` factors one of two matrices, mostly the smaller: I + √V X'N⁻¹X √V (p, p), from the products of each band, or
C (n, n).

    C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine Learning (2006)
    D. J. C. MacKay, Bayesian Interpolation, Neural Computation 4 (1992)
    M. Opper, O. Winther, Gaussian Processes for Classification: Mean-Field Algorithms, Neural Computation 12 (2000)
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Readings: TypeAlias = NDArray[np.float64]
"""One value (n,) for each reading."""
Design: TypeAlias = NDArray[np.float64]
"""Change (n, p) of the readings by each coefficient."""
Coefficients: TypeAlias = NDArray[np.float64]
"""One value (p,) for each column of the design."""
ByBand: TypeAlias = NDArray[np.float64]
"""One value (b,) for each band of readings with a common noise variance."""
Matrix: TypeAlias = NDArray[np.float64]
Indices: TypeAlias = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class BandProducts:
    """Products of the columns and readings of each band: all that a posterior needs of them."""

    gram: Matrix
    """X'X (b, p, p)."""
    right: Matrix
    """X'y (b, p)."""
    energy: ByBand
    """y'y."""

    def residual_energy(self, b: Coefficients) -> ByBand:
        """Squared residual |y − X b|² of each band."""
        return np.asarray(self.energy - 2 * self.right @ b + (self.gram @ b) @ b)


def band_products(X: Design, y: Readings, band: Indices) -> BandProducts:
    """Products of each band.

    >>> band_products(np.array([[1.0], [2.0], [3.0]]), np.array([1.0, 1.0, 2.0]), np.array([0, 0, 1])).gram.ravel()
    array([5., 9.])
    """
    p, bands = X.shape[1], int(band.max()) + 1
    gram, right, energy = np.empty((bands, p, p)), np.empty((bands, p)), np.empty(bands)
    for k in range(bands):
        part, values = X[band == k], y[band == k]
        np.matmul(part.T, part, out=gram[k])
        right[k], energy[k] = part.T @ values, values @ values
    return BandProducts(gram, right, energy)


@dataclass(frozen=True, eq=False)
class LinearModel:
    """Readings and the columns that may explain them."""

    X: Design
    y: Readings
    band: Indices
    """Band (n,) of each reading, from 0."""
    count: ByBand
    """Number of readings of each band."""
    products: BandProducts | None
    """None if a posterior factors C."""


def linear_model(
    X: Design, y: Readings, band: Indices | None = None, *, by_readings: bool | None = None
) -> LinearModel:
    """Model of the readings; all of them have the same noise if no bands are given.

    by_readings: factor C instead of I + √V X'N⁻¹X √V; by default if there are fewer readings than coefficients. C loses
    digits if a prior is much wider than the noise, such as that of a free constant: of sixteen digits it loses those of
    the ratio of their variances in the readings.

    >>> linear_model(np.ones((3, 1)), np.zeros(3)).count
    array([3.])
    """
    band = np.zeros(len(y), dtype=np.int64) if band is None else band
    by_readings = len(y) < X.shape[1] if by_readings is None else by_readings
    products = None if by_readings else band_products(X, y, band)
    return LinearModel(X, y, band, np.bincount(band).astype(np.float64), products)


@dataclass(frozen=True, eq=False)
class Prior:
    """Independent normal distributions of the coefficients. A variance of zero holds a coefficient at its mean."""

    mean: Coefficients
    variance: Coefficients


def zero_mean(variance: Coefficients) -> Prior:
    return Prior(np.zeros(len(variance)), variance)


@dataclass(frozen=True, eq=False)
class Gradient:
    """Slope of the log evidence by logarithms of variances."""

    by_log_noise: ByBand
    by_log_variance: Coefficients


@dataclass(frozen=True, eq=False)
class Posterior(ABC):
    """Distribution of the coefficients given the readings, with the factor of one matrix.

    Three readings of a constant of prior variance 2 with noise of variance 1: the precision is ½ + 3.

    >>> posterior = condition(linear_model(np.ones((3, 1)), np.array([1.0, 2.0, 3.0])), zero_mean(np.array([2.0])))
    >>> print(posterior.mean, posterior.covariance())
    [1.71428571] [[0.28571429]]
    """

    model: LinearModel
    prior: Prior
    noise: ByBand
    """Variance of the noise."""
    factor: Matrix
    """Lower Cholesky factor of the matrix that `condition` chose."""
    mean: Coefficients
    log_evidence: float

    @abstractmethod
    def covariance(self) -> Matrix:
        """Covariance A (p, p) of the coefficients."""

    @abstractmethod
    def covariance_among(self, columns: Indices) -> Matrix:
        """Covariances (…, q, q) among groups of columns (…, q)."""

    @abstractmethod
    def information(self, columns: Indices) -> Matrix:
        """Blocks (…, q, q) of D = X'ΩX for groups of columns (…, q): what the readings say about columns in addition to
        all others, those with a variance of their own included.
        """

    @abstractmethod
    def precision_among(self, rows: Indices) -> Matrix:
        """Block (g, g) of Ω."""

    @abstractmethod
    def freedom(self) -> ByBand:
        """Degrees of freedom of each band that the coefficients leave to the noise: Σ noise Ω_ii.

        >>> condition(linear_model(np.ones((3, 1)), np.zeros(3)), zero_mean(np.array([1e9]))).freedom().round(6)
        array([2.])
        """

    @abstractmethod
    def gradient(self) -> Gradient:
        """Slope of the log evidence.

        >>> model, prior = linear_model(np.ones((3, 1)), np.array([1.0, 2.0, 3.0])), zero_mean(np.array([2.0]))
        >>> step = condition(model, prior, np.array([np.exp(1e-6)])).log_evidence
        >>> slope = condition(model, prior).gradient().by_log_noise
        >>> bool(np.isclose((step - condition(model, prior).log_evidence) / 1e-6, slope[0], rtol=1e-4))
        True
        """

    @property
    def noise_of_readings(self) -> Readings:
        return self.noise[self.model.band]

    def residual(self) -> Readings:
        """Readings minus the contributions of all columns at their posterior means."""
        return np.asarray(self.model.y - self.model.X @ self.mean)

    def weighted_residual(self) -> Readings:
        """Ωr, which equals the residual over the variance of the noise."""
        return self.residual() / self.noise_of_readings

    def score(self) -> Coefficients:
        """Slope X'Ωr of the log evidence by the prior means."""
        return np.asarray(self.model.X.T @ self.weighted_residual())

    def predict(self, X: Design) -> tuple[Readings, Matrix]:
        """Mean and covariance of other readings with columns X, without their noise."""
        return X @ self.mean, X @ self.covariance() @ X.T


def condition(model: LinearModel, prior: Prior, noise: ByBand | None = None) -> Posterior:
    """Posterior of the coefficients for the noise variances of the bands, by default 1.

    >>> model = linear_model(np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]), np.array([1.0, 1.0, 2.0]))
    >>> condition(model, zero_mean(np.full(2, 1e6))).mean.round(3)
    array([1., 1.])
    """
    noise = np.ones(len(model.count)) if noise is None else noise
    return _by_readings(model, prior, noise) if model.products is None else _by_coefficients(model, prior, noise)


# By coefficients: with M = I + √V X'N⁻¹X √V, the covariance is A = √V M⁻¹ √V, and
# a'Ωb = a'N⁻¹b − (√V X'N⁻¹a)' M⁻¹ (√V X'N⁻¹b) (Woodbury; Rasmussen and Williams, A.9 and A.10).


@dataclass(frozen=True, eq=False)
class PosteriorByCoefficients(Posterior):
    """A posterior from the factor of I + √V X'N⁻¹X √V (p, p)."""

    products: BandProducts
    gram: Matrix
    """X'N⁻¹X (p, p)."""

    def covariance(self) -> Matrix:
        from scipy.linalg.lapack import dpotri  # noqa: PLC0415 - slow to import

        lower, _ = dpotri(self.factor, lower=True)
        inverse = np.tril(lower) + np.tril(lower, -1).T
        root = np.sqrt(self.prior.variance)
        return np.asarray(root[:, None] * inverse * root)

    def covariance_among(self, columns: Indices) -> Matrix:
        used, at = np.unique(columns, return_inverse=True)
        spread = np.zeros((len(self.mean), len(used)))
        spread[used, np.arange(len(used))] = np.sqrt(self.prior.variance[used])
        return _blocks_of_square(_solve_lower(self.factor, spread), at.reshape(columns.shape))

    def information(self, columns: Indices) -> Matrix:
        used, at = np.unique(columns, return_inverse=True)
        at = at.reshape(columns.shape)
        absorbed = _solve_lower(self.factor, np.sqrt(self.prior.variance)[:, None] * self.gram[:, used])
        whole = self.gram[columns[..., :, None], columns[..., None, :]]
        return np.asarray(whole - _blocks_of_square(absorbed, at))

    def precision_among(self, rows: Indices) -> Matrix:
        weight = 1 / self.noise_of_readings[rows]
        of_rows = np.sqrt(self.prior.variance)[:, None] * (weight[:, None] * self.model.X[rows]).T
        absorbed = _solve_lower(self.factor, of_rows)
        return np.asarray(np.diag(weight) - absorbed.T @ absorbed)

    def freedom(self) -> ByBand:
        return self._freedom(self.covariance())

    def _freedom(self, covariance: Matrix) -> ByBand:
        return np.asarray(self.model.count - np.tensordot(self.products.gram, covariance, axes=2) / self.noise)

    def gradient(self) -> Gradient:
        covariance = self.covariance()
        energy = self.products.residual_energy(self.mean) / self.noise
        squares = (self.mean - self.prior.mean) ** 2 + np.diag(covariance)
        variance = self.prior.variance
        ratio = np.divide(squares, variance, out=np.ones_like(squares), where=variance > 0)
        return Gradient(0.5 * (energy - self._freedom(covariance)), 0.5 * (ratio - 1))


def _by_coefficients(model: LinearModel, prior: Prior, noise: ByBand) -> PosteriorByCoefficients:
    from scipy.linalg import cholesky, solve_triangular  # noqa: PLC0415 - slow to import

    products = model.products
    assert products is not None  # noqa: S101 - the caller chose this side
    gram = np.tensordot(1 / noise, products.gram, axes=1)
    root = np.sqrt(prior.variance)
    M = root[:, None] * gram * root
    M[np.diag_indices_from(M)] += 1
    factor = cholesky(M, lower=True, overwrite_a=True, check_finite=False)
    right = (1 / noise) @ products.right - gram @ prior.mean
    half = solve_triangular(factor, root * right, lower=True, check_finite=False)
    mean = prior.mean + root * solve_triangular(factor, half, lower=True, trans=1, check_finite=False)
    energy = float(products.residual_energy(prior.mean) @ (1 / noise))
    log_det = 2 * float(np.log(np.diag(factor)).sum()) + float(model.count @ np.log(noise))
    log_evidence = -0.5 * (energy - float(half @ half) + log_det + len(model.y) * np.log(2 * np.pi))
    return PosteriorByCoefficients(model, prior, noise, factor, mean, log_evidence, products, gram)


# By readings: C itself is factored.


@dataclass(frozen=True, eq=False)
class PosteriorByReadings(Posterior):
    """A posterior from the factor of C (n, n)."""

    def covariance(self) -> Matrix:
        variance = self.prior.variance
        seen = _solve_lower(self.factor, self.model.X * variance)
        return np.asarray(np.diag(variance) - seen.T @ seen)

    def covariance_among(self, columns: Indices) -> Matrix:
        variance = self.prior.variance[columns]
        taken = variance[..., :, None] * self.information(columns) * variance[..., None, :]
        return np.asarray(variance[..., None] * np.eye(columns.shape[-1]) - taken)

    def information(self, columns: Indices) -> Matrix:
        used, at = np.unique(columns, return_inverse=True)
        return _blocks_of_square(_solve_lower(self.factor, self.model.X[:, used]), at.reshape(columns.shape))

    def precision_among(self, rows: Indices) -> Matrix:
        unit = np.zeros((len(self.model.y), len(rows)))
        unit[rows, np.arange(len(rows))] = 1.0
        half = _solve_lower(self.factor, unit)
        return np.asarray(half.T @ half)

    def freedom(self) -> ByBand:
        inverse_root = _solve_lower(self.factor, np.eye(len(self.model.y)))
        left = self.noise_of_readings * (inverse_root**2).sum(axis=0)
        return np.asarray(np.bincount(self.model.band, left, len(self.noise)), dtype=np.float64)

    def gradient(self) -> Gradient:
        inverse_root = _solve_lower(self.factor, np.eye(len(self.model.y)))
        weighted, X = self.weighted_residual(), self.model.X
        of_noise = self.noise_of_readings * (weighted**2 - (inverse_root**2).sum(axis=0))
        information = ((inverse_root @ X) ** 2).sum(axis=0)
        by_log_variance = 0.5 * self.prior.variance * ((X.T @ weighted) ** 2 - information)
        by_log_noise = 0.5 * np.bincount(self.model.band, of_noise, len(self.noise))
        return Gradient(np.asarray(by_log_noise, dtype=np.float64), by_log_variance)


def _by_readings(model: LinearModel, prior: Prior, noise: ByBand) -> PosteriorByReadings:
    from scipy.linalg import cholesky, solve_triangular  # noqa: PLC0415 - slow to import

    C = (model.X * prior.variance) @ model.X.T
    C[np.diag_indices_from(C)] += noise[model.band]
    factor = cholesky(C, lower=True, overwrite_a=True, check_finite=False)
    half = solve_triangular(factor, model.y - model.X @ prior.mean, lower=True, check_finite=False)
    weighted = solve_triangular(factor, half, lower=True, trans=1, check_finite=False)
    log_det = 2 * float(np.log(np.diag(factor)).sum())
    log_evidence = -0.5 * (float(half @ half) + log_det + len(model.y) * np.log(2 * np.pi))
    mean = prior.mean + prior.variance * (model.X.T @ weighted)
    return PosteriorByReadings(model, prior, noise, factor, mean, log_evidence)


def _solve_lower(factor: Matrix, right: Matrix) -> Matrix:
    from scipy.linalg import solve_triangular  # noqa: PLC0415 - slow to import

    return solve_triangular(factor, right, lower=True, check_finite=False)


def _blocks_of_square(root: Matrix, columns: Indices) -> Matrix:
    """Blocks (…, q, q) of root'root for groups of columns (…, q)."""
    if columns.ndim == 1:
        part = root[:, columns]
        return np.asarray(part.T @ part)
    parts = root.T[columns]
    return np.asarray(parts @ np.swapaxes(parts, -1, -2))


# Questions to a posterior.


@dataclass(frozen=True, eq=False)
class Cavity:
    """Likelihood exp(η'b − ½ b'Λb) of coefficients: what the readings say about them without their own prior."""

    precision: Matrix
    """Λ (…, q, q)."""
    shift: Matrix
    """η (…, q)."""


def cavity(posterior: Posterior, columns: Indices) -> Cavity:
    """Cavities of groups of columns (…, q), whose variances are all zero or all positive in each group.

    Three readings of a constant with noise of variance 1 have precision 3 and weighted sum 6, whatever the prior:

    >>> for variance in (0.0, 2.0):
    ...     model = linear_model(np.ones((3, 1)), np.array([1.0, 2.0, 3.0]))
    ...     likelihood = cavity(condition(model, zero_mean(np.array([variance]))), np.array([0]))
    ...     print(likelihood.precision.round(9), likelihood.shift.round(9))
    [[3.]] [6.]
    [[3.]] [6.]
    """
    variance, prior_mean = posterior.prior.variance[columns], posterior.prior.mean[columns]
    is_held = (variance == 0).all(axis=-1)
    precision, shift = np.empty((*columns.shape, columns.shape[-1])), np.empty(columns.shape)
    if is_held.any():
        held = columns[is_held]
        precision[is_held] = posterior.information(held)
        shift[is_held] = posterior.score()[held] + np.einsum(
            "...ij,...j->...i", precision[is_held], prior_mean[is_held]
        )
    if not is_held.all():
        free = columns[~is_held]
        inverse = np.linalg.inv(posterior.covariance_among(free))
        prior_precision = 1 / variance[~is_held]
        precision[~is_held] = inverse - prior_precision[..., None] * np.eye(columns.shape[-1])
        shift[~is_held] = np.einsum("...ij,...j->...i", inverse, posterior.mean[free])
        shift[~is_held] -= prior_precision * prior_mean[~is_held]
    return Cavity(precision, shift)


def log_bayes_factor(likelihood: Cavity, variances: Matrix) -> Matrix:
    """Log evidence (…, s) of coefficients N(0, v) with a common variance, for each of the variances (…, s), relative to
    coefficients of zero.

    With Λ = R diag(λ) R' and ε = R'η it is ½ Σ_j [ε_j² / (λ_j + 1/v) − log(1 + v λ_j)] (Wakefield, Am. J. Hum. Genet.
    81, 2007; Wang and others, J. R. Stat. Soc. B 82, 2020, for single coefficients).

    >>> log_bayes_factor(Cavity(np.array([[3.0]]), np.array([6.0])), np.array([2.0])).round(6)
    array([4.169902])
    """
    values, axes = np.linalg.eigh(likelihood.precision)
    along = np.einsum("...ji,...j->...i", axes, likelihood.shift)
    values, v = np.maximum(values, 0.0)[..., None, :], variances[..., :, None]
    each = along[..., None, :] ** 2 * v / (1 + v * values) - np.log1p(v * values)
    return np.asarray(0.5 * each.sum(axis=-1))


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Errors (g,) of predictions of readings from all others, and their covariance (g, g) with the readings' noise."""

    error: Readings
    covariance: Matrix

    @property
    def chi_square(self) -> float:
        return float(self.error @ np.linalg.solve(self.covariance, self.error))


def left_out(posterior: Posterior, rows: Indices) -> LeftOut:
    """Predict a group of readings from all others, without a new fit.

    The mean of two readings of a constant predicts the third:

    >>> model = linear_model(np.ones((3, 1)), np.array([1.0, 2.0, 3.0]))
    >>> left_out(condition(model, zero_mean(np.array([1e9]))), np.array([2])).error.round(6)
    array([1.5])
    """
    covariance = np.asarray(np.linalg.inv(posterior.precision_among(rows)))
    return LeftOut(covariance @ posterior.weighted_residual()[rows], covariance)
