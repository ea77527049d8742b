"""The expected posterior: what a diagnosis will know about each name from runs that have not been measured.

It uses the same columns in the same healthy background as a diagnosis. The uncertainty of a size does not depend on the
readings, so it is known before they exist.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.background import Background, FittedTerms, fault_sizes
from analysis.diagnosis.blocks import Block
from analysis.diagnosis.candidates import Candidate, candidates_for
from analysis.diagnosis.columns import LARGEST_FAULT, Columns
from analysis.diagnosis.diagnosis import ODDS
from analysis.diagnosis.linearisation import Linearisation
from analysis.diagnosis.refine import refine
from analysis.diagnosis.selection_state import is_same
from analysis.kinematics.arm import Array
from analysis.model.predict import SetUp
from rigs.effects import Effect
from rigs.schema.effect import healthy, healthy_size, is_play, is_wave, name_of, one_sided, scaled, size_field

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


class ExpectedPosterior:
    """The posterior that blocks of runs will give about their set-ups, at a level of the healthy background, while
    their readings are unknown.

    `candidates` lists the effects of the vocabulary that the runs could show; `least` is the smallest fault, in healthy
    sizes.
    """

    def __init__(self, blocks: Sequence[Block], setups: Mapping[str, SetUp], level: float = 1.0) -> None:
        # Without readings there is no residual, so no band of orders has its own strength.
        self.linear = Linearisation([replace(block, band=np.zeros_like(block.band)) for block in blocks], setups)
        self.candidates = candidates_for(self.linear)
        self.least = float(fault_sizes(level)[0])
        self._columns = Columns(self.linear, self.candidates)
        self._variance = self._columns.variance(level)
        none = np.empty((len(self.linear.y), 0))
        nothing = FittedTerms(np.zeros(len(self.linear.y)), none, np.empty((0, 0)), np.empty(0))
        self._A = self._background_without(()).posterior(nothing).A
        self._number = {form.effects: k for k, form in enumerate(self._columns.forms)}
        self._of_name: dict[str, list[int]] = {}
        for k, form in enumerate(self._columns.forms):
            self._of_name.setdefault(form.name, []).append(k)

    def sd(self, candidate: Candidate, size: float | None = None) -> float:
        """Return the standard uncertainty of a candidate's size, in healthy sizes, averaged over the phases where one
        is free.

        `size` is that of the fault in healthy sizes, which matters for a play, for example; None stands for the
        smallest fault that is detected.
        """
        sd, effect = self._linear_sd(candidate), candidate.effect
        # A shape is fitted with the size and makes it less certain; the order of a wave does not.
        shaped = bool(effect.FREE or effect.STRETCHED) and not is_wave(effect)
        if not shaped or not is_detectable(sd):
            return sd
        return self._fitted_sd(effect, size or float(np.clip(DETECTABLE * sd, self.least, LARGEST_FAULT)))

    def sd_of_name(self, name: str) -> float:
        """Return the standard uncertainty of the size of a name, in healthy sizes, in the form that is
        detected best."""
        forms = [one for one in self.candidates if one.name == name]
        return self.sd(min(forms, key=self._linear_sd)) if forms else float("inf")

    def separation_sigma(self, ones: Sequence[Effect], others: Sequence[Effect]) -> float:
        """Return the sigmas by which a name at its size is separated from another name of any size; each is given as
        one effect, or as two where the phase is free."""
        T = self._at_size([*ones, *others])
        own = self._background_without((ones[0], others[0])).weighed(T)
        H = own.products(own)
        q = len(ones)
        free = H[q:, q:] + np.diag([(size_of(other) / healthy_size(other) / LARGEST_FAULT) ** 2 for other in others])
        stands_in = H[:q, q:] @ np.linalg.solve(free, H[q:, :q])
        if len(H) == 2 and one_sided(ones[0]) and one_sided(others[0]) and H[0, 1] < 0:
            stands_in = np.zeros((1, 1))
        return float(np.sqrt(max(np.trace(H[:q, :q] - stands_in) / q, 0.0)))

    def close_pairs(self, chosen: Sequence[Candidate], sizes: Array) -> list[tuple[int, int]]:
        """Return the pairs (i, j) of candidates that are close while all other forms of either name are present as
        well, with sizes (n,) in healthy sizes. They include all pairs for which `separation_sigma` is below SEPARABLE.
        """
        p, count = len(self._A), len(chosen)
        # A dummy column without information completes forms that have only one.
        A, variance = np.eye(p + 2), np.append(self._variance, [1.0, 1.0])
        A[:p, :p] = self._A
        own = [self._columns.forms[self._number[one.effects]].columns for one in chosen]
        first, second = np.triu_indices(count, 1)
        columns = np.concatenate([[(*one, dummy)[:2] for one in own] for dummy in (p, p + 1)], axis=1).reshape(
            count, 2, 2
        )
        pair = np.concatenate([columns[first, 0], columns[second, 1]], axis=1)
        known = np.linalg.inv(A[pair[:, :, None], pair[:, None, :]])
        known[:, np.arange(4), np.arange(4)] -= 1 / variance[pair]
        width = np.array([len(one) for one in own])
        this, other, across = known[:, :2, :2], known[:, 2:, 2:], known[:, :2, 2:]
        sigma = np.minimum(
            sizes[first] * _left(this, across, other, width[first]),
            sizes[second] * _left(other, across.transpose(0, 2, 1), this, width[second]),
        )
        close = np.flatnonzero(sigma < SEPARABLE)
        places = [(int(first[k]), int(second[k])) for k in close[np.argsort(sigma[close])]]
        return [(i, j) for i, j in places if chosen[i].name != chosen[j].name]

    def _columns_of_name(self, effect: Effect) -> list[int]:
        """Return the indices of the columns that are other forms of the effect's name."""
        forms = self._columns.forms
        own = [k for k in self._of_name.get(name_of(effect), ()) if is_same(forms[k], effect)]
        return [column for k in own for column in forms[k].columns]

    def _cavity(self, columns: Sequence[int], asked: Sequence[int]) -> Array:
        """Return the precision (q, q) that the readings give the columns `asked`, which are among `columns`, beside
        everything except `columns`."""
        here = list(columns)
        inverse = np.asarray(np.linalg.inv(self._A[np.ix_(here, here)]), dtype=float)
        precision: Array = inverse - np.diag(1 / self._variance[here])
        own = [here.index(column) for column in asked]
        return precision[np.ix_(own, own)]

    def _background_without(self, effects: Sequence[Effect]) -> Background:
        """Return the background without all forms of the names of the effects."""
        variance = self._variance.copy()
        for effect in effects:
            variance[self._columns_of_name(effect)] = 0.0
        return Background(self._columns, np.ones(len(self.linear.y)), variance)

    def _linear_sd(self, candidate: Candidate) -> float:
        """Return the standard uncertainty of a candidate's size, in healthy sizes, as if its shape were known."""
        k = self._number.get(candidate.effects)
        if k is None:
            return float("inf")
        known = np.linalg.eigvalsh(
            self._cavity(self._columns_of_name(candidate.effect), self._columns.forms[k].columns)
        )
        return float(np.sqrt(np.mean(1 / np.maximum(known, 1e-12))))

    def _fitted_sd(self, effect: Effect, size: float) -> float:
        """Return the standard uncertainty of a size, in healthy sizes, where a fault is fitted together with its
        shapes."""
        fault = scaled(healthy(effect), size, **{free.field: free.expected for free in effect.FREE})
        found = refine(self.linear.simulated_with((fault,)), self._background_without((fault,)), [fault])
        return found.sd(0)[size_field(effect)] / healthy_size(effect)

    def _at_size(self, effects: Sequence[Effect]) -> Array:
        """Return what effects add to the whitened readings, (N, p), extrapolated from a small size; a play is not
        proportional to its width and stays as it is."""
        small = [one if is_play(one) else scaled(healthy(one), min(1.0, one.STRAIGHT)) for one in effects]
        times = [size_of(one) / size_of(other) for one, other in zip(effects, small, strict=True)]
        whole: Array = self.linear.columns(small) * np.array(times)
        return whole


def _left(own: Array, across: Array, other: Array, width: Array) -> Array:
    """Return the sigmas (n,) of a coefficient, root mean square over its width (n,), that remain beside another
    coefficient of any size, given the precisions (n, 2, 2)."""
    free = other + np.eye(2) / LARGEST_FAULT**2
    left = own - across @ np.linalg.solve(free, across.transpose(0, 2, 1))
    sigma: Array = np.sqrt(np.maximum(np.trace(left, axis1=1, axis2=2) / width, 0.0))
    return sigma


def size_of(effect: Effect) -> float:
    """Return the size of an effect in its own unit."""
    return float(getattr(effect, size_field(effect)))
