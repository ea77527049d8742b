"""What a diagnosis will know of each name from runs that are not driven yet.

It is the diagnosis's own law: the same columns in the same healthy background, of readings that are not there yet. How
sure a size will be does not depend on them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.background import Background, Known, fault_sizes
from analysis.diagnosis.blocks import Block
from analysis.diagnosis.candidates import Candidate, candidates_for
from analysis.diagnosis.columns import LARGEST, Columns
from analysis.diagnosis.diagnosis import ODDS
from analysis.diagnosis.linear import Linear
from analysis.diagnosis.refine import refine
from analysis.diagnosis.state import is_same
from analysis.kinematics.arm import Array
from analysis.model.predict import SetUp
from rigs.effects import Effect
from rigs.schema.effect import healthy, healthy_size, is_play, is_wave, name_of, one_sided, scaled, size_field

DETECTABLE = 7.0
"""Sigmas at which an effect is seen."""
ALIKE = float(np.sqrt(2 * np.log(ODDS)))
"""Sigmas below which the odds between two names stay within those at which a diagnosis dismisses a rival."""


def parts(sigma: float) -> bool:
    """Whether two names so far apart are told apart."""
    return sigma >= ALIKE


def shows(sd: float) -> bool:
    """Whether the largest fault is seen of a name whose size is known to sd healthy sizes."""
    return DETECTABLE * sd <= LARGEST


class Foresight:
    """What blocks of runs will tell about their set-ups, at a level of the healthy background, the readings unknown.

    linear; candidates; least: the smallest fault, in healthy sizes."""

    def __init__(self, blocks: Sequence[Block], setups: Mapping[str, SetUp], level: float = 1.0) -> None:
        # Nothing is left yet, so no band of orders has a strength of its own.
        self.linear = Linear([replace(block, band=np.zeros_like(block.band)) for block in blocks], setups)
        self.candidates = candidates_for(self.linear)
        self.least = float(fault_sizes(level)[0])
        self._columns = Columns(self.linear, self.candidates)
        self._variance = self._columns.variance(level)
        none = np.empty((len(self.linear.y), 0))
        nothing = Known(np.zeros(len(self.linear.y)), none, np.empty((0, 0)), np.empty(0))
        self._A = self._without(()).posterior(nothing).A
        self._number = {form.effects: k for k, form in enumerate(self._columns.forms)}
        self._of_name: dict[str, list[int]] = {}
        for k, form in enumerate(self._columns.forms):
            self._of_name.setdefault(form.name, []).append(k)

    def sd(self, candidate: Candidate, size: float | None = None) -> float:
        """Standard uncertainty of a candidate's size, in healthy sizes; over the phases where one is free.

        size: of the fault, in healthy sizes, for how a play is crossed, say, matters with its width; the smallest that
        shows where None.
        """
        sd, effect = self._straight_sd(candidate), candidate.effect
        # A shape is found with the size, and makes it less sure; a wave's is found beside it.
        shaped = bool(effect.FREE or effect.STRETCHED) and not is_wave(effect)
        if not shaped or not shows(sd):
            return sd
        return self._fitted_sd(effect, size or float(np.clip(DETECTABLE * sd, self.least, LARGEST)))

    def sd_of_name(self, name: str) -> float:
        """Standard uncertainty of the size of a name in the form that shows best, in healthy sizes."""
        forms = [one for one in self.candidates if one.name == name]
        return self.sd(min(forms, key=self._straight_sd)) if forms else float("inf")

    def apart(self, ones: Sequence[Effect], others: Sequence[Effect]) -> float:
        """Sigmas by which a name at its size is parted from another of any size; each one effect, or two where the
        phase is free."""
        T = self._at_size([*ones, *others])
        own = self._without((ones[0], others[0])).weighed(T)
        H = own.products(own)
        q = len(ones)
        free = H[q:, q:] + np.diag([(size_of(other) / healthy_size(other) / LARGEST) ** 2 for other in others])
        stands_in = H[:q, q:] @ np.linalg.solve(free, H[q:, :q])
        if len(H) == 2 and one_sided(ones[0]) and one_sided(others[0]) and H[0, 1] < 0:
            stands_in = np.zeros((1, 1))
        return float(np.sqrt(max(np.trace(H[:q, :q] - stands_in) / q, 0.0)))

    def near(self, chosen: Sequence[Candidate], sizes: Array) -> list[tuple[int, int]]:
        """Pairs (i, j) of candidates that are near while all ways of either name to show are there as well, each of
        sizes (n,) in healthy ones: all that `apart` finds near are among them."""
        p, count = len(self._A), len(chosen)
        # A column that nothing is known of stands in where a form has only one.
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
        close = np.flatnonzero(sigma < ALIKE)
        places = [(int(first[k]), int(second[k])) for k in close[np.argsort(sigma[close])]]
        return [(i, j) for i, j in places if chosen[i].name != chosen[j].name]

    def _alike(self, effect: Effect) -> list[int]:
        """Numbers of the columns that are another way of an effect to show."""
        forms = self._columns.forms
        own = [k for k in self._of_name.get(name_of(effect), ()) if is_same(forms[k], effect)]
        return [column for k in own for column in forms[k].columns]

    def _cavity(self, columns: Sequence[int], asked: Sequence[int]) -> Array:
        """What the readings say of the columns asked (q, q), beside all but `columns`, of which they are."""
        here = list(columns)
        inverse = np.asarray(np.linalg.inv(self._A[np.ix_(here, here)]), dtype=float)
        precision: Array = inverse - np.diag(1 / self._variance[here])
        own = [here.index(column) for column in asked]
        return precision[np.ix_(own, own)]

    def _without(self, effects: Sequence[Effect]) -> Background:
        """The background without what is alike to effects."""
        variance = self._variance.copy()
        for effect in effects:
            variance[self._alike(effect)] = 0.0
        return Background(self._columns, np.ones(len(self.linear.y)), variance)

    def _straight_sd(self, candidate: Candidate) -> float:
        """Standard uncertainty of a candidate's size as if its shape were known, in healthy sizes."""
        k = self._number.get(candidate.effects)
        if k is None:
            return float("inf")
        known = np.linalg.eigvalsh(self._cavity(self._alike(candidate.effect), self._columns.forms[k].columns))
        return float(np.sqrt(np.mean(1 / np.maximum(known, 1e-12))))

    def _fitted_sd(self, effect: Effect, size: float) -> float:
        """Standard uncertainty of a size, in healthy sizes, where a fault is fitted with its shapes."""
        fault = scaled(healthy(effect), size, **{free.field: free.expected for free in effect.FREE})
        found = refine(self.linear.showing((fault,)), self._without((fault,)), [fault])
        return found.sd(0)[size_field(effect)] / healthy_size(effect)

    def _at_size(self, effects: Sequence[Effect]) -> Array:
        """What effects add (N, p), as straight as a small one; a play is not twice itself, and stays."""
        small = [one if is_play(one) else scaled(healthy(one), min(1.0, one.STRAIGHT)) for one in effects]
        times = [size_of(one) / size_of(other) for one, other in zip(effects, small, strict=True)]
        whole: Array = self.linear.columns(small) * np.array(times)
        return whole


def _left(own: Array, across: Array, other: Array, width: Array) -> Array:
    """Sigmas (n,) of a coefficient of one, root mean square over its width (n,), that another of any size leaves; of
    precisions (n, 2, 2)."""
    free = other + np.eye(2) / LARGEST**2
    left = own - across @ np.linalg.solve(free, across.transpose(0, 2, 1))
    sigma: Array = np.sqrt(np.maximum(np.trace(left, axis1=1, axis2=2) / width, 0.0))
    return sigma


def size_of(effect: Effect) -> float:
    """In the unit of its size."""
    return float(getattr(effect, size_field(effect)))
