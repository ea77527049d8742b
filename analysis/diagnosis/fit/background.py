"""Background: all unnamed contributions as a normal distribution, and free-form errors."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from weakref import WeakKeyDictionary

import numpy as np

from analysis.diagnosis.fit.candidates import LARGEST_FAULT, BandWeights, Columns, Form, Level, fault_sizes
from analysis.diagnosis.fit.responses import Response
from analysis.diagnosis.fit.triangles import double_triangle
from analysis.robot.kinematics.arm import Array, Integers

# ----------------------------------------------------------------------------------------------------------------------
# Background: all unnamed contributions as a normal distribution: noise, set-ups, scatter between runs, and a healthy
# share of every effect.
#
# The covariance of the readings is C = W⁻¹ + X V X', with W the weights of the noise (lower in bands with a residual
# above the noise) and V the prior variances of all columns. With M = I + √V X'WX √V,
#
# a'C⁻¹b = a'Wb - (√V X'Wa)' M⁻¹ (√V X'Wb),    A = √V M⁻¹ √V the posterior covariance of all coefficients.
#
# The columns contribute X m at their prior means m, which is subtracted from the readings first.
#
# The possible size of a single form follows from its cavity (Λ, η): the information of the readings about it, excluding
# the prior.


@dataclass(frozen=True, eq=False)
class MarginalValues:
    """Values (N, k) prepared for products with C⁻¹: weights (N,) of the noise, and the part `absorbed` (p, k) by the
    columns.
    """

    values: Array
    weight: Array
    absorbed: Array

    @cached_property
    def weighted(self) -> Array:
        return self.weight[:, None] * self.values

    def products(self, right: MarginalValues) -> Array:
        """values' C⁻¹ right (k, l)."""
        return self.values.T @ right.weighted - self.absorbed.T @ right.absorbed


@dataclass(frozen=True, eq=False)
class FittedTerms:
    """Terms fitted in addition to the background: q columns in responses."""

    r: Array
    """Whitened residual (N,) of the model at zero terms."""
    responses: tuple[Response, ...]
    precision: Array
    """Prior precision (q, q)."""
    mean: Array
    """Prior mean (q,)."""
    held: Array
    """Values (q,) of terms at a limit, with unchanged uncertainty, NaN for all others."""

    @cached_property
    def with_residual(self) -> Array:
        """Columns and, last, the residual (N, q + 1)."""
        return np.concatenate([*(response.columns for response in self.responses), self.r[:, None]], axis=1)

    @property
    def T(self) -> Array:  # noqa: N802 - a matrix
        return self.with_residual[:, :-1]

    def best(self, normal: Array, right: Array) -> Array:
        """Solve normal (q, q) times terms = right (q,), with the terms at limits fixed."""
        free, terms = np.isnan(self.held), self.held.copy()
        right_free = right[free] - normal[np.ix_(free, ~free)] @ terms[~free]
        terms[free] = np.linalg.solve(normal[np.ix_(free, free)], right_free)
        return terms


@dataclass
class Work:
    """Number of the computations that take most of the time of a diagnosis."""

    factors: int = 0
    """Cholesky factors of the background."""
    fits: int = 0
    """Fits of effects on the simulator."""


