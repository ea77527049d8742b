"""State of a selection: fitted effects, noise and levels, with their background."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from analysis.diagnosis.evidence.blocks import recent
from analysis.diagnosis.fit.background import Background, CoefficientPosterior, Work
from analysis.diagnosis.fit.candidates import (
    Columns,
    Level,
    order_of,
    remaining_column_shares,
)
from analysis.diagnosis.fit.joint_curves import JointCurves
from analysis.diagnosis.fit.refine import Refined
from analysis.diagnosis.fit.unknown import UnknownCause
from analysis.robot.kinematics.arm import Array
from rigs.calibration import Term, effects_of, is_nothing
from rigs.effects import Effect, healthy_size, size_field
from rigs.schema.effect import PHASE, is_wave, name_of, size_of
from rigs.schema.reference import Reference

# ----------------------------------------------------------------------------------------------------------------------
# The state of a selection: the fitted effects, and the noise and healthy level of everything else.

FAULT = 5.0
"""Size in healthy sizes above which an effect is a fault: faults of real arms are 5 to 100 healthy sizes."""
LEAST_SHARE = 0.1
"""Share of the error above which every part has an action, or a reason for its absence. Chosen."""


def least_fault(effect: Effect, reference: Reference) -> float:
    """Size in healthy sizes above which an effect is a fault.

    Infinite for a link constant compared with a data sheet: constants do not wear, and every arm differs from its data
    sheet.
    """
    is_difference = reference.is_data_sheet and not effect.WEARS
    return math.inf if is_difference else FAULT * effect.usual_times(reference)


def large_effects(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """The effects larger than in healthy arms. The readings change nearly in proportion to small changes of others."""
    return tuple(effect for effect in effects if abs(size_of(effect)) > FAULT)


DRIVEN_WAVES = 2.0
"""Waves that a joint must drive before any of them is called a gear: fewer are a piece of a smooth curve."""
_NEAR_ORDER = 1.15
"""Ratio of orders of a gear below which they count as the same wave. Chosen: a lap does not separate closer orders of a
slow joint.
"""
_SAME_ORDER = 0.5
"""Difference of the orders of a gear below which they are the same wave. Chosen: most orders are integers."""
_MOST_WAVES = 6
"""Largest number of waves of a joint that are gears: a slipping joint was named as 22, other cases have up to three."""


@dataclass(frozen=True)
class SelectionState:
    """Fitted effects with the noise and level of everything else."""

    refined: Refined
    origins: tuple[int, ...]
    """Forms that the effects came from, -1 for none."""
    level: Level
    strength: Array
    """Ratio (b,) of the residual's variance to the noise in each band."""
    robust: Array
    """Weights (N,) of the entries."""
    refused: frozenset[int] = frozenset()
    """Forms that did not cover their penalty."""
    level_cap: float = 1.0
    """Upper limit of the level."""
    curves: JointCurves | None = None
    """None unless all readings are poses."""
    unknown: tuple[UnknownCause, ...] = ()
    replaced: frozenset[str] = frozenset()
    """Kinds of unknown causes that a named effect replaced."""

    @property
    def effects(self) -> tuple[Effect, ...]:
        return self.refined.effects

    def may_be_fault(self, place: int) -> bool:
        return bool(self.possible_faults([self.refined.effects[place]]))

    def is_large(self, place: int) -> bool:
        return bool(large_effects([self.refined.effects[place]]))

    def possible_faults(self, effects: Sequence[Effect]) -> tuple[Effect, ...]:
        """The effects larger than in healthy arms, or, if this arm is better than those, than usual in this arm."""
        return tuple(effect for effect in effects if abs(size_of(effect)) > FAULT * min(self.level.of(effect), 1.0))


def combined_effect(effects: Sequence[Effect], size: Array) -> Effect:
    """The effect that the columns of `effects` form with coefficients size (q,) in healthy sizes."""
    effect = effects[0]
    field_name, healthy = size_field(effect), healthy_size(effect)
    if len(size) == 2:
        phase = float(np.degrees(np.arctan2(size[1], size[0])))
        return effect.model_copy(update={field_name: float(np.hypot(*size)) * healthy, PHASE: phase})
    return effect.model_copy(update={field_name: float(size[0]) * healthy})


def is_alike(effect: Effect, other_effect: Effect) -> bool:
    """Whether two effects have the same name and, for waves, nearly the same order."""
    if name_of(effect) != name_of(other_effect):
        return False
    order, order_there = order_of(effect), order_of(other_effect)
    return np.isnan(order) or np.isnan(order_there) or max(order, order_there) / min(order, order_there) < _NEAR_ORDER


def is_one(effect: Effect, other_effect: Effect) -> bool:
    """Whether two effects are the same: equal name and, for waves, equal order."""
    apart = abs(order_of(effect) - order_of(other_effect))
    return name_of(effect) == name_of(other_effect) and not apart >= _SAME_ORDER


def is_duplicate(effects: Sequence[Effect]) -> bool:
    """Whether the last of several effects is a wave that is already present."""
    *others, last = effects
    return any(is_one(effect, last) for effect in others if np.isfinite(order_of(effect)))


