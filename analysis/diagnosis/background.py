"""All that is not named, as one normal law: noise, set-ups, scatter from run to run, a healthy share of everything.

The covariance of the readings is C = W⁻¹ + X V X', W the noise's weights (lower in bands where more is left than noise
gives) and V the prior variances of all columns. With M = I + √V X'WX √V,

    a'C⁻¹b = a'Wb - (√V X'Wa)' M⁻¹ (√V X'Wb),    A = √V M⁻¹ √V the posterior covariance of all coefficients.

What a single form may be is seen from its cavity (Λ, η): what the readings say of it without its own prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from analysis.diagnosis.columns import LARGEST, Columns, Form
from analysis.kinematics.arm import Array

_LEAST = 6.0
"""Of a fault, in what the arm at hand shows of everything: a fault is 5 to 100 times as large."""
_APART = 1.85
"""From one size that is tried to the next."""


def fault_sizes(level: float) -> Array:
    """Sizes (n,) that a fault may have, in healthy sizes, in an arm whose background is at some level."""
    least = min(_LEAST * level, LARGEST / 4)
    return np.geomspace(least, LARGEST, 1 + round(np.log(LARGEST / least) / np.log(_APART)))


@dataclass(frozen=True)
class Weighed:
    """Values (N, k) in a background: weighted (N, k) by the noise, and half (p, k), which the columns take of them."""

    values: Array
    weighted: Array
    half: Array

    def products(self, other: Weighed) -> Array:
        """values' C⁻¹ values of the other: (k, l) for (N, k) and (N, l)."""
        found: Array = self.weighted.T @ other.values - self.half.T @ other.half
        return found


@dataclass(frozen=True)
class Known:
    """Columns T (N, q) beside the background, with their prior precision (q, q) and prior means (q,), and what the
    model leaves r (N,) where they are all zero."""

    r: Array
    T: Array
    precision: Array
    mean: Array


class Background:
    """Noise weights (N,) of each reading, and prior variances (p,) of all columns."""

    def __init__(self, columns: Columns, weight: Array, variance: Array) -> None:
        from scipy.linalg import cholesky  # noqa: PLC0415 - slow to import

        self.columns, self.weight, self.variance = columns, weight, variance
        self._root = np.sqrt(variance)
        M = self._root[:, None] * self._weighted_gram() * self._root
        M[np.diag_indices_from(M)] += 1.0
        self._chol = np.asarray(cholesky(M, lower=True, overwrite_a=True, check_finite=False), dtype=float)

    def _weighted_gram(self) -> Array:
        """X'WX (p, p), from the products of bands whose readings weigh alike."""
        columns, gram = self.columns, self.columns.gram.copy()
        for b, products in enumerate(columns.K):
            rows = columns.rows[b]
            own = self.weight[rows]
            if np.ptp(own) > 0:
                part = columns.X[rows]
                gram += part.T @ ((own - 1)[:, None] * part)
            elif own[0] != 1:
                gram += (own[0] - 1) * products
        return gram

    def weighed(self, values: Array) -> Weighed:
        """Values (N, k) as C⁻¹ multiplies them."""
        from scipy.linalg import solve_triangular  # noqa: PLC0415 - slow to import

        weighted = self.weight[:, None] * values
        right = self._root[:, None] * (self.columns.X.T @ weighted)
        half = solve_triangular(self._chol, right, lower=True, overwrite_b=True, check_finite=False)
        return Weighed(values, weighted, np.asarray(half, dtype=float))

    def taken(self, weighed: Weighed) -> Array:
        """Coefficients (p, k) with which the columns take what they can of values."""
        from scipy.linalg import solve_triangular  # noqa: PLC0415 - slow to import

        back = solve_triangular(self._chol, weighed.half, lower=True, trans=1, check_finite=False)
        found: Array = self._root[:, None] * back
        return found

    def solved(self, weighed: Weighed) -> Array:
        """C⁻¹ values, (N, k) for values (N, k)."""
        found: Array = weighed.weighted - self.weight[:, None] * (self.columns.X @ self.taken(weighed))
        return found

    @property
    def logdet(self) -> float:
        """Of the covariance of the readings."""
        return 2 * float(np.log(np.diag(self._chol)).sum()) - float(np.log(self.weight).sum())

    @cached_property
    def covariance(self) -> Array:
        """A (p, p) of all coefficients, nothing known beside them."""
        from scipy.linalg.lapack import dpotri  # noqa: PLC0415 - slow to import

        inverse, _ = dpotri(self._chol, lower=True)
        whole = np.tril(inverse)
        whole += np.tril(inverse, -1).T
        found: Array = self._root[:, None] * whole * self._root
        return found

    def posterior(self, known: Known) -> Posterior:
        """Of all coefficients, beside what is known."""
        return Posterior(self, known)

    def evidence(self, known: Known) -> float:
        """Log density of the readings beside what is known, but for a constant."""
        q = len(known.mean)
        weighed = self.weighed(np.column_stack([known.T, known.r]))
        products = weighed.products(weighed)
        normal = products[:q, :q] + known.precision
        right = products[:q, q] + known.precision @ known.mean
        cost = products[q, q] + known.mean @ known.precision @ known.mean - right @ np.linalg.solve(normal, right)
        occam = np.linalg.slogdet(normal)[1] - np.linalg.slogdet(known.precision)[1] + self.logdet
        return -0.5 * float(cost + occam)