@dataclass(frozen=True, eq=False)
class Background:
    """Background of a state."""

    columns: Columns
    weight: Array
    """Noise weights (N,) of the readings."""
    variance: Array
    """Prior variances (p,) of all coefficients."""
    mean: Array
    """Prior means (p,)."""
    weighted_gram: Callable[[], Array]
    """Computes X'WX (p, p) for the factor, so that a cached background does not store it."""
    work: Work = field(default_factory=Work, repr=False)
    _latest: list[tuple[FittedTerms, Array, Array]] = field(default_factory=list, init=False, repr=False)
    _marginals: WeakKeyDictionary[Response, MarginalValues] = field(
        default_factory=WeakKeyDictionary, init=False, repr=False
    )

    @cached_property
    def _root(self) -> Array:
        return np.sqrt(self.variance)

    @cached_property
    def _weights(self) -> BandWeights:
        return self.columns.by_band(self.weight)

    @cached_property
    def _chol(self) -> Array:
        from scipy.linalg import cholesky  # noqa: PLC0415 - slow to import

        self.work.factors += 1
        M = self._root[:, None] * self.weighted_gram()
        M *= self._root
        M[np.diag_indices_from(M)] += 1.0
        return cholesky(M, lower=True, overwrite_a=True, check_finite=False)

    @cached_property
    def pull(self) -> Array:
        """Prior means over prior variances (p,), the contribution of the prior to η."""
        return np.divide(self.mean, self.variance, out=np.zeros_like(self.mean), where=self.variance > 0)

    @cached_property
    def at_mean(self) -> Array:
        """Contribution (N,) of the columns to the readings at their prior means."""
        return self.columns.X @ self.mean

    def marginal(self, values: Array) -> MarginalValues:
        # this order of products takes a third of the time
        return MarginalValues(values, self.weight, self._absorbed((self.weight[:, None] * values).T @ self.columns.X))

    def _absorbed(self, products: Array) -> Array:
        """The part (p, k) of values absorbed by the columns, given their products (k, p) with the weighted columns."""
        from scipy.linalg import solve_triangular  # noqa: PLC0415 - slow to import

        right = self._root[:, None] * products.T
        return solve_triangular(self._chol, right, lower=True, overwrite_b=True, check_finite=False)

    @cached_property
    def _absorbed_mean(self) -> Array:
        return self._absorbed((self.weighted_gram() @ self.mean)[None])

    def _prepare(self, responses: Sequence[Response]) -> list[MarginalValues]:
        """Prepare responses for products, all new ones together."""
        new = [response for response in dict.fromkeys(responses) if response not in self._marginals]
        if new:
            together = self._absorbed(self.columns.weighted_products(new, self._weights))
            ends = np.cumsum([response.columns.shape[1] for response in new])[:-1]
            for response, absorbed in zip(new, np.split(together, ends, axis=1), strict=True):
                self._marginals[response] = MarginalValues(response.columns, self.weight, absorbed)
        return [self._marginals[response] for response in responses]

    def marginal_residual(self, residual: Array) -> MarginalValues:
        """Prepare a whitened residual (N,) minus the readings at the prior means, as (N, 1). The part without prior
        means is cached while the residual is in use.
        """
        (whole,) = self._prepare([self.columns.response_of(residual)])
        values = residual - self.at_mean
        return MarginalValues(values[:, None], self.weight, whole.absorbed - self._absorbed_mean)

    def marginal_responses(self, responses: Sequence[Response]) -> MarginalValues:
        parts = self._prepare(responses)
        if len(parts) == 1:
            return parts[0]
        values = [np.empty((len(self.weight), 0)), *(part.values for part in parts)]
        absorbed = [np.empty((len(self.variance), 0)), *(part.absorbed for part in parts)]
        return MarginalValues(np.concatenate(values, axis=1), self.weight, np.concatenate(absorbed, axis=1))

    def marginal_terms(self, terms: FittedTerms) -> tuple[Array, Array]:
        """Products with C⁻¹ (q + 1, q + 1) of fitted terms and, last, their residual at the prior means, and the part
        (p, q + 1) absorbed by the columns. The latest are cached: a state's evidence and posterior both need them.
        """
        if not self._latest or self._latest[0][0] is not terms:
            parts = self._prepare([*terms.responses, self.columns.response_of(terms.r)])
            absorbed = np.concatenate([part.absorbed for part in parts], axis=1)
            absorbed[:, -1:] -= self._absorbed_mean
            products = self.columns.products_among(terms.with_residual, self._weights) - absorbed.T @ absorbed
            across = (self.weight * self.at_mean) @ terms.with_residual
            products[-1] -= across
            products[:, -1] -= across
            products[-1, -1] += self.weight @ self.at_mean**2
            self._latest[:] = [(terms, products, absorbed)]
        return self._latest[0][1:]

    def absorbed_coefficients(self, absorbed: Array) -> Array:
        """Coefficients (p, k) with which the columns absorb values, given their absorbed part (p, k)."""
        from scipy.linalg import solve_triangular  # noqa: PLC0415 - slow to import

        back = solve_triangular(self._chol, absorbed, lower=True, trans=1, check_finite=False)
        return self._root[:, None] * back

    def scores(self, values: MarginalValues) -> Array:
        """Products (p, k) with C⁻¹ of the columns with values (N, k)."""
        gram, taken = self.weighted_gram(), self.absorbed_coefficients(values.absorbed)
        return np.asarray(self.columns.X.T @ values.weighted - gram @ taken)

    @cached_property
    def information(self) -> Array:
        """Products (p, p) of the columns with C⁻¹: what the readings say about each, beside all others."""
        gram = self.weighted_gram()
        absorbed = self._absorbed(gram)
        return np.asarray(gram - absorbed.T @ absorbed)

    @property
    def logdet(self) -> float:
        return 2 * float(np.log(np.diag(self._chol)).sum()) - float(np.log(self.weight).sum())

    @cached_property
    def covariance(self) -> Array:
        """Posterior covariance A (p, p) of all coefficients, excluding fitted terms."""
        from scipy.linalg.lapack import dpotri  # noqa: PLC0415 - slow to import

        lower, _ = dpotri(self._chol, lower=True)
        covariance: Array = lower + lower.T  # the factor is zero above its diagonal, and stays so
        np.fill_diagonal(covariance, np.diag(lower))
        covariance *= self._root[:, None]
        covariance *= self._root
        return covariance

    @cached_property
    def variances(self) -> Array:
        """Diagonal (p,) of the covariance, at half the cost unless the full matrix exists."""
        if "covariance" in vars(self):  # location of a computed cached property
            return np.diag(self.covariance)
        from scipy.linalg.lapack import dtrtri  # noqa: PLC0415 - slow to import

        inverse, _ = dtrtri(self._chol, lower=True)
        return np.asarray(self.variance * np.einsum("kj,kj->j", inverse, inverse), dtype=float)

    def covariance_times(self, vector: Array) -> Array:
        return self.absorbed_coefficients(self._absorbed(vector[None]))[:, 0]

    @cached_property
    def spent(self) -> Array:
        """Energy of each band (b,), in noise variances, that the uncertainty of the coefficients hides."""
        return np.asarray(self.columns.K @ double_triangle(self.covariance), dtype=float)

    @cached_property
    def weighted_spent(self) -> Array:
        """`spent`, weighted by the noise."""
        if len(self.columns.count) > 1:
            return self.columns.weighted_spent(self.weight, self.covariance)
        # The trace of X'WX A is that of I - M⁻¹, which needs only the variances.
        free = self.variance > 0
        return np.array([np.sum(1 - self.variances[free] / self.variance[free])])

    def posterior(self, terms: FittedTerms) -> CoefficientPosterior:
        return CoefficientPosterior(self, terms)

    def evidence(self, terms: FittedTerms) -> float:
        """Log density of the readings with fitted terms, up to a constant."""
        q = len(terms.mean)
        products, _ = self.marginal_terms(terms)
        normal = products[:q, :q] + terms.precision
        right = products[:q, q] + terms.precision @ terms.mean
        best = terms.best(normal, right)
        cost = products[q, q] + terms.mean @ terms.precision @ terms.mean - (2 * right - normal @ best) @ best
        occam = np.linalg.slogdet(normal)[1] - np.linalg.slogdet(terms.precision)[1] + self.logdet
        return -0.5 * float(cost + occam)


