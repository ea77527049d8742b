"""Background: all unnamed contributions as a normal distribution, and free-form errors.

The unnamed contributions are the noise, the set-ups, the scatter between runs, and the small part of every effect that
each healthy arm has.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from weakref import WeakKeyDictionary

import numpy as np

from analysis.diagnosis.fit.candidates import LARGEST_FAULT, BandWeights, Columns, Form, Level, fault_sizes
from analysis.diagnosis.fit.responses import Response
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
    """Values (N, k) with the data for products with C⁻¹, marginal over the coefficients of a background: the weights
    (N,) of the noise, and `absorbed` (p, k), the part absorbed by the columns.
    """

    values: Array
    weight: Array
    absorbed: Array

    @cached_property
    def weighted(self) -> Array:
        """Values (N, k) weighted by the noise."""
        return self.weight[:, None] * self.values

    def products(self, right: MarginalValues) -> Array:
        """Return the products (k, l) values' C⁻¹ right of whitened values (N, k) and (N, l)."""
        return self.values.T @ right.weighted - self.absorbed.T @ right.absorbed


@dataclass(frozen=True, eq=False)
class MarginalTerms:
    """Fitted terms and, last, their residual at the prior means: products with C⁻¹ (q + 1, q + 1), and the part (p,
    q + 1) absorbed by the columns.
    """

    products: Array
    absorbed: Array


@dataclass(frozen=True, eq=False)
class FittedTerms:
    """Terms fitted in addition to the background: q columns in responses, with prior precision (q, q) and prior mean
    (q,), and the residual r (N,) of the model at zero terms.

    `held` (q,): values of terms at a limit, with unchanged uncertainty, NaN for all others. Readings are whitened.
    """

    r: Array
    responses: tuple[Response, ...]
    precision: Array
    mean: Array
    held: Array

    @cached_property
    def with_residual(self) -> Array:
        """Columns and, last, the residual (N, q + 1)."""
        return np.concatenate([*(response.columns for response in self.responses), self.r[:, None]], axis=1)

    @property
    def T(self) -> Array:  # noqa: N802 - a matrix
        """Columns (N, q)."""
        return self.with_residual[:, :-1]

    def best(self, normal: Array, right: Array) -> Array:
        """Solve normal (q, q) times terms = right (q,) for whitened columns, with the terms at limits fixed."""
        free, terms = np.isnan(self.held), self.held.copy()
        right_free = right[free] - normal[np.ix_(free, ~free)] @ terms[~free]
        terms[free] = np.linalg.solve(normal[np.ix_(free, free)], right_free)
        return terms


