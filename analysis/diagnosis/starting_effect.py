"""The effect with which the fit of a form starts on the simulator."""

from __future__ import annotations

from typing import Any

import numpy as np

from analysis.diagnosis.background import Posterior
from analysis.diagnosis.columns import LARGEST_FAULT, Columns, Form
from analysis.diagnosis.linearisation import Linearisation
from analysis.diagnosis.selection_state import combined_effect, order_of
from rigs.effects import Effect

_BETWEEN = np.linspace(-0.6, 0.6, 9)
"""Orders tried about the order of a form, as multiples of the distance to its neighbour. They cover a little more than
half of the distance to either side."""


def starting_effect(linear: Linearisation, columns: Columns, posterior: Posterior, form: Form) -> Effect:
    """Return a form at the size that it would have as a fault; for a wave, of the order between its neighbours that
    explains most of the readings (N,)."""
    effect: Any = form.effects[0]
    if not hasattr(effect, "order"):
        return combined_effect(form.effects, posterior.size(form))
    near = [abs(order_of(one.effects[0]) - effect.order) for one in columns.forms if one.name == form.name]
    tried = effect.order + (sorted(near)[1] if len(near) > 1 else 0.0) * _BETWEEN
    tried = tried[tried >= min(effect.order, max(one.low for one in effect.STRETCHED))]
    effects = [one.model_copy(update={"order": float(order)}) for order in tried for one in form.effects]
    precision, eta = posterior.cavity(linear.columns(effects) / form.size)
    pairs = [slice(2 * i, 2 * i + 2) for i in range(len(tried))]
    sizes = [np.linalg.solve(precision[own, own] + np.eye(2) / LARGEST_FAULT**2, eta[own]) for own in pairs]
    best = int(np.argmax([size @ eta[own] for size, own in zip(sizes, pairs, strict=True)]))
    return combined_effect(effects[pairs[best]], np.asarray(sizes[best], dtype=float))
