"""What is known of each form of each name before anything is measured: the posterior covariance of the forms' sizes in
a healthy arm, from which the uncertainty of a name and the separation of two names follow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from analysis.diagnosis.candidates import Candidate
from analysis.diagnosis.columns import LARGEST_FAULT, Form, column_shares_beside, shares_beside
from analysis.diagnosis.diagnosis import ODDS
from analysis.kinematics.arm import Array, Integers
from rigs.effects import Effect

DETECTABLE = 7.0
"""Size in sigmas at and above which an effect counts as detected. Chosen: 7 sigma are a log evidence of 24.5, well
above the price of a choice among some hundred forms."""
SEPARABLE = float(np.sqrt(2 * np.log(ODDS)))
"""Separation in sigmas below which the odds between two names stay within ODDS, at which a diagnosis dismisses a rival:
odds of o need a log evidence of ln o = sigma² / 2."""


def is_separable(sigma: float) -> bool:
    """Return whether two names separated by this many sigmas can be distinguished."""
    return sigma >= SEPARABLE


def is_detectable(sd: float) -> bool:
    """Return whether the largest fault of a name is detected when its size is known to `sd` healthy sizes."""
    return DETECTABLE * sd <= LARGEST_FAULT


@dataclass(frozen=True)
class FormPosterior:
    """The posterior covariance A (p, p) of the coefficients of `forms` beside everything else, with their prior
    variances (p,), all in healthy sizes."""

    forms: tuple[Form, ...]
    A: Array
    variance: Array

    @cached_property
    def _number(self) -> dict[tuple[Effect, ...], int]:
        """The index of each form by its effects."""
        return {form.effects: k for k, form in enumerate(self.forms)}

    def variance_beside(self, effects: Sequence[Effect]) -> Array:
        """Return the prior variance (p,) of all coefficients, in healthy sizes squared, beside named effects; what
        follows the forms is unchanged."""
        variance = self.variance
        for effect in effects:
            variance = variance * column_shares_beside(self.forms, effect, len(variance))
        return variance

    def sd(self, candidate: Candidate) -> float:
        """Return the standard uncertainty of a candidate's size, in healthy sizes, as if its shape were known, averaged
        over the phases where one is free."""
        k = self._number.get(candidate.effects)
        if k is None:
            return float("inf")
        shares = shares_beside(self.forms, candidate.effect)
        taken = [column for j in np.flatnonzero(shares < 1).tolist() for column in self.forms[j].columns]
        own = list(self.forms[k].columns)
        known = np.linalg.eigvalsh(self._cavity(taken, own))
        return float(np.sqrt(np.mean(1 / np.maximum(known, 1e-12) + shares[k] * self.variance[own])))

    def _cavity(self, columns: Sequence[int], asked: Sequence[int]) -> Array:
        """Return the precision (q, q) that the readings give the columns `asked`, which are among `columns`, beside
        everything except `columns`."""
        here = list(columns)
        inverse = np.asarray(np.linalg.inv(self.A[np.ix_(here, here)]), dtype=float)
        precision: Array = inverse - np.diag(1 / self.variance[here])
        own = [here.index(column) for column in asked]
        return precision[np.ix_(own, own)]

    def sigmas_apart(self, chosen: Sequence[Candidate], sizes: Array, pairs: Integers) -> Array:
        """Return the sigmas (m,) by which the candidates of pairs (m, 2), at sizes (n,) in healthy sizes, are apart
        while all other forms of either name are present as well."""
        p = len(self.A)
        # A dummy column without information completes forms that have only one.
        A, variance = np.eye(p + 2), np.append(self.variance, [1.0, 1.0])
        A[:p, :p] = self.A
        own = [self.forms[self._number[one.effects]].columns for one in chosen]
        first, second = pairs.T
        columns = np.concatenate([[(*one, dummy)[:2] for one in own] for dummy in (p, p + 1)], axis=1).reshape(
            len(chosen), 2, 2
        )
        pair = np.concatenate([columns[first, 0], columns[second, 1]], axis=1)
        known = np.linalg.inv(A[pair[:, :, None], pair[:, None, :]])
        known[:, np.arange(4), np.arange(4)] -= 1 / variance[pair]
        width = np.array([len(one) for one in own])
        this, other, across = known[:, :2, :2], known[:, 2:, 2:], known[:, :2, 2:]
        sigma: Array = np.minimum(
            sizes[first] * _left(this, across, other, width[first]),
            sizes[second] * _left(other, across.transpose(0, 2, 1), this, width[second]),
        )
        return sigma


def _left(own: Array, across: Array, other: Array, width: Array) -> Array:
    """Return the sigmas (n,) of a coefficient, root mean square over its width (n,), that remain beside another
    coefficient of any size, given the precisions (n, 2, 2)."""
    free = other + np.eye(2) / LARGEST_FAULT**2
    left = own - across @ np.linalg.solve(free, across.transpose(0, 2, 1))
    sigma: Array = np.sqrt(np.maximum(np.trace(left, axis1=1, axis2=2) / width, 0.0))
    return sigma
