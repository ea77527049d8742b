"""The information that runs hold about the forms of all names: one matrix for each set of runs, and they add up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from analysis.diagnosis.blocks import Block
from analysis.diagnosis.candidates import Candidate
from analysis.diagnosis.columns import Form, columns_for, forms_of, healthy_shares, in_each_shape
from analysis.diagnosis.form_posterior import FormPosterior
from analysis.diagnosis.linearisation import linearise
from analysis.kinematics.arm import Array
from analysis.model.predict import SetUp
from rigs.effects import Effect


def without_bands(blocks: Sequence[Block]) -> list[Block]:
    """Return blocks with all entries in one band: without readings there is no residual, so no band of orders has its
    own strength."""
    return [replace(block, band=np.zeros_like(block.band)) for block in blocks]


@dataclass(frozen=True)
class FormInformation:
    """The forms of `candidates`, p columns in all, and what runs say about them."""

    candidates: tuple[Candidate, ...]

    @cached_property
    def forms(self) -> tuple[Form, ...]:
        """Every form of the candidates."""
        return forms_of(in_each_shape(self.candidates))

    @cached_property
    def _variance(self) -> Array:
        return healthy_shares(self.forms)

    @cached_property
    def _place(self) -> dict[tuple[Effect, ...], tuple[int, ...]]:
        """The columns of each form."""
        return {form.effects: form.columns for form in self.forms}

    def of(self, blocks: Sequence[Block], setups: Mapping[str, SetUp]) -> Array:
        """Return the information (p, p) that runs hold about the coefficients in healthy sizes, with their set-ups and
        scatter eliminated. Forms that they do not show have none."""
        columns = columns_for(linearise(without_bands(blocks), setups), self.candidates)
        other = columns.fixed > 0
        own, rest = np.flatnonzero(~other), np.flatnonzero(other)
        across = columns.gram[np.ix_(own, rest)]
        known = columns.gram[np.ix_(rest, rest)] + np.diag(1 / columns.fixed[rest])
        place = [k for form in columns.forms for k in self._place[form.effects]]
        whole = np.zeros((len(self._variance), len(self._variance)))
        whole[np.ix_(place, place)] = columns.gram[np.ix_(own, own)] - across @ np.linalg.solve(known, across.T)
        return whole

    def posterior(self, information: Array) -> FormPosterior:
        """Return what is known of all forms, in healthy sizes, from runs with an information (p, p)."""
        A = np.asarray(np.linalg.inv(information + np.diag(1 / self._variance)), dtype=float)
        return FormPosterior(self.forms, A, self._variance)
