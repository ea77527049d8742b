"""The backgrounds of selection states, of which the most recent are kept."""

from __future__ import annotations

from analysis.diagnosis.background import Background
from analysis.diagnosis.columns import Columns
from analysis.diagnosis.selection_state import SelectionState, is_same
from rigs.effects import Effect
from rigs.schema.effect import name_of

_KEPT = 12
"""Number of backgrounds that are cached, at some 8 MB each: about as many as one round of a search returns to."""


class Backgrounds:
    """The backgrounds of states about some columns. States that differ only in the fitted sizes and shapes of the same
    names share one."""

    def __init__(self, columns: Columns) -> None:
        self._columns = columns
        self._recent: dict[tuple[bytes, bytes], Background] = {}

    def of(self, state: SelectionState) -> Background:
        """Return the background of everything that is not fitted as an effect in a state."""
        columns, recent = self._columns, self._recent
        variance = columns.variance(state.level)
        fitted: dict[str, list[Effect]] = {}
        for effect in state.refined.effects:
            fitted.setdefault(name_of(effect), []).append(effect)
        for form in columns.forms:
            if any(is_same(form, effect) for effect in fitted.get(form.name, ())):
                variance[list(form.columns)] = 0.0
        weight = state.robust / state.strength[columns.band]
        key = (weight.tobytes(), variance.tobytes())
        if key in recent:
            recent[key] = recent.pop(key)
        else:
            recent[key] = Background(columns, weight, variance)
            if len(recent) > _KEPT:
                del recent[next(iter(recent))]
        return recent[key]