def spurious_wave_series(effects: Sequence[Effect]) -> frozenset[str]:
    """Names with too many waves for a gear: the series of an error of a different form."""
    waves = Counter(name_of(effect) for effect in effects if is_wave(effect) and effect.STAGE == "joint")
    return frozenset(name for name, count in waves.items() if count > _MOST_WAVES)


_SHOULDER = 2
"""The first axis perpendicular to gravity, which carries nearly the same moment as the base."""


def _is_soft_shoulder(effect: Effect) -> bool:
    return effect.part == "gravity" and effect.STAGE == "joint" and getattr(effect, "axis", 0) == _SHOULDER


def has_compliant_base_only(effects: Sequence[Effect]) -> bool:
    yields = any(e.part == "gravity" and e.STAGE == "tool" and not hasattr(e, "axis") for e in effects)
    return yields and not any(map(_is_soft_shoulder, effects))


# ----------------------------------------------------------------------------------------------------------------------
# The backgrounds of selection states, with a cache of the most recent.

_KEPT = 4
"""Number of cached backgrounds, at some 20 MB each: three times as many saved a twentieth of the factors."""
_GRAMS = 2
"""Number of cached weighted products of the columns, at some 8 MB each: a round tries two strengths."""


@dataclass(frozen=True)
class Backgrounds:
    """Backgrounds of states about given columns, for an arm compared with a reference.

    States that differ only in sizes and shapes of the same effects share a background.
    """

    columns: Columns
    reference: Reference
    work: Work = field(default_factory=Work, repr=False)
    _recent: dict[tuple[bytes, bytes], Background] = field(default_factory=dict, init=False, repr=False)
    _grams: dict[bytes, Array] = field(default_factory=dict, init=False, repr=False)
    _shares: dict[tuple[str, str], Array] = field(default_factory=dict, init=False, repr=False)

    def prior(self, state: SelectionState) -> tuple[Array, Array]:
        """Prior variances and means (p,) of all coefficients in a state."""
        columns = self.columns
        variance, mean = columns.variance(state.level, state.curves), columns.mean(state.level)
        if has_compliant_base_only(state.effects):
            variance, mean = self._usual_load**2 * variance, self._usual_load * mean
        for effect in state.effects:
            name = (name_of(effect), str(order_of(effect)))
            if name not in self._shares:
                self._shares[name] = remaining_column_shares(columns.forms, effect, len(columns.healthy))
            variance, mean = self._shares[name] * variance, self._shares[name] * mean
        return variance, mean

    def of(self, state: SelectionState) -> Background:
        columns, (variance, mean) = self.columns, self.prior(state)
        weight = state.robust / state.strength[columns.band]
        seen = weight.tobytes()
        weighted_gram = partial(recent, self._grams, seen, partial(columns.weighted_gram, weight), _GRAMS)
        key = (seen, variance.tobytes())  # the means follow from the level and the names, as the variances do
        return recent(
            self._recent, key, lambda: Background(columns, weight, variance, mean, weighted_gram, self.work), _KEPT
        )

    @cached_property
    def _usual_load(self) -> Array:
        """Ratio (p,) of the usual to the healthy size for columns of the shoulder's compliance; 1 for all others.

        A compliant foundation rotates the arm like a compliant axis 2, about a lower point. Next to it, axis 2 is
        permitted the usual compliance of the build; otherwise the base took its compliance, at three times the true
        value.
        """
        usual = np.ones(len(self.columns.healthy))
        for form in self.columns.forms:
            if _is_soft_shoulder(form.effect):
                usual[list(form.columns)] = form.effect.usual_times(self.reference)
        return usual


# ----------------------------------------------------------------------------------------------------------------------
# Mean of the background, as terms and as effects of the arm.
#
# Every form of the background is the effect at the size used for the column, with the multiple shown by the readings.
# Single forms are rarely certain, but their sum is: it reaches a tenth of a millimetre if named effects reach half a
# millimetre.


def background_terms(posterior: CoefficientPosterior) -> list[Term]:
    """Each form of the background with its mean multiple."""
    mean, terms = posterior.mean, []
    for form in posterior.background.columns.forms:
        for effect, column in zip(form.effects, form.columns, strict=True):
            times = float(mean[column] / form.size)
            # Parts excluded from a model are not written either, so that every reader of the file has the same model.
            times = 0.0 if is_nothing(effect, times) else times
            terms.append(Term.model_construct(effect=effect, times=times, named=False))
    return terms


def background_effects(posterior: CoefficientPosterior) -> tuple[Effect, ...]:
    return tuple(effects_of([(term.effect, term.times) for term in background_terms(posterior)]))


def beginnings(state: SelectionState) -> list[SelectionState]:
    """A state and, if different, the same state with the strengths of the noise.

    Strengths estimated before a large effect was found do not determine the shape, and a wrong shape keeps them large;
    the residual then supports wrong names.
    """
    return [state, replace(state, strength=np.ones_like(state.strength))] if (state.strength != 1).any() else [state]
