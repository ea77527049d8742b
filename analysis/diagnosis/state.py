"""What a search takes to be there: effects, fitted, and how noisy and how healthy everything beside them is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.columns import Form
from analysis.diagnosis.freeforms import Stranger
from analysis.diagnosis.refine import Refined
from analysis.kinematics.arm import Array
from rigs.effects import Effect, healthy_size, size_field
from rigs.schema.effect import PHASE, name_of

FAULT = 5.0
"""Healthy sizes from which on an effect is a fault (real-cells.md); fewer in an arm that shows less of everything."""
_NEAR_ORDER = 1.15
"""Orders of one gear nearer than this are one wave."""


@dataclass(frozen=True)
class State:
    """What is taken to be there.

    refined: effects, fitted; origins: numbers of the forms that they come from, -1 where from none; level of the
    background, and the most that it may be; strength (b,) of what is left in each band, over noise; robust (N,):
    weights of readings; refused: numbers of forms that did not pay; strangers: what has no name; freed: words of those
    whose place a name took.
    """

    refined: Refined
    origins: tuple[int, ...]
    level: float
    strength: Array
    robust: Array
    refused: frozenset[int] = frozenset()
    most: float = 1.0
    strangers: tuple[Stranger, ...] = ()
    freed: frozenset[str] = frozenset()

    def is_fault(self, place: int) -> bool:
        """Whether an effect is larger than healthy arms, and arms like this one, show of it."""
        return abs(size_of(self.refined.effects[place])) > FAULT * min(self.level, 1.0)


def size_of(effect: Effect) -> float:
    """The size of an effect in healthy ones."""
    return float(getattr(effect, size_field(effect))) / healthy_size(effect)


def started(effects: Sequence[Effect], size: Array) -> Effect:
    """The effect that columns of effects make with coefficients size (q,), in healthy sizes."""
    effect = effects[0]
    field_name, healthy = size_field(effect), healthy_size(effect)
    if len(size) == 2:
        phase = float(np.degrees(np.arctan2(size[1], size[0])))
        return effect.model_copy(update={field_name: float(np.hypot(*size)) * healthy, PHASE: phase})
    return effect.model_copy(update={field_name: float(size[0]) * healthy})


def is_same(form: Form, effect: Effect) -> bool:
    """Whether a form is another way of the same name to show; waves of other orders are not."""
    return is_alike(form.effects[0], effect)


def is_alike(one: Effect, effect: Effect) -> bool:
    """Whether two effects are the same name in other sizes and shapes; waves of other orders are not."""
    if name_of(one) != name_of(effect):
        return False
    order, other = order_of(one), order_of(effect)
    return np.isnan(order) or np.isnan(other) or max(order, other) / min(order, other) < _NEAR_ORDER


def order_of(effect: Effect) -> float:
    """Of a gear's wave; not a number for all else."""
    return float(getattr(effect, "order", np.nan))
