"""Evidence of a state without some of its effects, by low-rank changes of one factor.

Without a name, its fitted terms leave the model, and its forms get back their share of the background: the covariance
of the readings becomes C + X_c D X_c' with the few columns c whose prior variances change by D. With Z any values,

Z'(C + X_c D X_c')⁻¹Z = Z'C⁻¹Z − B'(D⁻¹ + X_c'C⁻¹X_c)⁻¹B,    B = X_c'C⁻¹Z    (Woodbury).

All other effects move along their tangents. An unknown cause adds its columns, whose products with C⁻¹ are computed
only once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from analysis.diagnosis.fit.background import Background, Coefficients, MarginalValues
from analysis.diagnosis.fit.selection_state import SelectionState
from analysis.diagnosis.fit.state_evidence import StateEvidence
from analysis.diagnosis.fit.unknown import UnknownCauses
from analysis.robot.kinematics.arm import Array, Integers

UNDECIDED = 20.0
"""Log evidence between a state and an alternative, with all effects moved along their tangents, up to which a fit of
the alternative decides. Chosen: log odds of 20 are a probability above 0.9997.
"""
RECOVERED = 300.0
"""Log evidence lost at the noise of a state above which a new estimate of the noise leaves a loss above `UNDECIDED`.
With n entries in a band, a loss of E becomes about n log(1 + 2 E / n) / 2: 97 for a hundred entries, 20 for ten.
"""


@dataclass(frozen=True)
class ReducedState:
    """A state without some of its effects."""

    evidence: float
    """Log evidence, as of `StateEvidence.evidence`."""
    cause_gains: dict[str, Array]
    """Log evidence (a,) that each kind of unknown cause gains in addition, with each amplitude."""
    bare: SelectionState

    @property
    def most_evidence(self) -> float:
        """Log evidence with the likeliest unknown cause, or without one, before its price."""
        return self.evidence + max([0.0, *(float(gain.max()) for gain in self.cause_gains.values())])


@dataclass(frozen=True, eq=False)
class CoefficientsWithout(Coefficients):
    """Distribution of all coefficients after a low-rank change of a background: its information D (p, p) becomes
    D − added taken' (p, k). A coefficient whose prior is much wider than its uncertainty, such as one of a set-up,
    loses digits: of sixteen those of the ratio of the variances.
    """

    background: Background
    means: Array
    information: Array
    added: Array
    taken: Array

    @property
    def mean(self) -> Array:
        return self.means

    def covariance_among(self, columns: Integers) -> Array:
        left = self.information[columns[..., :, None], columns[..., None, :]]
        left = left - self.added[columns] @ np.swapaxes(self.taken[columns], -1, -2)
        variance, diagonal = self.background.variance[columns], np.arange(columns.shape[-1])
        covariance = -variance[..., :, None] * left * variance[..., None, :]
        covariance[..., diagonal, diagonal] += variance
        return np.asarray(covariance)


@dataclass(frozen=True, eq=False)
class LeaveOut:
    """A state whose effects are left out, and the unknown causes that compete with them."""

    selection: StateEvidence
    state: SelectionState
    causes: UnknownCauses = field(default_factory=lambda: UnknownCauses({}))
    _reduced: dict[tuple[int, ...], ReducedState] = field(default_factory=dict, init=False, repr=False)

    def _bare(self, places: Sequence[int]) -> tuple[SelectionState, list[int]]:
        """The state without the effects at these places, and the places of the others."""
        kept = [k for k in range(len(self.state.effects)) if k not in places]
        refined = self.state.refined.only(kept)
        refined = replace(refined, residual=self.selection.linear.residual(refined.effects))
        return replace(self.state, refined=refined, origins=tuple(self.state.origins[k] for k in kept)), kept

    def without(self, places: Sequence[int]) -> ReducedState:
        """The state without the effects at these places, at the same noise and level. Cached."""
        key = tuple(sorted(places))
        if key not in self._reduced:
            self._reduced[key] = self._without(key)
        return self._reduced[key]

    def _without(self, places: Sequence[int]) -> ReducedState:
        bare, kept = self._bare(places)
        variance, mean = self.selection.backgrounds.prior(bare)
        rows = self._rows(kept)
        terms = bare.refined.fitted_terms
        residual = bare.refined.residual - self._background.columns.X @ mean
        products, logdet = self._products(residual, variance, rows)
        q = len(terms.mean)
        normal = products[:q, :q] + terms.precision
        right = products[:q, -1] + terms.precision @ terms.mean
        best = terms.best(normal, right)
        cost = products[-1, -1] + terms.mean @ terms.precision @ terms.mean - (2 * right - normal @ best) @ best
        occam = np.linalg.slogdet(normal)[1] - np.linalg.slogdet(terms.precision)[1] + logdet
        evidence = -0.5 * float(cost + occam) + self.selection.log_prior(bare)
        free = np.isnan(terms.held)
        covariance = np.linalg.inv(normal[np.ix_(free, free)])
        cavities, ends = list[tuple[Array, Array]](), q + self._ends_of_causes
        for begin, end in pairwise(ends.tolist()):
            with_terms = products[:q, begin:end]
            precision = products[begin:end, begin:end] - with_terms[free].T @ covariance @ with_terms[free]
            cavities.append((precision, products[begin:end, -1] - best @ with_terms))
        return ReducedState(evidence, self.causes.gains_of(cavities), bare)

    def coefficients_without(self, places: Sequence[int]) -> CoefficientsWithout:
        """The distribution of all coefficients without the effects at these places."""
        bare, kept = self._bare(places)
        variance, mean = self.selection.backgrounds.prior(bare)
        background, terms = self._background, bare.refined.fitted_terms
        free = np.isnan(terms.held)
        rows = self._rows(kept)[: len(free)][free]
        changed = np.flatnonzero(variance != background.variance)
        change = variance[changed] - background.variance[changed]
        # Kept terms, and columns with another prior, are columns beside those of the background.
        information, scores = background.information, self._scores_of_values[:, rows]
        among, across = self._products_of_values[np.ix_(rows, rows)], scores[changed]
        added = np.concatenate([scores, information[:, changed]], axis=1)
        inner = np.block([[among, across.T], [across, information[np.ix_(changed, changed)]]])
        fixed = np.where(free, terms.mean, terms.held)
        r = background.marginal((bare.refined.residual - terms.T @ fixed - background.columns.X @ mean)[:, None])
        score = background.scores(r)[:, 0]
        right = np.concatenate([self._values.products(r)[rows, 0], score[changed]])
        prior = np.zeros_like(inner)
        prior[: len(rows), : len(rows)] = np.linalg.inv(terms.precision[np.ix_(free, free)])
        prior[np.arange(len(rows), len(inner)), np.arange(len(rows), len(inner))] = change
        taken = added @ np.linalg.solve(np.eye(len(inner)) + prior @ inner, prior)
        resized = replace(background, variance=variance, mean=mean)
        return CoefficientsWithout(resized, mean + variance * (score - taken @ right), information, added, taken)

    def is_close(self, places: Sequence[int]) -> bool:
        """Whether a fit without the effects at these places, with noise or an unknown cause instead, might explain
        nearly as much as the state.
        """
        selection, whole, reduced = self.selection, self.selection.evidence(self.state), self.without(places)
        if reduced.evidence < whole - RECOVERED:
            return reduced.most_evidence > whole - UNDECIDED
        louder = replace(reduced.bare, strength=selection.strength(reduced.bare, selection.posterior(reduced.bare)))
        return max(reduced.most_evidence, selection.evidence(louder)) > whole - UNDECIDED

    @cached_property
    def _background(self) -> Background:
        return self.selection.backgrounds.of(self.state)

    @cached_property
    def _values(self) -> MarginalValues:
        """The fitted terms (N, q) and all columns of unknown causes (N, u)."""
        terms = self.state.refined.fitted_terms
        return self._background.marginal_responses([*terms.responses, *self.causes.responses.values()])

    @cached_property
    def _products_of_values(self) -> Array:
        return self._values.products(self._values)

    @cached_property
    def _scores_of_values(self) -> Array:
        return self._background.scores(self._values)

    @cached_property
    def _ends_of_causes(self) -> Integers:
        return np.cumsum([0, *(response.columns.shape[1] for response in self.causes.responses.values())])

    def _rows(self, kept: Sequence[int]) -> Integers:
        """Columns of `_values`: terms of the kept effects and of unknown causes in the state, then all new causes."""
        refined = self.state.refined
        owners = [unknown.effect for unknown in refined.unknowns]
        owners += [k for k, response in enumerate(refined.departures) for _ in range(response.columns.shape[1])]
        of_effects = np.array(owners, dtype=np.int64)
        every = self._values.values.shape[1]
        return np.concatenate([np.flatnonzero(np.isin(of_effects, kept)), np.arange(len(of_effects), every)])

    def _products(self, residual: Array, variance: Array, rows: Integers) -> tuple[Array, float]:
        """Products of values at `rows` and, last, a residual (N,) with the inverse covariance for prior variances (p,),
        and the logarithm of the determinant of the covariance.
        """
        background = self._background
        r = background.marginal(residual[:, None])
        across = self._values.products(r)[rows]
        products = np.block([[self._products_of_values[np.ix_(rows, rows)], across], [across.T, r.products(r)]])
        changed = np.flatnonzero(variance != background.variance)
        if not len(changed):
            return products, background.logdet
        change = variance[changed] - background.variance[changed]
        columns = background.marginal(background.columns.X[:, changed])
        inner = columns.products(columns)
        B = np.concatenate([columns.products(self._values)[:, rows], columns.products(r)], axis=1)
        products -= B.T @ np.linalg.solve(np.diag(1 / change) + inner, B)
        logdet = np.linalg.slogdet(np.eye(len(changed)) + change[:, None] * inner)[1]
        return products, background.logdet + float(logdet)
