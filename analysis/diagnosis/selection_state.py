"""The state of a selection: the fitted effects, and the noise and healthy level of everything else."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.columns import Form, order_of
from analysis.diagnosis.free_forms import FittedFreeForm
from analysis.diagnosis.joint_curves import JointCurves
from analysis.diagnosis.refine import Refined
from analysis.kinematics.arm import Array
from rigs.effects import Effect, healthy_size, size_field
from rigs.schema.effect import PHASE, is_wave, name_of, size_of

FAULT = 5.0
"""Size in healthy sizes above which an effect is a fault: faults of real arms are 5 to 100 healthy sizes. The limit is
lower in an arm with a level below 1."""
DRIVEN_WAVES = 2.0
"""Waves that a joint must drive before one of them is called a gear: fewer are a piece of a smooth curve."""
_NEAR_ORDER = 1.15
"""Ratio of orders of one gear below which they count as one wave. Chosen: a lap does not separate closer orders of a
slow joint."""
_SAME_ORDER = 0.5
"""Difference of the orders of one gear below which they are one wave. Chosen: most orders are whole, as numbers of
teeth are."""
_MOST_WAVES = 6
"""Largest number of waves of one joint that are its gears. A sum of waves describes any error that goes with the angle
of a joint: one that slips was named as 22. Of 240 other generated cases none had more than three of a joint."""


@dataclass(frozen=True)
class SelectionState:
    """One state.

    `refined` has the fitted effects and `origins` the indices of the forms from which they come, -1 for none. `level`
    is that of the background and `most` its upper limit. `strength` (b,) is the variance of the residual in each band
    over that of the noise and `robust` (N,) the weights of the entries. `refused` has the indices of forms that did not
    cover their price, `free_forms` the free forms in use and `replaced_forms` the descriptions of those that a name
    replaced. `curves` is how large the curves of joints are, where poses alone show them, and None elsewhere.
    """

    refined: Refined
    origins: tuple[int, ...]
    level: float
    strength: Array
    robust: Array
    refused: frozenset[int] = frozenset()
    most: float = 1.0
    curves: JointCurves | None = None
    free_forms: tuple[FittedFreeForm, ...] = ()
    replaced_forms: frozenset[str] = frozenset()

    def is_fault(self, place: int) -> bool:
        """Whether an effect is larger than healthy arms, and arms of this level, show."""
        return bool(self.faults_among([self.refined.effects[place]]))

    def faults_among(self, effects: Sequence[Effect]) -> tuple[Effect, ...]:
        """Return the effects that are larger than healthy arms, and arms of this level, show."""
        return tuple(one for one in effects if abs(size_of(one)) > FAULT * min(self.level, 1.0))


def combined_effect(effects: Sequence[Effect], size: Array) -> Effect:
    """Return the effect that the columns of `effects` form with coefficients size (q,) in healthy sizes."""
    effect = effects[0]
    field_name, healthy = size_field(effect), healthy_size(effect)
    if len(size) == 2:
        phase = float(np.degrees(np.arctan2(size[1], size[0])))
        return effect.model_copy(update={field_name: float(np.hypot(*size)) * healthy, PHASE: phase})
    return effect.model_copy(update={field_name: float(size[0]) * healthy})


def is_same(form: Form, effect: Effect) -> bool:
    """Return whether a form is another form of the effect's name; waves of other orders are not."""
    return is_alike(form.effects[0], effect)


def is_alike(one: Effect, effect: Effect) -> bool:
    """Return whether two effects have the same name, with any size and shape; waves of other orders do not."""
    if name_of(one) != name_of(effect):
        return False
    order, other = order_of(one), order_of(effect)
    return np.isnan(order) or np.isnan(other) or max(order, other) / min(order, other) < _NEAR_ORDER


def is_one(one: Effect, other: Effect) -> bool:
    """Return whether two effects, of any size and shape, are one: of the same name and, for waves, the same order."""
    apart = abs(order_of(one) - order_of(other))
    return name_of(one) == name_of(other) and not apart >= _SAME_ORDER


def is_twice(effects: Sequence[Effect]) -> bool:
    """Return whether the last of some effects is the wave of one before it: of the same name and order."""
    *others, last = effects
    return any(is_one(one, last) for one in others if np.isfinite(order_of(one)))


def series_among(effects: Sequence[Effect]) -> frozenset[str]:
    """Return the names of which some effects have so many waves that these are no gears, but the series of an error of
    another form."""
    waves = Counter(name_of(one) for one in effects if is_wave(one) and one.STAGE == "joint")
    return frozenset(name for name, count in waves.items() if count > _MOST_WAVES)
