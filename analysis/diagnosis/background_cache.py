"""The backgrounds of selection states, of which the most recent are kept."""

from __future__ import annotations

from dataclasses import dataclass, field

from analysis.diagnosis.background import Background
from analysis.diagnosis.columns import Columns, column_shares_beside, order_of
from analysis.diagnosis.recent import recent
from analysis.diagnosis.selection_state import SelectionState
from analysis.kinematics.arm import Array
from rigs.effects import Effect
from rigs.schema.effect import name_of

_KEPT = 12
"""Number of backgrounds that are cached, at some 20 MB each with what they have weighed (1000 columns and 150 terms of
4600 entries): about as many as one round of a search returns to."""
_GRAMS = 4
"""Number of weighted products of the columns that are cached, at some 8 MB each: one round tries two strengths."""


@dataclass(frozen=True)
class Backgrounds:
    """The backgrounds of states about some columns. States that differ only in the fitted sizes and shapes of the same
    names share one; those that differ only in names and level share the weighted products of the columns."""

    columns: Columns
    _recent: dict[tuple[bytes, bytes], Background] = field(default_factory=dict, init=False, repr=False)
    _grams: dict[bytes, Array] = field(default_factory=dict, init=False, repr=False)
    _shares: dict[tuple[str, str], Array] = field(default_factory=dict, init=False, repr=False)

    def of(self, state: SelectionState) -> Background:
        """Return the background of everything that is not fitted as an effect in a state."""
        columns = self.columns
        variance, mean = columns.variance(state.level, state.curves), columns.mean(state.level)
        for effect in state.refined.effects:
            share = self._shares_beside(effect)
            variance, mean = share * variance, share * mean
        weight = state.robust / state.strength[columns.band]
        seen = weight.tobytes()
        gram = recent(self._grams, seen, lambda: columns.weighted_gram(weight), _GRAMS)
        key = (seen, variance.tobytes())  # the means follow from the level and the names, as the variances do
        return recent(self._recent, key, lambda: Background(columns, weight, variance, mean, gram), _KEPT)

    def _shares_beside(self, effect: Effect) -> Array:
        """Return the share of its healthy variance that each column (p,) keeps beside a named effect."""
        key = (name_of(effect), str(order_of(effect)))
        if key not in self._shares:
            self._shares[key] = column_shares_beside(self.columns.forms, effect, len(self.columns.healthy))
        return self._shares[key]
