"""The expected posterior: what a diagnosis will know about each name from runs that have not been measured.

It uses the same columns in the same healthy background as a diagnosis. The uncertainty of a size does not depend on the
readings, so it is known before they exist.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from analysis.diagnosis.background import Background, background_of
from analysis.diagnosis.blocks import Block
from analysis.diagnosis.candidates import Candidate, candidates_for
from analysis.diagnosis.columns import LARGEST_FAULT, Columns, columns_for, fault_sizes
from analysis.diagnosis.form_information import without_bands
from analysis.diagnosis.form_posterior import DETECTABLE, SEPARABLE, FormPosterior, is_detectable
from analysis.diagnosis.linearisation import Linearisation, linearise
from analysis.diagnosis.refine import refine
from analysis.kinematics.arm import Array
from analysis.model.predict import SetUp
from rigs.effects import Effect
from rigs.schema.effect import healthy, healthy_size, is_play, is_wave, one_sided, scaled, size_field, size_of


@dataclass(frozen=True)
class ExpectedPosterior:
    """The posterior that runs of a linearisation will give about their set-ups, at a level of the healthy background,
    while their readings are unknown."""

    linear: Linearisation
    level: float = 1.0

    @cached_property
    def candidates(self) -> tuple[Candidate, ...]:
        """The effects of the vocabulary that the runs could show."""
        return tuple(candidates_for(self.linear))

    @cached_property
    def least(self) -> float:
        """The smallest fault, in healthy sizes."""
        return float(fault_sizes(self.level)[0])

    @cached_property
    def _columns(self) -> Columns:
        return columns_for(self.linear, self.candidates)

    @cached_property
    def _variance(self) -> Array:
        return self._columns.variance(self.level)

    @cached_property
    def _known(self) -> FormPosterior:
        A = background_of(self._columns, np.ones(len(self.linear.y)), self._variance).covariance
        return FormPosterior(self._columns.forms, A, self._variance)

    def sd(self, candidate: Candidate, size: float | None = None) -> float:
        """Return the standard uncertainty of a candidate's size, in healthy sizes, averaged over the phases where one
        is free.

        `size` is that of the fault in healthy sizes, which matters for a play, for example; None stands for the
        smallest fault that is detected.
        """
        sd, effect = self._known.sd(candidate), candidate.effect
        # A shape is fitted with the size and makes it less certain; the order of a wave does not.
        shaped = bool(effect.FREE or effect.STRETCHED) and not is_wave(effect)
        if not shaped or not is_detectable(sd):
            return sd
        return self._fitted_sd(effect, size or float(np.clip(DETECTABLE * sd, self.least, LARGEST_FAULT)))

    def sd_of_name(self, name: str) -> float:
        """Return the standard uncertainty of the size of a name, in healthy sizes, in the form that is
        detected best."""
        forms = [one for one in self.candidates if one.name == name]
        return self.sd(min(forms, key=self._known.sd)) if forms else float("inf")

    def separation_sigma(self, ones: Sequence[Effect], others: Sequence[Effect]) -> float:
        """Return the sigmas by which a name at its size is separated from another name of any size; each is given as
        one effect, or as two where the phase is free."""
        T = self._at_size([*ones, *others])
        own = self._background_beside((ones[0], others[0])).weighed(T)
        H = own.products(own)
        q = len(ones)
        free = H[q:, q:] + np.diag([(size_of(other) / LARGEST_FAULT) ** 2 for other in others])
        stands_in = H[:q, q:] @ np.linalg.solve(free, H[q:, :q])
        if len(H) == 2 and one_sided(ones[0]) and one_sided(others[0]) and H[0, 1] < 0:
            stands_in = np.zeros((1, 1))
        return float(np.sqrt(max(np.trace(H[:q, :q] - stands_in) / q, 0.0)))

    def close_pairs(self, chosen: Sequence[Candidate], sizes: Array) -> list[tuple[int, int]]:
        """Return the pairs (i, j) of candidates that are close while all other forms of either name are present as
        well, with sizes (n,) in healthy sizes. They include all pairs for which `separation_sigma` is below SEPARABLE.
        """
        pairs = np.stack(np.triu_indices(len(chosen), 1), axis=1).astype(np.int64)
        sigma = self._known.sigmas_apart(chosen, sizes, pairs)
        close = np.flatnonzero(sigma < SEPARABLE)
        nearest_first = pairs[close[np.argsort(sigma[close])]].tolist()
        return [(i, j) for i, j in nearest_first if chosen[i].name != chosen[j].name]

    def _background_beside(self, effects: Sequence[Effect]) -> Background:
        """Return the background beside named effects."""
        return background_of(self._columns, np.ones(len(self.linear.y)), self._known.variance_beside(effects))

    def _fitted_sd(self, effect: Effect, size: float) -> float:
        """Return the standard uncertainty of a size, in healthy sizes, where a fault is fitted together with its
        shapes."""
        fault = scaled(healthy(effect), size, **{free.field: free.expected for free in effect.FREE})
        found = refine(self.linear.simulated_with((fault,)), self._background_beside((fault,)), [fault])
        return found.sd(0)[size_field(effect)] / healthy_size(effect)

    def _at_size(self, effects: Sequence[Effect]) -> Array:
        """Return what effects add to the whitened readings, (N, p), extrapolated from a small size; a play is not
        proportional to its width and stays as it is."""
        small = [one if is_play(one) else scaled(healthy(one), min(1.0, one.STRAIGHT)) for one in effects]
        times = [size_of(one) / size_of(other) for one, other in zip(effects, small, strict=True)]
        whole: Array = self.linear.columns(small) * np.array(times)
        return whole


def expected_posterior(blocks: Sequence[Block], setups: Mapping[str, SetUp], level: float = 1.0) -> ExpectedPosterior:
    """Return the posterior that blocks of runs, with N entries each, will give."""
    return ExpectedPosterior(linearise(without_bands(blocks), setups), level)