class Posterior:
    """Coefficients of all columns beside known ones: T's estimate (q,) and covariance (q, q), mean m (p,) and
    covariance A (p, p); left (N,): what stays of the readings with all at their means."""

    def __init__(self, background: Background, known: Known) -> None:
        self.background = background
        r, T, q = known.r, known.T, len(known.mean)
        weighed = self._weighed = background.weighed(np.column_stack([T, r]))
        products = weighed.products(weighed)
        self.known_covariance = np.linalg.inv(products[:q, :q] + known.precision)
        self.known = self.known_covariance @ (products[:q, q] + known.precision @ known.mean)
        taken = background.taken(weighed)
        self.mean = taken[:, q] - taken[:, :q] @ self.known
        self.A = background.covariance + taken[:, :q] @ self.known_covariance @ taken[:, :q].T
        self.left = r - T @ self.known - background.columns.X @ self.mean

    @property
    def healthy_share(self) -> Array:
        """What the forms of effects, at their means, add to the readings (N,)."""
        forms = self.background.columns.set_ups.start
        share: Array = self.background.columns.X[:, :forms] @ self.mean[:forms]
        return share

    def gains(self, forms: Sequence[Form], level: float) -> tuple[Array, Array, Array]:
        """Log evidence (n,) for each form as a fault, over its healthy share; the same for it as the one form that its
        name has, at the level of all others; and its sigmas (n,) at a healthy size."""
        fault, pick, sigma = np.full((3, len(forms)), -np.inf)
        sigma[:] = 0.0
        width = np.array([len(form.columns) for form in forms])
        for q in np.unique(width).tolist():
            members = np.flatnonzero(width == q)
            cols = np.array([forms[k].columns for k in members.tolist()])
            prior = self.background.variance[cols]
            kept = (prior > 0).all(axis=1)
            members, cols, prior = members[kept], cols[kept], prior[kept]
            if not len(members):
                continue
            inverse = np.linalg.inv(self.A[cols[:, :, None], cols[:, None, :]])
            eta = np.einsum("nij,nj->ni", inverse, self.mean[cols])
            precision = inverse.copy()
            precision[:, np.arange(q), np.arange(q)] -= 1 / prior
            values, turn = np.linalg.eigh(precision)
            values = np.maximum(values, 0.0)
            seen = np.einsum("nij,ni->nj", turn, eta) ** 2
            now = cavity_evidence(values, seen, prior.mean(axis=1)[:, None])
            fault[members] = fault_evidence(values, seen, level) - now
            pick[members] = cavity_evidence(values, seen, level**2 / q) - now
            sigma[members] = np.sqrt(values.max(axis=1))
            if q == 1:
                wrong = [
                    k for k, way in zip(members.tolist(), eta[:, 0], strict=True) if way < 0 and forms[k].one_sided
                ]
                fault[wrong] = pick[wrong] = -np.inf
        return fault, pick, sigma

    def cavity(self, columns: Array) -> tuple[Array, Array]:
        """What the readings say of columns (N, q) beside all else: Λ (q, q) and η (q,)."""
        own = self.background.weighed(columns)
        across = self._weighed.products(own)
        known, left = across[:-1], across[-1] - self.known @ across[:-1]
        precision: Array = own.products(own) - known.T @ self.known_covariance @ known
        return precision, left

    def size(self, form: Form) -> Array:
        """The coefficients (q,) that a form would have as a fault, in healthy sizes."""
        cols = list(form.columns)
        inverse = np.linalg.inv(self.A[np.ix_(cols, cols)])
        eta = inverse @ self.mean[cols]
        precision = inverse - np.diag(1 / self.background.variance[cols])
        return np.asarray(np.linalg.solve(precision + np.eye(len(cols)) / LARGEST**2, eta), dtype=float)


def fault_evidence(values: Array, seen: Array, level: float) -> Array:
    """Log evidence (…) of cavities for a fault of any size, over none.

    values (…, q): the precision's eigenvalues; seen (…, q): squares of η along them.
    """
    each = np.stack([cavity_evidence(values, seen, size**2 / values.shape[-1]) for size in fault_sizes(level)])
    top = each.max(axis=0)
    found: Array = top + np.log(np.exp(each - top).mean(axis=0))
    return found


def cavity_evidence(values: Array, seen: Array, variance: Array | float) -> Array:
    """F(V) (…) of cavities: precision's eigenvalues (…, q), squares of η along them (…, q), prior variance V."""
    found: Array = 0.5 * (seen / (values + 1 / variance) - np.log1p(variance * values)).sum(axis=-1)
    return found