@dataclass(frozen=True)
class Gains:
    """Gain of n forms over their part of the background, each fitted together with all other terms."""

    fault: Array
    """Log evidence as a fault."""
    healthy: Array
    """Log evidence as the only form of healthy size."""
    sigma: Array
    """Significance of a healthy size."""
    size: Array
    """Size shown by the readings, in healthy sizes."""


class Coefficients(ABC):
    """Normal distribution of all coefficients of the columns, given the readings."""

    background: Background

    @property
    @abstractmethod
    def mean(self) -> Array:
        """Means (p,), in healthy sizes."""

    @abstractmethod
    def covariance_among(self, columns: Integers) -> Array:
        """Covariances (…, q, q) among columns (…, q) of the background, in healthy sizes squared."""

    def gains(self, forms: Sequence[Form], level: Level) -> Gains:
        gains = Gains(*np.full((2, len(forms)), -np.inf), *np.zeros((2, len(forms))))
        alike = np.array([(len(form.columns), level.of(form.effect)) for form in forms]).reshape(-1, 2)
        usual_variance = self.background.columns.usual_variance(level)
        for width, of_these in np.unique(alike, axis=0).tolist():
            q, members = int(width), np.flatnonzero((alike == (width, of_these)).all(axis=1))
            cols = np.array([forms[k].columns for k in members.tolist()])
            is_free = (self.background.variance[cols] > 0).all(axis=1)
            members, cols = members[is_free], cols[is_free]
            inverse, precision = self._inverse_and_cavity(cols)
            eta = np.einsum("nij,nj->ni", inverse, self.mean[cols]) - self.background.pull[cols]
            values, axes = np.linalg.eigh(precision)
            values = np.maximum(values, 0.0)
            eta_along, mean_along = (np.einsum("nij,ni->nj", axes, v) for v in (eta, self.background.mean[cols]))
            usual = np.minimum(self.background.variance[cols], usual_variance[cols]).mean(axis=1)[:, None]
            share = cavity_evidence(values, (eta_along - values * mean_along) ** 2, usual)
            share += np.sum(eta_along * mean_along - 0.5 * values * mean_along**2, axis=1)
            gains.fault[members] = fault_evidence(values, eta_along**2, of_these) - share
            gains.healthy[members] = cavity_evidence(values, eta_along**2, of_these**2 / q) - share
            gains.sigma[members] = np.sqrt(values.max(axis=1))
            shown = np.divide(eta_along, values, out=np.zeros_like(values), where=values > 0)
            gains.size[members] = np.linalg.norm(shown, axis=1)
            if q == 1:
                one_sided = np.array([forms[k].one_sided for k in members.tolist()], dtype=bool)
                wrong_way = members[one_sided & (eta[:, 0] < 0)]
                gains.fault[wrong_way] = gains.healthy[wrong_way] = -np.inf
        return gains

    def size(self, form: Form) -> Array:
        """Coefficients (q,), in healthy sizes, of a form as a fault."""
        cols = np.array(form.columns)
        inverse, precision = self._inverse_and_cavity(cols)
        eta = inverse @ self.mean[cols] - self.background.pull[cols]
        return np.linalg.solve(precision + np.eye(len(cols)) / LARGEST_FAULT**2, eta)

    def _inverse_and_cavity(self, columns: Integers) -> tuple[Array, Array]:
        """Inverse covariance (…, q, q) among columns (…, q), and the same minus their prior precision."""
        inverse = np.asarray(np.linalg.inv(self.covariance_among(columns)), dtype=float)
        precision, diagonal = inverse.copy(), np.arange(columns.shape[-1])
        precision[..., diagonal, diagonal] -= 1 / self.background.variance[columns]
        return inverse, precision