@dataclass(frozen=True, eq=False)
class Background:
    """Background of a state: noise weights (N,) of the readings, prior variances and means (p,) of all coefficients.

    `weighted_gram` computes X'WX (p, p). It is needed only for the factor, so that a cached background does not store
    it.
    """

    columns: Columns
    weight: Array
    variance: Array
    mean: Array
    weighted_gram: Callable[[], Array]
    _latest: list[tuple[FittedTerms, MarginalTerms]] = field(default_factory=list, init=False, repr=False)
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
        """Lower Cholesky factor (p, p) of M."""
        from scipy.linalg import cholesky  # noqa: PLC0415 - slow to import

        M = self._root[:, None] * self.weighted_gram()
        M *= self._root
        M[np.diag_indices_from(M)] += 1.0
        return np.asarray(cholesky(M, lower=True, overwrite_a=True, check_finite=False), dtype=float)

    @cached_property
    def pull(self) -> Array:
        """Prior means over prior variances (p,), the contribution of the prior to η; zero for a zero mean."""
        return np.divide(self.mean, self.variance, out=np.zeros_like(self.mean), where=self.variance > 0)

    @cached_property
    def at_mean(self) -> Array:
        """Contribution (N,) of the columns to the whitened readings at their prior means."""
        return self.columns.X @ self.mean

    def marginal(self, values: Array) -> MarginalValues:
        """Return whitened values (N, k) prepared for products with C⁻¹."""
        # this order of products takes a third of the time
        return MarginalValues(values, self.weight, self._absorbed((self.weight[:, None] * values).T @ self.columns.X))

    def _absorbed(self, products: Array) -> Array:
        """Return the part (p, k) absorbed by the columns of values with products (k, p) with the weighted columns."""
        from scipy.linalg import solve_triangular  # noqa: PLC0415 - slow to import

        right = self._root[:, None] * products.T
        solution = solve_triangular(self._chol, right, lower=True, overwrite_b=True, check_finite=False)
        return np.asarray(solution, dtype=float)

    @cached_property
    def _absorbed_mean(self) -> Array:
        """The part (p, 1) absorbed by the columns of the readings at the prior means."""
        return self._absorbed((self.weighted_gram() @ self.mean)[None])

    def _prepare(self, responses: Sequence[Response]) -> list[MarginalValues]:
        """Return responses prepared for products; all that are new are prepared together."""
        new = [response for response in dict.fromkeys(responses) if response not in self._marginals]
        if new:
            together = self._absorbed(self.columns.weighted_products(new, self._weights))
            ends = np.cumsum([response.columns.shape[1] for response in new])[:-1]
            for response, absorbed in zip(new, np.split(together, ends, axis=1), strict=True):
                self._marginals[response] = MarginalValues(response.columns, self.weight, absorbed)
        return [self._marginals[response] for response in responses]

    def marginal_residual(self, residual: Array) -> MarginalValues:
        """Return a prepared whitened residual (N,) minus the readings at the prior means, as (N, 1).

        The part that needs no prior means is cached while the residual is in use.
        """
        (whole,) = self._prepare([self.columns.response_of(residual)])
        values = residual - self.at_mean
        return MarginalValues(values[:, None], self.weight, whole.absorbed - self._absorbed_mean)

    def marginal_responses(self, responses: Sequence[Response]) -> MarginalValues:
        """Return the columns of responses, prepared together."""
        parts = self._prepare(responses)
        if len(parts) == 1:
            return parts[0]
        values = [np.empty((len(self.weight), 0)), *(part.values for part in parts)]
        absorbed = [np.empty((len(self.variance), 0)), *(part.absorbed for part in parts)]
        return MarginalValues(np.concatenate(values, axis=1), self.weight, np.concatenate(absorbed, axis=1))

    def marginal_terms(self, terms: FittedTerms) -> MarginalTerms:
        """Return fitted terms and, last, their residual at the prior means, prepared.

        The latest result is cached, because a state's evidence and posterior both need it.
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
            self._latest[:] = [(terms, MarginalTerms(products, absorbed))]
        return self._latest[0][1]

    def absorbed_coefficients(self, absorbed: Array) -> Array:
        """Return the coefficients (p, k) with which the columns absorb as much as possible of values, given the part
        (p, k) that they absorb.
        """
        from scipy.linalg import solve_triangular  # noqa: PLC0415 - slow to import

        back = solve_triangular(self._chol, absorbed, lower=True, trans=1, check_finite=False)
        return self._root[:, None] * back

    @property
    def logdet(self) -> float:
        """Log determinant of the covariance of the readings."""
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
        """Return the product (p,) of the covariance of the coefficients, in healthy sizes, with a vector (p,)."""
        return self.absorbed_coefficients(self._absorbed(vector[None]))[:, 0]

    @cached_property
    def spent(self) -> Array:
        """Energy of each band (b,), in noise variances, that the uncertainty of the coefficients hides, excluding
        fitted terms.
        """
        return np.tensordot(self.columns.K, self.covariance, axes=2)

    @cached_property
    def weighted_spent(self) -> Array:
        """Energy of each band (b,), weighted by the noise, that the uncertainty of the coefficients hides, excluding
        fitted terms.
        """
        if len(self.columns.count) > 1:
            return self.columns.weighted_spent(self.weight, self.covariance)
        # The trace of X'WX A is that of I - M⁻¹, which needs only the variances.
        free = self.variance > 0
        return np.array([np.sum(1 - self.variances[free] / self.variance[free])])

    def posterior(self, terms: FittedTerms) -> CoefficientPosterior:
        """Return the posterior of all coefficients together with the fitted terms, T (N, q)."""
        return CoefficientPosterior(self, terms)

    def evidence(self, terms: FittedTerms) -> float:
        """Return the log density of the readings with fitted terms, T (N, q), up to a constant."""
        q = len(terms.mean)
        products = self.marginal_terms(terms).products
        normal = products[:q, :q] + terms.precision
        right = products[:q, q] + terms.precision @ terms.mean
        best = terms.best(normal, right)
        cost = products[q, q] + terms.mean @ terms.precision @ terms.mean - (2 * right - normal @ best) @ best
        occam = np.linalg.slogdet(normal)[1] - np.linalg.slogdet(terms.precision)[1] + self.logdet
        return -0.5 * float(cost + occam)


@dataclass(frozen=True)
class Gains:
    """Gain of n forms over their part of the background, each fitted together with all other terms.

    Log evidence (n,) as a `fault`, and as the only form of `healthy` size of the effect. `sigma` (n,): significance of
    a healthy size in sigmas. `size` (n,): size shown by the readings, in healthy sizes.
    """

    fault: Array
    healthy: Array
    sigma: Array
    size: Array


@dataclass(frozen=True, eq=False)
class CoefficientPosterior:
    """Posterior of all coefficients of whitened columns together with fitted terms."""

    background: Background
    terms: FittedTerms

    @cached_property
    def _marginal(self) -> MarginalTerms:
        return self.background.marginal_terms(self.terms)

    def _products_with(self, marginal: MarginalValues) -> Array:
        """Return the products (q + 1, k) with C⁻¹ of the fitted terms and, last, the residual with values (N, k)."""
        products = self.terms.with_residual.T @ marginal.weighted - self._marginal.absorbed.T @ marginal.absorbed
        products[-1] -= self.background.at_mean @ marginal.weighted
        return products

    @cached_property
    def term_covariance(self) -> Array:
        """Covariance (q, q) of the fitted terms."""
        q = len(self.terms.mean)
        return np.asarray(np.linalg.inv(self._marginal.products[:q, :q] + self.terms.precision), dtype=float)

    @cached_property
    def term_means(self) -> Array:
        """Means (q,) of the fitted terms."""
        q, terms = len(self.terms.mean), self.terms
        normal = self._marginal.products[:q, :q] + terms.precision
        return terms.best(normal, self._marginal.products[:q, q] + terms.precision @ terms.mean)

    @cached_property
    def _absorbed_coefficients(self) -> Array:
        """Coefficients (p, q + 1) with which the columns absorb the fitted terms and, last, the residual."""
        return self.background.absorbed_coefficients(self._marginal.absorbed)

    @cached_property
    def mean(self) -> Array:
        """Means (p,) of the background columns."""
        return (
            self.background.mean
            + self._absorbed_coefficients[:, -1]
            - self._absorbed_coefficients[:, :-1] @ self.term_means
        )

    @cached_property
    def variance(self) -> Array:
        """Variances (p,) of the background columns."""
        taken = self._absorbed_coefficients[:, :-1]
        return np.asarray(self.background.variances + np.sum(taken @ self.term_covariance * taken, axis=1), dtype=float)

    def covariance_among(self, columns: Integers) -> Array:
        """Return covariances (…, q, q) among columns (…, q) of the background, in healthy sizes squared."""
        taken = self._absorbed_coefficients[:, :-1][columns]
        without_terms = self.background.covariance[columns[..., :, None], columns[..., None, :]]
        return np.asarray(without_terms + taken @ self.term_covariance @ np.swapaxes(taken, -1, -2), dtype=float)

    def joint(self, columns: int, fitted: int) -> tuple[Array, Array]:
        """Mean (f + c,) and covariance (f + c, f + c) of the first `fitted` terms, then of the first `columns` of the
        background, in healthy sizes."""
        among_terms, taken = self.term_covariance[:fitted], self._absorbed_coefficients[:columns, :-1]
        across = -among_terms @ taken.T
        below = self.background.covariance[:columns, :columns] + taken @ self.term_covariance @ taken.T
        mean = np.concatenate([self.term_means[:fitted], self.mean[:columns]])
        return mean, np.asarray(np.block([[among_terms[:, :fitted], across], [across.T, below]]), dtype=float)

    def covariance_times(self, vector: Array) -> Array:
        """Return the product (p,) of the covariance of the whitened background columns with a vector (p,)."""
        taken = self._absorbed_coefficients[:, :-1]
        return self.background.covariance_times(vector) + taken @ (self.term_covariance @ (vector @ taken))

    @cached_property
    def residual(self) -> Array:
        """Whitened residual (N,) with all coefficients at their means."""
        return self.terms.r - self.terms.T @ self.term_means - self.background.columns.X @ self.mean

    @cached_property
    def spent(self) -> Array:
        """Energy of each band (b,), in noise variances, that the uncertainty of all coefficients hides."""
        return self.background.spent + np.bincount(self.background.columns.band, self._of_terms)

    def prediction_errors(self, rows: Integers) -> tuple[Array, Array]:
        """Return the prediction errors (n,) of given whitened rows (n,) from all others, and their covariance (n, n)
        excluding the noise of the readings.

        For a normal distribution both follow directly: with C the covariance of the readings, the residuals are
        (C⁻¹)_rows⁻¹ (C⁻¹ y)_rows and their covariance is (C⁻¹)_rows⁻¹ (Rasmussen and Williams, 2006, 5.4.2). The
        influence of the rows on fitted sizes and widths is not removed.
        """
        background, weight = self.background, self.background.weight[rows]
        X = background.columns.X[rows]
        terms = self.terms.T[rows] - X @ self._absorbed_coefficients[:, :-1]
        modelled = X @ background.covariance @ X.T + terms @ self.term_covariance @ terms.T
        covariance = np.linalg.inv(np.diag(weight) - weight[:, None] * modelled * weight)
        missed: Array = covariance @ (weight * self.residual[rows])
        return missed, np.asarray(covariance - np.diag(1 / weight), dtype=float)

    @cached_property
    def weighted_spent(self) -> Array:
        """Energy of each band (b,), weighted by the noise, that the uncertainty of all coefficients hides."""
        background = self.background
        return background.weighted_spent + np.bincount(background.columns.band, background.weight * self._of_terms)

    @cached_property
    def _of_terms(self) -> Array:
        """Variances (N,) of the readings due to the uncertainty of the fitted terms, after absorption by the
        columns.
        """
        remainder = self.terms.T - self.background.columns.X @ self._absorbed_coefficients[:, :-1]
        return np.asarray(np.sum(remainder @ self.term_covariance * remainder, axis=1), dtype=float)

    @property
    def residual_at_prior(self) -> Array:
        """Whitened residual (N,) of the fitted effects, with the background at its prior means."""
        return self.terms.r - self.background.at_mean

    @property
    def healthy_share(self) -> Array:
        """Contribution (N,) of the effect forms, at their posterior means, to the whitened readings."""
        forms = self.background.columns.set_ups.start
        return self.background.columns.X[:, :forms] @ self.mean[:forms]

    def gains(self, forms: Sequence[Form], level: Level) -> Gains:
        """Return the gains of forms in an arm whose other forms have a level."""
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
        """Return the coefficients (q,), in healthy sizes, of a form as a fault."""
        cols = np.array(form.columns)
        inverse, precision = self._inverse_and_cavity(cols)
        eta = inverse @ self.mean[cols] - self.background.pull[cols]
        return np.asarray(np.linalg.solve(precision + np.eye(len(cols)) / LARGEST_FAULT**2, eta), dtype=float)

    def _inverse_and_cavity(self, columns: Integers) -> tuple[Array, Array]:
        """Return the inverse covariance (…, q, q) among columns (…, q), and this inverse minus the prior precision
        of the columns.
        """
        inverse = np.asarray(np.linalg.inv(self.covariance_among(columns)), dtype=float)
        precision, diagonal = inverse.copy(), np.arange(columns.shape[-1])
        precision[..., diagonal, diagonal] -= 1 / self.background.variance[columns]
        return inverse, precision

    def cavity(self, columns: Array) -> tuple[Array, Array]:
        """Return the information of the readings about whitened columns (N, q), fitted together with all other
        terms: precision Λ (q, q) and vector η (q,).
        """
        marginal = self.background.marginal(columns)
        across = self._products_with(marginal)
        with_terms, eta = across[:-1], across[-1] - self.term_means @ across[:-1]
        precision: Array = marginal.products(marginal) - with_terms.T @ self.term_covariance @ with_terms
        return precision, eta

    def cavities_within_limits(self, responses: Sequence[Response]) -> list[tuple[Array, Array]]:
        """Return the same information about the columns of each response apart, with the terms at limits fixed there
        as in the evidence.
        """
        self.background.marginal_responses(responses)  # all together
        free, normal = np.isnan(self.terms.held), self._marginal.products[:-1, :-1] + self.terms.precision
        covariance = np.linalg.inv(normal[np.ix_(free, free)])
        cavities = []
        for response in responses:
            marginal = self.background.marginal_responses([response])
            across = self._products_with(marginal)
            with_terms, eta = across[:-1][free], across[-1] - self.term_means @ across[:-1]
            cavities.append((marginal.products(marginal) - with_terms.T @ covariance @ with_terms, eta))
        return cavities

    def without_absorbed(self, columns: Array) -> Array:
        """Return the part of whitened columns (N, q), added to the readings, not absorbed by all other terms."""
        marginal = self.background.marginal(columns)
        terms = self.term_covariance @ self._products_with(marginal)[:-1]
        taken = self.background.absorbed_coefficients(marginal.absorbed) - self._absorbed_coefficients[:, :-1] @ terms
        return columns - self.terms.T @ terms - self.background.columns.X @ taken


def background_of(columns: Columns, weight: Array, variance: Array, mean: Array | None = None) -> Background:
    """Return the background for noise weights (N,), prior variances (p,) and prior means (p,), zero by default."""
    mean = np.zeros(len(variance)) if mean is None else mean
    return Background(columns, weight, variance, mean, partial(columns.weighted_gram, weight))


def fault_evidence(values: Array, seen: Array, level: float) -> Array:
    """Return the log evidence (…) of cavities for a fault of any size over no fault.

    `values` (…, q): eigenvalues of the precision. `seen` (…, q): squares of η along the eigenvectors.
    """
    each = np.stack([cavity_evidence(values, seen, size**2 / values.shape[-1]) for size in fault_sizes(level)])
    top = each.max(axis=0)
    return np.asarray(top + np.log(np.exp(each - top).mean(axis=0)), dtype=float)


def cavity_evidence(values: Array, seen: Array, variance: Array | float) -> Array:
    """Return the log evidence F(V) (…) of cavities with precision eigenvalues (…, q), squares of η along the
    eigenvectors (…, q) and prior variance V.
    """
    return np.asarray(0.5 * (seen / (values + 1 / variance) - np.log1p(variance * values)).sum(axis=-1), dtype=float)
