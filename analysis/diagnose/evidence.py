"""How well a set of names explains the residual: evidence in closed form, effects linear.

Every effect is also there as a healthy arm's little share of it (the tolerance background), so the covariance of the
residual is I + B B', noise and background. A name's coefficient is taken to be anything up to large (a g-prior as wide
as 35 sigma, or as its own size): log evidence of a set S over nothing named is

    1/2 y'C⁻¹X (X'C⁻¹X + P⁻¹)⁻¹ X'C⁻¹y - 1/2 log det(1 + X'C⁻¹X P)

The strength of the background is not known either: the density of the residual decides (empirical Bayes, `search`).
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np

from analysis.diagnose.candidates import Candidate
from analysis.diagnose.linear import Linear
from analysis.kinematics.arm import Array
from rigs.effects import Effect

WIDE = 35.0
"""Sigmas that a named effect may well have."""
DETECTABLE = 7.0
"""Sigmas at which an effect alone is seen beyond doubt: its detection limit."""
LARGEST = 25.0
"""Healthy sizes at which an effect must at least be seen to be testable."""


class Dictionary:
    """The columns of all candidates on one linearisation.

    G (N, p): columns, each once; main, shape: by candidate its columns' numbers; sigma: length of the longest main
    column, so of a healthy size; own: share of it that no set-up term could do as well.
    """

    def __init__(self, linear: Linear, candidates: Sequence[Candidate]) -> None:
        self.candidates, self.y = list(candidates), linear.y
        columns: dict[tuple[Effect, Effect | None], int] = {}
        pairs = [
            [(effect, None) for effect in one.effects] + [(shape.more, shape.less) for shape in one.shapes]
            for one in candidates
        ]
        numbers = [np.array([columns.setdefault(pair, len(columns)) for pair in own]) for own in pairs]
        self.main = [cols[: len(one.effects)] for cols, one in zip(numbers, candidates, strict=True)]
        self.shape = [cols[len(one.effects) :] for cols, one in zip(numbers, candidates, strict=True)]
        whole = linear.raw([more for more, _ in columns])
        size = np.ones(len(columns))
        for cols, one in zip(numbers, candidates, strict=True):
            size[cols] = one.size
        shaped = [k for k, (_, less) in enumerate(columns) if less is not None]
        whole[:, shaped] -= linear.raw([less for _, less in columns if less is not None])
        whole /= size
        self.G = linear.projected(whole)
        size, own = np.linalg.norm(whole, axis=0), np.linalg.norm(self.G, axis=0)
        self.sigma = np.array([own[cols].max() for cols in self.main])
        self.own = np.array([(own[cols] / np.maximum(size[cols], 1e-9)).max() for cols in self.main])

    def background(self, level: float) -> Array:
        """Standard deviation (p,) of each column in a healthy arm, where each effect is at most healthy and has
        `level` of its detection limit."""
        share = np.zeros(self.G.shape[1])
        for k, candidate in enumerate(self.candidates):
            limit = DETECTABLE / max(self.sigma[k], 1e-9)
            share[self.main[k]] = candidate.share * min(1.0, level * limit)
        return share


class Background:
    """The covariance I + B B' of noise, B (N, b): of a healthy arm's share of every effect, by Woodbury's identity."""

    def __init__(self, B: Array) -> None:
        self._B = B
        self._gram = B.T @ B
        self._chol = np.linalg.cholesky(np.eye(B.shape[1]) + self._gram)

    def beside(self, columns: Array) -> Background:
        """With more columns (N, c) in it."""
        if not columns.shape[1]:
            return self
        other = copy(self)
        across = self._B.T @ columns
        other._B = np.concatenate([self._B, columns], axis=1)
        other._gram = np.block([[self._gram, across], [across.T, columns.T @ columns]])
        other._chol = np.linalg.cholesky(np.eye(len(other._gram)) + other._gram)
        return other

    @property
    def spread(self) -> Array:
        """Variance (N,) that it adds to the noise's 1."""
        added: Array = (self._B**2).sum(axis=1)
        return added

    @property
    def logdet(self) -> float:
        """Of the covariance."""
        return 2 * float(np.log(np.diag(self._chol)).sum())

    def halved(self, columns: Array) -> Array:
        """What must be taken off X'X and X'y: (p, …)."""
        from scipy.linalg import solve_triangular  # noqa: PLC0415 - slow to import

        found: Array = solve_triangular(self._chol, self._B.T @ columns, lower=True, check_finite=False)
        return found

    def product(self, left: Array, right: Array) -> Array:
        """left' C⁻¹ right."""
        half = self.halved(left)
        found: Array = left.T @ right - half.T @ (half if right is left else self.halved(right))
        return found

    def chi2(self, left: Array) -> float:
        """left' C⁻¹ left of (N,)."""
        half = self.halved(left)
        return float(left @ left - half @ half)

    def weighted(self, columns: Array) -> Array:
        """C⁻¹ columns, (N, …)."""
        from scipy.linalg import solve_triangular  # noqa: PLC0415 - slow to import

        half = self.halved(columns)
        return columns - self._B @ solve_triangular(self._chol, half, lower=True, trans=1, check_finite=False)