@dataclass(frozen=True, eq=False)
class CoefficientPosterior(Coefficients):
    """Posterior of all coefficients of the columns together with fitted terms."""

    background: Background
    terms: FittedTerms

    @cached_property
    def _marginal(self) -> tuple[Array, Array]:
        return self.background.marginal_terms(self.terms)

    def _products_with(self, marginal: MarginalValues) -> Array:
        """Products (q + 1, k) with C⁻¹ of the fitted terms and, last, the residual with values (N, k)."""
        products = self.terms.with_residual.T @ marginal.weighted - self._marginal[1].T @ marginal.absorbed
        products[-1] -= self.background.at_mean @ marginal.weighted
        return products

    @cached_property
    def _normal(self) -> Array:
        return self._marginal[0][:-1, :-1] + self.terms.precision

    @cached_property
    def term_covariance(self) -> Array:
        return np.asarray(np.linalg.inv(self._normal), dtype=float)

    @cached_property
    def term_means(self) -> Array:
        return self.terms.best(self._normal, self._marginal[0][:-1, -1] + self.terms.precision @ self.terms.mean)

    @cached_property
    def _coefficients(self) -> tuple[Array, Array]:
        """Coefficients with which the columns absorb the fitted terms (p, q), and the residual (p,)."""
        coefficients = self.background.absorbed_coefficients(self._marginal[1])
        return coefficients[:, :-1], coefficients[:, -1]

    @property
    def _taken(self) -> Array:
        return self._coefficients[0]

    @cached_property
    def mean(self) -> Array:
        return self.background.mean + self._coefficients[1] - self._taken @ self.term_means

    @cached_property
    def variance(self) -> Array:
        return np.asarray(
            self.background.variances + np.sum(self._taken @ self.term_covariance * self._taken, axis=1), dtype=float
        )

    def covariance_among(self, columns: Integers) -> Array:
        taken = self._taken[columns]
        without_terms = self.background.covariance[columns[..., :, None], columns[..., None, :]]
        return without_terms + taken @ self.term_covariance @ np.swapaxes(taken, -1, -2)

    def joint(self, columns: int, fitted: int) -> tuple[Array, Array]:
        """Mean (f + c,) and covariance of the first `fitted` terms, then of the first `columns` of the background, in
        healthy sizes.
        """
        among_terms, taken = self.term_covariance[:fitted], self._taken[:columns]
        across = -among_terms @ taken.T
        below = self.background.covariance[:columns, :columns] + taken @ self.term_covariance @ taken.T
        mean = np.concatenate([self.term_means[:fitted], self.mean[:columns]])
        return mean, np.block([[among_terms[:, :fitted], across], [across.T, below]])

    def covariance_times(self, vector: Array) -> Array:
        of_terms: Array = self._taken @ (self.term_covariance @ (vector @ self._taken))
        return self.background.covariance_times(vector) + of_terms

    @cached_property
    def residual(self) -> Array:
        """Whitened residual (N,) with all coefficients at their means."""
        return self.terms.r - self.terms.T @ self.term_means - self.background.columns.X @ self.mean

    @cached_property
    def spent(self) -> Array:
        """Energy of each band (b,), in noise variances, that the uncertainty of all coefficients hides."""
        return self.background.spent + np.bincount(self.background.columns.band, self._of_terms)

    def prediction_errors(self, rows: Integers) -> tuple[Array, Array]:
        """Prediction errors (n,) of whitened rows (n,) from all others, and their covariance excluding the noise of the
        readings.

        With C the covariance of the readings, the residuals are (C⁻¹)_rows⁻¹ (C⁻¹ y)_rows and their covariance is
        (C⁻¹)_rows⁻¹ (Rasmussen and Williams, 2006, 5.4.2). The influence of the rows on fitted sizes and widths is not
        removed.
        """
        background, weight = self.background, self.background.weight[rows]
        X = background.columns.X[rows]
        terms = self.terms.T[rows] - X @ self._taken
        modelled = X @ background.covariance @ X.T + terms @ self.term_covariance @ terms.T
        covariance = np.linalg.inv(np.diag(weight) - weight[:, None] * modelled * weight)
        missed: Array = covariance @ (weight * self.residual[rows])
        return missed, np.asarray(covariance - np.diag(1 / weight), dtype=float)

    @cached_property
    def weighted_spent(self) -> Array:
        """`spent`, weighted by the noise."""
        background = self.background
        return background.weighted_spent + np.bincount(background.columns.band, background.weight * self._of_terms)

    @cached_property
    def _of_terms(self) -> Array:
        """Variances (N,) of the readings due to the fitted terms, after absorption by the columns."""
        remainder = self.terms.T - self.background.columns.X @ self._taken
        return np.asarray(np.sum(remainder @ self.term_covariance * remainder, axis=1), dtype=float)

    @property
    def residual_at_prior(self) -> Array:
        """Whitened residual (N,) of the fitted effects, with the background at its prior means."""
        return self.terms.r - self.background.at_mean

    @property
    def healthy_share(self) -> Array:
        """Contribution (N,) of the effect forms at their posterior means."""
        forms = self.background.columns.set_ups.start
        return self.background.columns.X[:, :forms] @ self.mean[:forms]

    def as_coefficients(self) -> ResizedCoefficients:
        """The same distribution as a matrix, whose prior variances can be changed."""
        of_terms = self._taken @ self.term_covariance @ self._taken.T
        return ResizedCoefficients(self.background, self.mean, self.background.covariance + of_terms)

    def cavity(self, columns: Array) -> tuple[Array, Array]:
        """Information of the readings about whitened columns (N, q), fitted together with all other terms: precision Λ
        (q, q) and vector η (q,).
        """
        marginal = self.background.marginal(columns)
        across = self._products_with(marginal)
        with_terms, eta = across[:-1], across[-1] - self.term_means @ across[:-1]
        precision: Array = marginal.products(marginal) - with_terms.T @ self.term_covariance @ with_terms
        return precision, eta

    def cavities_within_limits(self, responses: Sequence[Response]) -> list[tuple[Array, Array]]:
        """The same for the columns of each response apart, with the terms at limits fixed as in the evidence."""
        self.background.marginal_responses(responses)  # all together
        free = np.isnan(self.terms.held)
        covariance = np.linalg.inv(self._normal[np.ix_(free, free)])
        cavities = []
        for response in responses:
            marginal = self.background.marginal_responses([response])
            across = self._products_with(marginal)
            with_terms, eta = across[:-1][free], across[-1] - self.term_means @ across[:-1]
            cavities.append((marginal.products(marginal) - with_terms.T @ covariance @ with_terms, eta))
        return cavities

    def without_absorbed(self, columns: Array) -> Array:
        """The part of added whitened columns (N, q) that all other terms do not absorb."""
        marginal = self.background.marginal(columns)
        terms = self.term_covariance @ self._products_with(marginal)[:-1]
        taken = self.background.absorbed_coefficients(marginal.absorbed) - self._taken @ terms
        return columns - self.terms.T @ terms - self.background.columns.X @ taken


