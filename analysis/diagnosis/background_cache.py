"""The backgrounds of selection states, of which the most recent are kept."""

from __future__ import annotations

from dataclasses import dataclass, field

from analysis.diagnosis.background import Background
from analysis.diagnosis.columns import Columns, Form
from analysis.diagnosis.recent import recent
from analysis.diagnosis.selection_state import SelectionState, is_same, order_of
from analysis.kinematics.arm import Array
from rigs.effects import Effect
from rigs.schema.effect import name_of

_KEPT = 12
"""Number of backgrounds that are cached, at some 8 MB each: about as many as one round of a search returns to."""
_SAME_ORDER = 0.5
"""Largest difference of the orders of one wave. Chosen: numbers of teeth are whole, so most orders are whole too."""
_GRAMS = 4
"""Number of weighted products of the columns that are cached, at some 8 MB each: one round tries two strengths."""


@dataclass(frozen=True)
class Backgrounds:
    """The backgrounds of states about some columns. States that differ only in the fitted sizes and shapes of the same
    names share one; those that differ only in names and level share the weighted products of the columns."""

    columns: Columns
    _recent: dict[tuple[bytes, bytes], Background] = field(default_factory=dict, init=False, repr=False)
    _grams: dict[bytes, Array] = field(default_factory=dict, init=False, repr=False)
    _alike: dict[tuple[str, str], list[int]] = field(default_factory=dict, init=False, repr=False)

    def of(self, state: SelectionState) -> Background:
        """Return the background of everything that is not fitted as an effect in a state."""
        columns = self.columns
        variance, mean = columns.variance(state.level), columns.mean(state.level)
        for effect in state.refined.effects:
            alike = self._columns_alike(effect)
            variance[alike] = mean[alike] = 0.0
        weight = state.robust / state.strength[columns.band]
        seen = weight.tobytes()
        gram = recent(self._grams, seen, lambda: columns.weighted_gram(weight), _GRAMS)
        key = (seen, variance.tobytes())  # the means follow from the level and the names, as the variances do
        return recent(self._recent, key, lambda: Background(columns, weight, variance, mean, gram), _KEPT)

    def _columns_alike(self, effect: Effect) -> list[int]:
        """Return the columns of all forms of an effect's name, of a wave those of its order.

        A healthy gear may have another wave beside it, which a joint that turns little hardly separates: without it,
        the size of a wave of order 16 was 5 % too large beside one of order 20, 4 times its uncertainty.
        """
        key = (name_of(effect), str(order_of(effect)))
        if key not in self._alike:
            forms = [form for form in self.columns.forms if is_same(form, effect) and not _is_apart(form, effect)]
            self._alike[key] = [column for form in forms for column in form.columns]
        return self._alike[key]


def _is_apart(form: Form, effect: Effect) -> bool:
    """Return whether a form is a wave of another order than an effect."""
    return abs(order_of(form.effects[0]) - order_of(effect)) > _SAME_ORDER
