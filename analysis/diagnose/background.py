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

from analysis.diagnose.columns import LARGEST, Columns, Form
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
        self.columns, self.weight, self.variance = columns, weight, variance
        self._root = np.sqrt(variance)
        self._gram = self._weighted_gram()
        M = self._root[:, None] * self._gram * self._root
        M[np.diag_indices_from(M)] += 1.0
        self._chol = np.linalg.cholesky(M)
        self._WX = weight[:, None] * columns.X

    def _weighted_gram(self) -> Array:
        columns, gram = self.columns, np.zeros(self.columns.K.shape[1:])
        for b in range(len(columns.count)):
            rows = columns.band == b
            own = self.weight[rows]
            if np.ptp(own) == 0:
                gram += own[0] * columns.K[b]
            else:
                part = columns.X[rows]
                gram += part.T @ (own[:, None] * part)
        return gram

    def halved(self, values: Array) -> Array:
        """L⁻¹ √V X'W values, (p, …)."""
        from scipy.linalg import solve_triangular  # noqa: PLC0415 - slow to import

        right = self._root.reshape(-1, *[1] * (values.ndim - 1)) * (self._WX.T @ values)
        return np.asarray(solve_triangular(self._chol, right, lower=True, check_finite=False), dtype=float)

    def solved(self, values: Array) -> Array:
        """C⁻¹ values, (N, …)."""
        from scipy.linalg import solve_triangular  # noqa: PLC0415 - slow to import

        tail = [1] * (values.ndim - 1)
        back = solve_triangular(self._chol, self.halved(values), lower=True, trans=1, check_finite=False)
        weighted = self.weight.reshape(-1, *tail) * values
        found: Array = weighted - self._WX @ (self._root.reshape(-1, *tail) * back)
        return found

    @property
    def logdet(self) -> float:
        """Of the covariance of the readings."""
        return 2 * float(np.log(np.diag(self._chol)).sum()) - float(np.log(self.weight).sum())

    @cached_property
    def covariance(self) -> Array:
        """A (p, p) of all coefficients, nothing known beside them."""
        from scipy.linalg import solve_triangular  # noqa: PLC0415 - slow to import

        half = solve_triangular(self._chol, np.diag(self._root), lower=True, check_finite=False)
        found: Array = half.T @ half
        return found

    def posterior(self, known: Known) -> Posterior:
        """Of all coefficients, beside what is known."""
        return Posterior(self, known)


class Posterior:
    """Coefficients of all columns beside known ones: T's estimate (q,) and covariance (q, q), mean m (p,) and
    covariance A (p, p); left (N,): what stays of the readings with all at their means."""

    def __init__(self, background: Background, known: Known) -> None:
        self.background = background
        r, T = known.r, known.T
        self.r, self.known_columns = r, T
        weighted = background.solved(T)
        normal = T.T @ weighted + known.precision
        right = weighted.T @ r + known.precision @ known.mean
        self.known_covariance = np.linalg.inv(normal)
        self.known = self.known_covariance @ right
        A = background.covariance
        B = A @ (background._WX.T @ T)
        self.mean = A @ (background._WX.T @ (r - T @ self.known))
        self.A = A + B @ self.known_covariance @ B.T
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
            now = _evidence(values, seen, prior.mean(axis=1)[:, None])
            fault[members] = fault_evidence(values, seen, level) - now
            pick[members] = _evidence(values, seen, level**2 / q) - now
            sigma[members] = np.sqrt(values.max(axis=1))
            if q == 1:
                wrong = [
                    k for k, way in zip(members.tolist(), eta[:, 0], strict=True) if way < 0 and forms[k].one_sided
                ]
                fault[wrong] = pick[wrong] = -np.inf
        return fault, pick, sigma

    def gain_of_columns(self, columns: Array, level: float) -> float:
        """Log evidence for columns (N, q) beside all else, their coefficients together one healthy size at a level."""
        background, T = self.background, self.known_columns
        weighted = background.solved(columns)
        across = T.T @ weighted
        precision = columns.T @ weighted - across.T @ self.known_covariance @ across
        eta = weighted.T @ (self.r - T @ self.known)
        values, turn = np.linalg.eigh(precision)
        seen = (turn.T @ eta) ** 2
        return float(_evidence(np.maximum(values, 0.0), seen, level**2 / len(eta)))

    def size(self, form: Form) -> Array:
        """The coefficients (q,) that a form would have as a fault, in healthy sizes."""
        cols = list(form.columns)
        inverse = np.linalg.inv(self.A[np.ix_(cols, cols)])
        eta = inverse @ self.mean[cols]
        precision = inverse - np.diag(1 / self.background.variance[cols])
        found: Array = np.linalg.solve(precision + np.eye(len(cols)) / LARGEST**2, eta)
        return found


def fault_evidence(values: Array, seen: Array, level: float) -> Array:
    """Log evidence (…) of cavities for a fault of any size, over none.

    values (…, q): the precision's eigenvalues; seen (…, q): squares of η along them.
    """
    each = np.stack([_evidence(values, seen, size**2 / values.shape[-1]) for size in fault_sizes(level)])
    top = each.max(axis=0)
    found: Array = top + np.log(np.exp(each - top).mean(axis=0))
    return found


def gain_over_healthy(precision: float, eta: float, level: float) -> float:
    """Log evidence of one cavity for a fault over a healthy share; precision and eta: for one healthy size."""
    values, seen = np.array([precision]), np.array([eta**2])
    return float(fault_evidence(values, seen, level) - _evidence(values, seen, level**2))


def _evidence(values: Array, seen: Array, variance: Array | float) -> Array:
    """F(V) (…) of cavities: precision's eigenvalues (…, q), squares of η along them (…, q), prior variance V."""
    found: Array = 0.5 * (seen / (values + 1 / variance) - np.log1p(variance * values)).sum(axis=-1)
    return found