@dataclass(frozen=True, eq=False)
class ResizedCoefficients(Coefficients):
    """Posterior with changed prior variances of a few coefficients, without a new factor."""

    background: Background
    means: Array
    covariance: Array
    """Covariance (p, p) of all coefficients."""

    @property
    def mean(self) -> Array:
        return self.means

    def covariance_among(self, columns: Integers) -> Array:
        return np.asarray(self.covariance[columns[..., :, None], columns[..., None, :]], dtype=float)

    def with_fault(self, form: Form) -> ResizedCoefficients:
        """The posterior if a form has the wide prior of a fitted effect: a change of rank q of the inverse covariance
        (Woodbury).
        """
        cols = np.array(form.columns)
        before, mean_before = self.background.variance[cols], self.background.mean[cols]
        change = 1 / LARGEST_FAULT**2 - 1 / before
        across = self.covariance[:, cols]
        inner = np.diag(1 / change) + across[cols]
        covariance = self.covariance - across @ np.linalg.solve(inner, across.T)
        mean = self.mean - covariance[:, cols] @ (mean_before / before + change * self.mean[cols])
        variance, prior_mean = self.background.variance.copy(), self.background.mean.copy()
        variance[cols], prior_mean[cols] = LARGEST_FAULT**2, 0.0
        return ResizedCoefficients(replace(self.background, variance=variance, mean=prior_mean), mean, covariance)


def background_of(columns: Columns, weight: Array, variance: Array, mean: Array | None = None) -> Background:
    mean = np.zeros(len(variance)) if mean is None else mean
    return Background(columns, weight, variance, mean, partial(columns.weighted_gram, weight))


def fault_evidence(values: Array, seen: Array, level: float) -> Array:
    """Log evidence (…) of cavities for a fault of any size over no fault. `values`, `seen` (…, q): eigenvalues of the
    precision, and squares of η along the eigenvectors.
    """
    each = np.stack([cavity_evidence(values, seen, size**2 / values.shape[-1]) for size in fault_sizes(level)])
    top = each.max(axis=0)
    return np.asarray(top + np.log(np.exp(each - top).mean(axis=0)), dtype=float)


def cavity_evidence(values: Array, seen: Array, variance: Array | float) -> Array:
    """Log evidence F(V) (…) of cavities for a prior variance V; arguments as of `fault_evidence`."""
    return np.asarray(0.5 * (seen / (values + 1 / variance) - np.log1p(variance * values)).sum(axis=-1), dtype=float)
